//! Corrections during a session: in between the surface stays close to the right one, at the end it is that of a session that was given
//! the final keyframes at once.

use std::path::PathBuf;

use crate::program::small_sequence;
use linecarve::Options;
use linecarve::stream::{Message, Reply, Session, SessionSummary};
use linecarve_mesh::TriangleMesh;
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const FRAMES: usize = 6;

/// A rendered sequence with exact poses, rows of 4x4 matrices.
struct Recording {
    folder: tempfile::TempDir,
    poses: Vec<Vec<Vec<f64>>>,
    start: Value,
}

/// A keyframe of a session: the frame that it is made from, and its pose.
#[derive(Clone)]
struct Known {
    id: u64,
    frame: usize,
    pose: Vec<Vec<f64>>,
}

impl Recording {
    fn new() -> Self {
        let folder = small_sequence(FRAMES, "7-scenes");
        let read = |name: String| -> Vec<f64> {
            let text = std::fs::read_to_string(folder.path().join("sequence").join(name)).unwrap();
            let words = text.split_whitespace();
            words.map(|word| word.parse().unwrap()).collect()
        };
        let k = read("camera-intrinsics.txt".to_owned());
        let rows = |frame: usize| {
            let numbers = read(format!("frame-{frame:06}.pose.txt"));
            numbers.chunks(4).map(<[f64]>::to_vec).collect()
        };
        Self {
            poses: (0..FRAMES).map(rows).collect(),
            start: json!({
                "type": "start", "median_depth": 2.0,
                "calibration": {
                    "color": { "fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5] },
                    "depth": { "scale": 1000.0 },
                },
            }),
            folder,
        }
    }

    fn file(&self, frame: usize, kind: &str) -> PathBuf {
        let folder = self.folder.path().join("sequence");
        let named = |extension: &str| folder.join(format!("frame-{frame:06}.{kind}.{extension}"));
        let files = ["jpg", "png"].map(named);
        files.into_iter().find(|path| path.exists()).unwrap()
    }

    fn keyframe(&self, known: &Known) -> Value {
        json!({
            "type": "keyframe", "id": known.id, "world_from_camera": { "matrix": known.pose },
            "color": { "path": self.file(known.frame, "color") },
            "depth": { "path": self.file(known.frame, "depth") },
        })
    }

    /// The pose of a frame, moved at random.
    fn moved(&self, frame: usize, by: f64, rng: &mut impl Rng) -> Vec<Vec<f64>> {
        let mut pose = self.poses[frame].clone();
        for row in pose.iter_mut().take(3) {
            row[3] += rng.random_range(-by..=by);
        }
        pose
    }

    /// The end of a session that is given these keyframes and nothing else.
    fn at_once(&self, known: &[Known]) -> SessionSummary {
        let mut session = Session::new(Options::default()).unwrap();
        send(&mut session, &self.start);
        for known in known {
            send(&mut session, &self.keyframe(known));
        }
        session.finish().summary
    }
}

fn send(session: &mut Session, message: &Value) -> Option<Reply> {
    let message: Message = serde_json::from_value(message.clone()).unwrap();
    session.handle(&message).unwrap()
}

fn poses(known: &[&Known]) -> Value {
    let pose =
        |known: &&Known| json!({ "id": known.id, "world_from_camera": { "matrix": known.pose } });
    json!({ "type": "poses", "poses": known.iter().map(pose).collect::<Vec<_>>() })
}

fn bits(mesh: &TriangleMesh) -> (Vec<[u64; 3]>, &[[u32; 3]]) {
    let positions = mesh.positions.iter();
    let bits = positions.map(|p| [p.x, p.y, p.z].map(f64::to_bits));
    (bits.collect(), &mesh.triangles)
}

/// Replies add up: removed triangles were there.
#[derive(Default)]
struct Client {
    triangles: usize,
}

impl Client {
    fn apply(&mut self, reply: Option<Reply>) {
        let Some(Reply::Surface {
            triangles, change, ..
        }) = reply
        else {
            panic!("{reply:?}");
        };
        self.triangles = self.triangles + change.added.len() - change.removed.len();
        assert_eq!(self.triangles, triangles);
    }
}

fn random_session(recording: &Recording, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut session = Session::new(Options::default()).unwrap();
    send(&mut session, &recording.start);
    let mut client = Client::default();
    let mut known: Vec<Known> = Vec::new();
    for id in 0..12 {
        let kind = if known.len() < 3 {
            0
        } else {
            rng.random_range(0..5)
        };
        match kind {
            0..2 => {
                let frame = rng.random_range(0..FRAMES);
                let pose = recording.moved(frame, 0.02, &mut rng);
                known.push(Known { id, frame, pose });
                client.apply(send(
                    &mut session,
                    &recording.keyframe(&known[known.len() - 1]),
                ));
            }
            2..4 => {
                let count = rng.random_range(1..=known.len());
                let indices: Vec<usize> = (0..known.len()).collect();
                let chosen: Vec<usize> = indices.sample(&mut rng, count).copied().collect();
                let by = *[0.0, 1e-5, 0.05].choose(&mut rng).unwrap();
                for &index in &chosen {
                    known[index].pose = recording.moved(known[index].frame, by, &mut rng);
                }
                let chosen: Vec<&Known> = chosen.iter().map(|index| &known[*index]).collect();
                client.apply(send(&mut session, &poses(&chosen)));
            }
            _ => {
                let gone = known.remove(rng.random_range(0..known.len()));
                client.apply(send(
                    &mut session,
                    &json!({ "type": "remove", "ids": [gone.id] }),
                ));
            }
        }
    }
    let end = session.finish();
    if let Some(last) = end.last_change.unwrap() {
        client.apply(Some(last));
    }
    let expected = recording.at_once(&known);
    assert_eq!(bits(&end.summary.mesh), bits(&expected.mesh), "seed {seed}");
    assert!(!expected.mesh.triangles.is_empty());
    assert_eq!(end.summary.segments, expected.segments, "seed {seed}");
    assert_eq!(end.summary.clusters, expected.clusters, "seed {seed}");
}

#[test]
fn any_messages_end_with_the_surface_of_the_final_keyframes() {
    let recording = Recording::new();
    // As for property tests: more cases when asked for.
    let cases = std::env::var("PROPTEST_CASES").ok();
    let cases = cases.and_then(|cases| cases.parse().ok()).unwrap_or(20);
    for seed in 0..cases {
        random_session(&recording, seed);
    }
}
