//! Corrections during a session: in between the surface stays close to the right one, at the end it is that of a session that was given
//! the final keyframes at once.

use crate::program::live_recording::{LiveRecording, TriangleCount};
use linecarve::Options;
use linecarve::stream::{Message, Reply, Session, SessionSummary};
use linecarve_mesh::TriangleMesh;
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const FRAMES: usize = 6;

/// A keyframe of a session: the frame that it is made from, and its pose.
#[derive(Clone)]
struct Known {
    id: u64,
    frame: usize,
    pose: Vec<Vec<f64>>,
}

/// The recording with a length scale, and what a session makes of it.
struct Recording(LiveRecording);

impl Recording {
    fn new() -> Self {
        let mut recording = LiveRecording::new(FRAMES);
        recording.start["median_depth"] = json!(2.0);
        Self(recording)
    }

    fn keyframe(&self, known: &Known) -> Value {
        let pose = json!({ "matrix": known.pose });
        self.0.keyframe(known.id, known.frame, &pose)
    }

    /// The pose of a frame, moved at random.
    fn moved(&self, frame: usize, by: f64, rng: &mut impl Rng) -> Vec<Vec<f64>> {
        let mut pose = self.0.poses[frame].clone();
        for row in pose.iter_mut().take(3) {
            row[3] += rng.random_range(-by..=by);
        }
        pose
    }

    /// The end of a session that is given these keyframes and nothing else.
    fn at_once(&self, known: &[Known]) -> SessionSummary {
        let mut session = Session::new(Options::default()).unwrap();
        send(&mut session, &self.0.start);
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

fn random_session(recording: &Recording, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut session = Session::new(Options::default()).unwrap();
    send(&mut session, &recording.0.start);
    let mut client = TriangleCount::default();
    let mut known: Vec<Known> = Vec::new();
    for id in 0..12 {
        let kind = if known.len() < 3 {
            0
        } else {
            rng.random_range(0..6)
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
            4 => {
                if let Some(reply) = session.settle().unwrap() {
                    client.apply(Some(reply));
                }
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
    let cases = cases.and_then(|cases| cases.parse().ok()).unwrap_or(12);
    for seed in 0..cases {
        random_session(&recording, seed);
    }
}

#[test]
fn corrections_below_the_deviation_of_depth_are_said_to_be_pending() {
    let recording = Recording::new();
    let mut session = Session::new(Options::default()).unwrap();
    send(&mut session, &recording.0.start);
    let mut known: Vec<Known> = (0..FRAMES)
        .map(|frame| Known {
            id: frame as u64,
            frame,
            pose: recording.0.poses[frame].clone(),
        })
        .collect();
    for known in &known {
        send(&mut session, &recording.keyframe(known));
    }
    let mut pending_after = |known: &mut Known, by: f64| {
        known.pose[0][3] += by;
        let reply = send(&mut session, &poses(&[known]));
        let Some(Reply::Surface {
            pending, change, ..
        }) = reply
        else {
            panic!("no surface: {reply:?}");
        };
        (pending, change.added.is_empty())
    };
    assert_eq!(pending_after(&mut known[1], 1e-5), (1, true));
    assert_eq!(pending_after(&mut known[2], 1e-5), (2, true));
    assert_eq!(pending_after(&mut known[1], 0.05), (1, false));
    // While no message comes they are made.
    assert_eq!(session.pending_corrections(), 1);
    let reply = session.settle().unwrap();
    let Some(Reply::Surface {
        pending: 0,
        idle: true,
        ..
    }) = reply
    else {
        panic!("not settled: {reply:?}");
    };
    assert!(session.settle().unwrap().is_none());
    let end = session.finish();
    let expected = recording.at_once(&known);
    assert_eq!(bits(&end.summary.mesh), bits(&expected.mesh));
}
