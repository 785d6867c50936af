//! What is known about a video, as text.

use linecarve_engine::video::VideoFacts;

/// The facts as lines of text.
pub(crate) fn video_text(facts: &VideoFacts) -> String {
    let rate = match facts.pictures {
        2.. if facts.duration_s > 0.0 => {
            format!(
                ", {:.2} a second",
                (facts.pictures - 1) as f64 / facts.duration_s
            )
        }
        _ => String::new(),
    };
    let turned = match facts.quarter_turns {
        0 => String::new(),
        turns => format!(
            ", turned by {} degrees to be upright",
            90 * u32::from(turns)
        ),
    };
    let codec = match facts.codec {
        "none" => "not compressed",
        codec => codec,
    };
    format!(
        "video      {}, {codec}\nimages     {} of {} x {} pixels{turned}, over {:.3} s{rate}\nposes      none in a video: linecarve track \
         finds them and writes images, poses and calibration to a folder; linecarve reconstruct takes the video as it is\n",
        facts.container, facts.pictures, facts.width, facts.height, facts.duration_s
    )
}
