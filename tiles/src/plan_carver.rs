//! The plan of what a carver holds.

use std::path::Path;

use linecarve_carving::{Carver, ExportOptions};
use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::plan::PlanOptions;
use crate::planner::{Planner, SeenPoint};
use crate::work::Work;

/// Plans what a [deferred](Carver::deferred) carver holds. Larger inputs than a carver go through a [`Planner`].
///
/// The mesh will be that of [`Carver::mesh`] with these options after [`Carver::carve`].
///
/// # Errors
/// When there are no cells, the folder holds another plan or a file cannot be written.
pub fn plan(
    folder: &Path,
    carver: &Carver,
    export: &ExportOptions,
    options: &PlanOptions,
    caller: String,
) -> Result<Work, TilesError> {
    let mut number_of: FxHashMap<u32, u32> = FxHashMap::default();
    let mut centers: Vec<[f64; 3]> = Vec::new();
    for view in carver.views() {
        number_of.insert(view.0, centers.len() as u32);
        centers.extend(carver.view(view).map(<[f64; 3]>::from));
    }
    let mut rays: Vec<(u32, [u32; 2])> = (carver.observations())
        .map(|(view, point, weight)| (point.0, [number_of[&view.0], weight]))
        .collect();
    rays.sort_unstable();
    let mut rays = &rays[..];
    let mut own = Vec::new();
    let mut planner = Planner::new(folder, &centers, *options)?;
    for point in carver.points() {
        let Some(position) = carver.point(point) else {
            continue;
        };
        let (these, others) = rays.split_at(rays.partition_point(|(p, _)| *p <= point.0));
        rays = others;
        own.clear();
        own.extend(these.iter().map(|(_, ray)| *ray));
        planner.add(SeenPoint {
            position: position.into(),
            sigma: carver.sigma(point),
            rays: &own,
        })?;
    }
    planner.finish(carver.options(), *export, caller)
}
