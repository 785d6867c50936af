//! `linecarve synth`: a rendered sequence with exact ground truth.

use std::sync::Mutex;

use crate::cli::{NoiseModel, SynthArgs};
use crate::commands::Outcome;
use crate::progress::{Progress, Verbosity};
use crate::synth::{ColorFormat, DepthNoise, SynthOptions, write_sequence};

pub(super) fn run(args: &SynthArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let (width, height) = args.size;
    let options = SynthOptions {
        scene: args.scene,
        frames: args.frames,
        width,
        height,
        focal_px: args.focal,
        layout: args.layout,
        color: match args.jpeg_quality {
            Some(quality) => ColorFormat::Jpeg { quality },
            None => ColorFormat::Png,
        },
        noise: match args.noise {
            NoiseModel::None => DepthNoise::Exact,
            NoiseModel::Kinect => DepthNoise::Kinect {
                strength: args.noise_strength,
            },
        },
        color_noise: args.color_noise,
        exposure_change: args.exposure_change,
        seed: args.seed,
        command: Some(command_line(args)),
    };
    let progress = Mutex::new(Progress::start("frames", args.frames as usize, verbosity));
    let summary = write_sequence(&options, &args.out, &|done, _| {
        if let Ok(mut progress) = progress.lock() {
            progress.set(done, String::new);
        }
    })?;
    if verbosity > Verbosity::Quiet {
        eprintln!(
            "{} frames, {} triangles of ground truth of which {:.0} % were seen; {}",
            summary.frames,
            summary.triangles,
            100.0 * summary.observed_share,
            args.out.display()
        );
    }
    Ok(Outcome::Done)
}

/// The command that makes the same folder again, with every option that matters; the output folder is left open.
fn command_line(args: &SynthArgs) -> String {
    use clap::ValueEnum;
    let name = |value: Option<clap::builder::PossibleValue>| {
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    };
    let (width, height) = args.size;
    let mut line = format!(
        "linecarve synth {} --frames {} --size {width}x{height} --layout {} --noise {} --noise-strength {} \
         --color-noise {} --exposure-change {} --seed {}",
        name(args.scene.to_possible_value()),
        args.frames,
        name(args.layout.to_possible_value()),
        name(args.noise.to_possible_value()),
        args.noise_strength,
        args.color_noise,
        args.exposure_change,
        args.seed
    );
    if let Some(focal) = args.focal {
        line += &format!(" --focal {focal}");
    }
    if let Some(quality) = args.jpeg_quality {
        line += &format!(" --jpeg-quality {quality}");
    }
    line + " --out DIR"
}
