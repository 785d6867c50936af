//! Errors of a trajectory as text.

use std::fmt::Write;

use linecarve_sequence::{TrajectoryAlignment, TrajectoryComparison};

pub(crate) fn trajectory_text(found: &TrajectoryComparison) -> String {
    let alignment = match found.alignment {
        TrajectoryAlignment::None => "none",
        TrajectoryAlignment::Se3 => "rigid (se3)",
        TrajectoryAlignment::Sim3 => "similarity (sim3)",
    };
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(text, "alignment  {alignment}, scale {:.6}", found.scale);
    let _ = writeln!(
        text,
        "coverage   {:.1} % of {} frames; {} poses compared",
        100.0 * found.coverage,
        found.frames,
        found.pairs
    );
    let _ = writeln!(
        text,
        "path       {:.3} long; a camera that stands still scores {:.5}",
        found.path, found.spread
    );
    let position = &found.position;
    let _ = writeln!(
        text,
        "positions  rmse {:.5}, median {:.5}, largest {:.5}",
        position.rmse, position.median, position.max
    );
    for one in &found.relative {
        let _ = writeln!(
            text,
            "{:2} apart   rmse {:.5}, {:.3} degrees, of {} pairs",
            one.frames_apart, one.translation, one.rotation_degrees, one.pairs
        );
    }
    text
}
