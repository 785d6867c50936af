//! Compares the map with the dense depth of a keyframe and finds missing points.

use std::cmp::Ordering;

use linecarve_lines::camera::Camera;
use linecarve_lines::triangulation::{
    ImageTriangulation, ImageVertex, RefineOptions, SurfaceSample, SurfaceSamples,
};
use nalgebra::{Isometry3, Point2, Point3, Unit, Vector2, Vector3};
use rustc_hash::FxHashSet;

use super::landmarks::Measurement;
use super::view_region::ViewRegion;
use crate::options::SurfacePointOptions;

/// The dense surface of a keyframe with its camera and pose.
pub(super) struct KeyframeSurface<'a> {
    samples: &'a SurfaceSamples,
    camera: &'a Camera,
    world_from_camera: &'a Isometry3<f64>,
    camera_from_world: Isometry3<f64>,
    agreement_sigmas: f64,
    /// Standard deviation of depth beyond the noise of the samples, as a share of the depth.
    disagreement: f64,
}

/// A plane that a keyframe measured near a point, in world coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeasuredPlane {
    /// Normal, towards the camera.
    pub normal: Unit<Vector3<f64>>,
    /// Distance of the plane from the point along the normal.
    pub distance: f64,
    /// Variance of that distance: of the depth, and of a pixel across the ray.
    pub variance: f64,
}

/// Least cosine between the normal of a surface and the direction to the camera. Depth at a grazing angle says little about it.
const LEAST_COSINE: f64 = 0.2;

/// Samples next to each other further apart than this, in standard deviations, lie on either side of a depth step.
const STEP_SIGMAS: f64 = 4.0;
/// Samples this many columns or rows from a depth step are near an outline: as far as points lie apart.
const OUTLINE_SAMPLES: usize = 2;

/// Tangent of the largest angle between the normal of a surface and the ray with which it faces the camera.
const LARGEST_TILT: f64 = 0.6;

/// A point of the map compared with the surface of a keyframe.
#[derive(Debug, Clone, Copy)]
pub(super) enum SurfaceCheck {
    /// No statement: outside the image, behind the surface, or where no surface was measured.
    Unknown,
    /// The surface agrees with the point.
    Confirmed {
        /// Projection of the point, with its inverse depth.
        vertex: ImageVertex,
        /// The surface along the same ray.
        measurement: Measurement,
    },
    /// The surface lies behind the point.
    Contradicted,
}

impl<'a> KeyframeSurface<'a> {
    /// The surface `samples` of a keyframe. Seen from other keyframes its depth is off by `disagreement`, a standard deviation as a
    /// share of the depth, beyond the noise of the samples.
    pub(super) fn new(
        samples: &'a SurfaceSamples,
        camera: &'a Camera,
        world_from_camera: &'a Isometry3<f64>,
        options: &SurfacePointOptions,
        disagreement: f64,
    ) -> Self {
        Self {
            samples,
            camera,
            world_from_camera,
            camera_from_world: world_from_camera.inverse(),
            agreement_sigmas: options.agreement_sigmas,
            disagreement,
        }
    }

    /// The depth is off by this standard deviation from now on, see [`new`](Self::new).
    pub(super) fn set_disagreement(&mut self, disagreement: f64) {
        self.disagreement = disagreement;
    }

    /// Projection of a world point; `None` when it is not in front of the camera.
    pub(super) fn vertex(&self, point_in_world: &Point3<f64>) -> Option<ImageVertex> {
        let point = self.camera_from_world * point_in_world;
        let pixel = self.camera.project(&point)?;
        Some(ImageVertex {
            pixel,
            rho: 1.0 / point.z,
        })
    }

    /// Standard deviation of the inverse depth of a sample, seen from another keyframe.
    fn sigma(&self, sample: &SurfaceSample) -> f64 {
        let own = f64::from(sample.sigma);
        let shared = self.disagreement * f64::from(sample.rho);
        // `hypot` is a call, once for each sample of a triangle.
        (own * own + shared * shared).sqrt()
    }

    /// Whether the surface at a sample faces the camera: a tilted one is at another depth when the pose is off across the ray.
    pub(super) fn is_head_on(&self, sample: &SurfaceSample) -> bool {
        let slope = sample.slope[0].hypot(sample.slope[1]);
        f64::from(slope) * self.camera.mean_focal_px() <= LARGEST_TILT * f64::from(sample.rho)
    }

    /// Samples `stride` apart along columns and rows, with their world points.
    pub(super) fn points(
        &self,
        stride: usize,
    ) -> impl Iterator<Item = (Point3<f64>, SurfaceSample)> + '_ {
        let columns = (stride / 2..self.samples.columns()).step_by(stride);
        let rows = (stride / 2..self.samples.rows()).step_by(stride);
        let places = rows.flat_map(move |row| columns.clone().map(move |column| (column, row)));
        places.filter_map(|(column, row)| self.point(column, row))
    }

    /// A sample with its world point.
    fn point(&self, column: usize, row: usize) -> Option<(Point3<f64>, SurfaceSample)> {
        let sample = self.samples.get(column, row)?;
        let pixel = self.samples.pixel(column, row);
        let depth = 1.0 / f64::from(sample.rho);
        let point = self.camera.point_at_depth(&pixel, depth).ok()?;
        Some((self.world_from_camera * point, sample))
    }

    /// Standard deviation of a sample's inverse depth, seen from another keyframe, as a share of it.
    pub(super) fn relative_sigma(&self, sample: &SurfaceSample) -> f64 {
        self.sigma(sample) / f64::from(sample.rho)
    }

    /// The samples near outlines, with their world points: within [`OUTLINE_SAMPLES`] of a depth step or of unknown depth along columns and
    /// rows.
    pub(super) fn points_at_outlines(
        &self,
    ) -> impl Iterator<Item = (Point3<f64>, SurfaceSample)> + '_ {
        let (columns, rows) = (self.samples.columns(), self.samples.rows());
        let mut is_near = self.steps();
        for _ in 0..OUTLINE_SAMPLES {
            is_near = dilated(&is_near, columns, rows);
        }
        let places = (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)));
        let near = places.zip(is_near).filter(|(_, is_near)| *is_near);
        near.filter_map(|((column, row), _)| self.point(column, row))
    }

    /// Whether there is a depth step or unknown depth beside each place of the grid, to the right or below, on either side.
    fn steps(&self) -> Vec<bool> {
        let (columns, rows) = (self.samples.columns(), self.samples.rows());
        let mut is_step = vec![false; columns * rows];
        let step_px = f64::from(self.samples.step_px());
        let is_apart = |from: Option<SurfaceSample>, to: Option<SurfaceSample>, axis: usize| {
            let (Some(from), Some(to)) = (from, to) else {
                return from.is_some() || to.is_some();
            };
            let slope = 0.5 * (f64::from(from.slope[axis]) + f64::from(to.slope[axis]));
            let expected = f64::from(from.rho) + step_px * slope;
            (expected - f64::from(to.rho)).abs() > STEP_SIGMAS * self.sigma(&from)
        };
        for row in 0..rows {
            for column in 0..columns {
                let here = self.samples.get(column, row);
                for (axis, [right, below]) in [[1, 0], [0, 1]].into_iter().enumerate() {
                    let (x, y) = (column + right, row + below);
                    if x < columns && y < rows && is_apart(here, self.samples.get(x, y), axis) {
                        is_step[row * columns + column] = true;
                        is_step[y * columns + x] = true;
                    }
                }
            }
        }
        is_step
    }

    /// Mean of some of the measured points, in world coordinates; `None` without any.
    pub(super) fn middle(&self) -> Option<Point3<f64>> {
        let mean = |stride| {
            let points = self.points(stride).map(|(point, _)| (point.coords, 1.0));
            let (sum, count) = points.reduce(|sum, point| (sum.0 + point.0, sum.1 + point.1))?;
            Some(Point3::from(sum / count))
        };
        // In small images all samples of the coarse grid may be unknown.
        [8, 1].into_iter().find_map(mean)
    }

    /// Whether the camera has a world point in its image, whatever is in front of it.
    pub(super) fn is_in_view(&self, point_in_world: &Point3<f64>) -> bool {
        let step = f64::from(self.samples.step_px());
        let size = [self.samples.columns(), self.samples.rows()].map(|count| count as f64 * step);
        self.vertex(point_in_world).is_some_and(|vertex| {
            (0.0..size[0]).contains(&vertex.pixel.x) && (0.0..size[1]).contains(&vertex.pixel.y)
        })
    }

    /// Projection of a world point and the surface along the same ray; `None` where nothing was measured.
    pub(super) fn look_up(
        &self,
        point_in_world: &Point3<f64>,
    ) -> Option<(ImageVertex, SurfaceSample)> {
        let vertex = self.vertex(point_in_world)?;
        Some((vertex, self.samples.near(&vertex.pixel)?))
    }

    /// Compares a point with the surface along the same ray, see [`look_up`](Self::look_up).
    pub(super) fn check(&self, vertex: ImageVertex, sample: &SurfaceSample) -> SurfaceCheck {
        let bound = self.agreement_sigmas * self.sigma(sample);
        let nearer = vertex.rho - f64::from(sample.rho);
        if nearer > bound {
            return SurfaceCheck::Contradicted;
        }
        if nearer < -bound {
            return SurfaceCheck::Unknown;
        }
        match self.measurement(&vertex.pixel, sample) {
            Some(measurement) => SurfaceCheck::Confirmed {
                vertex,
                measurement,
            },
            None => SurfaceCheck::Unknown,
        }
    }

    /// The region outside of which [`check`](Self::check) is `Unknown`: the pyramid from the camera to beyond the farthest sample.
    /// `None` when that is unbounded, as a sample may lie at infinity.
    pub(super) fn region(&self) -> Option<ViewRegion> {
        let step = f64::from(self.samples.step_px());
        let (columns, rows) = (self.samples.columns(), self.samples.rows());
        let nearest = (0..rows)
            .flat_map(|row| (0..columns).filter_map(move |column| self.samples.get(column, row)))
            .map(|sample| {
                // A sample's plane is used up to half a step away.
                let slope = step * f64::from(sample.slope[0].abs() + sample.slope[1].abs());
                f64::from(sample.rho) - slope - self.agreement_sigmas * self.sigma(&sample)
            })
            .fold(f64::INFINITY, f64::min);
        let depth = Some(1.0 / nearest).filter(|depth| *depth > 0.0 && depth.is_finite())?;
        // Pixels around all samples. Their rays enclose all that is measured.
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
        let frame: Option<Vec<_>> = frame
            .map(|pixel| self.camera.point_at_depth(&pixel, depth).ok())
            .collect();
        Some(ViewRegion::new(self.world_from_camera, &frame?))
    }

    /// Projection of a world point, and the signed distance of the measured surface behind it in standard deviations. `None`
    /// where nothing was measured.
    pub(super) fn depth_deviation(
        &self,
        point_in_world: &Point3<f64>,
    ) -> Option<(Point2<f64>, f64)> {
        let (vertex, sample) = self.look_up(point_in_world)?;
        let nearer = vertex.rho - f64::from(sample.rho);
        Some((vertex.pixel, nearer / self.sigma(&sample)))
    }

    /// Whether a world point lies in front of the measured surface (`Less`), on it or behind it; `None` where nothing was
    /// measured.
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

    /// The plane measured where a world point is seen, when it lies within `gate` standard deviations of the point along the
    /// ray and is not seen at a grazing angle.
    pub(super) fn plane_near(
        &self,
        point_in_world: &Point3<f64>,
        gate: f64,
    ) -> Option<MeasuredPlane> {
        let point = self.camera_from_world * point_in_world;
        let pixel = self.camera.project(&point)?;
        let sample = self.samples.near(&pixel)?;
        let rho = f64::from(sample.rho);
        // d z = d rho / rho^2.
        let sigma = self.sigma(&sample) / (rho * rho);
        if (1.0 / rho - point.z).abs() > gate * sigma {
            return None;
        }
        let measured = point * (1.0 / (point.z * rho));
        let neighbour = |offset: Vector2<f64>, slope: f32| {
            let depth = 1.0 / (rho + f64::from(slope));
            let neighbour = self.camera.point_at_depth(&(pixel + offset), depth).ok()?;
            Some(neighbour - measured)
        };
        let right = neighbour(Vector2::x(), sample.slope[0])?;
        let down = neighbour(Vector2::y(), sample.slope[1])?;
        // x right and y down: their product points away from the camera.
        let normal = Unit::try_new(-right.cross(&down), 0.0)?;
        let ray = point.coords / point.z;
        let along = normal.dot(&ray);
        let cosine = -along / ray.norm();
        let pixel_size = point.z / self.camera.mean_focal_px();
        (cosine >= LEAST_COSINE).then(|| MeasuredPlane {
            normal: self.world_from_camera.rotation * normal,
            distance: normal.dot(&(measured - point)),
            variance: (sigma * along).powi(2) + pixel_size.powi(2) * (1.0 - cosine * cosine),
        })
    }

    /// Centre of the camera, in world coordinates.
    pub(super) fn center(&self) -> Point3<f64> {
        self.world_from_camera.translation.vector.into()
    }

    fn measurement(&self, pixel: &Point2<f64>, sample: &SurfaceSample) -> Option<Measurement> {
        let (rho, sigma) = (f64::from(sample.rho), self.sigma(sample));
        let point_in_camera = self.camera.point_at_depth(pixel, 1.0 / rho).ok()?;
        let point_in_world = self.world_from_camera * point_in_camera;
        let ray = self.world_from_camera.rotation * point_in_camera.coords;
        Some(Measurement {
            point_in_world,
            direction: Unit::try_new(ray, 0.0)?,
            pixel: 1.0 / (rho * self.camera.mean_focal_px()),
            // d z = d rho / rho^2, scaled to the length of the ray.
            sigma: sigma / rho * ray.norm(),
        })
    }

    /// Refines a triangulation of `vertices`, of the first in each square of the minimum distance, until it follows the surface. Returns
    /// the added points.
    pub(super) fn refine(
        &self,
        vertices: &[ImageVertex],
        options: &RefineOptions,
    ) -> Vec<Measurement> {
        let square = |along: f64| (along / options.minimum_distance_px) as i64;
        let mut taken = FxHashSet::default();
        let is_first = |vertex: &&ImageVertex| taken.insert(vertex.pixel.coords.map(square));
        let thinned: Vec<ImageVertex> = vertices.iter().filter(is_first).copied().collect();
        let mut triangulation = ImageTriangulation::new(&thinned);
        let mut options = *options;
        options.relative_error = self.disagreement;
        let added = triangulation.refine(self.samples, &options);
        let added = added.iter().filter_map(|vertex| {
            let sample = self.samples.near(&vertex.pixel)?;
            self.measurement(&vertex.pixel, &sample)
        });
        added.collect()
    }
}

/// Places of a grid with their neighbours along columns and rows.
fn dilated(is_in: &[bool], columns: usize, rows: usize) -> Vec<bool> {
    let mut dilated = is_in.to_vec();
    for (place, _) in is_in.iter().enumerate().filter(|(_, is_in)| **is_in) {
        let (column, row) = (place % columns, place / columns);
        if column > 0 {
            dilated[place - 1] = true;
        }
        if column + 1 < columns {
            dilated[place + 1] = true;
        }
        if row > 0 {
            dilated[place - columns] = true;
        }
        if row + 1 < rows {
            dilated[place + columns] = true;
        }
    }
    dilated
}

#[cfg(test)]
mod tests {
    use linecarve_lines::depth::{InverseDepth, InverseDepthMap};

    use super::*;
    use linecarve_lines::triangulation::SampleOptions;

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
        let surface = KeyframeSurface::new(&samples, &camera, &pose, &options, 0.0);
        let check = |x: f64, z: f64| {
            let found = surface.look_up(&Point3::new(1.0 + x, 2.0, 3.0 + z));
            found.map_or(SurfaceCheck::Unknown, |(vertex, sample)| {
                surface.check(vertex, &sample)
            })
        };
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
        // The region is tight.
        let region = surface.region().unwrap();
        let holds = |x: f64, z: f64| region.holds(&[1.0 + x, 2.0, 3.0 + z]);
        assert!(holds(0.0, 2.007) && !holds(0.0, 2.1) && !holds(0.0, -0.1));
        for x in [-1.05, 1.05] {
            assert!(matches!(check(x, 2.0), SurfaceCheck::Confirmed { .. }));
            assert!(holds(x, 2.0) && !holds(1.3 * x, 2.0) && !holds(x, 1.5));
        }
    }

    #[test]
    fn the_middle_is_that_of_the_few_samples_of_a_small_image() {
        let mut map = InverseDepthMap::unknown(36, 36).unwrap();
        for (x, y) in (0..36).flat_map(|x| (0..9).map(move |y| (x, y))) {
            map.set(x, y, InverseDepth::new(0.5, 0.001));
        }
        let camera = Camera::pinhole(40.0, 40.0, 17.5, 17.5).unwrap();
        let pose = Isometry3::translation(0.0, 0.0, 1.0);
        let options = SurfacePointOptions::default();
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        let surface = KeyframeSurface::new(&samples, &camera, &pose, &options, 0.0);
        assert_eq!(surface.points(8).count(), 0);
        let middle = surface.middle().unwrap();
        assert!((middle.z - 3.0).abs() < 1e-5 && middle.y < -0.3, "{middle}");
        let unknown = SurfaceSamples::default();
        let surface = KeyframeSurface::new(&unknown, &camera, &pose, &options, 0.0);
        assert_eq!(surface.middle(), None);
    }

    #[test]
    fn refinement_adds_points_only_where_they_are_missing() {
        let (samples, camera, pose) = wall();
        let options = SurfacePointOptions::default();
        let surface = KeyframeSurface::new(&samples, &camera, &pose, &options, 0.0);
        let refined = surface.refine(&[], &options.refine);
        // One in each square of 24 pixels.
        assert_eq!(refined.len(), 7 * 5);
        assert!(
            refined
                .iter()
                .all(|m| (m.point_in_world.z - 5.0).abs() < 1e-5)
        );
        let known: Vec<ImageVertex> = refined
            .iter()
            .map(|m| surface.vertex(&m.point_in_world).unwrap())
            .collect();
        assert!(surface.refine(&known, &options.refine).is_empty());
        // A second vertex in the same square is left out, even one that is off the surface.
        let beside = |vertex: &ImageVertex, by: f64, rho: f64| ImageVertex {
            pixel: vertex.pixel.map(|along| along.round() + by),
            rho,
        };
        let first = known.iter().map(|it| beside(it, 0.25, it.rho));
        let second = known.iter().map(|it| beside(it, 0.5, 1.1 * it.rho));
        let both: Vec<ImageVertex> = first.chain(second).collect();
        assert!(surface.refine(&both, &options.refine).is_empty());
    }
}
