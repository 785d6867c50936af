//! `linecarve info`: what a sequence holds and whether it agrees with itself.

use std::path::Path;

use anyhow::ensure;

use crate::cli::InfoArgs;
use crate::commands::Outcome;
use crate::commands::input::{open_options, unpack_pictures};
use crate::progress::Verbosity;
use crate::sinks::{TemporaryFolder, print_object, print_text};
use crate::standard_error::say;
use crate::text::{sequence_text, video_text};
use linecarve_engine::tracking::{TrackingMode, open_with_or_without_poses};
use linecarve_engine::video::{describe, is_video};
use linecarve_sequence::{InspectOptions, OpenOptions, Warning, inspect, video_to_unpack};

pub(super) fn run(args: &InfoArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let input = &args.input.sequence;
    if is_video(input) {
        return describe_video(input, args.json, verbosity);
    }
    let mut open = open_options(&args.input);
    // Lives until the images have been looked at.
    let _pictures = match video_to_unpack(input, &open) {
        Some(video) => Some(first_pictures(&video, &mut open, verbosity)?),
        None => None,
    };
    let (sequence, without_poses) = open_with_or_without_poses(input, &open)?;
    let mut facts = inspect(&sequence, &InspectOptions::default())?;
    let missed = sequence.unread_files().iter().filter(|file| file.is_missed);
    facts
        .warnings
        .extend(missed.map(|file| Warning::statement(file.problem(sequence.folder()))));
    if let Some(statement) = without_poses {
        let source = match TrackingMode::of(&sequence) {
            TrackingMode::Rgbd => "images with depth",
            TrackingMode::Stereo => "stereo pairs",
            TrackingMode::Mono => "images of one camera",
        };
        facts.warnings.push(Warning::statement(format!(
            "{statement}: `linecarve track` and `linecarve reconstruct` find them from {source}"
        )));
    }
    if args.json {
        print_object(&facts)?;
    } else {
        print_text(&sequence_text(&facts))?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in &facts.warnings {
            say!("warning: {warning}");
        }
    }
    Ok(Outcome::Done)
}

/// Unpacks the first pictures of a recording's video to a temporary folder.
fn first_pictures(
    video: &Path,
    open: &mut OpenOptions,
    verbosity: Verbosity,
) -> anyhow::Result<TemporaryFolder> {
    /// Two seconds, or four: enough motion to compare poses and images.
    const MOST: usize = 120;
    let folder = TemporaryFolder::create(&std::env::temp_dir())?;
    unpack_pictures(video, folder.path(), Some(MOST), open, verbosity)?;
    if verbosity > Verbosity::Quiet {
        say!(
            "note: of {} at most the first {MOST} pictures are looked at",
            video.display()
        );
    }
    Ok(folder)
}

/// Says what a video holds.
fn describe_video(path: &Path, as_json: bool, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    ensure!(
        path != Path::new("-"),
        "standard input cannot be described: give the file of the video"
    );
    let facts = describe(path)?;
    if as_json {
        print_object(&facts)?;
    } else {
        print_text(&video_text(&facts))?;
    }
    if verbosity > Verbosity::Quiet
        && let Some(damage) = &facts.damage
    {
        say!("warning: {damage}");
    }
    Ok(Outcome::Done)
}
