//! Directions of the axes of poses in the image, and the camera pose that follows.

use std::fmt;

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::Deserialize;

/// A direction in the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Right,
    Left,
    Down,
    Up,
    Forward,
    Back,
}

impl Direction {
    const ALL: [Self; 6] = [
        Self::Right,
        Self::Left,
        Self::Down,
        Self::Up,
        Self::Forward,
        Self::Back,
    ];

    fn letter(self) -> char {
        self.word().chars().next().unwrap_or_default()
    }

    fn word(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Left => "left",
            Self::Down => "down",
            Self::Up => "up",
            Self::Forward => "forward",
            Self::Back => "back",
        }
    }

    /// In camera axes: x right, y down, z forward.
    fn vector(self) -> Vector3<f64> {
        match self {
            Self::Right => Vector3::x(),
            Self::Left => -Vector3::x(),
            Self::Down => Vector3::y(),
            Self::Up => -Vector3::y(),
            Self::Forward => Vector3::z(),
            Self::Back => -Vector3::z(),
        }
    }
}

/// Where the x, y and z axes of poses point in the image, as in three letters: `rdf` is right, down, forward, the axes of a camera.
///
/// Left-handed axes, such as `ruf`, come with a left-handed world, as in Unity. The x axis of the world is mirrored then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub(super) struct CameraAxes([Direction; 3]);

impl Default for CameraAxes {
    fn default() -> Self {
        Self::AS_READ
    }
}

impl CameraAxes {
    /// As defined by the format.
    pub(super) const AS_READ: Self = Self([Direction::Right, Direction::Down, Direction::Forward]);

    /// Rotated about x by 180 degrees, as between OpenCV (y down, z forward) and OpenGL (y up, z backward).
    pub(super) const Y_AND_Z_FLIPPED: Self =
        Self([Direction::Right, Direction::Up, Direction::Back]);

    /// All 48 axes along those of a camera.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let triples = Direction::ALL.into_iter().flat_map(|x| {
            Direction::ALL
                .into_iter()
                .flat_map(move |y| Direction::ALL.into_iter().map(move |z| [x, y, z]))
        });
        triples.filter_map(Self::of)
    }

    /// `None` unless the directions lie along three axes.
    fn of(directions: [Direction; 3]) -> Option<Self> {
        let axes = Self(directions);
        (axes.camera_from_body().determinant() != 0.0).then_some(axes)
    }

    fn camera_from_body(self) -> Matrix3<f64> {
        Matrix3::from_columns(&self.0.map(Direction::vector))
    }

    /// Whether the axes, and so the world of the poses, are left-handed.
    pub(super) fn is_left_handed(self) -> bool {
        self.camera_from_body().determinant() < 0.0
    }

    /// The pose of a camera whose axes point as in an image, from a pose with these axes.
    pub(super) fn world_from_camera(self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let mut pose = *pose;
        let mut body_from_camera = self.camera_from_body().transpose();
        if self.is_left_handed() {
            // The mirror image of a rotation: its axis is a pseudovector.
            let mirror = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
            let q = pose.rotation.coords;
            pose.rotation = UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, -q.y, -q.z));
            pose.translation.vector.x = -pose.translation.vector.x;
            body_from_camera = mirror * body_from_camera;
        }
        pose.rotation *= match self {
            Self::AS_READ => return pose,
            Self::Y_AND_Z_FLIPPED => half_turn_about_x(),
            _ => UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                body_from_camera,
            )),
        };
        pose
    }

    /// The axes in words, for messages.
    pub(super) fn words(self) -> String {
        if self == Self::Y_AND_Z_FLIPPED {
            return "camera axes y up, z backward (OpenGL)".to_owned();
        }
        let [x, y, z] = self.0.map(Direction::word);
        let name = if self.is_left_handed() {
            " (left-handed; or the images are mirrored)"
        } else {
            ""
        };
        // Axes that lie in the image turn about the viewing direction.
        let turn = match (self.0[0], self.0[2], self.is_left_handed()) {
            (Direction::Left, Direction::Forward, false) => ", or images turned by 180 degrees",
            (Direction::Up | Direction::Down, Direction::Forward, false) => {
                ", or images turned by 90 degrees"
            }
            _ => "",
        };
        format!("camera axes x {x}, y {y}, z {z}{name}{turn}")
    }
}

/// Name of the axes of OpenGL, beside their letters.
const FLIPPED: &str = "y-and-z-flipped";

impl TryFrom<String> for CameraAxes {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let of_letters = || {
            let directions: Vec<Direction> = text
                .chars()
                .map(|letter| Direction::ALL.into_iter().find(|it| it.letter() == letter))
                .collect::<Option<_>>()?;
            Self::of(directions.try_into().ok()?)
        };
        match text.as_str() {
            "as-read" => Ok(Self::AS_READ),
            FLIPPED => Ok(Self::Y_AND_Z_FLIPPED),
            _ => of_letters().ok_or_else(|| {
                format!(
                    "axes = \"{text}\" is none of \"as-read\", \"{FLIPPED}\" and three letters for where x, y and z point in the image: \
                     one each of r or l, u or d, f or b, such as \"flu\""
                )
            }),
        }
    }
}

impl fmt::Display for CameraAxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::AS_READ => f.write_str("as-read"),
            Self::Y_AND_Z_FLIPPED => f.write_str(FLIPPED),
            Self(directions) => directions
                .into_iter()
                .try_for_each(|it| write!(f, "{}", it.letter())),
        }
    }
}

/// Rotation between axes y down, z forward and axes y up, z backward.
pub(super) fn half_turn_about_x() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Translation3};

    #[test]
    fn axes_are_48_each_read_from_what_it_prints() {
        let all: Vec<CameraAxes> = CameraAxes::all().collect();
        assert_eq!(all.len(), 48);
        assert_eq!(all.iter().filter(|axes| axes.is_left_handed()).count(), 24);
        for axes in all {
            assert_eq!(CameraAxes::try_from(axes.to_string()), Ok(axes));
        }
        for wrong in ["", "rd", "rdd", "rlf", "rdfx", "RDF", "xyz"] {
            assert!(CameraAxes::try_from(wrong.to_owned()).is_err(), "{wrong}");
        }
        assert_eq!(
            CameraAxes::try_from("rub".to_owned()),
            Ok(CameraAxes::Y_AND_Z_FLIPPED)
        );
    }

    #[test]
    fn points_are_seen_where_the_axes_say() {
        let pose = Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 0.5),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 0.4)),
        );
        for axes in CameraAxes::all() {
            let in_camera = Vector3::new(0.2, -0.3, 2.0);
            // The same point in the axes of the poses, then in their world; a left-handed one is mirrored.
            let in_body = axes.camera_from_body().transpose() * in_camera;
            let mut in_world = pose * Point3::from(in_body);
            if axes.is_left_handed() {
                in_world.x = -in_world.x;
            }
            let found = axes.world_from_camera(&pose) * Point3::from(in_camera);
            assert!((found - in_world).norm() < 1e-12, "{axes}");
        }
    }
}
