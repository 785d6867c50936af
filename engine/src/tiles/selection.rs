//! The points of a dense cloud that are carved, in memory that does not grow with it.

use std::path::Path;

use linecarve_sequence::{DenseCloud, ModelView};
use nalgebra::{Point3, Vector3};

use super::ProjectError;
use super::median::Medians;
use super::spill::Spill;
use crate::map::cloud::{ViewStatistics, top_level};
use crate::map::{ModelCounts, PointSelector};
use crate::options::Options;
use crate::recording::{PointExtent, Precision, RecordingError, model_origin};

/// Selected points, in the frame of computation.
pub(super) struct Selection {
    /// Subtracted from all coordinates.
    pub(super) origin: Vector3<f64>,
    /// Centres of the views.
    pub(super) centers: Vec<Point3<f64>>,
    /// Top level of the octree of the cloud.
    pub(super) top: i32,
    /// Depths of all points in their views.
    pub(super) depths: Medians,
    pub(super) spill: Spill,
    pub(super) counts: ModelCounts,
}

impl Selection {
    /// Selects points in two passes: the extent of the cloud decides on the origin of computation; then points are selected and shifted,
    /// as [`Recording`](crate::recording::Recording) and [`Map`](crate::map::Map) do with a model in memory. Temporary files are in
    /// `folder`.
    ///
    /// # Errors
    /// When a parameter is out of range, a file cannot be read or written, or coordinates have lost their precision.
    pub(super) fn of(
        cloud: &DenseCloud,
        options: &Options,
        folder: &Path,
    ) -> Result<Self, ProjectError> {
        options.validate()?;
        let mut extent = PointExtent::default();
        let mut statistics = ViewStatistics::default();
        let mut precision = Precision::default();
        cloud.visit(|point| {
            extent.add(&point.point_in_world);
            precision.add(&point, cloud.views());
            statistics.add(&point);
            Ok::<(), ProjectError>(())
        })?;
        if let Some(loss) = precision.loss() {
            let path = cloud.path().display();
            return Err(RecordingError::Missing(format!("{path}: {loss}")).into());
        }
        let origin = model_origin(cloud.views(), &extent);
        let shifted = |view: &ModelView| {
            let mut view = view.clone();
            view.world_from_camera.translation.vector += -origin;
            view
        };
        let views: Vec<ModelView> = cloud.views().iter().map(shifted).collect();
        let center = |view: &ModelView| Point3::from(view.world_from_camera.translation.vector);
        let centers: Vec<Point3<f64>> = views.iter().map(center).collect();
        let mut selector = PointSelector::new(views, options, statistics);
        let file_error = |fault| ProjectError::file(folder)(fault);
        std::fs::create_dir_all(folder).map_err(file_error)?;
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
        Ok(Self {
            origin,
            centers,
            top,
            depths,
            spill,
            counts: selector.counts(),
        })
    }
}
