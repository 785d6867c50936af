//! What is known about a sequence, as text.

use std::fmt::Write;

use linecarve_sequence::{CameraFacts, SequenceFacts};

/// So many other readings are printed; the JSON object has them all.
const SHOWN: usize = 5;

/// The facts as lines of text.
pub(crate) fn sequence_text(facts: &SequenceFacts) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = describe(facts, &mut text);
    text
}

fn describe(facts: &SequenceFacts, out: &mut String) -> std::fmt::Result {
    writeln!(out, "layout     {}", facts.layout)?;
    writeln!(out, "frames     {}", facts.frames)?;
    match &facts.motion {
        None => writeln!(out, "motion     unknown, as there are no poses")?,
        Some(motion) => {
            let [x, y, z] = motion.extent;
            writeln!(
                out,
                "motion     path {:.3}, box {x:.3} x {y:.3} x {z:.3}, median step {:.4} and {:.2} degrees, largest step {:.4}{}",
                motion.path_length,
                motion.median_step,
                motion.median_rotation_deg,
                motion.largest_step,
                motion
                    .largest_step_to
                    .as_ref()
                    .map_or_else(String::new, |frame| format!(" (to {frame})"))
            )?;
        }
    }
    writeln!(out, "colour     {}", camera(&facts.color))?;
    if let Some(images) = &facts.images {
        let [darkest, brightest] = images.mean_gray;
        writeln!(
            out,
            "images     mean grey {darkest:.0} to {brightest:.0}; most blurred {} ({:.0} % of the median sharpness)",
            images.most_blurred,
            100.0 * images.least_relative_sharpness
        )?;
    }
    match &facts.depth {
        None => writeln!(out, "depth      none")?,
        Some(depth) => {
            writeln!(
                out,
                "depth      {} frames, {} raw units a unit, {}; {}",
                depth.frames,
                depth.scale,
                if depth.registered {
                    "registered to colour"
                } else {
                    "of a camera of its own"
                },
                camera(&depth.camera)
            )?;
            write!(
                out,
                "           {:.0} % of the pixels known (at least {:.0} %)",
                100.0 * depth.mean_coverage,
                100.0 * depth.least_coverage
            )?;
            if let Some([low, median, high]) = depth.percentiles {
                write!(
                    out,
                    ", 1 % below {low:.3}, median {median:.3}, 1 % above {high:.3}"
                )?;
            }
            writeln!(out)?;
        }
    }
    for consistency in &facts.consistency {
        writeln!(
            out,
            "agreement  of depth {} frame(s) apart, {} pairs:",
            consistency.gap, consistency.pairs
        )?;
        let readings =
            std::iter::once(&consistency.as_read).chain(consistency.others.iter().take(SHOWN));
        for reading in readings {
            writeln!(
                out,
                "           {:<44} median {:.4} ({:.2} % of depth), {:.0} % within 1 %",
                reading.reading,
                reading.median_difference,
                100.0 * reading.median_relative,
                100.0 * reading.share_within_1_percent
            )?;
        }
    }
    if let Some(points) = &facts.map_points {
        write!(
            out,
            "points     {} of {} views, {:.1} views each, {:.1} % of the sightings before their camera",
            points.points,
            points.views,
            points.mean_observations,
            100.0 * points.share_in_front
        )?;
        if let Some(median) = points.median_reprojection_px {
            write!(
                out,
                ", median {median:.2} px from where they were seen ({} sightings)",
                points.compared
            )?;
        }
        writeln!(out)?;
    }
    if let Some(epipolar) = &facts.epipolar {
        writeln!(
            out,
            "corners    {} that look alike in {} pairs of images lie off their epipolar lines by:",
            epipolar.matches, epipolar.pairs
        )?;
        let readings = std::iter::once(&epipolar.as_read).chain(epipolar.others.iter().take(SHOWN));
        for reading in readings {
            writeln!(
                out,
                "           {:<44} median {:.2} px, {:.0} % within 2 px",
                reading.reading,
                reading.median_px,
                100.0 * reading.share_within_2_px
            )?;
        }
    }
    if let Some(registration) = &facts.registration {
        let [x, y] = registration.best_shift_px;
        writeln!(
            out,
            "outlines   of depth lie {:.2} px from colour edges on {} images; at best {:.2} px, scaled by {:.2} and shifted \
             by ({x:.0}, {y:.0}) px",
            registration.mean_distance_px,
            registration.frames,
            registration.best_distance_px,
            registration.best_scale,
        )?;
    }
    for convention in &facts.conventions {
        writeln!(out, "assumed    {convention}")?;
    }
    Ok(())
}

fn camera(camera: &CameraFacts) -> String {
    let size = match (camera.width, camera.height) {
        (Some(width), Some(height)) => format!("{width} x {height}, "),
        _ => String::new(),
    };
    let distortion = if camera.distortion.is_empty() {
        String::new()
    } else {
        format!(" {:?}", camera.distortion)
    };
    format!(
        "{size}{}{distortion}, f {} {}, c {} {} ({})",
        camera.model, camera.fx, camera.fy, camera.cx, camera.cy, camera.origin
    )
}
