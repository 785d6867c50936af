//! A small rendered recording as messages of a live system.

use std::path::PathBuf;

use linecarve::stream::Reply;
use serde_json::{Value, json};

use super::small_sequence;

/// A rendered sequence with exact poses.
pub(crate) struct LiveRecording {
    pub(crate) folder: tempfile::TempDir,
    /// Four rows for each frame.
    pub(crate) poses: Vec<Vec<Vec<f64>>>,
    /// The first message, without a length scale.
    pub(crate) start: Value,
}

impl LiveRecording {
    pub(crate) fn new(frames: usize) -> Self {
        let folder = small_sequence(frames, "7-scenes");
        let read = |name: &str| -> Vec<f64> {
            let text = std::fs::read_to_string(folder.path().join("sequence").join(name));
            let text = text.expect("a file of the sequence");
            let words = text.split_whitespace();
            words.map(|word| word.parse().expect("a number")).collect()
        };
        let k = read("camera-intrinsics.txt");
        let rows = |frame: usize| {
            let numbers = read(&format!("frame-{frame:06}.pose.txt"));
            numbers.chunks(4).map(<[f64]>::to_vec).collect()
        };
        Self {
            poses: (0..frames).map(rows).collect(),
            start: json!({
                "type": "start",
                "calibration": {
                    "color": { "fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5] },
                    "depth": { "scale": 1000.0 },
                },
            }),
            folder,
        }
    }

    /// The image of a frame: `color` or `depth`.
    pub(crate) fn file(&self, frame: usize, kind: &str) -> PathBuf {
        let folder = self.folder.path().join("sequence");
        let named = |extension: &str| folder.join(format!("frame-{frame:06}.{kind}.{extension}"));
        let files = ["jpg", "png", "npy"].map(named);
        let found = files.into_iter().find(|path| path.exists());
        found.expect("an image of the frame")
    }

    /// A keyframe with the images of a frame; `pose` as in messages.
    pub(crate) fn keyframe(&self, id: u64, frame: usize, pose: &Value) -> Value {
        json!({
            "type": "keyframe", "id": id, "world_from_camera": pose,
            "color": { "path": self.file(frame, "color") }, "depth": { "path": self.file(frame, "depth") },
        })
    }
}

/// Counts the triangles of a surface by its changes.
#[derive(Default)]
pub(crate) struct TriangleCount(usize);

impl TriangleCount {
    /// Applies a reply, which must be a surface of as many triangles as the changes add up to.
    pub(crate) fn apply(&mut self, reply: Option<Reply>) {
        let Some(Reply::Surface {
            triangles, change, ..
        }) = reply
        else {
            panic!("no surface: {reply:?}");
        };
        self.0 = self.0 + change.added.len() - change.removed.len();
        assert_eq!(self.0, triangles);
    }
}
