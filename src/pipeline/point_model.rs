//! Points with visibility, carved without a look at the images.

use std::time::{Duration, Instant};

use linecarve_carving::{Carver, PointId, Transaction, TransactionError};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::map_points::{carver_options, surface_of};
use super::options::Options;
use crate::map_points::{ModelPoint, PointModel, parallax_cosine};
use crate::mesh::TriangleMesh;

/// Which points of a model are carved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PointModelOptions {
    /// A point is carved when this many views see it ...
    pub min_views: usize,
    /// ... and rays of some two of them differ by this angle. Below, its depth is hardly known.
    pub parallax_degrees: f64,
    /// A sighting counts when the model's own point is within this distance of it in the image, where the model gives
    /// both a pixel and a camera.
    pub max_reprojection_px: f64,
}

impl Default for PointModelOptions {
    fn default() -> Self {
        Self {
            min_views: 3,
            parallax_degrees: 1.0,
            max_reprojection_px: 4.0,
        }
    }
}

/// Why a model cannot be carved.
#[derive(Debug, thiserror::Error)]
pub enum PointModelError {
    /// A sighting names a view that there is not.
    #[error("point {point} of the model is seen by view {view}, but there are {views} views")]
    UnknownView {
        /// Index of the point.
        point: usize,
        /// The view named.
        view: u32,
        /// How many there are.
        views: usize,
    },
    /// The carver refuses a view.
    #[error("view {name} of the model cannot be used: {source} (check its pose)")]
    View {
        /// Its name.
        name: String,
        /// Why.
        source: TransactionError,
    },
    /// The carver refuses a point.
    #[error("point {point} of the model cannot be used: {source}")]
    Point {
        /// Index of the point.
        point: usize,
        /// Why.
        source: TransactionError,
    },
    /// The carver refuses what a view adds.
    #[error("view {name} of the model cannot be carved: {source}")]
    Carve {
        /// Name of the view.
        name: String,
        /// Why.
        source: TransactionError,
    },
}

/// What became of the points of a model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ModelCounts {
    /// Points that are carved.
    pub carved: usize,
    /// Points left out because a coordinate is not a number or out of range.
    pub not_finite: usize,
    /// Points left out because too few views see them.
    pub too_few_views: usize,
    /// Points left out because their rays hardly differ.
    pub too_little_parallax: usize,
    /// Sightings left out because the point projects elsewhere, or behind the camera.
    pub wrong_sightings: usize,
}

/// What one view did.
#[derive(Debug, Clone, Copy, Default)]
pub struct ModelUpdate {
    /// Points that are new.
    pub new_points: usize,
    /// Older points that it sees as well.
    pub observed_again: usize,
    /// Triangles that the surface gained and lost.
    pub changed_triangles: usize,
    /// Time for inserting points, walking rays and bringing labels and surface up to date.
    pub carving: Duration,
}

/// A model on its way to a surface, one view after another or all at once.
pub struct ModelCarver<'a> {
    model: &'a PointModel,
    options: Options,
    carver: Carver,
    counts: ModelCounts,
    /// Points that each view sees, ascending; view by view.
    seen: Vec<Vec<u32>>,
    points: Vec<Option<PointId>>,
    median_depth: Option<f64>,
    next_view: usize,
}

impl<'a> ModelCarver<'a> {
    /// Chooses the points to carve. Linear in the number of sightings, quadratic in the length of a track whose parallax
    /// is small.
    ///
    /// # Errors
    /// When a sighting names a view that there is not.
    pub fn new(model: &'a PointModel, options: &Options) -> Result<Self, PointModelError> {
        let mut counts = ModelCounts::default();
        let mut seen = vec![Vec::new(); model.views.len()];
        let mut depths = Vec::new();
        let mut views = Vec::new();
        for (index, point) in model.points.iter().enumerate() {
            if let Some(sighting) = point
                .sightings
                .iter()
                .find(|sighting| sighting.view as usize >= model.views.len())
            {
                return Err(PointModelError::UnknownView {
                    point: index,
                    view: sighting.view,
                    views: model.views.len(),
                });
            }
            if choose(
                model,
                point,
                &options.point_model,
                &mut views,
                &mut depths,
                &mut counts,
            ) {
                for view in &views {
                    seen[*view as usize].push(index as u32);
                }
            }
        }
        let middle = depths.len() / 2;
        let median_depth =
            (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f64::total_cmp).1);
        Ok(Self {
            model,
            options: options.clone(),
            carver: Carver::new(carver_options(options)),
            counts,
            seen,
            points: vec![None; model.points.len()],
            median_depth,
            next_view: 0,
        })
    }

    /// Adds the next view with its points; `None` after the last.
    ///
    /// # Errors
    /// When the carver refuses the view or one of its points.
    pub fn push_view(&mut self) -> Result<Option<ModelUpdate>, PointModelError> {
        let Some(view) = self.model.views.get(self.next_view) else {
            return Ok(None);
        };
        let start = Instant::now();
        let mut update = ModelUpdate::default();
        let mut transaction = self.carver.transaction();
        add_view(
            &mut transaction,
            self.model,
            self.next_view,
            &self.seen[self.next_view],
            &mut self.points,
            &mut update,
        )?;
        let report = transaction
            .commit()
            .map_err(|source| PointModelError::Carve {
                name: view.name.clone(),
                source,
            })?;
        update.changed_triangles = report.surface.added.len() + report.surface.removed.len();
        update.carving = start.elapsed();
        self.next_view += 1;
        Ok(Some(update))
    }

    /// Adds all views that are left at once: the same surface, sooner.
    ///
    /// # Errors
    /// As [`push_view`](Self::push_view).
    pub fn push_all(&mut self) -> Result<ModelUpdate, PointModelError> {
        let start = Instant::now();
        let mut update = ModelUpdate::default();
        let mut transaction = self.carver.transaction();
        for view in self.next_view..self.model.views.len() {
            let seen = &self.seen[view];
            add_view(
                &mut transaction,
                self.model,
                view,
                seen,
                &mut self.points,
                &mut update,
            )?;
        }
        let report = transaction
            .commit()
            .map_err(|source| PointModelError::Carve {
                name: "(all)".to_owned(),
                source,
            })?;
        self.next_view = self.model.views.len();
        update.changed_triangles = report.surface.added.len() + report.surface.removed.len();
        update.carving = start.elapsed();
        Ok(update)
    }

    /// The view that sees most of the points that are carved, of equals the first; `None` without views.
    pub fn richest_view(&self) -> Option<usize> {
        (0..self.seen.len()).max_by_key(|&view| (self.seen[view].len(), std::cmp::Reverse(view)))
    }

    /// What became of the points.
    pub fn counts(&self) -> ModelCounts {
        self.counts
    }

    /// Median depth of the points in the views that see them; `None` without one.
    pub fn median_depth(&self) -> Option<f64> {
        self.median_depth
    }

    /// The carved tetrahedralisation.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// Indices of the points that have been carved so far, ascending.
    pub fn carved_points(&self) -> impl Iterator<Item = usize> + '_ {
        let ids = self.points.iter().enumerate();
        ids.filter(|(_, id)| id.is_some()).map(|(index, _)| index)
    }

    /// The surface as it stands, without what the options leave out.
    pub fn surface(&self) -> TriangleMesh {
        surface_of(&self.carver, &self.options, self.median_depth)
    }
}

/// Whether a point is to be carved; then `views` holds who counts as seeing it, and `depths` gains its depths.
fn choose(
    model: &PointModel,
    point: &ModelPoint,
    options: &PointModelOptions,
    views: &mut Vec<u32>,
    depths: &mut Vec<f64>,
    counts: &mut ModelCounts,
) -> bool {
    views.clear();
    let place = point.point_in_world;
    if !place.iter().all(|x| x.is_finite()) {
        counts.not_finite += 1;
        return false;
    }
    let depths_before = depths.len();
    for sighting in &point.sightings {
        let view = &model.views[sighting.view as usize];
        let in_camera = view.world_from_camera.inverse_transform_point(&place);
        let is_right = in_camera.z > 0.0
            && match (&view.camera, sighting.pixel) {
                (Some(camera), Some([x, y])) => camera.project(&in_camera).is_some_and(|pixel| {
                    (pixel.x - x).hypot(pixel.y - y) <= options.max_reprojection_px
                }),
                _ => true,
            };
        if is_right {
            views.push(sighting.view);
            depths.push(in_camera.z);
        } else {
            counts.wrong_sightings += 1;
        }
    }
    views.dedup();
    let centers: Vec<Point3<f64>> = views
        .iter()
        .map(|view| {
            let pose = &model.views[*view as usize].world_from_camera;
            Point3::from(pose.translation.vector)
        })
        .collect();
    let is_chosen = if views.len() < options.min_views {
        counts.too_few_views += 1;
        false
    } else if parallax_cosine(&centers, &place) > options.parallax_degrees.to_radians().cos() {
        counts.too_little_parallax += 1;
        false
    } else {
        counts.carved += 1;
        true
    };
    if !is_chosen {
        depths.truncate(depths_before);
    }
    is_chosen
}

/// Adds a view, those of its points that are new, and its observations.
fn add_view(
    transaction: &mut Transaction<'_>,
    model: &PointModel,
    view: usize,
    seen: &[u32],
    points: &mut [Option<PointId>],
    update: &mut ModelUpdate,
) -> Result<(), PointModelError> {
    let record = &model.views[view];
    let refused = |source| PointModelError::View {
        name: record.name.clone(),
        source,
    };
    let center = Point3::from(record.world_from_camera.translation.vector);
    let id = transaction.add_view(center).map_err(refused)?;
    for &index in seen {
        let slot = &mut points[index as usize];
        let point = match *slot {
            Some(point) => {
                update.observed_again += 1;
                point
            }
            None => {
                update.new_points += 1;
                let place = model.points[index as usize].point_in_world;
                let point =
                    transaction
                        .add_point(place)
                        .map_err(|source| PointModelError::Point {
                            point: index as usize,
                            source,
                        })?;
                *slot.insert(point)
            }
        };
        transaction.add_observation(id, point, 1).map_err(refused)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
