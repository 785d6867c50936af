//! Messages and replies of a session, as serde types.

use std::path::PathBuf;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::SurfaceDifference;
use linecarve_lines::camera::CameraCorrection;
use linecarve_sequence::rigid;

/// A message to a [`Session`](super::Session).
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Message {
    /// The cameras; the first message, sent once.
    Start(StartMessage),
    /// A keyframe.
    Keyframe(KeyframeMessage),
    /// A frame whose pose is found by the session.
    Frame(FrameMessage),
    /// Corrected poses of earlier keyframes.
    Poses {
        /// The corrected keyframes; all take effect at once.
        poses: Vec<PoseUpdate>,
    },
    /// Removes keyframes, as a SLAM system culls them.
    Remove {
        /// Ids of the removed keyframes.
        ids: Vec<u64>,
    },
    /// New and moved points of a map without images, and points that go.
    Points {
        /// The points.
        #[serde(default)]
        points: Vec<PointMessage>,
        /// Ids of points that go with their observations.
        #[serde(default)]
        removed: Vec<u64>,
    },
    /// Points of a map without images that a keyframe observes.
    Observations {
        /// Id of the keyframe.
        keyframe: u64,
        /// Ids of points that it observes.
        #[serde(default)]
        points: Vec<u64>,
        /// Ids of points that it does not observe any more.
        #[serde(default)]
        removed: Vec<u64>,
    },
    /// New and changed 3D segments of a map without images, and segments that go.
    Lines {
        /// The segments.
        #[serde(default)]
        lines: Vec<LineMessage>,
        /// Ids of segments that go.
        #[serde(default)]
        removed: Vec<u64>,
    },
    /// Ends the session; the end of the input does the same.
    End {},
}

/// A point of a map without images.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointMessage {
    /// Its id; a known point moves and keeps its observations.
    pub id: u64,
    /// In the frame of the poses.
    pub position: [f64; 3],
    /// Standard deviation along the view rays.
    pub sigma: Option<f64>,
}

/// A 3D segment of a map without images.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineMessage {
    /// Its id; a known segment is replaced.
    pub id: u64,
    /// In the frame of the poses.
    pub ends: [[f64; 3]; 2],
    /// Ids of the keyframes that see all of it.
    pub keyframes: Vec<u64>,
    /// Standard deviation of its points along the view rays.
    pub sigma: Option<f64>,
}

/// The cameras, and settings that a recorded sequence would provide.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartMessage {
    /// As in the sidecar file of a sequence: tables `color`, `depth`, `right`, `poses`. Without images it may be left out.
    #[serde(default)]
    pub calibration: serde_json::Value,
    /// Median scene depth in units of the poses; default: that of the first keyframe with depth. The value in `report.json`
    /// of a run over a recording reproduces its result exactly.
    pub median_depth: Option<f64>,
    /// Origin subtracted from all coordinates, for maps far from zero; default: the rounded first position where that is far
    /// away.
    pub origin: Option<[f64; 3]>,
    /// Source of the depth of keyframes.
    #[serde(default)]
    pub depth_source: DepthKind,
    /// Where the poses come from.
    #[serde(default)]
    pub poses: PoseKind,
}

/// Where the poses of a session come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseKind {
    /// Keyframes bring their poses.
    #[default]
    Given,
    /// Frames without poses are tracked, and keyframes are chosen among them.
    Track,
}

/// Source of the depth of keyframes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthKind {
    /// Each keyframe has a depth image.
    #[default]
    Sensor,
    /// Matching with neighbouring keyframes; depth images are ignored.
    SemiDense,
    /// No images: points and segments come in messages.
    None,
}

/// A keyframe.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeMessage {
    /// Unique number of the keyframe.
    pub id: u64,
    /// Pose of the camera that `poses.camera` of the calibration names, by default the colour camera.
    pub world_from_camera: Pose,
    /// The colour or grey image; not used where the session has no images.
    pub color: Option<ImageSource>,
    /// The depth image, 16 bits per pixel; none with depth from images alone.
    pub depth: Option<ImageSource>,
}

/// A frame of a session that tracks.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameMessage {
    /// Unique number of the frame.
    pub id: u64,
    /// Time in nanoseconds, for `trajectory.txt`; without it the id is written.
    pub timestamp_ns: Option<i64>,
    /// The colour or grey image.
    pub color: Option<ImageSource>,
    /// The depth image.
    pub depth: Option<ImageSource>,
    /// The image of the right camera.
    pub right: Option<ImageSource>,
    /// Read only to be refused: a session that tracks takes no poses.
    pub world_from_camera: Option<serde::de::IgnoredAny>,
}

/// A corrected pose.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseUpdate {
    /// Id of the keyframe.
    pub id: u64,
    /// The new pose.
    pub world_from_camera: Pose,
}

/// An image: a file, or data in the message.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ImageSource {
    /// A path, relative to the working folder.
    Path(PathBuf),
    /// Content of an image file, in base 64.
    Base64(String),
}

/// A rigid transform: `matrix`, four rows, or `translation` and `rotation`.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum Pose {
    /// A row-major 4x4 matrix.
    Matrix {
        /// Its rows.
        matrix: [[f64; 4]; 4],
    },
    /// A translation and a unit quaternion.
    Parts {
        /// x, y, z.
        translation: [f64; 3],
        /// x, y, z, w.
        rotation: [f64; 4],
    },
}

impl Pose {
    /// The transform.
    ///
    /// # Errors
    /// When the numbers are not finite or not those of a rotation; the text continues "the pose".
    pub fn to_isometry(&self) -> Result<Isometry3<f64>, String> {
        match self {
            Self::Matrix { matrix } => rigid::from_matrix(matrix),
            Self::Parts {
                translation,
                rotation,
            } => rigid::from_translation_quaternion(*translation, *rotation),
        }
        .map_err(|problem| problem.to_string())
    }
}

/// A reply of a [`Session`](super::Session).
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Reply {
    /// The cameras are accepted.
    Ready {
        /// Name and version of the program.
        generator: &'static str,
    },
    /// The surface after a message that changed the map.
    Surface {
        /// Number of keyframes in the map.
        keyframes: usize,
        /// Number of their segments.
        segments: usize,
        /// Number of triangles of the surface.
        triangles: usize,
        /// Difference from the previous surface.
        #[serde(flatten)]
        change: SurfaceDifference,
        /// Number of keyframes whose corrections the surface does not show yet, as they are below the deviation of what was measured. They
        /// are shown when they add up, when the session is idle, and at the end.
        #[serde(skip_serializing_if = "is_zero")]
        pending: usize,
        /// Whether no message led to this reply: corrections that waited were made.
        #[serde(skip_serializing_if = "is_false")]
        idle: bool,
        /// What in the poses, the depth scale or the calibration contradicts the images, with the remedy. It is said once.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<String>,
        /// Time from the message to this reply.
        milliseconds: f64,
    },
    /// A frame was tracked.
    Frame(Box<FrameReply>),
    /// A message was rejected.
    Error {
        /// Line of the message in the input, counted from 1.
        line: u64,
        /// The problem.
        message: String,
    },
    /// The session ended.
    End {
        /// Number of keyframes in the map.
        keyframes: usize,
        /// Vertices of the final surface.
        vertices: usize,
        /// Triangles of the final surface.
        triangles: usize,
        /// Files in the output folder.
        files: Vec<String>,
        /// Poses corrected from images before the final estimates.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        corrected_poses: Vec<CorrectedPose>,
        /// How the camera of the final estimates differs from the given one.
        #[serde(flatten)]
        camera_correction: Option<CameraCorrection>,
        /// What tracking came to, in a session that tracks.
        #[serde(skip_serializing_if = "Option::is_none")]
        tracking: Option<TrackingSummary>,
        /// What was left out of the keyframes, and what contradicts the images.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<String>,
    },
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

fn is_false(value: &bool) -> bool {
    !*value
}

/// What became of a frame without pose, and what its arrival changed.
#[derive(Debug, Clone, Serialize)]
pub struct FrameReply {
    /// Id of the frame.
    pub id: u64,
    /// Pose of its colour camera as it is known now.
    pub world_from_camera: Option<PoseParts>,
    /// Why there is no pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The sub-map in whose coordinates the pose is, numbered in the order of their starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub submap: Option<u32>,
    /// The sub-map whose keyframes make the surface.
    pub surface_submap: u32,
    /// Frames that became keyframes of the surface: this one, or earlier ones.
    pub keyframes: Vec<u64>,
    /// Earlier keyframes whose poses changed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub corrected_poses: Vec<CorrectedPose>,
    /// Keyframes that left the surface, with their sub-map.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub removed: Vec<u64>,
    /// What the surface could not follow, and other changes to know of.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// The change of the surface, as a [`Reply::Surface`]; none when nothing reached it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface: Option<Reply>,
    /// Time from the message to this reply.
    pub milliseconds: f64,
}

/// What tracking came to at the end of a session.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TrackingSummary {
    /// Frames that were tracked, with and without success.
    pub frames: usize,
    /// Frames with a pose in the largest sub-map, that of the surface and of `trajectory.txt`.
    pub tracked: usize,
    /// Number of sub-maps.
    pub submaps: usize,
    /// Loops that were closed.
    pub loops_closed: usize,
    /// Loops that were refused.
    pub loops_refused: usize,
    /// What is missing, or contradicts the poses.
    pub warnings: Vec<String>,
}

/// The pose of a colour camera.
#[derive(Debug, Clone, Serialize)]
pub struct CorrectedPose {
    /// Id of the keyframe.
    pub id: u64,
    /// `point_in_world = pose * point_in_camera`.
    pub world_from_camera: PoseParts,
}

impl CorrectedPose {
    pub(super) fn new(id: u64, world_from_camera: &Isometry3<f64>) -> Self {
        Self {
            id,
            world_from_camera: world_from_camera.into(),
        }
    }
}

/// A rigid transform, as in messages.
#[derive(Debug, Clone, Serialize)]
pub struct PoseParts {
    /// x, y, z.
    pub translation: [f64; 3],
    /// x, y, z, w.
    pub rotation: [f64; 4],
}

impl From<&Isometry3<f64>> for PoseParts {
    fn from(transform: &Isometry3<f64>) -> Self {
        Self {
            translation: transform.translation.vector.into(),
            rotation: transform.rotation.coords.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_read_as_documented() {
        let pose = r#"{"translation":[1,2,3],"rotation":[0,0,0,1]}"#;
        let keyframe = format!(
            r#"{{"type":"keyframe","id":7,"world_from_camera":{pose},"color":{{"path":"a.png"}},"depth":{{"base64":"AA=="}}}}"#
        );
        let Message::Keyframe(keyframe) = serde_json::from_str(&keyframe).unwrap() else {
            panic!("not a keyframe");
        };
        let pose = keyframe.world_from_camera.to_isometry().unwrap();
        assert_eq!(pose.translation.vector.as_slice(), [1.0, 2.0, 3.0]);
        assert!(matches!(
            serde_json::from_str(r#"{"type":"end"}"#).unwrap(),
            Message::End {}
        ));
        for wrong in [
            r#"{"type":"keyframe","id":-1}"#,
            r#"{"type":"keyframes"}"#,
            r#"{"id":1}"#,
            r#"{"type":"start","calibration":{},"median":1}"#,
            "[]",
            "",
        ] {
            assert!(serde_json::from_str::<Message>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn invalid_poses_are_rejected() {
        let nan = Pose::Parts {
            translation: [f64::NAN, 0.0, 0.0],
            rotation: [0.0, 0.0, 0.0, 1.0],
        };
        assert!(nan.to_isometry().unwrap_err().contains("not finite"));
        let zero = Pose::Matrix {
            matrix: [[0.0; 4]; 4],
        };
        assert!(zero.to_isometry().is_err());
    }
}
