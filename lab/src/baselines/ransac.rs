//! Lines by RANSAC in space: segments are detected in the image, and a line is fitted to the 3D points along each.

use std::time::Instant;

use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::decoupled::inverse_depth;
use super::image_segments::ImageSegments;
use super::line_detection::{LineDetectorOptions, LineSegment2d};
use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::edges::EdgeOptions;
use linecarve_lines::paper::line_of;

/// Settings of [`Ransac`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RansacOptions {
    /// Shorter image segments are left out.
    pub minimum_length_px: f64,
    /// A point is an inlier within this share of its depth from the line.
    pub tolerance: f64,
    /// Least share of the pixels along a segment with a point, and with one that is an inlier.
    pub minimum_inlier_share: f64,
    /// Smallest angle between a segment and the view rays of its ends; segments below it are left out.
    pub minimum_view_angle_rad: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for RansacOptions {
    /// The values of the decoupled baseline.
    fn default() -> Self {
        Self {
            minimum_length_px: 20.0,
            tolerance: 0.01,
            minimum_inlier_share: 0.3,
            minimum_view_angle_rad: 30.0_f64.to_radians(),
            seed: 1,
        }
    }
}

impl RansacOptions {
    fn validate(&self) -> Result<(), MethodError> {
        for (name, value, least) in [
            ("minimum_length_px", self.minimum_length_px, 0.0),
            ("tolerance", self.tolerance, f64::MIN_POSITIVE),
            ("minimum_inlier_share", self.minimum_inlier_share, 0.0),
            ("minimum_view_angle_rad", self.minimum_view_angle_rad, 0.0),
        ] {
            if !(value.is_finite() && value >= least) {
                return Err(MethodError::Option {
                    method: Method::Ransac,
                    name,
                    value,
                });
            }
        }
        Ok(())
    }
}

/// Lines by RANSAC in space. [`LineDetector`](super::LineDetector) finds segments in the image; the pixels along each with a depth
/// become points in space. RANSAC, with one iteration for each point, finds the line through two of them with most inliers; total least
/// squares refines it over the inliers. The ends are their outermost projections.
///
/// # Complexity
/// O(k^2) for k points along a segment.
///
/// # Reference
/// M. Fischler, R. Bolles, Random sample consensus, Communications of the ACM 24(6), 1981; Y. Nakayama, H. Saito, M. Shimizu,
/// N. Yamaguchi, 3D line segment based model generation by RGB-D camera for camera pose estimation, ACCV Workshops 2014.
///
/// *Differs from the papers*: the tolerance grows with depth; samples are seeded, so that runs repeat.
#[derive(Debug, Clone)]
pub struct Ransac {
    options: RansacOptions,
    segments: ImageSegments,
    points: Vec<Point3<f64>>,
}

impl Ransac {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        edges: EdgeOptions,
        detector: LineDetectorOptions,
        options: RansacOptions,
    ) -> Result<Self, MethodError> {
        options.validate()?;
        Ok(Self {
            options,
            segments: ImageSegments::new(edges, detector)?,
            points: Vec::new(),
        })
    }

    /// The segment in the camera; `None` when too few points agree on a line, or when it runs along the view ray.
    fn fit(
        &mut self,
        segment: &LineSegment2d,
        depth: &InverseDepthMap,
        keyframe: &PosedKeyframe<'_>,
        rng: &mut ChaCha8Rng,
    ) -> Option<[Point3<f64>; 2]> {
        let pixels = segment.length_px().ceil() as usize + 1;
        let along = segment.ends_px[1] - segment.ends_px[0];
        self.points.clear();
        for step in 0..pixels {
            let pixel = segment.ends_px[0] + along * (step as f64 / (pixels - 1).max(1) as f64);
            let rho = inverse_depth(depth, &pixel, 2.0 * self.options.tolerance);
            let point = rho.and_then(|rho| keyframe.camera.point_at_depth(&pixel, 1.0 / rho).ok());
            self.points.extend(point);
        }
        let least = (self.options.minimum_inlier_share * pixels as f64).max(3.0);
        if (self.points.len() as f64) < least {
            return None;
        }
        let count = self.points.len();
        let mut best: Option<(usize, [Point3<f64>; 2])> = None;
        for _ in 0..count {
            let line = [rng.random_range(0..count), rng.random_range(0..count)];
            let line = line.map(|index| self.points[index]);
            let inliers = self.inliers(&line).count();
            if best.is_none_or(|(most, _)| inliers > most) {
                best = Some((inliers, line));
            }
        }
        let mut line = best?.1;
        // Twice, as the inliers of the refined line differ from those of the sampled one.
        for _ in 0..2 {
            let inliers: Vec<Point3<f64>> = self.inliers(&line).copied().collect();
            if (inliers.len() as f64) < least {
                return None;
            }
            line = line_of(&inliers)?;
        }
        let direction = (line[1] - line[0]).try_normalize(0.0)?;
        let largest_cosine = self.options.minimum_view_angle_rad.cos();
        line.iter()
            .all(|end| direction.dot(&end.coords).abs() <= largest_cosine * end.coords.norm())
            .then_some(line)
    }

    /// The points within the tolerance of a line; none of two points that are the same.
    fn inliers(&self, line: &[Point3<f64>; 2]) -> impl Iterator<Item = &Point3<f64>> {
        let origin = line[0];
        let direction = (line[1] - line[0]).try_normalize(0.0);
        let tolerance = self.options.tolerance;
        self.points.iter().filter(move |point| {
            direction.is_some_and(|direction| {
                (**point - origin).cross(&direction).norm() <= tolerance * point.z
            })
        })
    }
}

impl LineMethod for Ransac {
    fn method(&self) -> Method {
        Method::Ransac
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let segments = self.segments.find(keyframe, findings);
        let start = Instant::now();
        // A stream for each keyframe: its samples do not depend on earlier keyframes.
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed);
        rng.set_stream(u64::from(keyframe.number));
        for segment in &segments {
            if segment.length_px() < self.options.minimum_length_px {
                continue;
            }
            if let Some(ends) = self.fit(segment, depth, keyframe, &mut rng) {
                findings.segments.push(FoundSegment {
                    ends_in_world: ends.map(|end| keyframe.world_from_camera * end),
                    keyframe: Some(keyframe.number),
                });
            }
        }
        findings.add_time("fit", start.elapsed());
        Ok(())
    }
}
