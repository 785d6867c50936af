//! Sessions without images: points, observations and lines come in messages. The end depends on what there is, not on how it came.

use std::collections::{BTreeMap, BTreeSet};

use crate::program::live_recording::TriangleCount;
use linecarve::Options;
use linecarve::stream::{Message, Reply, Session, SessionSummary};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// What a SLAM system knows.
#[derive(Default)]
struct World {
    /// Positions by id; the cameras look along z.
    keyframes: BTreeMap<u64, [f64; 3]>,
    points: BTreeMap<u64, ([f64; 3], BTreeSet<u64>)>,
    lines: BTreeMap<u64, ([[f64; 3]; 2], Vec<u64>)>,
    next: u64,
}

fn start() -> Value {
    json!({
        "type": "start", "depth_source": "none",
        "calibration": { "color": { "fx": 500, "fy": 500, "cx": 320, "cy": 240 } },
    })
}

fn pose(position: &[f64; 3]) -> Value {
    json!({ "translation": position, "rotation": [0, 0, 0, 1] })
}

fn keyframe(id: u64, position: &[f64; 3]) -> Value {
    json!({ "type": "keyframe", "id": id, "world_from_camera": pose(position) })
}

fn position(rng: &mut impl Rng, from: f64, to: f64) -> [f64; 3] {
    [
        rng.random_range(-2.0..2.0),
        rng.random_range(-2.0..2.0),
        rng.random_range(from..to),
    ]
}

fn chosen(rng: &mut impl Rng, keyframes: &BTreeMap<u64, [f64; 3]>) -> Vec<u64> {
    keyframes
        .keys()
        .copied()
        .filter(|_| rng.random_bool(0.6))
        .collect()
}

impl World {
    /// A random message, whose effect is made here at once.
    fn message(&mut self, rng: &mut impl Rng) -> Value {
        self.next += 1;
        let id = self.next;
        let kind = if self.keyframes.len() < 4 {
            0
        } else {
            rng.random_range(0..8)
        };
        match kind {
            0 => {
                let place = position(rng, -0.5, 0.5);
                self.keyframes.insert(id, place);
                keyframe(id, &place)
            }
            1 => {
                let moved = *self.keyframes.keys().next().unwrap();
                let place = position(rng, -0.5, 0.5);
                self.keyframes.insert(moved, place);
                json!({ "type": "poses", "poses": [{ "id": moved, "world_from_camera": pose(&place) }] })
            }
            2 if self.keyframes.len() > 5 => {
                let (gone, _) = self.keyframes.pop_last().unwrap();
                for (_, seen) in self.points.values_mut() {
                    seen.remove(&gone);
                }
                for (_, seen) in self.lines.values_mut() {
                    seen.retain(|other| *other != gone);
                }
                json!({ "type": "remove", "ids": [gone] })
            }
            2..4 => {
                let mut points = Vec::new();
                for number in 0..20 {
                    let known = self
                        .points
                        .keys()
                        .nth(number)
                        .filter(|_| rng.random_bool(0.2));
                    let id = known.copied().unwrap_or(100 * id + number as u64);
                    let place = position(rng, 3.0, 4.0);
                    self.points.entry(id).or_default().0 = place;
                    points.push(json!({ "id": id, "position": place }));
                }
                let gone = self.points.keys().find(|_| rng.random_bool(0.02)).copied();
                let gone = gone.filter(|gone| points.iter().all(|point| point["id"] != *gone));
                gone.and_then(|gone| self.points.remove(&gone));
                json!({ "type": "points", "points": points, "removed": Vec::from_iter(gone) })
            }
            4..7 => {
                let all: Vec<u64> = self.keyframes.keys().copied().collect();
                let keyframe = all[rng.random_range(0..all.len())];
                let (mut points, mut removed) = (Vec::new(), Vec::new());
                for (id, (_, seen)) in &mut self.points {
                    if rng.random_bool(0.7) {
                        seen.insert(keyframe);
                        points.push(*id);
                    } else if rng.random_bool(0.1) {
                        seen.remove(&keyframe);
                        removed.push(*id);
                    }
                }
                json!({ "type": "observations", "keyframe": keyframe, "points": points, "removed": removed })
            }
            _ => {
                let known = self.lines.keys().next().filter(|_| rng.random_bool(0.5));
                let id = known.copied().unwrap_or(id);
                let ends = [position(rng, 3.0, 4.0), position(rng, 3.0, 4.0)];
                let seen = chosen(rng, &self.keyframes);
                self.lines.insert(id, (ends, seen.clone()));
                let line = json!({ "id": id, "ends": ends, "keyframes": seen, "sigma": 0.02 });
                json!({ "type": "lines", "lines": [line] })
            }
        }
    }

    /// Everything in a few messages.
    fn at_once(&self) -> Vec<Value> {
        let mut messages = vec![start()];
        messages.extend(
            self.keyframes
                .iter()
                .map(|(id, place)| keyframe(*id, place)),
        );
        let points = self.points.iter();
        let points = points.map(|(id, (place, _))| json!({ "id": id, "position": place }));
        messages.push(json!({ "type": "points", "points": points.collect::<Vec<_>>() }));
        for id in self.keyframes.keys() {
            let seen = self
                .points
                .iter()
                .filter(|(_, (_, seen))| seen.contains(id));
            let points: Vec<u64> = seen.map(|(id, _)| *id).collect();
            messages.push(json!({ "type": "observations", "keyframe": id, "points": points }));
        }
        let lines = self.lines.iter().map(|(id, (ends, seen))| {
            json!({ "id": id, "ends": ends, "keyframes": seen, "sigma": 0.02 })
        });
        messages.push(json!({ "type": "lines", "lines": lines.collect::<Vec<_>>() }));
        messages
    }
}

/// Runs a session and demands that the changes of its surface add up.
fn run(messages: &[Value]) -> SessionSummary {
    let mut session = Session::new(Options::default()).unwrap();
    let mut count = TriangleCount::default();
    for message in messages {
        let message: Message = serde_json::from_value(message.clone()).unwrap();
        let reply = session.handle(&message).unwrap();
        if let Some(Reply::Surface { .. }) = reply {
            count.apply(reply);
        }
    }
    let end = session.finish();
    count.apply(end.last_change.unwrap());
    end.summary
}

#[test]
fn any_messages_end_with_the_surface_of_what_there_is() {
    let mut surfaces = 0;
    for seed in 0..100 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut world = World::default();
        let mut messages = vec![start()];
        for _ in 0..30 {
            messages.push(world.message(&mut rng));
        }
        let (grown, at_once) = (run(&messages), run(&world.at_once()));
        assert_eq!(grown.mesh.positions, at_once.mesh.positions, "seed {seed}");
        assert_eq!(grown.mesh.triangles, at_once.mesh.triangles, "seed {seed}");
        assert_eq!(grown.segments, at_once.segments, "seed {seed}");
        surfaces += usize::from(!grown.mesh.triangles.is_empty());
    }
    assert!(surfaces > 50, "{surfaces} of 100 sessions have a surface");
}

#[test]
fn bad_points_and_lines_are_refused_and_change_nothing() {
    let mut session = Session::new(Options::default()).unwrap();
    let mut send = |message: Value| {
        let message: Message = serde_json::from_value(message).unwrap();
        session.handle(&message).map_err(|error| error.to_string())
    };
    send(start()).unwrap();
    let point = |id: u64, x: f64| json!({ "id": id, "position": [x, 0, 3] });
    let early = send(json!({ "type": "points", "points": [point(1, 0.0)] }));
    assert!(early.unwrap_err().contains("after the first `keyframe`"));
    send(keyframe(1, &[0.0; 3])).unwrap();
    send(json!({ "type": "points", "points": [point(1, 0.0)] })).unwrap();
    let line = json!({ "id": 3, "ends": [[0, 0, 3], [1, 0, 3]], "keyframes": [1] });
    send(json!({ "type": "lines", "lines": [line.clone()] })).unwrap();
    let with = |key: &str, value: Value| {
        let mut line = line.clone();
        line[key] = value;
        json!({ "type": "lines", "lines": [line] })
    };
    for (message, expected) in [
        (keyframe(1, &[0.0; 3]), "keyframe 1 exists already"),
        (
            json!({ "type": "points", "points": [point(2, 1e300)] }),
            "point 2",
        ),
        (
            json!({ "type": "points", "points": [point(2, 0.0), point(2, 1.0)] }),
            "twice",
        ),
        (
            json!({ "type": "points", "points": [point(2, 0.0)], "removed": [9] }),
            "no point 9",
        ),
        (
            json!({ "type": "observations", "keyframe": 1, "points": [1, 2] }),
            "no point 2",
        ),
        (
            json!({ "type": "observations", "keyframe": 7 }),
            "no keyframe 7",
        ),
        (with("sigma", json!(-1.0)), "`sigma` is -1"),
        (with("keyframes", json!([1, 8])), "no keyframe 8"),
        (json!({ "type": "lines", "removed": [4] }), "no line 4"),
        (json!({ "type": "remove", "ids": [1, 2] }), "no keyframe 2"),
    ] {
        let problem = send(message.clone()).unwrap_err();
        assert!(problem.contains(expected), "{message}: {problem}");
    }
    let Some(Reply::Surface {
        keyframes,
        segments,
        ..
    }) = send(json!({ "type": "poses", "poses": [] })).unwrap()
    else {
        panic!("no reply");
    };
    assert_eq!((keyframes, segments), (1, 1));
}

#[test]
fn points_are_refused_where_images_are_expected() {
    let mut session = Session::new(Options::default()).unwrap();
    let mut images = start();
    images["depth_source"] = json!("semi-dense");
    for (message, expected) in [
        (images, None),
        (
            json!({ "type": "points", "points": [] }),
            Some("\"depth_source\": \"none\""),
        ),
        (keyframe(1, &[0.0; 3]), Some("no `color` image")),
    ] {
        let message: Message = serde_json::from_value(message).unwrap();
        let outcome = session.handle(&message);
        match expected {
            Some(expected) => assert!(outcome.unwrap_err().to_string().contains(expected)),
            None => assert!(outcome.is_ok()),
        }
    }
}
