//! `linecarve convert`: trajectories, maps, meshes and lines in the formats of other programs.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::cli::{ConvertArgs, RecordingErrors, SequenceArgs, Target, WrongPixels};
use crate::commands::Outcome;
use crate::commands::convert_geometry::convert_geometry;
use crate::commands::input::open;
use crate::commands::unused::refuse_unused;
use crate::progress::Verbosity;
use crate::sinks::{check_outputs, keep_apart, keep_sequence};
use crate::standard_error::say;
use linecarve_sequence::Sequence;
use linecarve_sequence::export::{
    Disturbance, RecordingLayout, TrajectoryFormat, WrongDepth, posed_images, write_colmap,
    write_disturbed_recording, write_trajectory, write_transforms,
};

pub(super) fn run(args: &ConvertArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let target = match args.to {
        Some(target) => target,
        None => by_extension(&args.out)?,
    };
    if recording_layout(target).is_none() {
        let reason =
            "only recordings with depth (--to stray-scanner and so on) are written with errors";
        refuse_unused(&args.errors.given(), reason)?;
    }
    if target.is_geometry() {
        let reason = "meshes, lines and clouds are no sequences";
        refuse_unused(&args.given_of_sequences(), reason)?;
        return convert_geometry(&args.input, &args.out, target);
    }
    if target.is_file() {
        let inputs = [&args.input].into_iter().chain(&args.poses);
        let inputs: Vec<&Path> = inputs
            .chain(&args.calibration)
            .map(PathBuf::as_path)
            .collect();
        check_outputs(&[("--out", &args.out)], &inputs)?;
    }
    let sequence = open(&SequenceArgs {
        sequence: args.input.clone(),
        layout: args.layout.clone(),
        model: args.model.clone(),
        poses: args.poses.clone(),
        calibration: args.calibration.clone(),
        accept_as_is: true,
    })
    .with_context(|| format!("{target:?} is written from a sequence"))?;
    if target.is_file() {
        keep_sequence(("--out", &args.out), &sequence)?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in sequence.warnings() {
            say!("warning: {warning}");
        }
    }
    if let Some(reading) = sequence.sidecar_pose_convention()
        && verbosity > Verbosity::Quiet
    {
        say!(
            "note: the poses written are of the colour camera, world from camera. The [poses] table of the calibration \
             ({reading}) is for the files of the folder and not for these: where they are read beside it, give a \
             --calibration without that table"
        );
    }
    convert_sequence(&sequence, &args.out, target, &disturbance(&args.errors))
}

fn disturbance(errors: &RecordingErrors) -> Disturbance {
    Disturbance {
        scale: errors.error_scale,
        shift: errors.error_shift,
        translation: errors.error_position,
        rotation: errors.error_rotation.to_radians(),
        wrong: errors.error_pixels,
        wrong_depth: match errors.error_marks {
            WrongPixels::Unmarked => WrongDepth::Unmarked,
            WrongPixels::Confidence => WrongDepth::Marked,
            WrongPixels::Unknown => WrongDepth::Unknown,
        },
        seed: errors.error_seed,
    }
}

/// The format that the extension of the output asks for.
fn by_extension(out: &Path) -> anyhow::Result<Target> {
    let extension = out
        .extension()
        .map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    Ok(match extension.as_deref() {
        None => Target::Colmap,
        Some("txt") => Target::Tum,
        Some("csv") => Target::Euroc,
        Some("log") => Target::Open3dLog,
        Some("json") => Target::Transforms,
        Some("obj") => Target::Obj,
        Some("ply") => Target::Ply,
        Some("glb") => Target::Glb,
        Some(other) => bail!("no format is known for .{other}: name it with --to"),
    })
}

/// The layout of a whole recording.
fn recording_layout(target: Target) -> Option<RecordingLayout> {
    Some(match target {
        Target::StrayScanner => RecordingLayout::StrayScanner,
        Target::Record3d => RecordingLayout::Record3d,
        Target::Polycam => RecordingLayout::Polycam,
        Target::Scannet => RecordingLayout::Scannet,
        Target::ArkitScenes => RecordingLayout::ArkitScenes,
        Target::Replica => RecordingLayout::Replica,
        Target::DepthAnything3 => RecordingLayout::DepthAnything3,
        Target::ColmapDense => RecordingLayout::ColmapDense,
        Target::MvsNet => RecordingLayout::MvsNet,
        Target::Exr => RecordingLayout::Exr,
        Target::Pfm => RecordingLayout::Pfm,
        _ => return None,
    })
}

fn convert_sequence(
    sequence: &Sequence,
    out: &Path,
    target: Target,
    disturbance: &Disturbance,
) -> anyhow::Result<Outcome> {
    if sequence.frames().is_empty() && target != Target::Colmap {
        return Ok(Outcome::Negative(
            "the images of the model are not there, and without images there is no trajectory (--to colmap writes all views)"
                .to_owned(),
        ));
    }
    if let Some(layout) = recording_layout(target) {
        keep_apart(out, sequence.folder())?;
        write_disturbed_recording(out, sequence, layout, disturbance)?;
        return Ok(Outcome::Done);
    }
    let format = match target {
        Target::Tum => TrajectoryFormat::Tum,
        Target::Euroc => TrajectoryFormat::Euroc,
        Target::Kitti => TrajectoryFormat::Kitti,
        Target::Open3dLog => TrajectoryFormat::Open3dLog,
        Target::Transforms => {
            write_transforms(out, sequence)?;
            return Ok(Outcome::Done);
        }
        _ => {
            keep_apart(out, sequence.folder())?;
            let is_inside = out
                .canonicalize()
                .ok()
                .zip(sequence.folder().canonicalize().ok());
            let is_inside = is_inside.is_some_and(|(out, folder)| out.starts_with(folder));
            let has_model = ["txt", "bin"]
                .iter()
                .any(|it| out.join("images").with_extension(it).exists());
            if is_inside && has_model {
                bail!(
                    "{} has a model of the recording, which is not to be changed: give another folder with --out",
                    out.display()
                );
            }
            std::fs::create_dir_all(out)
                .with_context(|| format!("cannot make the folder {}", out.display()))?;
            write_colmap(out, sequence)?;
            return Ok(Outcome::Done);
        }
    };
    let mut images = posed_images(sequence);
    if let (TrajectoryFormat::Euroc, Some(body_from_color)) = (format, sequence.body_from_color()) {
        // The format is of the body, and is read so where the mounting is known.
        for image in &mut images {
            image.world_from_camera *= body_from_color.inverse();
        }
    }
    write_trajectory(out, format, &images)?;
    Ok(Outcome::Done)
}
