//! The plan of points with views.

use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use linecarve_carving::Hull;
use linecarve_mesh::files::write_atomically;
use linecarve_tiles::{PlanOptions, Planner, SeenPoint, TilesError, Work};
use nalgebra::Point3;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::selection::Selection;
use super::{Finish, POINTS_OF_TILE, ProjectError, Split};
use crate::map::cloud::{CloudSurface, JoinedPoint, append_centers, append_record};
use crate::map::{carver_options, export_options};

impl Selection {
    /// Plans the points, which go through memory one part after the other.
    ///
    /// # Errors
    /// When a temporary file cannot be read, or the plan cannot be made.
    pub(super) fn plan(mut self, split: Split, folder: &Path) -> Result<Work, ProjectError> {
        let file_error = |fault| ProjectError::temporary(folder)(fault);
        let coordinates = self.centers.iter().map(|center| (*center).into());
        let coordinates: Vec<[f64; 3]> = coordinates.collect();
        let mut plan = PlanOptions::default();
        plan.tiles = split.tiles.unwrap_or(1);
        plan.halo = split.halo;
        let mut planner = Planner::new(folder, &coordinates, plan)?;
        let mut surface = SurfaceFile::new(folder).map_err(file_error)?;
        let mut is_dense = false;
        self.visit(folder, |points| {
            for point in points {
                planner.add(SeenPoint {
                    position: point.position.into(),
                    sigma: point.sigma,
                    rays: &point.rays,
                })?;
                is_dense |= point.is_dense;
                surface.add(point).map_err(file_error)?;
            }
            Ok(())
        })?;
        if split.tiles.is_none() {
            planner.set_tiles((planner.point_count() as usize).div_ceil(POINTS_OF_TILE));
        }
        let export = export_options(&self.options, self.median_depth);
        let finish = Finish::text(
            self.origin.into(),
            &self.options,
            is_dense.then_some(export),
        )?;
        let mut carver = carver_options(&self.options);
        if is_dense {
            planner.keep_neighbors();
            carver.hull = Hull::Keep;
        }
        let work = planner.finish(carver, export, finish)?;
        if is_dense {
            surface.keep(&self.centers, folder)?;
        }
        Ok(work)
    }
}

/// Name of the file with what the mesh of a dense cloud needs of its points, and at its end a digest of that.
const FILE: &str = "cloud";

/// What the mesh of a dense cloud needs of its points, while it is not known whether the cloud is one.
struct SurfaceFile {
    /// Without a name.
    records: BufWriter<File>,
    record: Vec<u8>,
    hash: Xxh3,
}

impl SurfaceFile {
    fn new(folder: &Path) -> std::io::Result<Self> {
        Ok(Self {
            records: BufWriter::new(tempfile::tempfile_in(folder)?),
            record: Vec::new(),
            hash: Xxh3::new(),
        })
    }

    fn add(&mut self, point: &JoinedPoint) -> std::io::Result<()> {
        self.record.clear();
        append_record(point, &mut self.record);
        self.hash.update(&self.record);
        self.records.write_all(&self.record)
    }

    fn keep(mut self, centers: &[Point3<f64>], folder: &Path) -> Result<(), ProjectError> {
        self.record.clear();
        append_centers(centers, &mut self.record);
        self.hash.update(&self.record);
        let copy = |out: &mut dyn Write| {
            let mut records = self.records.into_inner()?;
            records.rewind()?;
            std::io::copy(&mut records, out)?;
            out.write_all(&self.record)?;
            out.write_all(&self.hash.digest().to_le_bytes())
        };
        Ok(write_atomically(&folder.join(FILE), copy)?)
    }
}

/// What was kept.
///
/// # Errors
/// When the file is missing or damaged.
pub(super) fn read_surface(folder: &Path) -> Result<CloudSurface, ProjectError> {
    let bytes = read_kept(folder)?;
    let surface = CloudSurface::from_bytes(&bytes);
    surface.ok_or_else(|| damaged(&folder.join(FILE)))
}

/// The bytes that were kept, verified.
///
/// # Errors
/// As [`read_surface`].
pub(super) fn read_kept(folder: &Path) -> Result<Vec<u8>, ProjectError> {
    let path = folder.join(FILE);
    let mut bytes = std::fs::read(&path).map_err(|fault| match fault.kind() {
        std::io::ErrorKind::NotFound => damaged(&path),
        _ => ProjectError::file(&path)(fault),
    })?;
    let length = bytes.len().saturating_sub(8);
    let digest = bytes.split_off(length);
    match digest == xxh3_64(&bytes).to_le_bytes() {
        true => Ok(bytes),
        false => Err(damaged(&path)),
    }
}

fn damaged(path: &Path) -> ProjectError {
    ProjectError::from(TilesError::DamagedPlan {
        path: path.to_owned(),
        what: "missing or damaged".to_owned(),
    })
}
