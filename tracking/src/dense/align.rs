//! Alignment of two depth images.

use linecarve_lines::upper_median;
use nalgebra::{Isometry3, Matrix3, Matrix6, SymmetricEigen, Vector3, Vector6};

use super::view::DenseSurface;
use crate::camera::moved;

/// Every so many pixels along either axis are aligned.
const STRIDE: usize = 2;

/// Largest distance from the plane of the other image, as a share of the depth, in the first steps and in the last ones.
const GATES: [f32; 2] = [0.1, 0.03];

/// Steps with the first gate.
const FIRST_STEPS: usize = 3;

/// Largest number of steps.
const STEPS: usize = 12;

/// A step below this length (share of the depth, radians) is the last.
const LAST_STEP: f64 = 2e-5;

/// Cosine of the largest angle between the planes of two pixels that are the same surface.
const MIN_NORMAL_COSINE: f32 = 0.85;

/// Scale of Cauchy's kernel in standard deviations.
const ROBUST_SIGMAS: f32 = 2.5;

/// Fewest pixels that determine a motion.
const MIN_PIXELS: usize = 300;

/// Directions (translations relative to the depth, rotations) whose information is below this multiple of what noise of the planes
/// makes of a single wall, or below this share of the largest, are taken to be undetermined.
const UNDETERMINED_NOISE: f64 = 1.5;
const UNDETERMINED_SHARE: f64 = 1e-4;

/// Motion between the cameras of two depth images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alignment {
    pub(crate) target_from_source: Isometry3<f64>,
    /// Information about a small motion of points in the target (translation, then rotation), if the pixels erred independently.
    /// Zero along what the surfaces leave open.
    pub(crate) information: Matrix6<f64>,
    /// Number of directions that the surfaces determine: 6 for all, 3 for a single wall.
    pub(crate) determined: usize,
    /// Share of the pixels inside the other image that lie on its surface.
    pub(crate) agreeing: f64,
    /// Share of all pixels that lie on the surface of the other image.
    pub(crate) overlap: f64,
}

/// Finds the motion between two depth images from one that is nearly right; `None` when they have too little in common.
///
/// Minimises the distances of the pixels of either image from the planes at the pixels of the other where they are seen,
/// in standard deviations, by Gauss-Newton with Cauchy's weights. The scale of the noise is estimated. `depth` is the length
/// against which translations are compared with rotations.
///
/// # Complexity
/// Linear in the pixels, for at most twelve steps.
///
/// # Reference
/// Chen and Medioni, "Object modelling by registration of multiple range images", 1992; Blais and Levine, "Registering multiview
/// range data to create 3D computer objects", PAMI 1995 (projective association). *Differs:* both images play both parts, so that
/// noise of the planes prefers neither direction of the motion.
pub(crate) fn align(
    source: &DenseSurface,
    target: &DenseSurface,
    depth: f64,
    start: &Isometry3<f64>,
) -> Option<Alignment> {
    let mut pose = *start;
    let mut noise = 1.0;
    for step in 0..STEPS {
        let gate = GATES[usize::from(step >= FIRST_STEPS)];
        let sums = Sums::of([source, target], &pose, gate, noise)?;
        noise = sums.noise;
        let motion = Directions::of(&sums, depth).solve(&-sums.gradient);
        if !motion.iter().all(|value| value.is_finite()) {
            return None;
        }
        pose = moved(&pose, &motion);
        let length = motion.fixed_rows::<3>(0).norm() / depth + motion.fixed_rows::<3>(3).norm();
        if step > FIRST_STEPS && length < LAST_STEP {
            break;
        }
    }
    let mut sums = Sums::of([source, target], &pose, GATES[1], noise)?;
    let scale = f64::from(sums.noise);
    sums.noise_of_planes *= scale * scale;
    let directions = Directions::of(&sums, depth);
    Some(Alignment {
        target_from_source: pose,
        information: directions.information() / (scale * scale),
        determined: directions.count(),
        agreeing: sums.used as f64 / sums.seen as f64,
        overlap: sums.used as f64 / sums.all as f64,
    })
}

/// Normal equations of a step, and counts of pixels.
struct Sums {
    normal: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Information along a wall that noise of its planes makes.
    noise_of_planes: f64,
    /// Absolute errors of the pixels that agree, in standard deviations.
    errors: Vec<f32>,
    /// Standard deviation of the errors, in those expected.
    noise: f32,
    used: usize,
    seen: usize,
    all: usize,
}

impl Sums {
    /// `None` when too few pixels agree.
    fn of(
        [source, target]: [&DenseSurface; 2],
        target_from_source: &Isometry3<f64>,
        gate: f32,
        noise: f32,
    ) -> Option<Self> {
        let mut sums = Self {
            normal: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            noise_of_planes: 0.0,
            errors: Vec::new(),
            noise: 1.0,
            used: 0,
            seen: 0,
            all: 0,
        };
        sums.add(source, target, target_from_source, gate, noise, false);
        sums.add(
            target,
            source,
            &target_from_source.inverse(),
            gate,
            noise,
            true,
        );
        if sums.used < MIN_PIXELS {
            return None;
        }
        sums.noise = noise_of(&mut sums.errors);
        Some(sums)
    }

    /// Adds the pixels of `from` against the planes of `to`; `is_back` when `to` is the source of the motion.
    fn add(
        &mut self,
        from: &DenseSurface,
        to: &DenseSurface,
        to_from: &Isometry3<f64>,
        gate: f32,
        noise: f32,
        is_back: bool,
    ) {
        let rotation: Matrix3<f32> = to_from.rotation.to_rotation_matrix().matrix().cast();
        let shift: Vector3<f32> = to_from.translation.vector.cast();
        for y in (0..from.height).step_by(STRIDE) {
            for x in (0..from.width).step_by(STRIDE) {
                let at = y * from.width + x;
                let plane = &from.planes[at];
                if *plane == Vector3::zeros() {
                    continue;
                }
                self.all += 1;
                let point = &from.points[at];
                let moved = rotation * point + shift;
                let Some(there) = to.pixel_of(&moved) else {
                    continue;
                };
                let other = &to.planes[there];
                if *other == Vector3::zeros() {
                    continue;
                }
                self.seen += 1;
                let error = 1.0 - other.dot(&moved);
                let turned = rotation * plane;
                let cosine = turned.dot(other);
                let bound = MIN_NORMAL_COSINE
                    * MIN_NORMAL_COSINE
                    * turned.norm_squared()
                    * other.norm_squared();
                if error.abs() > gate || cosine <= 0.0 || cosine * cosine < bound {
                    continue;
                }
                let variance = from.variances[at] + to.variances[there];
                let scaled = error / variance.sqrt();
                self.used += 1;
                self.errors.push(scaled.abs());
                let robust = scaled / (ROBUST_SIGMAS * noise);
                let weight = 1.0 / ((1.0 + robust * robust) * variance);
                self.noise_of_planes += f64::from(weight * to.slope_variances[there]);
                // By a small motion of points in the target.
                let (normal, arm) = match is_back {
                    false => (-other, moved),
                    true => (rotation.tr_mul(other), *point),
                };
                let turn = arm.cross(&normal);
                let row = [normal.x, normal.y, normal.z, turn.x, turn.y, turn.z];
                for i in 0..6 {
                    let weighted = weight * row[i];
                    self.gradient[i] += f64::from(weighted * error);
                    for (j, value) in row.iter().enumerate().take(i + 1) {
                        self.normal[(i, j)] += f64::from(weighted * value);
                    }
                }
            }
        }
        self.normal.fill_upper_triangle_with_lower_triangle();
    }
}

/// Standard deviation of errors by their median, in those expected; at least one.
fn noise_of(errors: &mut [f32]) -> f32 {
    let median = upper_median(errors, f32::total_cmp);
    median.map_or(1.0, |median| (1.4826 * median).max(1.0))
}

/// Directions of motion that normal equations determine.
struct Directions {
    eigen: SymmetricEigen<f64, nalgebra::Const<6>>,
    /// Information along each, 0 where it is undetermined.
    values: Vector6<f64>,
    /// Unit of each coordinate.
    units: Vector6<f64>,
}

impl Directions {
    fn of(sums: &Sums, depth: f64) -> Self {
        let units = Vector6::new(depth, depth, depth, 1.0, 1.0, 1.0);
        let scale = Matrix6::from_diagonal(&units);
        let eigen = SymmetricEigen::new(scale * sums.normal * scale);
        let bound = (UNDETERMINED_NOISE * depth * depth * sums.noise_of_planes)
            .max(UNDETERMINED_SHARE * eigen.eigenvalues.max());
        let values = eigen
            .eigenvalues
            .map(|value| if value > bound { value - bound } else { 0.0 });
        Self {
            eigen,
            values,
            units,
        }
    }

    fn count(&self) -> usize {
        self.values.iter().filter(|value| **value > 0.0).count()
    }

    fn information(&self) -> Matrix6<f64> {
        let vectors = self.vectors(|unit| 1.0 / unit);
        vectors * Matrix6::from_diagonal(&self.values) * vectors.transpose()
    }

    /// The shortest solution of the normal equations along the determined directions.
    fn solve(&self, right: &Vector6<f64>) -> Vector6<f64> {
        let vectors = self.vectors(|unit| unit);
        let along = vectors.tr_mul(right);
        let inverse = self.values.zip_map(&self.eigen.eigenvalues, |kept, value| {
            if kept > 0.0 { 1.0 / value } else { 0.0 }
        });
        vectors * along.component_mul(&inverse)
    }

    fn vectors(&self, scale: impl Fn(f64) -> f64) -> Matrix6<f64> {
        Matrix6::from_diagonal(&self.units.map(scale)) * self.eigen.eigenvectors
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pinhole;
    use crate::dense::DenseView;
    use linecarve_lines::camera::Camera;
    use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};

    /// What a camera sees of planes `n . x = d`: the nearest in front, with noise of the inverse depth.
    fn surface(planes: &[(Vector3<f64>, f64)], pose: &Isometry3<f64>, seed: u64) -> DenseSurface {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let camera = Camera::pinhole(250.0, 250.0, 159.5, 119.5).unwrap();
        let camera = Pinhole::new(&camera, 320, 240);
        let mut map = InverseDepthMap::unknown(320, 240).unwrap();
        let center = pose.inverse_transform_point(&Point3::origin()).coords;
        for at in 0..320 * 240 {
            let pixel = nalgebra::Point2::new((at % 320) as f64, (at / 320) as f64);
            let ray = pose.inverse() * camera.ray(&pixel);
            let rho = planes
                .iter()
                .map(|(normal, offset)| normal.dot(&ray) / (offset - normal.dot(&center)))
                .fold(0.0, f64::max);
            let noisy = rho + random.random_range(-2e-3..2e-3);
            map.set(at % 320, at / 320, InverseDepth::new(noisy as f32, 1.2e-3));
        }
        DenseView::new(&map).surface(&camera)
    }

    fn motion() -> Isometry3<f64> {
        Isometry3::new(
            Vector3::new(0.05, -0.03, 0.04),
            Vector3::new(0.02, -0.03, 0.02),
        )
    }

    #[test]
    fn the_motion_before_a_corner_is_found() {
        let planes = [
            (Vector3::z(), 2.5),
            (Vector3::new(0.8, 0.0, 0.6), 1.9),
            (Vector3::new(0.0, 0.7, 0.714), 2.0),
        ];
        let from = surface(&planes, &Isometry3::identity(), 1);
        let to = surface(&planes, &motion(), 2);
        let found = align(&from, &to, from.depth, &Isometry3::identity()).unwrap();
        let error = found.target_from_source * motion().inverse();
        assert!(error.translation.vector.norm() < 1e-3, "{error}");
        assert!(error.rotation.angle() < 1e-3, "{error}");
        assert_eq!(found.determined, 6);
        assert!(found.agreeing > 0.9 && found.overlap > 0.7);
        // Too far away, nothing agrees.
        let far = Isometry3::translation(0.0, 0.0, -1.0);
        assert!(align(&from, &to, from.depth, &far).is_none_or(|one| one.agreeing < 0.5));
        let back = align(&to, &from, to.depth, &Isometry3::identity()).unwrap();
        let there_and_back = back.target_from_source * found.target_from_source;
        assert!(there_and_back.translation.vector.norm() < 2e-4);
    }

    #[test]
    fn a_single_wall_leaves_three_directions_open() {
        let planes = [(Vector3::z(), 2.0)];
        let from = surface(&planes, &Isometry3::identity(), 1);
        let to = surface(&planes, &motion(), 2);
        let found = align(&from, &to, from.depth, &Isometry3::identity()).unwrap();
        assert_eq!(found.determined, 3);
        // Slides along the wall, and turns about its normal, carry no information.
        let normal = found.target_from_source.rotation * Vector3::z();
        let along = normal.cross(&Vector3::x()).normalize();
        let slide = Vector6::new(along.x, along.y, along.z, 0.0, 0.0, 0.0);
        let across = Vector6::new(normal.x, normal.y, normal.z, 0.0, 0.0, 0.0);
        let of = |motion: &Vector6<f64>| motion.dot(&(found.information * motion));
        assert!(
            of(&slide) < 1e-3 * of(&across),
            "{} {}",
            of(&slide),
            of(&across)
        );
    }

    #[test]
    fn images_without_depth_have_no_motion() {
        let nothing = DenseView::new(&InverseDepthMap::unknown(320, 240).unwrap());
        let camera = Camera::pinhole(250.0, 250.0, 159.5, 119.5).unwrap();
        let nothing = nothing.surface(&Pinhole::new(&camera, 320, 240));
        assert!(align(&nothing, &nothing, 1.0, &Isometry3::identity()).is_none());
        let empty = DenseSurface::default();
        assert!(align(&empty, &nothing, 1.0, &Isometry3::identity()).is_none());
    }
}
