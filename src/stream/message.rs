//! What is said in either direction, as serde sees it.

use std::path::PathBuf;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::SurfaceChange;
use linecarve_sequence::rigid;

/// A message to a [`Session`](super::Session).
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Message {
    /// The cameras; the first message, once.
    Start(StartMessage),
    /// A keyframe.
    Keyframe(KeyframeMessage),
    /// Better poses of keyframes that came before.
    Poses {
        /// The keyframes concerned; all take effect at once.
        poses: Vec<PoseUpdate>,
    },
    /// Keyframes that are to be forgotten, as a SLAM system culls them.
    Remove {
        /// The keyframes concerned.
        ids: Vec<u64>,
    },
    /// Ends the session; the end of the input does the same.
    End {},
}

/// The cameras, and what a recorded sequence would tell.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartMessage {
    /// As in the sidecar file of a sequence: tables `color`, `depth`, `poses`.
    pub calibration: serde_json::Value,
    /// Median depth of the scene in units of the poses; default: that of the first keyframe with depth. The lengths of all
    /// stages are shares of it, so give the value of `report.json` to get the very result of a run over a recording.
    pub median_depth: Option<f64>,
    /// Taken off all coordinates while computing, for maps far from zero; default: the first keyframe's position in whole
    /// units where that is far away.
    pub origin: Option<[f64; 3]>,
    /// Where the depth of keyframes comes from.
    #[serde(default)]
    pub depth_source: DepthKind,
}

/// Where the depth of keyframes comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthKind {
    /// Every keyframe brings a depth image.
    #[default]
    Sensor,
    /// The images of neighbouring keyframes; depth images are left alone.
    SemiDense,
}

/// A keyframe.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeMessage {
    /// Any number that no other keyframe has.
    pub id: u64,
    /// Where its camera is: that which `poses.camera` of the calibration names, colour by default.
    pub world_from_camera: Pose,
    /// The colour or grey image.
    pub color: ImageSource,
    /// The depth image, 16 bits a pixel; none where depth comes from images alone.
    pub depth: Option<ImageSource>,
}

/// A better pose.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseUpdate {
    /// Whose.
    pub id: u64,
    /// The pose that replaces the one before.
    pub world_from_camera: Pose,
}

/// Where an image is: in a file, or in the message itself.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ImageSource {
    /// A file; relative to the working folder.
    Path(PathBuf),
    /// The bytes of a file, in base 64.
    Base64(String),
}

/// A rigid motion: `matrix`, four rows, or `translation` and `rotation`.
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
    /// The motion.
    ///
    /// # Errors
    /// When the numbers are not finite or not those of a rotation; the text ends a sentence that begins with "the pose".
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

/// An answer of a [`Session`](super::Session).
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Reply {
    /// The cameras are understood.
    Ready {
        /// Name and version of the program.
        generator: &'static str,
    },
    /// The surface after a message that changed the map.
    Surface {
        /// Keyframes in the map.
        keyframes: usize,
        /// Segments of all of them.
        segments: usize,
        /// Triangles of the surface now.
        triangles: usize,
        /// What differs from the surface before.
        #[serde(flatten)]
        change: SurfaceChange,
        /// From the arrival of the message to this reply.
        milliseconds: f64,
    },
    /// A message had no effect.
    Error {
        /// Its line in the input, counted from 1.
        line: u64,
        /// What is wrong with it.
        message: String,
    },
    /// The session is over.
    End {
        /// Keyframes in the map.
        keyframes: usize,
        /// Vertices of the final surface.
        vertices: usize,
        /// Triangles of the final surface.
        triangles: usize,
        /// Files in the output folder.
        files: Vec<String>,
        /// Poses that the images contradicted, as they were corrected before the last estimates.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        corrected_poses: Vec<CorrectedPose>,
        /// Radial distortion, `k1` of Brown's model, that images of a supposed pinhole turned out to have; taken out of them before
        /// the last estimates.
        #[serde(skip_serializing_if = "Option::is_none")]
        lens_k1: Option<f64>,
    },
}

/// The pose of a colour camera.
#[derive(Debug, Clone, Serialize)]
pub struct CorrectedPose {
    /// Of which keyframe.
    pub id: u64,
    /// `point_in_world = pose * point_in_camera`.
    pub world_from_camera: PoseParts,
}

/// A rigid motion as messages have it.
#[derive(Debug, Clone, Serialize)]
pub struct PoseParts {
    /// x, y, z.
    pub translation: [f64; 3],
    /// x, y, z, w.
    pub rotation: [f64; 4],
}

impl From<&Isometry3<f64>> for PoseParts {
    fn from(motion: &Isometry3<f64>) -> Self {
        Self {
            translation: motion.translation.vector.into(),
            rotation: motion.rotation.coords.into(),
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
    fn poses_that_are_none_are_told() {
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
