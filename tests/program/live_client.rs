//! What a page knows that follows a run, by the messages of `/events`.

use base64::Engine;
use serde_json::Value;

use super::delta_reader::{Corners, DeltaReader};

#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct LiveClient {
    pub(crate) has_scene: bool,
    pub(crate) keyframes: Vec<Value>,
    pub(crate) rows: Vec<Value>,
    pub(crate) segments: u64,
    pub(crate) clusters: u64,
    pub(crate) points: u64,
    pub(crate) image: Option<Value>,
    pub(crate) has_ended: bool,
    surface: DeltaReader,
}

impl LiveClient {
    /// Applies a message; with `whole` it replaces everything before.
    pub(crate) fn apply(&mut self, message: &Value) {
        if message["whole"] == true {
            *self = Self::default();
        }
        self.has_scene |= message["scene"].is_object();
        for (key, list) in [("keyframes", &mut self.keyframes), ("rows", &mut self.rows)] {
            if let Some(tail) = message.get(key) {
                let from = tail["from"].as_u64().expect("a number") as usize;
                assert!(from <= list.len());
                list.truncate(from);
                list.extend(tail["list"].as_array().expect("a list").iter().cloned());
            }
        }
        if let Some(tail) = message.get("segments") {
            let many = tail["list"]["count"].as_u64().expect("a number") / 2;
            let from = tail["from"].as_u64().expect("a number");
            assert!(from <= self.segments);
            self.segments = from + many;
        }
        if let Some(clusters) = message.get("clusters") {
            self.clusters = clusters["count"].as_u64().expect("a number") / 2;
        }
        if let Some(points) = message.get("points") {
            self.points = points["count"].as_u64().expect("a number");
        }
        if let Some(image) = message.get("image") {
            self.image = Some(image.clone());
        }
        if let Some(surface) = message.get("surface") {
            if surface["anew"] == true {
                self.surface = DeltaReader::default();
            }
            let delta = surface["delta"].as_str().expect("a text");
            let engine = base64::engine::general_purpose::STANDARD;
            self.surface.apply(&engine.decode(delta).expect("base64"));
        }
        self.has_ended = message["ended"] == true;
    }

    /// The triangles, sorted.
    pub(crate) fn surface(&self) -> Vec<Corners> {
        self.surface.triangles()
    }
}
