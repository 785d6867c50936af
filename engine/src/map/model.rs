//! A map of the points of a sparse model, which bring their observations. No image is read.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use linecarve_carving::{Carver, CommitReport, PointId, Transaction};
use linecarve_lines::upper_median;
use linecarve_points::parallax_cosine;
use linecarve_sequence::{ModelPoint, ModelView, SparseModel};
use nalgebra::{Matrix3, Point3, Vector3};

use super::cloud::{CloudSurface, JoinedPoint, SeenPoint, ViewStatistics, join, top_level};
use super::error::MapError;
use super::update::MapUpdate;
use crate::options::{Options, PointModelOptions};
use crate::recording::PointExtent;

/// Numbers of carved and rejected points of a model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ModelCounts {
    /// Points that pass the filter.
    pub carved: usize,
    /// Points with a coordinate that is not finite.
    pub not_finite: usize,
    /// Points with too few views.
    pub too_few_views: usize,
    /// Points with too little parallax.
    pub too_little_parallax: usize,
    /// Observations with too large a reprojection error or behind the camera.
    pub wrong_observations: usize,
}

impl ModelCounts {
    /// Says which points are not carved, and which observations are not used; `None` when all are.
    pub fn left_out(&self) -> Option<String> {
        let reasons = [
            (self.not_finite, "not finite"),
            (self.too_few_views, "seen by too few views"),
            (
                self.too_little_parallax,
                "seen from nearly the same direction only",
            ),
        ];
        let out: usize = reasons.iter().map(|(count, _)| count).sum();
        let reasons: Vec<String> = (reasons.iter().filter(|(count, _)| *count > 0))
            .map(|(count, reason)| format!("{count} {reason}"))
            .collect();
        let mut parts = Vec::new();
        if out > 0 {
            let (total, reasons) = (out + self.carved, reasons.join(", "));
            parts.push(format!("{out} of {total} points are left out: {reasons}"));
        }
        if self.wrong_observations > 0 {
            let count = self.wrong_observations;
            parts.push(format!("{count} observations project elsewhere"));
        }
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

/// A model and the state of its points.
pub(super) struct ModelMap {
    model: Arc<SparseModel>,
    counts: ModelCounts,
    /// Points that each view observes, ascending.
    points_of_view: Vec<Vec<u32>>,
    points: Vec<Option<PointId>>,
    /// Standard deviation of each point for the carver, if known.
    sigmas: Vec<Option<f64>>,
    median_depth: Option<f64>,
    joined: Option<Joined>,
}

/// The points of a dense cloud that are carved.
struct Joined {
    points: Vec<ModelPoint>,
    /// The views of each, ascending, with weights.
    rays: Vec<Vec<[u32; 2]>>,
    surface: CloudSurface,
}

impl ModelMap {
    /// Selects the points to carve. Linear in the number of observations; quadratic in the track length of points with small
    /// parallax.
    ///
    /// # Errors
    /// When an observation names a view that does not exist.
    pub(super) fn new(
        model: Arc<SparseModel>,
        options: &PointModelOptions,
        sigma_factor: f64,
    ) -> Result<Self, MapError> {
        let mut counts = ModelCounts::default();
        let options =
            &with_least_views(options, &model.views, || ViewStatistics::of(&model.points));
        let mut points_of_view = vec![Vec::new(); model.views.len()];
        let mut depths = Vec::new();
        let mut views = Vec::new();
        let mut sigmas = vec![None; model.points.len()];
        let mut seen = Vec::new();
        let mut extent = PointExtent::default();
        // Pixels are those of features, which are matched one by one.
        let is_dense = (model.points.iter().flat_map(|point| &point.observations))
            .all(|observation| observation.pixel.is_none());
        for (index, point) in model.points.iter().enumerate() {
            if let Some(observation) = point
                .observations
                .iter()
                .find(|observation| observation.view as usize >= model.views.len())
            {
                return Err(MapError::UnknownView {
                    point: index,
                    view: observation.view,
                    views: model.views.len(),
                });
            }
            extent.add(&point.point_in_world);
            if select_point(&model, point, options, &mut views, &mut depths, &mut counts) {
                for view in &views {
                    points_of_view[*view as usize].push(index as u32);
                }
                let seen_from = views.iter().map(|view| &model.views[*view as usize]);
                sigmas[index] = sigma_along_rays(&point.point_in_world, seen_from)
                    .map(|sigma| sigma_factor * sigma);
                if is_dense {
                    seen.push(SeenPoint {
                        position: point.point_in_world,
                        color: point.color,
                        views: views.clone(),
                        sigma: sigmas[index],
                        pixel: smallest_pixel(&point.point_in_world, &model.views, &views),
                    });
                }
            }
        }
        let median_depth = upper_median(&mut depths, f64::total_cmp);
        let mut map = Self {
            counts,
            points_of_view,
            points: vec![None; model.points.len()],
            sigmas,
            median_depth,
            model,
            joined: None,
        };
        map.join(seen, &extent);
        Ok(map)
    }

    /// Joins the points of a dense cloud; does nothing where no surface is found.
    fn join(&mut self, seen: Vec<SeenPoint>, extent: &PointExtent) {
        let center = |view: &ModelView| Point3::from(view.world_from_camera.translation.vector);
        let centers: Vec<Point3<f64>> = self.model.views.iter().map(center).collect();
        let joined = join(seen, top_level(extent.longest()), &centers);
        if !joined.iter().any(|point| point.is_dense) {
            return;
        }
        self.points_of_view = vec![Vec::new(); self.model.views.len()];
        for (index, point) in joined.iter().enumerate() {
            for [view, _] in &point.rays {
                self.points_of_view[*view as usize].push(index as u32);
            }
        }
        self.points = vec![None; joined.len()];
        self.sigmas = joined.iter().map(|point| point.sigma).collect();
        let surface = CloudSurface::of(joined.iter(), centers);
        let point = |point: &JoinedPoint| ModelPoint {
            point_in_world: point.position,
            color: point.color,
            observations: Vec::new(),
        };
        self.joined = Some(Joined {
            points: joined.iter().map(point).collect(),
            rays: joined.into_iter().map(|point| point.rays).collect(),
            surface,
        });
    }

    /// What is known of the points of a dense cloud; `None` for other models.
    pub(super) fn cloud(&self) -> Option<&CloudSurface> {
        self.joined.as_ref().map(|joined| &joined.surface)
    }

    /// Adds views and their points in one transaction.
    ///
    /// # Errors
    /// When the carver rejects a view or one of its points.
    pub(super) fn push(
        &mut self,
        carver: &mut Carver,
        views: Range<usize>,
    ) -> Result<MapUpdate, MapError> {
        let start = Instant::now();
        let (mut update, mut report) = self.enter(carver, views)?;
        if carver.is_deferred() {
            report = carver.carve();
        }
        update.deltas.push(report.surface);
        update.times.carving = start.elapsed();
        Ok(update)
    }

    /// The same without carving where the carver is deferred, and without the change of the surface.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    fn enter(
        &mut self,
        carver: &mut Carver,
        views: Range<usize>,
    ) -> Result<(MapUpdate, CommitReport), MapError> {
        let mut update = MapUpdate::default();
        let last = views.end.saturating_sub(1);
        let mut transaction = carver.transaction();
        for view in views {
            let points_of_view = &self.points_of_view[view];
            let points = (&mut self.points[..], &self.sigmas[..]);
            let own = match &self.joined {
                Some(joined) => (&joined.points[..], Some(&joined.rays[..])),
                None => (&self.model.points[..], None),
            };
            add_view(
                &mut transaction,
                (&self.model.views[view], own),
                view,
                points_of_view,
                points,
                &mut update,
            )?;
        }
        let report = transaction.commit().map_err(|source| MapError::View {
            name: self
                .model
                .views
                .get(last)
                .map_or_else(String::new, |view| view.name.clone()),
            source,
        })?;
        Ok((update, report))
    }

    /// Enters all views.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub(super) fn enter_all(&mut self, carver: &mut Carver) -> Result<(), MapError> {
        let views = 0..self.model.views.len();
        self.enter(carver, views).map(drop)
    }

    /// The view with the most carved points, the first of equals; `None` without views.
    pub(super) fn richest_view(&self) -> Option<usize> {
        (0..self.points_of_view.len())
            .max_by_key(|&view| (self.points_of_view[view].len(), std::cmp::Reverse(view)))
    }

    /// The model.
    pub(super) fn model(&self) -> &SparseModel {
        &self.model
    }

    /// Numbers of carved and rejected points.
    pub(super) fn counts(&self) -> ModelCounts {
        self.counts
    }

    /// Median depth of the points in their views; `None` without points.
    pub(super) fn median_depth(&self) -> Option<f64> {
        self.median_depth
    }

    /// The points carved so far.
    pub(super) fn carved(&self) -> impl Iterator<Item = &ModelPoint> {
        let own = self
            .joined
            .as_ref()
            .map_or(&self.model.points, |joined| &joined.points);
        let points = self.points.iter().zip(own);
        points
            .filter(|(id, _)| id.is_some())
            .map(|(_, point)| point)
    }
}

/// Options with the least number of views that the model asks for, where they leave it open.
fn with_least_views(
    options: &PointModelOptions,
    views: &[ModelView],
    statistics: impl FnOnce() -> ViewStatistics,
) -> PointModelOptions {
    let mut options = *options;
    if options.min_views == 0 {
        options.min_views = statistics().least_views(views);
    }
    options
}

/// Selects the points of a model as [`ModelMap`] does, one by one.
pub(crate) struct PointSelector {
    /// Without points.
    model: SparseModel,
    options: PointModelOptions,
    sigma_factor: f64,
    counts: ModelCounts,
    views: Vec<u32>,
    depths: Vec<f64>,
}

impl PointSelector {
    pub(crate) fn new(
        views: Vec<ModelView>,
        options: &Options,
        statistics: ViewStatistics,
    ) -> Self {
        let point_model = with_least_views(&options.point_model, &views, || statistics);
        Self {
            model: SparseModel {
                views,
                points: Vec::new(),
            },
            options: point_model,
            sigma_factor: options.carving.cut.sigma_factor,
            counts: ModelCounts::default(),
            views: Vec::new(),
            depths: Vec::new(),
        }
    }

    /// Numbers of points so far.
    pub(crate) fn counts(&self) -> ModelCounts {
        self.counts
    }

    /// A point as it is carved, with its depths in its views, if it is carved. Observations must name views of the
    /// model.
    pub(crate) fn select(&mut self, point: &ModelPoint) -> Option<(SeenPoint, &[f64])> {
        self.depths.clear();
        let (model, views) = (&self.model, &mut self.views);
        let is_carved = select_point(
            model,
            point,
            &self.options,
            views,
            &mut self.depths,
            &mut self.counts,
        );
        is_carved.then(|| {
            let seen_from = views.iter().map(|view| &model.views[*view as usize]);
            let sigma = sigma_along_rays(&point.point_in_world, seen_from);
            let sigma = sigma.map(|sigma| self.sigma_factor * sigma);
            let seen = SeenPoint {
                position: point.point_in_world,
                color: point.color,
                views: views.clone(),
                sigma,
                pixel: smallest_pixel(&point.point_in_world, &model.views, views),
            };
            (seen, &self.depths[..])
        })
    }
}

/// Whether a point is carved. If so, `views` holds its views, and its depths are appended to `depths`.
pub(super) fn select_point(
    model: &SparseModel,
    point: &ModelPoint,
    options: &PointModelOptions,
    views: &mut Vec<u32>,
    depths: &mut Vec<f64>,
    counts: &mut ModelCounts,
) -> bool {
    views.clear();
    let position = point.point_in_world;
    if !position.iter().all(|x| x.is_finite()) {
        counts.not_finite += 1;
        return false;
    }
    let depths_before = depths.len();
    for observation in &point.observations {
        let view = &model.views[observation.view as usize];
        let in_camera = view.world_from_camera.inverse_transform_point(&position);
        let is_inlier = in_camera.z > 0.0
            && match (&view.camera, observation.pixel) {
                (Some(camera), Some([x, y])) => camera.project(&in_camera).is_some_and(|pixel| {
                    (pixel.x - x).hypot(pixel.y - y) <= options.max_reprojection_px
                }),
                _ => true,
            };
        if is_inlier {
            views.push(observation.view);
            depths.push(in_camera.z);
        } else {
            counts.wrong_observations += 1;
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
    let is_selected = if views.len() < options.min_views {
        counts.too_few_views += 1;
        false
    } else if parallax_cosine(&centers, &position) > options.parallax_degrees.to_radians().cos() {
        counts.too_little_parallax += 1;
        false
    } else {
        counts.carved += 1;
        true
    };
    if !is_selected {
        depths.truncate(depths_before);
    }
    is_selected
}

/// Standard deviation of a point along the mean direction of its rays, when each of its pixels is accurate to [`PIXEL_SIGMA_PX`];
/// `None` when a view has no camera, or when the rays are so nearly parallel that the deviation is greater than the distance.
pub(super) fn sigma_along_rays<'a>(
    point: &Point3<f64>,
    views: impl Iterator<Item = &'a ModelView>,
) -> Option<f64> {
    let mut information = Matrix3::zeros();
    let mut towards = Vector3::zeros();
    let mut farthest: f64 = 0.0;
    for view in views {
        let ray = point - Point3::from(view.world_from_camera.translation.vector);
        let direction = ray.normalize();
        // A ray says where the point is across it.
        let across = Matrix3::identity() - direction * direction.transpose();
        let sigma = PIXEL_SIGMA_PX * ray.norm() / view.camera.as_ref()?.mean_focal_px();
        information += across / (sigma * sigma);
        towards += direction;
        farthest = farthest.max(ray.norm());
    }
    let towards = towards.try_normalize(0.0)?;
    let sigma = towards.dot(&(information.try_inverse()? * towards)).sqrt();
    (sigma > 0.0 && sigma < farthest).then_some(sigma)
}

/// Size of a pixel at a point, in the view where it is smallest; `None` without cameras.
pub(super) fn smallest_pixel(
    point: &Point3<f64>,
    views: &[ModelView],
    seen_by: &[u32],
) -> Option<f64> {
    let sizes = seen_by.iter().filter_map(|view| {
        let view = &views[*view as usize];
        let ray = point - Point3::from(view.world_from_camera.translation.vector);
        Some(ray.norm() / view.camera.as_ref()?.mean_focal_px())
    });
    sizes.min_by(f64::total_cmp)
}

/// Assumed standard deviation of the pixels of a model, which do not come with one.
const PIXEL_SIGMA_PX: f64 = 1.0;

/// The points of a model, and where they are joined their views with weights, by view.
type WeightedPoints<'a> = (&'a [ModelPoint], Option<&'a [Vec<[u32; 2]>]>);

/// Adds a view, its observations and its new points.
fn add_view(
    transaction: &mut Transaction<'_>,
    (record, (own, rays)): (&ModelView, WeightedPoints<'_>),
    view: usize,
    points_of_view: &[u32],
    (points, sigmas): (&mut [Option<PointId>], &[Option<f64>]),
    update: &mut MapUpdate,
) -> Result<(), MapError> {
    let rejected = |source| MapError::View {
        name: record.name.clone(),
        source,
    };
    let center = Point3::from(record.world_from_camera.translation.vector);
    let id = transaction.add_view(center).map_err(rejected)?;
    for &index in points_of_view {
        let slot = &mut points[index as usize];
        let point = match *slot {
            Some(point) => {
                update.observed_again += 1;
                point
            }
            None => {
                update.new_points += 1;
                let position = own[index as usize].point_in_world;
                let point = transaction
                    .add_point(position)
                    .map_err(|source| MapError::Point {
                        point: index as usize,
                        source,
                    })?;
                transaction
                    .set_sigma(point, sigmas[index as usize])
                    .map_err(rejected)?;
                *slot.insert(point)
            }
        };
        let weight = rays.map_or(1, |rays| {
            let own = &rays[index as usize];
            let found = own.binary_search_by_key(&(view as u32), |[view, _]| *view);
            found.map_or(1, |place| own[place][1])
        });
        transaction
            .add_observation(id, point, weight)
            .map_err(rejected)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
