//! The plan of a dense cloud, in memory that does not grow with it.

use std::path::Path;

use linecarve_sequence::{DenseCloud, ModelView};
use linecarve_tiles::{PlanOptions, Planner, SeenPoint, Work};

use super::median::Medians;
use super::{Finish, POINTS_OF_TILE, ProjectError, Split};
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
    cloud.visit(|point| {
        extent.add(&point.point_in_world);
        Ok::<(), ProjectError>(())
    })?;
    let origin = model_origin(cloud.views(), &extent);
    let shifted = |view: &ModelView| {
        let mut view = view.clone();
        view.world_from_camera.translation.vector += -origin;
        view
    };
    let views: Vec<ModelView> = cloud.views().iter().map(shifted).collect();
    let center = |view: &ModelView| view.world_from_camera.translation.vector.into();
    let centers: Vec<[f64; 3]> = views.iter().map(center).collect();
    let plan = PlanOptions {
        tiles: split.tiles.unwrap_or(1),
        halo: split.halo,
        ..PlanOptions::default()
    };
    let mut planner = Planner::new(folder, &centers, plan)?;
    let mut selector = PointSelector::new(views, options);
    let file_error = |fault| ProjectError::file(folder)(fault);
    let mut depths = Medians::new(folder).map_err(file_error)?;
    let mut rays = Vec::new();
    cloud.visit(|mut point| {
        point.point_in_world += -origin;
        let Some((views, depths_of_point, sigma)) = selector.select(&point) else {
            return Ok(());
        };
        depths.add(depths_of_point).map_err(file_error)?;
        rays.clear();
        rays.extend(views.iter().map(|&view| [view, 1]));
        planner.add(SeenPoint {
            position: point.point_in_world.into(),
            sigma,
            rays: &rays,
        })?;
        Ok::<(), ProjectError>(())
    })?;
    if split.tiles.is_none() {
        planner.set_tiles((planner.point_count() as usize).div_ceil(POINTS_OF_TILE));
    }
    let export = export_options(options, depths.upper_median().map_err(file_error)?);
    let finish = Finish::text(origin.into(), options)?;
    Ok(planner.finish(carver_options(options), export, finish)?)
}
