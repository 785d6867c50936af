//! What the dense depth of a keyframe says about the map, and the points that it adds where the map lacks them.

use std::cmp::Ordering;

use linecarve_lines::camera::Camera;
use linecarve_lines::triangulation::{
    ImageTriangulation, ImageVertex, RefineOptions, SampleOptions, SurfaceSamples,
};
use nalgebra::{Isometry3, Point2, Point3, Unit};

use super::landmarks::Measurement;

/// Points between the segments, where depth is dense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePointOptions {
    /// Whether there are any; otherwise segments alone make the map.
    pub enabled: bool,
    /// A landmark is seen by a keyframe whose surface agrees with it within this many standard deviations; a surface that
    /// lies further behind contradicts it.
    pub agreement_sigmas: f64,
    /// Where the carved surface lies before what a keyframe measured by more than this many standard deviations, what the
    /// keyframe measured becomes a point, whose ray carves the surface away. Infinite: never.
    pub correction_sigmas: f64,
    /// How depth is sampled.
    pub samples: SampleOptions,
    /// How closely the triangulation of a keyframe follows the samples.
    pub refine: RefineOptions,
}

impl Default for SurfacePointOptions {
    fn default() -> Self {
        Self {
            enabled: true,
            agreement_sigmas: 3.0,
            correction_sigmas: 4.0,
            samples: SampleOptions::default(),
            refine: RefineOptions::default(),
        }
    }
}

/// A keyframe's surface, ready to be asked.
pub(super) struct KeyframeSurface<'a> {
    samples: &'a SurfaceSamples,
    camera: &'a Camera,
    world_from_camera: &'a Isometry3<f64>,
    camera_from_world: Isometry3<f64>,
    agreement_sigmas: f64,
}

/// What a keyframe says about a point of the map.
#[derive(Debug, Clone, Copy)]
pub(super) enum SurfaceCheck {
    /// Nothing: the point is outside the image, behind the surface, or where no surface was measured.
    Unknown,
    /// It measured the surface right there.
    Confirmed {
        /// Where the point is seen, with its own inverse depth.
        vertex: ImageVertex,
        /// The surface along the same ray.
        measurement: Measurement,
    },
    /// It measured a surface behind the point.
    Contradicted,
}

impl<'a> KeyframeSurface<'a> {
    /// The surface `samples` of a keyframe of `camera`.
    pub(super) fn new(
        samples: &'a SurfaceSamples,
        camera: &'a Camera,
        world_from_camera: &'a Isometry3<f64>,
        options: &SurfacePointOptions,
    ) -> Self {
        Self {
            samples,
            camera,
            world_from_camera,
            camera_from_world: world_from_camera.inverse(),
            agreement_sigmas: options.agreement_sigmas,
        }
    }

    /// A point of the world in the image; `None` when it is not before the camera.
    pub(super) fn vertex(&self, point_in_world: &Point3<f64>) -> Option<ImageVertex> {
        let point = self.camera_from_world * point_in_world;
        let pixel = self.camera.project(&point)?;
        Some(ImageVertex {
            pixel,
            rho: 1.0 / point.z,
        })
    }

    /// What the keyframe says about a point of the map.
    pub(super) fn check(&self, point_in_world: &Point3<f64>) -> SurfaceCheck {
        let Some(vertex) = self.vertex(point_in_world) else {
            return SurfaceCheck::Unknown;
        };
        let Some(sample) = self.samples.near(&vertex.pixel) else {
            return SurfaceCheck::Unknown;
        };
        let bound = self.agreement_sigmas * f64::from(sample.sigma);
        let nearer = vertex.rho - f64::from(sample.rho);
        if nearer > bound {
            return SurfaceCheck::Contradicted;
        }
        if nearer < -bound {
            return SurfaceCheck::Unknown;
        }
        match self.measurement(&vertex.pixel, sample.rho.into(), sample.sigma.into()) {
            Some(measurement) => SurfaceCheck::Confirmed {
                vertex,
                measurement,
            },
            None => SurfaceCheck::Unknown,
        }
    }

    /// The corners of a box of the world outside of which [`KeyframeSurface::check`] says nothing: it holds the pyramid from
    /// the camera to beyond the farthest sample. `None` when there is no such box, as a sample may lie at infinity.
    pub(super) fn bounds(&self) -> Option<[Point3<f64>; 2]> {
        let step = f64::from(self.samples.step_px());
        let (columns, rows) = (self.samples.columns(), self.samples.rows());
        let nearest = (0..rows)
            .flat_map(|row| (0..columns).filter_map(move |column| self.samples.get(column, row)))
            .map(|sample| {
                // The plane answers for pixels up to half a step away.
                let fall = step * f64::from(sample.slope[0].abs() + sample.slope[1].abs());
                f64::from(sample.rho) - fall - self.agreement_sigmas * f64::from(sample.sigma)
            })
            .fold(f64::INFINITY, f64::min);
        let depth = Some(1.0 / nearest).filter(|depth| *depth > 0.0 && depth.is_finite())?;
        // A frame of pixels around all samples. Between its rays and the camera lies all that they see.
        let (right, bottom) = (columns as f64 * step, rows as f64 * step);
        let along = |end: f64| {
            (-1..)
                .map(move |i| f64::from(i) * step)
                .take_while(move |at| *at <= end + step)
        };
        let frame = along(right)
            .flat_map(|x| [Point2::new(x, -step), Point2::new(x, bottom + step)])
            .chain(
                along(bottom).flat_map(|y| [Point2::new(-step, y), Point2::new(right + step, y)]),
            );
        let center = Point3::from(self.world_from_camera.translation.vector);
        let (mut low, mut high) = (center, center);
        for pixel in frame {
            let point = self.world_from_camera * self.camera.point_at_depth(&pixel, depth).ok()?;
            low = low.inf(&point);
            high = high.sup(&point);
        }
        Some([low, high])
    }

    /// Where a point of the world is seen, and how many standard deviations the surface that was measured there lies behind
    /// it; negative when it lies before it. `None` where nothing was measured.
    pub(super) fn depth_deviation(
        &self,
        point_in_world: &Point3<f64>,
    ) -> Option<(Point2<f64>, f64)> {
        let vertex = self.vertex(point_in_world)?;
        let sample = self.samples.near(&vertex.pixel)?;
        let nearer = vertex.rho - f64::from(sample.rho);
        Some((vertex.pixel, nearer / f64::from(sample.sigma)))
    }

    /// Whether a point of the world lies before the surface that was measured where it is seen, on it or behind it; `None` where
    /// nothing was measured.
    pub(super) fn compare_depth(&self, point_in_world: &Point3<f64>) -> Option<Ordering> {
        let (_, sigmas) = self.depth_deviation(point_in_world)?;
        Some(if sigmas > self.agreement_sigmas {
            Ordering::Less
        } else if sigmas < -self.agreement_sigmas {
            Ordering::Greater
        } else {
            Ordering::Equal
        })
    }

    /// The surface at a pixel.
    pub(super) fn measurement_at(&self, pixel: &Point2<f64>) -> Option<Measurement> {
        let sample = self.samples.near(pixel)?;
        self.measurement(pixel, sample.rho.into(), sample.sigma.into())
    }

    fn measurement(&self, pixel: &Point2<f64>, rho: f64, sigma: f64) -> Option<Measurement> {
        let point_in_camera = self.camera.point_at_depth(pixel, 1.0 / rho).ok()?;
        let point_in_world = self.world_from_camera * point_in_camera;
        let ray = self.world_from_camera.rotation * point_in_camera.coords;
        Some(Measurement {
            point_in_world,
            direction: Unit::try_new(ray, 0.0)?,
            pixel: 1.0 / (rho * self.camera.mean_focal_px()),
            // d z = d rho / rho^2; along the ray the length grows with its slant.
            sigma: sigma / rho * ray.norm(),
        })
    }

    /// Refines the triangulation of what the map holds, `vertices` with `lines` between them, until it follows the
    /// surface.
    pub(super) fn refine(
        &self,
        vertices: &[ImageVertex],
        lines: &[[u32; 2]],
        options: &RefineOptions,
    ) -> Vec<Option<Measurement>> {
        let mut triangulation = ImageTriangulation::new(vertices, lines);
        triangulation.refine(self.samples, options);
        let missing = triangulation.vertices()[vertices.len()..]
            .iter()
            .map(|vertex| {
                let sample = self.samples.near(&vertex.pixel)?;
                self.measurement(&vertex.pixel, vertex.rho, sample.sigma.into())
            })
            .collect();
        missing
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::depth::{InverseDepth, InverseDepthMap};

    use super::*;

    fn wall() -> (SurfaceSamples, Camera, Isometry3<f64>) {
        let mut map = InverseDepthMap::unknown(160, 120).unwrap();
        for (x, y) in (0..160).flat_map(|x| (0..120).map(move |y| (x, y))) {
            map.set(x, y, InverseDepth::new(0.5, 0.001));
        }
        let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5).unwrap();
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        (samples, camera, Isometry3::translation(1.0, 2.0, 3.0))
    }

    #[test]
    fn points_before_on_and_behind_a_wall() {
        let (samples, camera, pose) = wall();
        let options = SurfacePointOptions::default();
        let surface = KeyframeSurface::new(&samples, &camera, &pose, &options);
        let check = |x: f64, z: f64| surface.check(&Point3::new(1.0 + x, 2.0, 3.0 + z));
        let SurfaceCheck::Confirmed {
            vertex,
            measurement,
        } = check(0.1, 2.005)
        else {
            panic!("the point lies on the wall");
        };
        assert!((vertex.rho - 1.0 / 2.005).abs() < 1e-12);
        assert!((measurement.point_in_world.z - 5.0).abs() < 1e-6);
        // 0.001 / 0.25 along z, and a little more along the ray.
        assert!((measurement.sigma - 0.004).abs() < 1e-5);
        assert!(matches!(check(0.0, 1.9), SurfaceCheck::Contradicted));
        assert!(matches!(check(0.0, 2.1), SurfaceCheck::Unknown));
        assert!(matches!(check(0.0, -2.0), SurfaceCheck::Unknown));
        assert!(matches!(check(5.0, 2.0), SurfaceCheck::Unknown));
        assert!(matches!(check(f64::NAN, 2.0), SurfaceCheck::Unknown));
        // What is judged is within bounds, and little else.
        let [low, high] = surface.bounds().unwrap();
        assert!(low.z <= 3.0 && high.z > 5.01 && high.z < 5.1);
        for (x, bound) in [(-1.05, low.x), (1.05, high.x)] {
            assert!(matches!(check(x, 2.0), SurfaceCheck::Confirmed { .. }));
            assert!((1.0 + x - bound).abs() < 0.3 && (bound - 1.0).abs() > 1.15);
        }
    }

    #[test]
    fn an_unknown_wall_gets_points_and_a_known_one_none() {
        let (samples, camera, pose) = wall();
        let options = SurfacePointOptions::default();
        let surface = KeyframeSurface::new(&samples, &camera, &pose, &options);
        let refined = surface.refine(&[], &[], &options.refine);
        assert_eq!(refined.len(), 4 * 3);
        let missing: Vec<Measurement> = refined.into_iter().flatten().collect();
        assert!(
            missing
                .iter()
                .all(|m| (m.point_in_world.z - 5.0).abs() < 1e-5)
        );
        let known: Vec<ImageVertex> = missing
            .iter()
            .map(|m| surface.vertex(&m.point_in_world).unwrap())
            .collect();
        let again = surface.refine(&known, &[], &options.refine);
        assert!(again.is_empty());
    }
}
