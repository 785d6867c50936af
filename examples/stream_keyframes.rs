//! Feeds three keyframes of the sample sequence to a streaming session, as a running SLAM system would.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve::Options;
use linecarve::stream::{PoseParts, Reply, Session};
use linecarve_sequence::{OpenOptions, Sequence};
use serde_json::{from_value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let sequence = Sequence::open(&folder, &OpenOptions::default())?;
    let mut session = Session::new(Options::default())?;
    let color = json!({"fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5});
    let calibration = json!({"color": color, "depth": {"scale": 5000.0}});
    let start = json!({"type": "start", "calibration": calibration});
    session.handle(&from_value(start)?)?;
    let (mut added, mut removed) = (0, 0);
    for (id, frame) in sequence.frames().iter().take(3).enumerate() {
        let message = json!({
            "type": "keyframe",
            "id": id,
            "world_from_camera": PoseParts::from(&frame.world_from_camera),
            "color": {"path": frame.color},
            "depth": {"path": frame.depth},
        });
        if let Some(Reply::Surface { change, .. }) = session.handle(&from_value(message)?)? {
            added += change.added.len();
            removed += change.removed.len();
        }
    }
    let mesh = session.finish().summary.mesh;
    println!("{added} triangles added, {removed} removed");
    println!("{} triangles at the end", mesh.triangles.len());
    Ok(())
}
