//! The plan of a dense cloud. Points and rays pass through files; what the mesh needs of each point ([`CloudSurface`]) is in memory.

use std::path::Path;

use linecarve_carving::Hull;
use linecarve_mesh::files::write_atomically;
use linecarve_sequence::{DenseCloud, ModelView};
use linecarve_tiles::{PlanOptions, Planner, SeenPoint, Work};
use nalgebra::Point3;

use super::median::Medians;
use super::spill::Spill;
use super::{Finish, POINTS_OF_TILE, ProjectError, Split};
use crate::map::cloud::{CloudSurface, ViewStatistics, join, top_level};
use crate::map::{PointSelector, carver_options, export_options};
use crate::options::Options;
use crate::recording::{PointExtent, model_origin};

/// Plans a cloud in two passes: its extent decides on the origin of computation; then points are selected and shifted, as
/// [`Recording`](crate::recording::Recording) and [`Map`](crate::map::Map) do with a model in memory.
///
/// # Errors
/// When the files cannot be read, or the plan cannot be made.
pub(super) fn plan(
    cloud: &DenseCloud,
    options: &Options,
    split: Split,
    folder: &Path,
) -> Result<Work, ProjectError> {
    options.validate()?;
    let mut extent = PointExtent::default();
    let mut statistics = ViewStatistics::default();
    cloud.visit(|point| {
        extent.add(&point.point_in_world);
        statistics.add(&point);
        Ok::<(), ProjectError>(())
    })?;
    let origin = model_origin(cloud.views(), &extent);
    let shifted = |view: &ModelView| {
        let mut view = view.clone();
        view.world_from_camera.translation.vector += -origin;
        view
    };
    let views: Vec<ModelView> = cloud.views().iter().map(shifted).collect();
    let center = |view: &ModelView| Point3::from(view.world_from_camera.translation.vector);
    let centers: Vec<Point3<f64>> = views.iter().map(center).collect();
    let coordinates: Vec<[f64; 3]> = centers.iter().map(|center| (*center).into()).collect();
    let plan = PlanOptions {
        tiles: split.tiles.unwrap_or(1),
        halo: split.halo,
        ..PlanOptions::default()
    };
    let mut planner = Planner::new(folder, &coordinates, plan)?;
    let mut selector = PointSelector::new(views, options, statistics);
    let file_error = |fault| ProjectError::file(folder)(fault);
    let mut depths = Medians::new(folder).map_err(file_error)?;
    let top = top_level(extent.translated(&-origin).longest());
    let mut spill = Spill::new(folder, top).map_err(file_error)?;
    cloud.visit(|mut point| {
        point.point_in_world += -origin;
        if let Some((point, depths_of_point)) = selector.select(&point) {
            depths.add(depths_of_point).map_err(file_error)?;
            spill.add(&point).map_err(file_error)?;
        }
        Ok::<(), ProjectError>(())
    })?;
    let mut surface = CloudSurface::new(centers.clone());
    let mut is_dense = false;
    spill.visit(folder, |points| {
        for point in join(points, top, &centers) {
            planner.add(SeenPoint {
                position: point.position.into(),
                sigma: point.sigma,
                rays: &point.rays,
            })?;
            is_dense |= point.is_dense;
            surface.add(&point);
        }
        Ok::<(), ProjectError>(())
    })?;
    if split.tiles.is_none() {
        planner.set_tiles((planner.point_count() as usize).div_ceil(POINTS_OF_TILE));
    }
    let export = export_options(options, depths.upper_median().map_err(file_error)?);
    let finish = Finish::text(origin.into(), options, is_dense.then_some(export))?;
    let mut carver = carver_options(options);
    if is_dense {
        planner.keep_neighbors();
        carver.hull = Hull::Keep;
    }
    let work = planner.finish(carver, export, finish)?;
    if is_dense {
        write_surface(&surface, folder)?;
    }
    Ok(work)
}

/// Name of the file with what the mesh of a dense cloud needs of its points.
const FILE: &str = "cloud";

/// Keeps what the mesh of a dense cloud needs of its points.
///
/// # Errors
/// When the file cannot be written.
pub(super) fn write_surface(surface: &CloudSurface, folder: &Path) -> Result<(), ProjectError> {
    let bytes = surface.to_bytes();
    write_atomically(&folder.join(FILE), |out| out.write_all(&bytes))?;
    Ok(())
}

/// What [`write_surface`] kept.
///
/// # Errors
/// When the file is missing or damaged.
pub(super) fn read_surface(folder: &Path) -> Result<CloudSurface, ProjectError> {
    let path = folder.join(FILE);
    let damaged = || {
        let problem = "the file is damaged: plan into an empty folder";
        std::io::Error::new(std::io::ErrorKind::InvalidData, problem)
    };
    let bytes = std::fs::read(&path).map_err(ProjectError::file(&path))?;
    CloudSurface::from_bytes(&bytes).ok_or_else(|| ProjectError::file(&path)(damaged()))
}
