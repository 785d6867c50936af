//! The points of an input that are carved: of a dense cloud in memory that does not grow with it.

use std::path::Path;

use linecarve_mesh::render::up_direction;
use linecarve_sequence::{DenseCloud, ModelView, SparseModel};
use nalgebra::{Point3, Vector3};

use super::ProjectError;
use super::median::Medians;
use super::spill::Spill;
use crate::map::cloud::{JoinedPoint, ViewStatistics, join, top_level};
use crate::map::{ModelCounts, PointSelector, SelectedPoints, center_of};
use crate::options::Options;
use crate::recording::{Input, PointExtent, Precision, Recording, RecordingError, model_origin};

/// Points with views, or the recording of an input that has none.
pub(super) enum Opened {
    Points(Box<Selection>),
    Recording(Box<Recording>),
}

/// Selected points, in the frame of computation.
pub(super) struct Selection {
    pub(super) options: Options,
    /// Subtracted from all coordinates.
    pub(super) origin: Vector3<f64>,
    /// Mean up direction of the views.
    pub(super) up: Vector3<f64>,
    /// Centres of the views.
    pub(super) centers: Vec<Point3<f64>>,
    /// Median depth of the points in their views; `None` without points.
    pub(super) median_depth: Option<f64>,
    pub(super) counts: ModelCounts,
    points: Points,
}

enum Points {
    Joined(Vec<JoinedPoint>),
    /// Not joined yet, and the top level of the octree of the cloud.
    Spilled(Spill, i32),
}

/// Mean up direction of views.
pub fn up_of_views(views: &[ModelView]) -> Vector3<f64> {
    let poses: Vec<_> = views.iter().map(|view| view.world_from_camera).collect();
    up_direction(&poses)
}

impl Opened {
    /// The points of a dense cloud or else of a model. The cloud is read point by point, with temporary files in `folder`.
    ///
    /// # Errors
    /// When the input cannot be read, a parameter is out of range, a temporary file cannot be written, or coordinates have lost their
    /// precision.
    pub(super) fn new(
        input: &Input,
        cloud: Option<&DenseCloud>,
        options: Options,
        folder: &Path,
    ) -> Result<Self, ProjectError> {
        if let Some(cloud) = cloud {
            let points = Selection::of_cloud(cloud, options, folder)?;
            return Ok(Self::Points(Box::new(points)));
        }
        let mut recording = Recording::open(input, options)?;
        Ok(match recording.take_model() {
            Some(model) => {
                let points = Selection::of_model(&model, recording.options, recording.origin)?;
                Self::Points(Box::new(points))
            }
            None => Self::Recording(Box::new(recording)),
        })
    }
}

impl Selection {
    /// The points of a model in the frame of computation.
    ///
    /// # Errors
    /// When an observation names a view that does not exist.
    pub(super) fn of_model(
        model: &SparseModel,
        options: Options,
        origin: Vector3<f64>,
    ) -> Result<Self, ProjectError> {
        let selected = SelectedPoints::of(model, &options)?;
        Ok(Self {
            options,
            origin,
            up: up_of_views(&model.views),
            centers: selected.centers,
            median_depth: selected.median_depth,
            counts: selected.counts,
            points: Points::Joined(selected.points),
        })
    }

    /// Selects points in two passes: the extent of the cloud decides on the origin of computation; then points are selected and shifted,
    /// as [`Recording`] and [`SelectedPoints`] do with a model in memory. Temporary files are in `folder`.
    ///
    /// # Errors
    /// When a parameter is out of range, a file cannot be read or written, or coordinates have lost their precision.
    fn of_cloud(cloud: &DenseCloud, options: Options, folder: &Path) -> Result<Self, ProjectError> {
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
        let centers = views.iter().map(center_of).collect();
        let mut selector = PointSelector::new(views, &options, statistics);
        std::fs::create_dir_all(folder).map_err(ProjectError::file(folder))?;
        let file_error = |fault| ProjectError::temporary(folder)(fault);
        let mut depths = Medians::new(folder).map_err(file_error)?;
        let top = top_level(extent.translated(&-origin).longest());
        let mut spill = Spill::new(folder, top).map_err(file_error)?;
        let skipped = cloud.visit(|mut point| {
            point.point_in_world += -origin;
            if let Some((point, depths_of_point)) = selector.select(&point) {
                depths.add(depths_of_point).map_err(file_error)?;
                spill.add(&point).map_err(file_error)?;
            }
            Ok::<(), ProjectError>(())
        })?;
        Ok(Self {
            options,
            origin,
            up: up_of_views(cloud.views()),
            centers,
            median_depth: depths.upper_median().map_err(file_error)?,
            counts: ModelCounts {
                not_finite: skipped.not_finite,
                without_normal: skipped.without_normal,
                ..selector.counts()
            },
            points: Points::Spilled(spill, top),
        })
    }

    /// Calls `take` with all points, one part after the other.
    ///
    /// # Errors
    /// When a temporary file cannot be read; and what `take` returns.
    pub(super) fn visit(
        &mut self,
        folder: &Path,
        mut take: impl FnMut(&[JoinedPoint]) -> Result<(), ProjectError>,
    ) -> Result<(), ProjectError> {
        let none = Points::Joined(Vec::new());
        match std::mem::replace(&mut self.points, none) {
            Points::Joined(points) => take(&points),
            Points::Spilled(spill, top) => {
                spill.visit(folder, |part| take(&join(part, top, &self.centers)))
            }
        }
    }
}
