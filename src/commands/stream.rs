//! `linecarve stream`: messages on standard input, changes of the surface on standard output.

use std::time::Duration;

use anyhow::Context;

use crate::cli::StreamArgs;
use crate::commands::Outcome;
use crate::commands::input::base_options;
use crate::commands::stream_lines::{Line, Lines, Replies};
use crate::process::is_signalled;
use crate::progress::Verbosity;
use crate::report::page::write_page;
use crate::sinks::{OutputFolder, SessionPage, SurfaceFiles, final_mesh_edges, last_page};
use crate::standard_error::say;
use linecarve_engine::front_end::unmeasurable_warning;
use linecarve_engine::stream::{Message, Reply, Session, SessionEnd, SessionSummary};
use linecarve_mesh::GltfFrame;
use linecarve_sequence::export::{TrajectoryFormat, write_trajectory};
use nalgebra::Vector3;

/// Time without a message after which small corrections are made that wait: longer than between keyframes, so that none has to wait.
const PATIENCE: Duration = Duration::from_millis(500);

pub(super) fn run(args: &StreamArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let options = base_options(args.preset, args.config.as_deref(), &["simplify"])?;
    let mut output = args
        .out
        .as_deref()
        .map(|out| OutputFolder::create(out, &[]))
        .transpose()?;
    let mut session = Session::new(options).context("cannot make a folder for temporary files")?;
    if let Some(view) = args.live.start(verbosity)? {
        session.set_observer(Box::new(SessionPage::new(view)));
    }
    let mut replies = Replies::default();
    let lines = Lines::begin()?;
    let mut number = 0;
    let mut patience = PATIENCE;
    loop {
        let waits = session.pending_corrections() > 0;
        let line = lines.next(waits.then_some(patience))?;
        if matches!(line, Line::Idle) {
            // The others follow at once, unless a message comes.
            patience = Duration::ZERO;
            match session.settle() {
                Ok(Some(reply)) => replies.send(&reply)?,
                Ok(None) => {}
                Err(error) => replies.refuse(number, error.to_string(), verbosity)?,
            }
            if replies.nobody_listens {
                break;
            }
            continue;
        }
        patience = PATIENCE;
        number += 1;
        let answer = match line {
            Line::End => break,
            Line::Idle => continue,
            Line::Unusable(problem) => Err(problem),
            Line::Text(text) if text.trim().is_empty() => continue,
            Line::Text(text) => match serde_json::from_str::<Message>(&text) {
                Ok(Message::End {}) => break,
                Ok(message) => session.handle(&message).map_err(|error| error.to_string()),
                Err(error) => Err(format!("not a message: {error}")),
            },
        };
        match answer {
            Ok(Some(reply)) => replies.send(&reply)?,
            Ok(None) => {}
            Err(message) => replies.refuse(number, message, verbosity)?,
        }
        if replies.nobody_listens {
            break;
        }
    }
    let SessionEnd {
        last_change,
        summary,
        state,
    } = session.finish();
    match last_change {
        Ok(Some(reply)) => replies.send(&reply)?,
        Ok(None) => {}
        Err(error) => replies.refuse(number, error.to_string(), verbosity)?,
    }
    let keyframes = summary.keyframes;
    let (vertices, triangles) = (summary.mesh.positions.len(), summary.mesh.triangles.len());
    let corrected_poses = summary.corrected_poses.clone();
    let camera_correction = summary.camera_correction;
    let tracking = summary.tracking.clone();
    let unmeasurable = state.as_ref().map_or(0, |it| it.unmeasurable_depths());
    let mut warnings: Vec<String> = unmeasurable_warning(unmeasurable).into_iter().collect();
    let is_contradicted = summary.contradiction.is_some() && !args.accept_as_is;
    warnings.extend(summary.contradiction.clone());
    warnings.extend(summary.warnings.iter().cloned());
    let of_tracking = tracking.iter().flat_map(|tracking| &tracking.warnings);
    for warning in of_tracking.chain(&warnings) {
        if verbosity > Verbosity::Quiet {
            say!("warning: {warning}");
        }
    }
    if let Some(output) = &mut output {
        let page = state.map(|state| last_page(state.as_ref(), &summary.mesh));
        let up = page.as_ref().map(|page| page.up);
        write_results(args, summary, output, up)?;
        if let Some(page) = page {
            write_page(&output.file("report.html")?, &page)?;
        }
        output.remove_stale()?;
    }
    replies.send(&Reply::End {
        keyframes,
        vertices,
        triangles,
        files: output.map_or_else(Vec::new, |output| output.written().to_vec()),
        corrected_poses,
        camera_correction,
        tracking,
        warnings,
    })?;
    Ok(if is_signalled() {
        Outcome::Negative(format!("stopped by a signal after {keyframes} keyframe(s)"))
    } else if triangles == 0 {
        Outcome::Negative(format!("the mesh is empty after {keyframes} keyframe(s)"))
    } else if is_contradicted {
        Outcome::Negative(
            "the images contradict the poses, the depth scale or the calibration of the messages (--accept-as-is takes them as they are)"
                .to_owned(),
        )
    } else {
        Outcome::Done
    })
}

/// Writes what there is at the end.
fn write_results(
    args: &StreamArgs,
    summary: SessionSummary,
    output: &mut OutputFolder,
    up: Option<Vector3<f64>>,
) -> anyhow::Result<()> {
    if !summary.trajectory.is_empty() {
        let path = output.file("trajectory.txt")?;
        write_trajectory(&path, TrajectoryFormat::Tum, &summary.trajectory)?;
    }
    let edges = final_mesh_edges(&summary.mesh, &summary.clusters, None)?;
    let mut surface = SurfaceFiles {
        mesh: summary.mesh,
        texture: None,
        lines: Some((summary.segments, summary.clusters)),
        edges: edges.lines,
    };
    surface.translate(&summary.origin);
    let formats: Vec<_> = args.format.iter().map(|&format| format.into()).collect();
    let frame = match up {
        Some(up) => GltfFrame::upright(summary.origin, &up),
        None => GltfFrame::from(&summary.origin),
    };
    surface.write(output, "", &formats, &frame)
}
