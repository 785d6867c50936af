//! Points of a dense cloud in files, so that those of one cube of the octree are in memory together, but not all points.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use nalgebra::Point3;

use super::ProjectError;
use crate::map::cloud::{SeenPoint, color_from_bytes, color_to_bytes, halves, top_cube};

/// Number of files. Points of 64 times the memory of a task can be planned.
const FILES: u64 = 64;

/// Files without names.
pub(super) struct Spill {
    files: Vec<BufWriter<File>>,
    top: i32,
}

impl Spill {
    /// No points yet; the files are on the disk of a folder.
    pub(super) fn new(folder: &Path, top: i32) -> std::io::Result<Self> {
        let file = |_| Ok(BufWriter::new(tempfile::tempfile_in(folder)?));
        Ok(Self {
            files: (0..FILES).map(file).collect::<std::io::Result<_>>()?,
            top,
        })
    }

    pub(super) fn add(&mut self, point: &SeenPoint) -> std::io::Result<()> {
        let mut bytes = Vec::with_capacity(48 + 4 * point.views.len());
        for value in point.position.iter() {
            bytes.extend(value.to_le_bytes());
        }
        for value in [point.sigma, point.pixel] {
            bytes.extend(value.unwrap_or(f64::NAN).to_le_bytes());
        }
        bytes.extend((point.views.len() as u32).to_le_bytes());
        bytes.extend(color_to_bytes(point.color));
        point
            .views
            .iter()
            .for_each(|view| bytes.extend(view.to_le_bytes()));
        let cube = top_cube(&point.position, self.top);
        let mixed = cube.iter().fold(0u64, |hash, x| {
            (hash ^ *x as u64)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(29)
        });
        self.files[(mixed % FILES) as usize].write_all(&bytes)
    }

    /// Calls `take` with the points of each file.
    ///
    /// # Errors
    /// When a file cannot be read; and what `take` returns.
    pub(super) fn visit(
        self,
        folder: &Path,
        mut take: impl FnMut(Vec<SeenPoint>) -> Result<(), ProjectError>,
    ) -> Result<(), ProjectError> {
        for file in self.files {
            let points = points_of(file).map_err(ProjectError::temporary(folder))?;
            take(points)?;
        }
        Ok(())
    }
}

fn points_of(file: BufWriter<File>) -> std::io::Result<Vec<SeenPoint>> {
    let mut file = file
        .into_inner()
        .map_err(std::io::IntoInnerError::into_error)?;
    let end = file.stream_position()?;
    file.rewind()?;
    let mut reader = BufReader::with_capacity(1 << 20, file);
    let mut points = Vec::new();
    let mut at = 0;
    while at < end {
        let mut head = [[0; 8]; 6];
        for value in &mut head {
            reader.read_exact(value)?;
        }
        let [x, y, z, sigma, pixel, _] = head.map(f64::from_le_bytes);
        let [count, color] = halves(head[5]);
        let count = u64::from(u32::from_le_bytes(count));
        let mut views = Vec::with_capacity(count as usize);
        for _ in 0..count {
            let mut view = [0; 4];
            reader.read_exact(&mut view)?;
            views.push(u32::from_le_bytes(view));
        }
        at += 48 + 4 * count;
        points.push(SeenPoint {
            position: Point3::new(x, y, z),
            color: color_from_bytes(color),
            views,
            sigma: (!sigma.is_nan()).then_some(sigma),
            pixel: (!pixel.is_nan()).then_some(pixel),
        });
    }
    Ok(points)
}
