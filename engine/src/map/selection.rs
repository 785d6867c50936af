//! The points of a model that are carved.

use linecarve_lines::upper_median;
use linecarve_points::parallax_cosine;
use linecarve_sequence::{ModelPoint, ModelView, SparseModel};
use nalgebra::{Matrix3, Point3, Vector3};

use super::cloud::{JoinedPoint, SeenPoint, ViewStatistics, join, top_level};
use super::error::MapError;
use crate::options::{Options, PointModelOptions};
use crate::recording::PointExtent;

/// Numbers of carved and rejected points of a model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ModelCounts {
    /// Points that pass the filter.
    pub carved: usize,
    /// Points with a coordinate that is not finite.
    pub not_finite: usize,
    /// Points whose normal, which decides on their views, is zero or not finite.
    pub without_normal: usize,
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
            (self.without_normal, "without a usable normal"),
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

/// The points of a model that are carved; those of a dense cloud are joined.
pub(crate) struct SelectedPoints {
    pub(crate) points: Vec<JoinedPoint>,
    /// Centres of the views.
    pub(crate) centers: Vec<Point3<f64>>,
    /// Median depth of the points in their views; `None` without points.
    pub(crate) median_depth: Option<f64>,
    pub(crate) counts: ModelCounts,
}

impl SelectedPoints {
    /// Selects the points of a model, in the model's frame.
    ///
    /// # Errors
    /// When an observation names a view that does not exist.
    ///
    /// # Complexity
    /// Linear in the number of observations; quadratic in the track length of points with small parallax.
    pub(crate) fn of(model: &SparseModel, options: &Options) -> Result<Self, MapError> {
        let (views, points) = (model.views.len(), &model.points);
        let statistics = ViewStatistics::of(points);
        let mut selector = PointSelector::new(model.views.clone(), options, statistics);
        let mut extent = PointExtent::default();
        let (mut depths, mut seen) = (Vec::new(), Vec::new());
        // Pixels are those of features, which are matched one by one.
        let mut has_pixels = false;
        for (index, point) in points.iter().enumerate() {
            for observation in &point.observations {
                let (point, view) = (index, observation.view);
                if view as usize >= views {
                    return Err(MapError::UnknownView { point, view, views });
                }
                has_pixels |= observation.pixel.is_some();
            }
            extent.add(&point.point_in_world);
            if let Some((point, depths_of_point)) = selector.select(point) {
                depths.extend_from_slice(depths_of_point);
                seen.push(point);
            }
        }
        let centers: Vec<Point3<f64>> = model.views.iter().map(center_of).collect();
        Ok(Self {
            points: match has_pixels {
                true => seen.into_iter().map(JoinedPoint::alone).collect(),
                false => join(seen, top_level(extent.longest()), &centers),
            },
            centers,
            median_depth: upper_median(&mut depths, f64::total_cmp),
            counts: selector.counts(),
        })
    }
}

/// The centre of a view.
pub(crate) fn center_of(view: &ModelView) -> Point3<f64> {
    Point3::from(view.world_from_camera.translation.vector)
}

/// Selects the points of a model, one by one.
pub(crate) struct PointSelector {
    model_views: Vec<ModelView>,
    options: PointModelOptions,
    sigma_factor: f64,
    counts: ModelCounts,
    views: Vec<u32>,
    depths: Vec<f64>,
}

impl PointSelector {
    pub(crate) fn new(
        model_views: Vec<ModelView>,
        options: &Options,
        statistics: ViewStatistics,
    ) -> Self {
        let mut point_model = options.point_model;
        if point_model.min_views == 0 {
            point_model.min_views = statistics.least_views(&model_views);
        }
        Self {
            model_views,
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
        let (all, views) = (&self.model_views, &mut self.views);
        let kept = (views, &mut self.depths, &mut self.counts);
        if !select_point(all, point, &self.options, kept) {
            return None;
        }
        let (position, views) = (point.point_in_world, &self.views);
        let seen_from = views.iter().map(|view| &all[*view as usize]);
        let seen = SeenPoint {
            position,
            color: point.color,
            views: views.clone(),
            sigma: sigma_along_rays(&position, seen_from.clone())
                .map(|sigma| self.sigma_factor * sigma),
            pixel: smallest_pixel(&position, seen_from),
        };
        Some((seen, &self.depths))
    }
}

/// Whether a point is carved. If so, `views` holds its views, and its depths are appended to `depths`.
pub(super) fn select_point(
    all: &[ModelView],
    point: &ModelPoint,
    options: &PointModelOptions,
    (views, depths, counts): (&mut Vec<u32>, &mut Vec<f64>, &mut ModelCounts),
) -> bool {
    views.clear();
    let position = point.point_in_world;
    if !position.iter().all(|x| x.is_finite()) {
        counts.not_finite += 1;
        return false;
    }
    let depths_before = depths.len();
    for observation in &point.observations {
        let view = &all[observation.view as usize];
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
        .map(|view| center_of(&all[*view as usize]))
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
        let ray = point - center_of(view);
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
fn smallest_pixel<'a>(
    point: &Point3<f64>,
    views: impl Iterator<Item = &'a ModelView>,
) -> Option<f64> {
    let sizes = views.filter_map(|view| {
        let ray = point - center_of(view);
        Some(ray.norm() / view.camera.as_ref()?.mean_focal_px())
    });
    sizes.min_by(f64::total_cmp)
}

/// Assumed standard deviation of the pixels of a model, which do not come with one.
const PIXEL_SIGMA_PX: f64 = 1.0;
