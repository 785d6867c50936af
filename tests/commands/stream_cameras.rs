//! `stream` with stereo pairs or one camera, without poses: bad input, and sessions without a map.

use std::path::{Path, PathBuf};

use crate::program::{stream, text};
use serde_json::{Value, json};

/// An image of the sample, in place of the left and of the right one: only what is wrong with messages counts here.
fn image(number: usize) -> PathBuf {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let list = std::fs::read_to_string(room.join("rgb.txt")).unwrap();
    let line = list.lines().nth(number + 1).unwrap();
    room.join(line.split(' ').nth(1).unwrap())
}

fn start(right: Value) -> Value {
    let color = json!({"fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5});
    json!({
        "type": "start", "poses": "track", "depth_source": "semi-dense",
        "calibration": { "color": color, "right": right },
    })
}

fn frame(id: u64, number: usize, right: Value) -> Value {
    json!({ "type": "frame", "id": id, "color": { "path": image(number) }, "right": right })
}

/// Sends the lines, and checks what the first replies say.
fn expect_replies(messages: &[(Value, &str)], status: i32) -> Vec<Value> {
    let lines: Vec<String> = messages.iter().map(|(line, _)| line.to_string()).collect();
    let (found, replies) = stream(&[], &lines);
    assert_eq!(found, Some(status), "{replies:?}");
    for (reply, (message, expected)) in replies.iter().zip(messages) {
        let text = reply["message"].as_str().unwrap_or_default();
        assert_eq!(text.is_empty(), expected.is_empty(), "{message}: {reply}");
        assert!(text.contains(expected), "{message}: {reply}");
    }
    replies
}

#[test]
fn right_cameras_that_cannot_be_are_refused() {
    let behind = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1], [0, 0, 0, 1]];
    let mut with_sensor = start(json!({ "baseline": 0.1 }));
    with_sensor["depth_source"] = json!("sensor");
    let mut with_depth = start(Value::Null);
    with_depth["median_depth"] = json!(2.0);
    let mut without_images = start(Value::Null);
    without_images["depth_source"] = json!("none");
    expect_replies(
        &[
            (start(json!({})), "[right] needs baseline"),
            (start(json!({ "baseline": 0 })), "[right] baseline = 0"),
            (start(json!({ "base": 0.1 })), "unknown field `base`"),
            (
                start(json!({ "color_from_right": behind })),
                "not at the right",
            ),
            (
                start(json!({ "baseline": 0.1, "fx": 500 })),
                "fx, fy, cx and cy",
            ),
            (with_sensor, "\"depth_source\": \"semi-dense\" for pairs"),
            (with_depth, "leave out `median_depth`"),
            (without_images, "\"semi-dense\" is for stereo pairs"),
            (start(json!({ "baseline": 0.1 })), ""),
        ],
        1,
    );
}

#[test]
fn pairs_that_cannot_be_used_are_answered_and_the_session_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::new(320, 200)
        .save(path("small.png"))
        .unwrap();
    std::fs::write(path("broken.png"), "no image").unwrap();
    let in_file = |name: &str| json!({ "path": path(name) });
    let right = || json!({ "path": image(1) });
    let mut without_color = frame(1, 0, right());
    without_color["color"] = Value::Null;
    let replies = expect_replies(
        &[
            (start(json!({ "baseline": 0.1 })), ""),
            (frame(0, 0, Value::Null), "frame 0 has no `right` image"),
            (frame(0, 0, in_file("small.png")), "320 x 200"),
            (frame(0, 0, right()), ""),
            (frame(1, 0, Value::Null), "leave `right` out of"),
            (frame(1, 0, in_file("small.png")), "small.png"),
            (frame(1, 0, in_file("broken.png")), "broken.png"),
            (frame(1, 0, in_file("nowhere.png")), "nowhere.png"),
            (frame(1, 0, json!({ "base64": "%" })), "not base 64"),
            (without_color, "needs `color` and `right`"),
            (frame(0, 0, right()), "frame 0 exists already"),
            (frame(1, 0, right()), ""),
        ],
        1,
    );
    let end = replies.last().unwrap();
    assert_eq!(end["tracking"]["frames"], 2);
}

#[test]
fn one_camera_takes_no_right_images_and_may_end_without_a_map() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut lines = vec![start(Value::Null).to_string()];
    lines.push(frame(0, 0, json!({ "path": image(0) })).to_string());
    // The camera stands still.
    lines.extend((0..14).map(|id| frame(id, 0, Value::Null).to_string()));
    let (status, replies) = stream(&["--out", text(&out)], &lines);
    assert_eq!(status, Some(1));
    let message = replies[1]["message"].as_str().unwrap();
    assert!(message.contains("has no `right` camera"), "{message}");
    for reply in &replies[2..16] {
        assert!(reply["world_from_camera"].is_null(), "{reply}");
        let reason = reply["reason"].as_str().unwrap();
        assert!(reason.contains("no map yet"), "{reason}");
    }
    let end = replies.last().unwrap();
    assert_eq!(end["triangles"], 0);
    assert_eq!(end["tracking"]["tracked"], 0);
    let warnings = end["tracking"]["warnings"].to_string();
    assert!(warnings.contains("14 of 14 frames"), "{warnings}");
    assert!(!out.join("trajectory.txt").exists());
}
