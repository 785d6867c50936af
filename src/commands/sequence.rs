//! What `reconstruct` and `lines` do first: open the sequence, choose keyframes, set up the depth camera.

use anyhow::bail;
use linecarve_lines::depth::DepthSensor;
use nalgebra::{Point3, Vector3};

use crate::cli::{KeyframeArgs, SequenceArgs, StageArgs};
use crate::commands::depth::depth_source;
use crate::commands::output::{OutputFolder, write_poses};
use crate::pipeline::scale::far_origin;
use crate::pipeline::{DepthSource, Options, correct_poses};
use crate::progress::{Progress, Verbosity};
use crate::report::PoseSummary;
use linecarve_sequence::{OpenOptions, Sequence, every_nth, read_keyframe_list, select_keyframes};

/// A sequence that is ready to be worked on.
pub(super) struct Prepared {
    pub(super) sequence: Sequence,
    pub(super) options: Options,
    /// Indices of the chosen frames.
    pub(super) keyframes: Vec<usize>,
    pub(super) depth: DepthSource,
    /// Median depth of the scene in units of the poses.
    pub(super) median_depth: f64,
    /// Taken off all coordinates while computing.
    pub(super) origin: Vector3<f64>,
    /// What the images say about the poses, when depth comes from them.
    pub(super) poses: Option<PoseSummary>,
    pub(super) warnings: Vec<String>,
}

impl Prepared {
    /// Writes the poses of the keyframes, where they are others than those given.
    pub(super) fn write_corrected_poses(&self, output: &mut OutputFolder) -> anyhow::Result<()> {
        if !self.poses.is_some_and(|poses| poses.is_corrected) {
            return Ok(());
        }
        let frames = self.sequence.frames();
        let poses = |&frame: &usize| (frame, frames[frame].world_from_camera);
        write_poses(output, &self.sequence, self.keyframes.iter().map(poses))
    }

    /// The depth camera, for what measures depth with one alone.
    ///
    /// # Errors
    /// When depth is estimated from the images.
    pub(super) fn sensor(&self) -> anyhow::Result<&DepthSensor> {
        match &self.depth {
            DepthSource::Sensor(sensor) => Ok(sensor),
            DepthSource::SemiDense(_) => bail!(
                "this method takes its depth from depth images only, and {}; edge-aided lines and matched lines do without",
                match self.sequence.depth_calibration() {
                    Some(_) => "--depth semi-dense leaves them out",
                    None => "the sequence has none",
                }
            ),
        }
    }
}

/// Opens a sequence.
pub(super) fn open(args: &SequenceArgs) -> anyhow::Result<Sequence> {
    let options = OpenOptions {
        calibration: args.calibration.clone(),
        poses: args.poses.clone(),
        layout: args.layout.clone(),
    };
    Ok(Sequence::open(&args.sequence, &options)?)
}

/// Opens a sequence and prepares everything that comes before its first keyframe.
pub(super) fn prepare(
    input: &SequenceArgs,
    selection: &KeyframeArgs,
    stages: &StageArgs,
    verbosity: Verbosity,
) -> anyhow::Result<Prepared> {
    let mut options = read_options(stages)?;
    let mut sequence = open(input)?;
    anyhow::ensure!(
        !sequence.frames().is_empty(),
        "{}: none of the images of the model is there; without images only its points can be used",
        input.sequence.display()
    );
    let mut warnings: Vec<String> = sequence
        .warnings()
        .iter()
        .map(ToString::to_string)
        .collect();
    limit_image_size(&mut sequence, &options, &mut warnings);
    let depth = depth_source(&sequence, stages.depth, &options)?;
    let median_depth = depth.median_depth;
    let keyframes = choose(&sequence, selection, &mut options, median_depth, verbosity)?;
    let mut poses = None;
    if matches!(depth.source, DepthSource::SemiDense(_)) && options.pose_correction.enabled {
        let warnings = &mut warnings;
        poses = Some(correct(
            &mut sequence,
            &keyframes,
            &options,
            warnings,
            verbosity,
        )?);
    }
    let origin = origin_of(&sequence, &keyframes, median_depth, &mut warnings);
    Ok(Prepared {
        options,
        keyframes,
        depth: depth.source,
        median_depth,
        origin,
        poses,
        warnings,
        sequence,
    })
}

/// Gives keyframes the poses that their images have, and images the lens; says so when that makes a difference.
pub(super) fn correct(
    sequence: &mut Sequence,
    keyframes: &[usize],
    options: &Options,
    warnings: &mut Vec<String>,
    verbosity: Verbosity,
) -> anyhow::Result<PoseSummary> {
    let mut progress = Progress::start("poses", keyframes.len(), verbosity);
    let corrected = correct_poses(sequence, keyframes, options, || {
        progress.step(|| "comparing poses with images".to_owned());
    })?;
    progress.finish();
    let summary = corrected.summary;
    if summary.is_corrected {
        sequence.set_poses(keyframes.iter().copied().zip(corrected.world_from_camera));
        warnings.push(format!(
            "the images disagree with the poses of {} keyframes, by {:.1} pixels in direction and {:.1} in place (RMS): corrected \
             ([pose_correction] enabled = false takes poses as they are)",
            summary.keyframes, summary.turn_px, summary.shift_px
        ));
    }
    if let Some(k1) = summary.lens_k1 {
        sequence.set_radial_distortion(k1)?;
        warnings.push(lens_warning(k1));
    }
    Ok(summary)
}

/// Says that images were not those of a pinhole.
pub(super) fn lens_warning(k1: f64) -> String {
    format!(
        "the images are not those of a pinhole: radial distortion k1 = {k1:.4} is taken out ([pose_correction] lens = false takes them \
         as they are; to say it, or what a calibration found, in linecarve.toml: [color] model = \"radial-tangential\", distortion = \
         [{k1:.4}, 0.0, 0.0, 0.0])"
    )
}

/// The options that a command starts from.
pub(super) fn read_options(stages: &StageArgs) -> anyhow::Result<Options> {
    let mut options = match &stages.config {
        Some(path) => Options::read(path)?,
        None => Options::default(),
    };
    let size = &mut options.images.longest_side_px;
    *size = stages.max_image_size.unwrap_or(*size);
    Ok(options)
}

/// Has large images loaded smaller, and says so.
pub(super) fn limit_image_size(
    sequence: &mut Sequence,
    options: &Options,
    warnings: &mut Vec<String>,
) {
    if let Some([stored, loaded]) = sequence.limit_image_size(options.images.longest_side()) {
        warnings.push(format!(
            "images of {} x {} are computed on at {} x {} (--max-image-size 0, or [images] longest_side_px = 0: as they are, which takes longer)",
            stored.width, stored.height, loaded.width, loaded.height
        ));
    }
}

/// What is taken off all coordinates while computing on these keyframes; says so when it is not nothing.
pub(super) fn origin_of(
    sequence: &Sequence,
    keyframes: &[usize],
    median_depth: f64,
    warnings: &mut Vec<String>,
) -> Vector3<f64> {
    let positions = keyframes.iter().map(|frame| {
        let pose = &sequence.frames()[*frame].world_from_camera;
        Point3::from(pose.translation.vector)
    });
    let origin = far_origin(positions, median_depth);
    if origin != Vector3::zeros() {
        warnings.push(far_warning(&origin));
    }
    origin
}

/// Says that coordinates are computed on after a shift.
pub(super) fn far_warning(origin: &Vector3<f64>) -> String {
    format!(
        "coordinates lie far from zero: computed relative to ({}, {}, {})",
        origin.x, origin.y, origin.z
    )
}

/// The keyframes that the options ask for; what the flags say goes into `options`, so that the report tells it.
pub(super) fn choose(
    sequence: &Sequence,
    selection: &KeyframeArgs,
    options: &mut Options,
    median_depth: f64,
    verbosity: Verbosity,
) -> anyhow::Result<Vec<usize>> {
    let chosen = &mut options.keyframes;
    chosen.translation = selection.min_translation.or(chosen.translation);
    chosen.rotation_degrees = selection.min_rotation.unwrap_or(chosen.rotation_degrees);
    chosen.sharpness_window = selection
        .sharpness_window
        .unwrap_or(chosen.sharpness_window);
    let count = sequence.frames().len();
    let mut keyframes = if let Some(n) = selection.every {
        anyhow::ensure!(n > 0, "--every 0: give 1 for every frame");
        every_nth(n, count)
    } else if let Some(path) = &selection.keyframes {
        read_keyframe_list(path, sequence.frames())?
    } else {
        let mut progress = Progress::start("frames", count, verbosity);
        let keyframes = select_keyframes(sequence, chosen, median_depth, |looked_at| {
            progress.set(looked_at, || "choosing keyframes".to_owned());
        })?;
        progress.finish();
        keyframes
    };
    if let Some(limit) = selection.max_keyframes {
        anyhow::ensure!(
            limit > 0,
            "--max-keyframes 0: at least one keyframe is needed"
        );
        keyframes.truncate(limit);
    }
    Ok(keyframes)
}
