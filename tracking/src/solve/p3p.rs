//! Camera poses from three points.

use linecarve_lines::fit_similarity;
use nalgebra::{Isometry3, Matrix4, Point3, Unit, Vector3};

/// Largest imaginary part of a root, relative to its magnitude, that counts as rounding.
const MAX_IMAGINARY: f64 = 1e-6;

/// Poses `camera_from_world` in which three world points lie on three rays of the camera; at most four.
///
/// Distances along the rays follow from a quartic equation, whose roots are eigenvalues of its companion matrix; poses follow by
/// alignment. Degenerate points give no pose.
///
/// # Reference
/// Grunert's solution as in Haralick, Lee, Ottenberg, Noelle, "Review and analysis of solutions of the three point perspective pose
/// estimation problem", IJCV 13(3), 1994, equations 4 to 9.
pub(crate) fn perspective_three_point(
    world: &[Point3<f64>; 3],
    rays: &[Unit<Vector3<f64>>; 3],
) -> Vec<Isometry3<f64>> {
    let a2 = (world[1] - world[2]).norm_squared();
    let b2 = (world[0] - world[2]).norm_squared();
    let c2 = (world[0] - world[1]).norm_squared();
    if !(a2 > 0.0 && b2 > 0.0 && c2 > 0.0) {
        return Vec::new();
    }
    let cos_a = rays[1].dot(&rays[2]);
    let cos_b = rays[0].dot(&rays[2]);
    let cos_g = rays[0].dot(&rays[1]);
    let difference = (a2 - c2) / b2;
    let sum = (a2 + c2) / b2;
    let (a_b, c_b) = (a2 / b2, c2 / b2);
    let a4 = (difference - 1.0).powi(2) - 4.0 * c_b * cos_a * cos_a;
    let a3 = 4.0
        * (difference * (1.0 - difference) * cos_b - (1.0 - sum) * cos_a * cos_g
            + 2.0 * c_b * cos_a * cos_a * cos_b);
    let a2_ = 2.0
        * (difference * difference - 1.0
            + 2.0 * difference * difference * cos_b * cos_b
            + 2.0 * (1.0 - c_b) * cos_a * cos_a
            - 4.0 * sum * cos_a * cos_b * cos_g
            + 2.0 * (1.0 - a_b) * cos_g * cos_g);
    let a1 = 4.0
        * (-difference * (1.0 + difference) * cos_b + 2.0 * a_b * cos_g * cos_g * cos_b
            - (1.0 - sum) * cos_a * cos_g);
    let a0 = (1.0 + difference).powi(2) - 4.0 * a_b * cos_g * cos_g;
    let mut poses = Vec::new();
    for v in real_roots([a0, a1, a2_, a3, a4]) {
        let below = 2.0 * (cos_g - v * cos_a);
        let u =
            ((difference - 1.0) * v * v - 2.0 * difference * cos_b * v + 1.0 + difference) / below;
        let first = (b2 / (1.0 + v * v - 2.0 * v * cos_b)).sqrt();
        let distances = [first, u * first, v * first];
        if !distances.iter().all(|d| d.is_finite() && *d > 0.0) {
            continue;
        }
        let in_camera = [0, 1, 2].map(|i| Point3::from(rays[i].into_inner() * distances[i]));
        poses.extend(fit_similarity(world, &in_camera, false).map(|fit| fit.isometry));
    }
    poses
}

/// Real roots of a quartic, coefficients in ascending order.
fn real_roots([a0, a1, a2, a3, a4]: [f64; 5]) -> Vec<f64> {
    let largest = [a0, a1, a2, a3].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !largest.is_finite() || a4.abs() < 1e-12 * largest.max(1e-12) {
        return Vec::new();
    }
    let mut companion = Matrix4::zeros();
    for (row, coefficient) in [a0, a1, a2, a3].into_iter().enumerate() {
        companion[(row, 3)] = -coefficient / a4;
        if row > 0 {
            companion[(row, row - 1)] = 1.0;
        }
    }
    let Some(schur) = nalgebra::Schur::try_new(companion, f64::EPSILON, 200) else {
        return Vec::new();
    };
    schur
        .complex_eigenvalues()
        .iter()
        .filter(|root| root.im.abs() <= MAX_IMAGINARY * root.re.abs().max(1.0))
        .map(|root| root.re)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn one_of_the_poses_is_the_true_one() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut number = |scale: f64| random.random_range(-scale..scale);
        let mut found = 0;
        for _ in 0..200 {
            let pose = Isometry3::new(
                Vector3::new(number(1.0), number(1.0), number(1.0)),
                Vector3::new(number(1.5), number(1.5), number(1.5)),
            );
            let in_camera =
                [(); 3].map(|()| Point3::new(number(1.0), number(1.0), 2.5 + number(1.0)));
            let world = in_camera.map(|point| pose.inverse() * point);
            let rays = in_camera.map(|point| Unit::new_normalize(point.coords));
            let error = perspective_three_point(&world, &rays)
                .iter()
                .map(|other| (other.to_homogeneous() - pose.to_homogeneous()).norm())
                .fold(f64::INFINITY, f64::min);
            found += usize::from(error < 1e-4);
        }
        assert!(found >= 195, "{found} of 200");
    }

    #[test]
    fn equal_points_give_no_pose() {
        let point = Point3::new(0.0, 0.0, 2.0);
        let ray = Vector3::z_axis();
        assert!(perspective_three_point(&[point; 3], &[ray; 3]).is_empty());
    }
}
