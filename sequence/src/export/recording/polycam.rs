//! Raw data of Polycam.

use serde_json::{Map, Value, json};

use super::RecordingError;
use super::source::{Source, intrinsics, matrix_rows};
use crate::camera_axes::half_turn_about_x;

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    for folder in ["images", "cameras", "depth"] {
        source.make_folder(&format!("keyframes/{folder}"))?;
    }
    for index in 0..source.count() {
        // Microseconds; the names of the app have as many digits.
        let stem = 1_000_000_000 + source.time_ns(index) / 1000;
        source.write_picture(index, &format!("keyframes/images/{stem}"))?;
        source.write_depth_png(index, 1000.0, &format!("keyframes/depth/{stem}.png"))?;
        let camera = camera(source, index, stem);
        source.write(&format!("keyframes/cameras/{stem}.json"), camera.as_bytes())?;
    }
    Ok(())
}

fn camera(source: &Source<'_>, index: usize, timestamp: i64) -> String {
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let size = source.size();
    let mut keys = Map::new();
    for (name, value) in [
        ("fx", json!(fx)),
        ("fy", json!(fy)),
        ("cx", json!(cx)),
        ("cy", json!(cy)),
        ("width", json!(size.width)),
        ("height", json!(size.height)),
        ("timestamp", json!(timestamp)),
    ] {
        keys.insert(name.to_owned(), value);
    }
    let mut pose = *source.pose(index);
    pose.rotation *= half_turn_about_x().inverse();
    for (r, row) in matrix_rows(&pose).iter().take(3).enumerate() {
        for (c, value) in row.iter().enumerate() {
            keys.insert(format!("t_{r}{c}"), json!(value));
        }
    }
    Value::Object(keys).to_string()
}
