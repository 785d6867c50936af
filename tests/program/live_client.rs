//! What a page knows that follows a run, by the messages of `/events`.

use std::collections::{BTreeMap, BTreeSet};

use base64::Engine;
use serde_json::Value;

/// A triangle by the bits of the positions of its corners.
pub(crate) type Corners = [[u32; 3]; 3];

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
    vertices: BTreeMap<u32, [u32; 3]>,
    faces: BTreeSet<[u32; 3]>,
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
                self.vertices.clear();
                self.faces.clear();
            }
            let delta = surface["delta"].as_str().expect("a text");
            let engine = base64::engine::general_purpose::STANDARD;
            self.apply_delta(&engine.decode(delta).expect("base64"));
        }
        self.has_ended = message["ended"] == true;
    }

    /// Applies the bytes of a `.delta` file.
    fn apply_delta(&mut self, bytes: &[u8]) {
        assert_eq!(&bytes[..8], b"LCDELTA1");
        let mut words = bytes[32..]
            .chunks_exact(4)
            .map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")));
        let mut next = || words.next().expect("another number");
        let counts: [u32; 7] = std::array::from_fn(|_| next());
        let [
            vertices,
            triangles,
            removed,
            freed,
            placed,
            recolored,
            added,
        ] = counts;
        for _ in 0..removed {
            let face = [(); 3].map(|()| next());
            assert!(self.faces.remove(&face), "{face:?} was there");
        }
        for _ in 0..freed {
            let number = next();
            assert!(self.vertices.remove(&number).is_some());
        }
        for _ in 0..placed {
            let number = next();
            self.vertices.insert(number, [(); 3].map(|()| next()));
            next();
        }
        for _ in 0..recolored {
            assert!(self.vertices.contains_key(&next()));
            next();
        }
        for _ in 0..added {
            let face = [(); 3].map(|()| next());
            assert!(self.faces.insert(face), "{face:?} is new");
        }
        assert_eq!(self.vertices.len() as u32, vertices);
        assert_eq!(self.faces.len() as u32, triangles);
    }

    /// The triangles, sorted.
    pub(crate) fn surface(&self) -> Vec<Corners> {
        let faces = self.faces.iter();
        sorted(faces.map(|face| face.map(|number| self.vertices[&number])))
    }
}

/// Triangles with the smallest corner first, sorted.
pub(crate) fn sorted(triangles: impl Iterator<Item = Corners>) -> Vec<Corners> {
    let first = |[a, b, c]: Corners| [a, b, c].min([b, c, a]).min([c, a, b]);
    let mut all: Vec<Corners> = triangles.map(first).collect();
    all.sort_unstable();
    all
}
