//! The dense cloud of COLMAP read point by point, for clouds larger than memory.

use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use linecarve_mesh::files::open_regular;
use nalgebra::Point3;

use super::super::super::SequenceError;
use super::super::super::layout::Folder;
use super::{FoundModel, find_model, fused, read_images_only};
use crate::sparse_model::{ModelObservation, ModelPoint, ModelView};

/// `fused.ply` with `fused.ply.vis`, of which only the views of the model are in memory.
///
/// Views and points are those of [`Sequence::sparse_model`](crate::Sequence::sparse_model) of the same file.
#[derive(Debug)]
pub struct DenseCloud {
    cloud: PathBuf,
    visibility: PathBuf,
    views: Vec<ModelView>,
    /// View of each image, in the order of their ids.
    view_of_image: Vec<u32>,
    rows: Rows,
}

/// The vertices of a binary, little-endian PLY file.
#[derive(Debug, Clone, Copy)]
struct Rows {
    start: u64,
    count: u64,
    bytes: usize,
    /// Where in a row each coordinate is, and whether it has 8 bytes.
    coordinates: [(usize, bool); 3],
    /// Where in a row red, green and blue are; each has one byte.
    colors: Option<[usize; 3]>,
}

impl DenseCloud {
    /// Opens the cloud that a path names. `None` when the path names something else, or a PLY file that has to be read as a whole:
    /// text, big-endian, lists in vertices, other elements before these.
    ///
    /// # Errors
    /// When the model beside the cloud cannot be read.
    pub fn open(input: &Path) -> Result<Option<Self>, SequenceError> {
        let name = input.file_name().and_then(|name| name.to_str());
        let Some(name) = name.filter(|name| fused::is_cloud(name) && input.is_file()) else {
            return Ok(None);
        };
        let folder = Folder::of_file(input, name)?;
        let (Some(cloud), Some(FoundModel { path, format, .. })) =
            (fused::named_cloud(&folder), find_model(&folder))
        else {
            return Ok(None);
        };
        let Some(rows) = Rows::read(&cloud).map_err(io(&cloud))? else {
            return Ok(None);
        };
        let (mut model, view_of_image) = read_images_only(&path, format)?;
        let new_index = model.sort_images();
        Ok(Some(Self {
            visibility: fused::visibility(&cloud),
            cloud,
            views: model.views(),
            view_of_image: (view_of_image.iter())
                .filter_map(|&view| new_index.get(view as usize).copied())
                .collect(),
            rows,
        }))
    }

    /// The number of points, those that are not finite included.
    pub fn point_count(&self) -> u64 {
        self.rows.count
    }

    /// The file of the points.
    pub fn path(&self) -> &Path {
        &self.cloud
    }

    /// The views of the model.
    pub fn views(&self) -> &[ModelView] {
        &self.views
    }

    /// Passes the finite points to `take`.
    ///
    /// # Errors
    /// When a file cannot be read, both differ in their number of points, or one names an unknown image; and what `take` returns.
    pub fn visit<E: From<SequenceError>>(
        &self,
        mut take: impl FnMut(ModelPoint) -> Result<(), E>,
    ) -> Result<(), E> {
        let (mut rows, mut seen, mut at) = self.open_files()?;
        let mut row = vec![0; self.rows.bytes];
        for _ in 0..self.rows.count {
            rows.read_exact(&mut row).map_err(io(&self.cloud))?;
            let point_in_world = Point3::from(self.rows.position(&row));
            let count = self.u32(&mut seen, &mut at)?;
            let mut observations = Vec::with_capacity(count.min(1 << 10) as usize);
            for _ in 0..count {
                let image = self.u32(&mut seen, &mut at)?;
                let Some(&view) = self.view_of_image.get(image as usize) else {
                    let views = self.view_of_image.len();
                    let problem = format!(
                        "names image {image}, and the model has {views}: give the model that was fused"
                    );
                    return Err(self.visibility_error(at, problem).into());
                };
                observations.push(ModelObservation { view, pixel: None });
            }
            observations.sort_unstable_by_key(|observation| observation.view);
            observations.dedup_by_key(|observation| observation.view);
            if point_in_world.iter().all(|x| x.is_finite()) {
                take(ModelPoint {
                    point_in_world,
                    color: self.rows.colors.map(|at| at.map(|at| row[at])),
                    observations,
                })?;
            }
        }
        Ok(())
    }

    /// Both files at their first point.
    fn open_files(&self) -> Result<(impl Read, impl Read, u64), SequenceError> {
        let open = |path: &Path| open_regular(path).map_err(io(path));
        let mut rows = open(&self.cloud)?;
        let error = io(&self.cloud);
        (rows.seek(SeekFrom::Start(self.rows.start))).map_err(error)?;
        let seen = open(&self.visibility)?;
        let mut seen = BufReader::with_capacity(1 << 20, seen);
        let mut count = [0; 8];
        seen.read_exact(&mut count).map_err(io(&self.visibility))?;
        let count = u64::from_le_bytes(count);
        if count != self.rows.count {
            let problem = format!(
                "has {} points, {} has {count}: fuse both again",
                self.rows.count,
                self.visibility.display()
            );
            let path = self.cloud.clone();
            return Err(SequenceError::Content { path, problem });
        }
        Ok((BufReader::with_capacity(1 << 20, rows), seen, 8))
    }

    fn u32(&self, seen: &mut impl Read, at: &mut u64) -> Result<u32, SequenceError> {
        let mut bytes = [0; 4];
        seen.read_exact(&mut bytes)
            .map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => self.visibility_error(
                    *at,
                    "the file ends too early (truncated?): copy it again".to_owned(),
                ),
                _ => io(&self.visibility)(error),
            })?;
        *at += 4;
        Ok(u32::from_le_bytes(bytes))
    }

    fn visibility_error(&self, offset: u64, problem: String) -> SequenceError {
        SequenceError::Byte {
            path: self.visibility.clone(),
            offset,
            problem,
        }
    }
}

fn io(path: &Path) -> impl Fn(std::io::Error) -> SequenceError + '_ {
    |error| SequenceError::Content {
        path: path.to_owned(),
        problem: error.to_string(),
    }
}

impl Rows {
    /// Reads the header; `None` when rows cannot be read one by one or the file is too short for them.
    fn read(path: &Path) -> std::io::Result<Option<Self>> {
        /// Longer headers are none of COLMAP.
        const LONGEST: u64 = 1 << 16;
        let file = open_regular(path)?;
        let length = file.metadata()?.len();
        let mut reader = BufReader::new(file.take(LONGEST));
        let mut start = 0;
        let mut lines = Vec::new();
        loop {
            let mut line = Vec::new();
            let read = reader.read_until(b'\n', &mut line)?;
            if read == 0 {
                return Ok(None);
            }
            start += read as u64;
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            if line == "end_header" {
                break;
            }
            lines.push(line);
        }
        let rows = Self::parse(&lines, start);
        let is_whole = |rows: &Self| {
            let bytes = rows.count.checked_mul(rows.bytes as u64);
            bytes.is_some_and(|bytes| bytes <= length - rows.start)
        };
        Ok(rows.filter(is_whole))
    }

    fn parse(lines: &[String], start: u64) -> Option<Self> {
        let mut words = lines.iter().map(|line| {
            let words = line.split_ascii_whitespace();
            words.collect::<Vec<&str>>()
        });
        if words.next()? != ["ply"] {
            return None;
        }
        let mut elements = 0;
        let mut rows = Self {
            start,
            count: 0,
            bytes: 0,
            coordinates: [(0, false); 3],
            colors: None,
        };
        let mut found = [false; 3];
        let mut colors = [None; 3];
        for words in words {
            match words[..] {
                ["format", format, _] if format != "binary_little_endian" => return None,
                ["element", name, count] => {
                    elements += 1;
                    if elements == 1 {
                        rows.count = count.parse().ok().filter(|_| name == "vertex")?;
                    }
                }
                ["property", kind, name] if elements == 1 => {
                    let size = match kind {
                        "char" | "uchar" | "int8" | "uint8" => 1,
                        "short" | "ushort" | "int16" | "uint16" => 2,
                        "int" | "uint" | "float" | "int32" | "uint32" | "float32" => 4,
                        "double" | "float64" => 8,
                        _ => return None,
                    };
                    if let Some(k) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
                        if !matches!(kind, "float" | "float32" | "double" | "float64") {
                            return None;
                        }
                        rows.coordinates[k] = (rows.bytes, size == 8);
                        found[k] = true;
                    }
                    let mut channels = ["red", "green", "blue"].iter();
                    if let Some(k) = channels.position(|channel| *channel == name) {
                        colors[k] = matches!(kind, "uchar" | "uint8").then_some(rows.bytes);
                    }
                    rows.bytes += size;
                }
                ["property", ..] if elements == 1 => return None,
                _ => (),
            }
        }
        if let [Some(red), Some(green), Some(blue)] = colors {
            rows.colors = Some([red, green, blue]);
        }
        found.iter().all(|found| *found).then_some(rows)
    }

    fn position(&self, row: &[u8]) -> [f64; 3] {
        self.coordinates.map(|(at, is_double)| {
            if is_double {
                let mut bytes = [0; 8];
                bytes.copy_from_slice(&row[at..at + 8]);
                return f64::from_le_bytes(bytes);
            }
            let mut bytes = [0; 4];
            bytes.copy_from_slice(&row[at..at + 4]);
            f64::from(f32::from_le_bytes(bytes))
        })
    }
}
