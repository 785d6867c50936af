//! Main directions: three at right angles, which planes keep when their covariance allows it.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

use crate::estimate::Measured;
use crate::plane::Plane;

/// Planes within this angle of a main direction decide about it: radians.
const NEAR: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// A plane keeps its own normal when chi-square, with two degrees of freedom, is larger: 1 % of true ones are.
const CHI_SQUARE: f64 = 9.21;

/// Three main directions at right angles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Directions {
    /// The axes; the third one is up.
    pub(crate) axes: [Vector3<f64>; 3],
    /// Covariance of a small rotation of all three.
    pub(crate) covariance: Matrix3<f64>,
}

/// The direction among the axes and their opposites that is nearest to a normal.
fn nearest(axes: &[Vector3<f64>; 3], normal: &Vector3<f64>) -> Vector3<f64> {
    let signed = axes.map(|axis| if axis.dot(normal) < 0.0 { -axis } else { axis });
    let [a, b, c] = signed;
    let larger =
        |a: Vector3<f64>, b: Vector3<f64>| if b.dot(normal) > a.dot(normal) { b } else { a };
    larger(larger(a, b), c)
}

/// The main directions of planes, given their areas and a direction that is about up: the largest plane that faces about up or down, and
/// the largest plane at a right angle to it, adjusted to all planes near the three directions by weighted least squares. `None` without two such planes.
pub(crate) fn directions(
    planes: &[Measured],
    areas: &[f64],
    up: &Vector3<f64>,
) -> Option<Directions> {
    let largest = |fits: &dyn Fn(&Vector3<f64>) -> bool| {
        let numbers = (0..planes.len()).filter(|it| fits(&planes[*it].plane.normal));
        // Planes in one direction support each other.
        let support = |it: &usize| {
            let normal = planes[*it].plane.normal;
            let parallel = planes.iter().zip(areas);
            let parallel =
                parallel.filter(|(it, _)| it.plane.normal.dot(&normal).abs() > NEAR.cos());
            parallel.map(|it| it.1).sum::<f64>()
        };
        let best = numbers.max_by(|a, b| support(a).total_cmp(&support(b)).then(b.cmp(a)));
        best.map(|it| planes[it].plane.normal)
    };
    let vertical = largest(&|normal| normal.dot(up).abs() > 25.0_f64.to_radians().cos())?;
    let vertical = if vertical.dot(up) < 0.0 {
        -vertical
    } else {
        vertical
    };
    let level = largest(&|normal| normal.dot(&vertical).abs() < NEAR.sin())?;
    let level = (level - level.dot(&vertical) * vertical).normalize();
    let mut axes = [level, vertical.cross(&level), vertical];
    let mut covariance = Matrix3::zeros();
    for _ in 0..8 {
        let mut normal_matrix = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for measured in planes {
            let normal = measured.plane.normal;
            let axis = nearest(&axes, &normal);
            if axis.dot(&normal) < NEAR.cos() {
                continue;
            }
            // Turning the frame by w moves the axis by w x axis; only the directions across the normal are measured.
            let Some(weight) = measured.slopes().try_inverse() else {
                continue;
            };
            let [u, v] = measured.plane.axes();
            let off = normal - axis;
            let rows = [u, v].map(|direction| axis.cross(&direction));
            let residual = Vector2::new(u.dot(&off), v.dot(&off));
            // Planes that contradict the others, or are hardly measured, do not decide.
            let chi = (residual.transpose() * weight * residual)[0];
            let robust = (CHI_SQUARE / chi).min(1.0);
            let jacobian = nalgebra::Matrix2x3::from_rows(&rows.map(|it| it.transpose()));
            normal_matrix += robust * jacobian.transpose() * weight * jacobian;
            right += robust * jacobian.transpose() * weight * residual;
        }
        covariance = normal_matrix.try_inverse()?;
        let turn = covariance * right;
        let rotation = Rotation3::new(turn);
        axes = axes.map(|axis| rotation * axis);
    }
    Some(Directions { axes, covariance })
}

/// The plane with its normal in a main direction, when the data allow it.
pub(crate) fn align(measured: &Measured, directions: &Directions) -> Option<Plane> {
    let axis = nearest(&directions.axes, &measured.plane.normal);
    let off = axis - measured.plane.normal;
    let [u, v] = measured.plane.axes();
    let residual = Vector2::new(u.dot(&off), v.dot(&off));
    let chi = (residual.transpose() * measured.slopes().try_inverse()? * residual)[0];
    (axis.dot(&measured.plane.normal) >= NEAR.cos() && chi <= CHI_SQUARE)
        .then(|| Plane::new(axis, measured.plane.center))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// A plane with this normal, whose slopes have this standard deviation.
    fn plane(normal: Vector3<f64>, sigma: f64) -> Measured {
        Measured {
            plane: Plane::new(normal, Point3::origin()),
            covariance: Matrix3::from_diagonal_element(sigma * sigma),
            rms: 0.0,
        }
    }

    #[test]
    fn planes_within_their_deviations_take_the_main_directions() {
        let turn = Rotation3::from_euler_angles(0.2, 0.1, 0.4);
        let tilt = |x: f64, y: f64| Rotation3::new(Vector3::new(x, y, 0.0));
        let planes = [
            plane(turn * Vector3::z(), 1e-3),
            plane(turn * (tilt(1.5e-3, 0.0) * Vector3::y()), 1e-3),
            plane(turn * (tilt(0.0, -1e-3) * -Vector3::x()), 1e-3),
            // Five degrees off, and a hundred deviations off.
            plane(turn * (tilt(0.087, 0.0) * Vector3::y()), 1e-3),
            plane(turn * (tilt(0.02, 0.0) * Vector3::y()), 2e-4),
        ];
        let areas = [9.0, 8.0, 7.0, 1.0, 1.0];
        let found = directions(&planes, &areas, &(turn * Vector3::new(0.2, 0.1, 1.0))).unwrap();
        assert!(found.axes[2].dot(&(turn * Vector3::z())) > 0.99999);
        for pair in [(0, 1), (1, 2), (2, 0)] {
            assert!(found.axes[pair.0].dot(&found.axes[pair.1]).abs() < 1e-12);
        }
        let aligned = planes.each_ref().map(|it| align(it, &found).is_some());
        assert_eq!(aligned, [true, true, true, false, false]);
        // Two planes at a right angle are not enough when none is level.
        assert!(directions(&planes[1..3], &areas[1..3], &(turn * Vector3::z())).is_none());
    }
}
