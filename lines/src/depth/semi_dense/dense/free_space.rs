//! Places that other keyframes look through: they measured a surface behind them.

use nalgebra::{Isometry3, Point2};

use super::warp::SurfaceView;
use crate::triangulation::SurfaceSample;

/// A surface lies behind a place when the inverse depths differ by more than this many standard deviations of their difference.
const GATE_SIGMAS: f64 = 2.5;

/// Keyframes with their surfaces, seen from a reference.
pub(super) struct FreeSpace<'a> {
    reference: SurfaceView<'a>,
    others: Vec<(SurfaceView<'a>, Isometry3<f64>)>,
}

impl<'a> FreeSpace<'a> {
    pub(super) fn new(reference: &SurfaceView<'a>, others: &[SurfaceView<'a>]) -> Self {
        let with_motion = |other: &SurfaceView<'a>| {
            let other_from_world = other.world_from_camera.inverse();
            (*other, other_from_world * reference.world_from_camera)
        };
        Self {
            reference: *reference,
            others: others.iter().map(with_motion).collect(),
        }
    }

    /// Number of keyframes that measured a surface behind a sample at a pixel of the reference.
    ///
    /// # Complexity
    /// One projection for each keyframe.
    pub(super) fn keyframes_behind(&self, pixel: &Point2<f64>, sample: &SurfaceSample) -> usize {
        let rho = f64::from(sample.rho);
        let Ok(point) = self.reference.camera.point_at_depth(pixel, 1.0 / rho) else {
            return 0;
        };
        let is_behind = |(other, other_from_reference): &&(SurfaceView<'a>, Isometry3<f64>)| {
            let point = other_from_reference * point;
            let Some(measured) = other
                .camera
                .project(&point)
                .and_then(|at| other.samples.near(&at))
            else {
                return false;
            };
            let here = point.z.recip();
            let sigma = f64::from(sample.sigma) * (here / rho).powi(2);
            let bound = GATE_SIGMAS * sigma.hypot(f64::from(measured.sigma));
            here - f64::from(measured.rho) > bound
        };
        self.others.iter().filter(is_behind).count()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::camera::Camera;
    use crate::triangulation::SurfaceSamples;

    #[test]
    fn keyframes_with_a_surface_behind_a_place_are_counted() {
        let camera = Camera::pinhole(150.0, 150.0, 80.0, 60.0).unwrap();
        // A wall two metres ahead of three cameras, of which one does not see its left half; the fourth looks the other way.
        let wall = |first_column: usize| {
            let sample = |index: usize| match index % 40 >= first_column {
                true => SurfaceSample {
                    rho: 0.5,
                    slope: [0.0; 2],
                    sigma: 0.005,
                },
                false => SurfaceSample::default(),
            };
            SurfaceSamples::new(4, 40, 30, (0..40 * 30).map(sample).collect())
        };
        let walls = [wall(0), wall(0), wall(20), wall(0)];
        let away = Isometry3::rotation(Vector3::new(0.0, std::f64::consts::PI, 0.0));
        let poses = [
            Isometry3::identity(),
            Isometry3::translation(0.1, 0.0, 0.0),
            Isometry3::translation(-0.1, 0.0, 0.0),
            away,
        ];
        let views = SurfaceView::from_poses(&walls, &camera, &poses);
        let free_space = FreeSpace::new(&views[0], &views[1..]);
        let behind = |x: f64, rho: f32| {
            let sample = SurfaceSample {
                rho,
                slope: [0.0; 2],
                sigma: 0.005,
            };
            free_space.keyframes_behind(&Point2::new(x, 60.0), &sample)
        };
        assert_eq!(behind(120.0, 0.8), 2);
        assert_eq!(behind(40.0, 0.8), 1);
        assert_eq!(behind(120.0, 0.51), 0, "on the wall");
        assert_eq!(behind(120.0, 0.3), 0, "behind the wall");
    }
}
