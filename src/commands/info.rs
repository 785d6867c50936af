//! `linecarve info`: what a sequence holds and whether it agrees with itself.

use anyhow::ensure;

use crate::cli::InfoArgs;
use crate::commands::Outcome;
use crate::commands::input::open_options;
use crate::progress::Verbosity;
use crate::sinks::{print_object, print_text};
use crate::standard_error::say;
use crate::text::sequence_text;
use linecarve_engine::tracking::{TrackingMode, open_with_or_without_poses};
use linecarve_engine::video::is_video;
use linecarve_sequence::{InspectOptions, Warning, inspect};

pub(super) fn run(args: &InfoArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let input = &args.input.sequence;
    ensure!(
        !is_video(input),
        "{} is a video: `linecarve reconstruct` takes it as it is; `linecarve track` writes its images, poses and calibration to a \
         folder that `linecarve info` reads",
        input.display()
    );
    let (sequence, without_poses) = open_with_or_without_poses(input, &open_options(&args.input))?;
    let mut facts = inspect(&sequence, &InspectOptions::default())?;
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
