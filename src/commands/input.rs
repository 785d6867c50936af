//! What the options of the command line ask for.

use std::path::Path;

use anyhow::bail;

use super::unused::read_configuration;
use crate::cli::{KeyframeArgs, PresetArg, SequenceArgs, StageArgs};
use crate::progress::Verbosity;
use crate::sinks::OutputFolder;
use crate::standard_error::say;
use linecarve_engine::options::Options;
use linecarve_engine::video::{Unpacking, of_video, unpack, unpack_as};
use linecarve_engine::{Input, SourceChoice};
use linecarve_sequence::{OpenOptions, Sequence, video_to_unpack};

/// What is to be reconstructed from which source.
pub fn input(
    args: &SequenceArgs,
    selection: &KeyframeArgs,
    source: SourceChoice,
    verbosity: Verbosity,
) -> Input {
    let mut input = Input::from(&args.sequence);
    input.open = open_options(args);
    input.selection.every = selection.every;
    input.selection.list = selection.keyframes.clone();
    input.selection.max_keyframes = selection.max_keyframes;
    input.selection.given = selection.given();
    input.source = source;
    input.accept_as_is = args.accept_as_is;
    input.progress = verbosity.hook();
    input
}

/// Opens a sequence alone.
pub(super) fn open(args: &SequenceArgs) -> anyhow::Result<Sequence> {
    Ok(Sequence::open(&args.sequence, &open_options(args))?)
}

pub(super) fn open_options(args: &SequenceArgs) -> OpenOptions {
    let mut options = OpenOptions::default();
    options.calibration = args.calibration.clone();
    options.poses = args.poses.clone();
    options.layout = args.layout.clone();
    options.model = args.model.clone();
    options
}

/// The files that options of a run name.
pub(super) fn named_files<'a>(
    input: &'a SequenceArgs,
    selection: &'a KeyframeArgs,
    stages: &'a StageArgs,
) -> impl Iterator<Item = &'a Path> {
    let others = [&selection.keyframes, &stages.config].into_iter();
    input
        .files()
        .chain(others.filter_map(|file| file.as_deref()))
}

/// Writes the images of a video to the output folder, and makes these the input.
///
/// # Errors
/// When there is no output folder, or the video has no picture that can be read.
pub(super) fn unpack_video(
    input: &mut Input,
    output: Option<&mut OutputFolder>,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let Some(output) = output else {
        bail!(
            "{}: unpack the video with linecarve track first",
            input.path.display()
        );
    };
    let folder = output.subfolder("video")?;
    output.numbered("video/images", &["jpg"])?;
    output.file("video/times.txt")?;
    for warning in unpack(&input.path, &folder, &verbosity.hook())? {
        if verbosity > Verbosity::Quiet {
            say!("warning: {warning}");
        }
    }
    input.open = of_video(std::mem::take(&mut input.open));
    input.path = folder;
    input.track = input.open.poses.is_none();
    Ok(())
}

/// Writes the pictures of the video in a recording's folder, such as that of Stray Scanner, to the output folder, and makes them its colour
/// images. Without an output folder the reader of the recording says how to unpack it.
///
/// # Errors
/// When the video has no picture that can be read.
pub(super) fn unpack_recorded_video(
    path: &Path,
    open: &mut OpenOptions,
    output: Option<&mut OutputFolder>,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let (Some(video), Some(output)) = (video_to_unpack(path, open), output) else {
        return Ok(());
    };
    let folder = output.subfolder("video")?;
    output.numbered("video/images", &["jpg"])?;
    output.file("video/times.txt")?;
    unpack_pictures(&video, &folder, None, open, verbosity)
}

/// Writes the pictures of a recording's video, or the first of them, to a folder, and makes them its colour images.
pub(super) fn unpack_pictures(
    video: &Path,
    folder: &Path,
    most: Option<usize>,
    open: &mut OpenOptions,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let unpacking = Unpacking {
        of_recording: true,
        most,
    };
    for warning in unpack_as(video, folder, unpacking, &verbosity.hook())? {
        if verbosity > Verbosity::Quiet {
            say!("warning: {warning}");
        }
    }
    open.video_images = Some(folder.join("images"));
    Ok(())
}

/// The parameters that a preset or a configuration file gives; the defaults without either. The tables `unused` have no effect.
///
/// # Errors
/// When the configuration cannot be read or sets a table without effect; the text names file and key.
pub(super) fn base_options(
    preset: Option<PresetArg>,
    config: Option<&Path>,
    unused: &[&str],
) -> anyhow::Result<Options> {
    Ok(match (preset, config) {
        (Some(PresetArg::Paper), _) => Options::paper(),
        (None, Some(path)) => read_configuration(path, unused)?.options(),
        (None, None) => Options::default(),
    })
}

/// The parameters of all stages: those of the preset or of the configuration, with the flags on top.
///
/// # Errors
/// When the configuration cannot be read; the text names file and key.
pub fn parameters(stages: &StageArgs, selection: &KeyframeArgs) -> anyhow::Result<Options> {
    used_parameters(stages, selection, &[])
}

/// As [`parameters`], for a command on which the tables `unused` have no effect.
///
/// # Errors
/// As [`parameters`], and when the configuration sets one of these tables.
pub(super) fn used_parameters(
    stages: &StageArgs,
    selection: &KeyframeArgs,
    unused: &[&str],
) -> anyhow::Result<Options> {
    let mut options = base_options(stages.preset, stages.config.as_deref(), unused)?;
    let size = &mut options.images.longest_side_px;
    *size = stages.max_image_size.unwrap_or(*size);
    keyframe_options(selection, &mut options);
    Ok(options)
}

/// Applies the flags that choose keyframes by motion.
pub(super) fn keyframe_options(selection: &KeyframeArgs, options: &mut Options) {
    let chosen = &mut options.keyframes;
    chosen.translation = selection.min_translation.or(chosen.translation);
    chosen.rotation_degrees = selection.min_rotation.unwrap_or(chosen.rotation_degrees);
    chosen.sharpness_window = selection
        .sharpness_window
        .unwrap_or(chosen.sharpness_window);
}
