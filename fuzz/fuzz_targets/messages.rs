//! Conversations with a session of `linecarve stream` about points, lines and poses: each message has the form that the session expects, and
//! any numbers and ids. A message is answered or refused, and the session ends with a mesh of finite points. Bytes that are no messages are
//! tried by `readers`.
//!
//! In the folder above:
//!
//! ```text
//! export RUSTC_BOOTSTRAP=1
//! cargo fuzz run messages -- -rss_limit_mb=1024 -max_len=600
//! ```

#![no_main]

use libfuzzer_sys::fuzz_target;
use linecarve_engine::Options;
use linecarve_engine::stream::{Message, Session};
use serde_json::{Value, json};

/// Numbers that are drawn more often than others.
const NUMBERS: [f64; 12] = [
    0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    1e-9,
    -1e-9,
    1e3,
    1e6,
    -1e9,
    1e30,
    f64::MAX,
];

/// The bytes that decide, one after another; zeros at their end.
struct Bytes<'a>(std::slice::Iter<'a, u8>);

impl Bytes<'_> {
    fn next(&mut self) -> u8 {
        self.0.next().copied().unwrap_or_default()
    }

    fn is_empty(&self) -> bool {
        self.0.len() == 0
    }

    /// A number: most often a small one.
    fn number(&mut self) -> f64 {
        let byte = self.next();
        match byte {
            0..12 => NUMBERS[usize::from(byte)],
            _ => (f64::from(byte) - 134.0) / 32.0,
        }
    }

    fn numbers(&mut self) -> [f64; 3] {
        [(); 3].map(|()| self.number())
    }

    /// An id: most often a known one.
    fn id(&mut self) -> u64 {
        match self.next() {
            255 => u64::MAX,
            byte => u64::from(byte % 8),
        }
    }

    fn pose(&mut self) -> Value {
        let mut rotation = [self.number(), self.number(), self.number(), 1.0];
        let norm = rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
        // Others are refused.
        if self.next() % 8 > 0 {
            rotation = rotation.map(|x| x / norm);
        }
        json!({ "translation": self.numbers(), "rotation": rotation })
    }

    fn list(&mut self, mut one: impl FnMut(&mut Self) -> Value) -> Vec<Value> {
        let count = self.next() % 6;
        (0..count).map(|_| one(self)).collect()
    }

    fn ids(&mut self) -> Vec<Value> {
        self.list(|bytes| bytes.id().into())
    }

    fn message(&mut self) -> Value {
        match self.next() % 6 {
            0 => json!({ "type": "keyframe", "id": self.id(), "world_from_camera": self.pose() }),
            1 => {
                let poses = self.list(|it| json!({ "id": it.id(), "world_from_camera": it.pose() }));
                json!({ "type": "poses", "poses": poses })
            }
            2 => json!({ "type": "remove", "ids": self.ids() }),
            3 => {
                let points = self.list(|it| {
                    json!({ "id": it.id(), "position": it.numbers(), "sigma": it.number() })
                });
                json!({ "type": "points", "points": points, "removed": self.ids() })
            }
            4 => json!({
                "type": "observations", "keyframe": self.id(), "points": self.ids(), "removed": self.ids(),
            }),
            _ => {
                let lines = self.list(|it| {
                    let ends = [it.numbers(), it.numbers()];
                    json!({ "id": it.id(), "ends": ends, "keyframes": it.ids() })
                });
                json!({ "type": "lines", "lines": lines, "removed": self.ids() })
            }
        }
    }
}

fuzz_target!(|data: &[u8]| {
    let mut session = Session::new(Options::default()).expect("a temporary folder");
    let mut bytes = Bytes(data.iter());
    let mut start = json!({ "type": "start", "depth_source": "none" });
    if bytes.next() % 2 == 1 {
        start["median_depth"] = bytes.number().into();
    }
    let mut message = start;
    loop {
        // A message that the session does not know is one that this target writes wrongly.
        let parsed: Message = serde_json::from_value(message.clone())
            .unwrap_or_else(|error| panic!("{message}: {error}"));
        if let Err(error) = session.handle(&parsed) {
            assert!(!error.to_string().is_empty());
        }
        if bytes.is_empty() {
            break;
        }
        message = bytes.message();
    }
    let mesh = session.finish().summary.mesh;
    let is_finite = mesh.positions.iter().all(|point| point.iter().all(|x| x.is_finite()));
    assert!(is_finite);
});
