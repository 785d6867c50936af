//! Views: cameras of pictures.

use linecarve_lines::camera::{Camera, CameraError};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::TriangleMesh;

/// Vertical field of view of outside views: narrow, so that parallel walls look parallel.
const OUTSIDE_FIELD_OF_VIEW_RAD: f64 = 0.55;
/// Downward angle of outside views.
const OUTSIDE_ELEVATION_RAD: f64 = 0.72;
/// Share of the vertices along each axis that outside views must fit: carved surfaces may have a few distant
/// vertices.
const OUTSIDE_SHARE: f64 = 0.98;
/// Outside views also fit the remaining vertices on a side if these extend no farther than this share of the central
/// extent.
const OUTSIDE_EXTENSION: f64 = 0.6;

/// A pinhole camera with pose and image size.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The camera; lens distortion is ignored.
    pub camera: Camera,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `point_in_world = world_from_camera * point_in_camera`, camera x right, y down, z forward.
    pub world_from_camera: Isometry3<f64>,
    /// Direction of the sky light.
    pub up: Vector3<f64>,
}

impl View {
    /// The view of a keyframe, without lens distortion.
    pub fn from_keyframe(
        camera: &Camera,
        width: u32,
        height: u32,
        world_from_camera: Isometry3<f64>,
        up: Vector3<f64>,
    ) -> Self {
        Self {
            camera: camera.without_distortion(),
            width,
            height,
            world_from_camera,
            up,
        }
    }

    /// A view from `eye` towards `target`, upright with respect to `up`, with a vertical field of view in radians.
    ///
    /// # Errors
    /// When field of view or size do not define a camera.
    pub fn look_at(
        eye: &Point3<f64>,
        target: &Point3<f64>,
        up: &Vector3<f64>,
        (width, height): (u32, u32),
        field_of_view_rad: f64,
    ) -> Result<Self, CameraError> {
        let focal = 0.5 * f64::from(height) / (0.5 * field_of_view_rad).tan();
        let camera = Camera::pinhole(
            focal,
            focal,
            0.5 * (f64::from(width) - 1.0),
            0.5 * (f64::from(height) - 1.0),
        )?;
        Ok(Self {
            camera,
            width,
            height,
            world_from_camera: Isometry3::from_parts(
                Translation3::from(eye.coords),
                upright_rotation(&(target - eye), up),
            ),
            up: *up,
        })
    }

    /// A view of the whole mesh from outside and above. With [`BackFaces::Hidden`](super::BackFaces), a room is
    /// visible through its near walls and ceiling.
    ///
    /// The view direction follows the mean direction of the cameras `poses`, so that it shows what they saw;
    /// "above" is their [`up_direction`]. `None` when the mesh has no triangles or no finite extent.
    pub fn dollhouse(
        mesh: &TriangleMesh,
        poses: &[Isometry3<f64>],
        size: (u32, u32),
    ) -> Option<Self> {
        Self::outside(&used_vertices(mesh), poses, size)
    }

    /// [`View::dollhouse`] of points. `None` without points, and when a coordinate is not finite or all points are the same.
    pub fn outside(
        points: &[Point3<f64>],
        poses: &[Isometry3<f64>],
        (width, height): (u32, u32),
    ) -> Option<Self> {
        let up = up_direction(poses);
        let (east, north) = horizontal_axes(&up);
        let (low, high) = central_box(points, [&east, &north, &up])?;
        let size = high - low;
        let heading = heading_of(poses, &up, size.x >= size.y, (&east, &north));
        let (sin, cos) = OUTSIDE_ELEVATION_RAD.sin_cos();
        let forward = heading * cos - up * sin;
        let rotation = upright_rotation(&forward, &up);
        let tan_y = (0.5 * OUTSIDE_FIELD_OF_VIEW_RAD).tan();
        let tan_x = tan_y * f64::from(width) / f64::from(height);

        let corners: Vec<Vector3<f64>> = (0..8)
            .map(|corner| {
                let pick = |axis: usize| {
                    if corner >> axis & 1 == 0 {
                        low[axis]
                    } else {
                        high[axis]
                    }
                };
                rotation.inverse() * (east * pick(0) + north * pick(1) + up * pick(2))
            })
            .collect();
        // In a camera at `offset` every corner c gives |c.x - offset.x| <= tan_x (c.z - offset.z): the extreme sums and
        // differences place the camera, first sideways, then back.
        let fit = |axis: usize, tan: f64| {
            let plus = corners
                .iter()
                .map(|c| c[axis] + tan * -c.z)
                .fold(f64::MIN, f64::max);
            let minus = corners
                .iter()
                .map(|c| c[axis] + tan * c.z)
                .fold(f64::MAX, f64::min);
            (0.5 * (plus + minus), -0.5 * (plus - minus) / tan)
        };
        let margin = 1.06;
        let (x, back_x) = fit(0, tan_x / margin);
        let (y, back_y) = fit(1, tan_y / margin);
        let back = back_x.min(back_y);
        if !(x.is_finite() && y.is_finite() && back.is_finite()) || size.norm() == 0.0 {
            return None;
        }
        let eye = Point3::from(rotation * Vector3::new(x, y, back));
        let target = eye + forward;
        Self::look_at(
            &eye,
            &target,
            &up,
            (width, height),
            OUTSIDE_FIELD_OF_VIEW_RAD,
        )
        .ok()
    }
}

/// The up direction of a scene: the mean of the cameras' -y axes. Without cameras, or when they cancel out, it is the
/// -y axis of the frame.
pub fn up_direction(poses: &[Isometry3<f64>]) -> Vector3<f64> {
    let sum: Vector3<f64> = poses.iter().map(|pose| pose.rotation * -Vector3::y()).sum();
    let mean = sum / poses.len().max(1) as f64;
    if mean.norm() > 0.1 {
        mean.normalize()
    } else {
        -Vector3::y()
    }
}

/// `world_from_camera` rotation that looks along `forward` and keeps `up` at the top of the picture; any roll when both
/// are parallel.
pub fn upright_rotation(forward: &Vector3<f64>, up: &Vector3<f64>) -> UnitQuaternion<f64> {
    let z = forward.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let up = up.try_normalize(0.0).unwrap_or_else(|| -Vector3::y());
    let across = z.cross(&up);
    let x = if across.norm() > 1e-9 {
        across.normalize()
    } else {
        horizontal_axes(&z).0
    };
    let y = z.cross(&x);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(
        &[x, y, z],
    )))
}

/// Two unit vectors that form a right-handed frame with `up` (first, second, up).
fn horizontal_axes(up: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = Vector3::ith(up.iamin(), 1.0);
    let first = helper.cross(up).normalize();
    (first, up.cross(&first))
}

/// The horizontal view direction of an outside view.
fn heading_of(
    poses: &[Isometry3<f64>],
    up: &Vector3<f64>,
    longer_east: bool,
    (east, north): (&Vector3<f64>, &Vector3<f64>),
) -> Vector3<f64> {
    let sum: Vector3<f64> = poses.iter().map(|pose| pose.rotation * Vector3::z()).sum();
    let mean = (sum - up * sum.dot(up)) / poses.len().max(1) as f64;
    // Cameras in all directions have no mean direction: then the view crosses the longer side, slightly from a
    // corner.
    if mean.norm() > 0.15 {
        return mean.normalize();
    }
    let (across, along) = if longer_east {
        (north, east)
    } else {
        (east, north)
    };
    (across + along * 0.45).normalize()
}

/// Vertices in use, each once.
fn used_vertices(mesh: &TriangleMesh) -> Vec<Point3<f64>> {
    let mut used = vec![false; mesh.positions.len()];
    for &corner in mesh.triangles.iter().flatten() {
        if let Some(entry) = used.get_mut(corner as usize) {
            *entry = true;
        }
    }
    let finite = |p: &Point3<f64>| p.iter().all(|v| v.is_finite());
    mesh.positions
        .iter()
        .zip(used)
        .filter_map(|(position, used)| (used && finite(position)).then_some(*position))
        .collect()
}

/// The box along `axes` that holds the central share of the points along each; `None` of no points.
fn central_box(
    points: &[Point3<f64>],
    axes: [&Vector3<f64>; 3],
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    if points.is_empty() {
        return None;
    }
    let (mut low, mut high) = (Vector3::zeros(), Vector3::zeros());
    for (index, axis) in axes.into_iter().enumerate() {
        let mut along: Vec<f64> = points.iter().map(|point| point.coords.dot(axis)).collect();
        along.sort_unstable_by(f64::total_cmp);
        // With few vertices all are relevant: a box has only eight.
        let cut = if along.len() < 500 {
            0
        } else {
            (along.len() as f64 * 0.5 * (1.0 - OUTSIDE_SHARE)) as usize
        };
        let (first, last) = (along[0], along[along.len() - 1]);
        let (mut from, mut to) = (along[cut], along[along.len() - 1 - cut]);
        // Vertices may be dense on small objects: parts that extend moderately farther belong to the scene.
        let reach = OUTSIDE_EXTENSION * (to - from);
        if from - first <= reach {
            from = first;
        }
        if last - to <= reach {
            to = last;
        }
        low[index] = from;
        high[index] = to;
    }
    Some((low, high))
}
