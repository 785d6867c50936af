//! The frame of a glTF file, whose y axis points up.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

/// An up direction within this angle of an axis is that axis: worlds are made with an axis up, and cameras are held a little askew.
const SNAP_DEG: f64 = 25.0;

/// Where a glTF file has its origin and its axes in the original frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GltfFrame {
    /// Subtracted from all positions.
    pub origin: Vector3<f64>,
    /// Rotation of the axes: `direction_in_gltf = gltf_from_original * direction_in_original`.
    pub gltf_from_original: Rotation3<f64>,
}

impl GltfFrame {
    /// The frame whose y axis is an up direction of the original frame. An up direction near an axis, see [`snapped_up`], permutes and
    /// negates coordinates and rounds none.
    pub fn upright(origin: Vector3<f64>, up: &Vector3<f64>) -> Self {
        let up = snapped_up(up);
        let nearest = axis_near(&up);
        let of_axis = Rotation3::from_matrix_unchecked(y_from_axis(&nearest));
        let turned = of_axis * up;
        let gltf_from_original = if nearest == up {
            of_axis
        } else {
            Rotation3::rotation_between(&turned, &Vector3::y()).unwrap_or_default() * of_axis
        };
        Self {
            origin,
            gltf_from_original,
        }
    }

    /// Up in the original frame.
    pub fn up(&self) -> Vector3<f64> {
        self.gltf_from_original.inverse() * Vector3::y()
    }
}

impl From<&Vector3<f64>> for GltfFrame {
    /// A frame with an origin and the axes of a camera, whose y axis points down.
    fn from(origin: &Vector3<f64>) -> Self {
        Self::upright(*origin, &-Vector3::y())
    }
}

/// The origin for files in single precision: the middle of the points in whole units where they lie far from zero for their size, else zero.
pub fn far_origin(points: &[Point3<f64>]) -> Vector3<f64> {
    let Some(first) = points.first() else {
        return Vector3::zeros();
    };
    let (low, high) = points.iter().fold((*first, *first), |(low, high), point| {
        (low.inf(point), high.sup(point))
    });
    let middle = nalgebra::center(&low, &high).coords;
    if middle.amax() > 1000.0 * (high - low).amax() {
        middle.map(f64::round)
    } else {
        Vector3::zeros()
    }
}

/// An up direction as a unit vector: the axis of the frame that is within 25 degrees, else the direction itself. -y without a direction.
pub fn snapped_up(up: &Vector3<f64>) -> Vector3<f64> {
    let Some(up) = up.try_normalize(1e-12) else {
        return -Vector3::y();
    };
    let nearest = axis_near(&up);
    match nearest.dot(&up) >= SNAP_DEG.to_radians().cos() {
        true => nearest,
        false => up,
    }
}

/// The axis of the frame, or its negative, nearest to a direction.
fn axis_near(direction: &Vector3<f64>) -> Vector3<f64> {
    let axis = direction.iamax();
    let mut nearest = Vector3::zeros();
    nearest[axis] = if direction[axis] < 0.0 { -1.0 } else { 1.0 };
    nearest
}

/// The rotation that makes an axis up, without rounding.
fn y_from_axis(axis: &Vector3<f64>) -> Matrix3<f64> {
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let rows = match axis.iamax() {
        // The directions that glTF's x and y have; z completes the frame.
        0 => [-axis.x * y, axis.x * x],
        1 => [x, axis.y * y],
        _ => [x, axis.z * z],
    };
    let third = rows[0].cross(&rows[1]);
    // Adding zero turns -0 into 0.
    Matrix3::from_rows(&[rows[0].transpose(), rows[1].transpose(), third.transpose()])
        .map(|value| value + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_up_becomes_y() {
        for up in [
            [0.0, -1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.5, 0.6, -0.4],
            [-0.6, 0.5, 0.6],
        ] {
            let up = Vector3::from(up).normalize();
            let frame = GltfFrame::upright(Vector3::zeros(), &up);
            let turned = frame.gltf_from_original * up;
            assert!((turned - Vector3::y()).norm() < 1e-12, "{up}: {turned}");
            let matrix = frame.gltf_from_original.into_inner();
            assert!((matrix.determinant() - 1.0).abs() < 1e-12, "{up}");
            assert!((frame.up() - up).norm() < 1e-12, "{up}");
        }
        let of_camera = GltfFrame::from(&Vector3::new(1.0, 2.0, 3.0));
        let expected = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        assert_eq!(of_camera.gltf_from_original.into_inner(), expected);
    }

    #[test]
    fn points_far_from_zero_get_an_origin() {
        let at = |x: f64| [Point3::new(x, 0.0, 0.25), Point3::new(x + 3.0, 4.0, 0.0)];
        assert_eq!(
            far_origin(&at(500_000.25)),
            Vector3::new(500_002.0, 2.0, 0.0)
        );
        assert_eq!(far_origin(&at(100.0)), Vector3::zeros());
        assert_eq!(far_origin(&[]), Vector3::zeros());
    }

    #[test]
    fn directions_near_an_axis_are_that_axis() {
        let tilted = |degrees: f64| {
            let angle = degrees.to_radians();
            Vector3::new(angle.sin(), 0.0, angle.cos())
        };
        assert_eq!(snapped_up(&tilted(24.0)), Vector3::z());
        assert!((snapped_up(&tilted(30.0)) - tilted(30.0)).norm() < 1e-12);
        assert_eq!(snapped_up(&Vector3::zeros()), -Vector3::y());
    }
}
