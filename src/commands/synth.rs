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
        color: if args.png {
            ColorFormat::Png
        } else {
            ColorFormat::Jpeg {
                quality: args.jpeg_quality,
            }
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

/// The command that makes the same folder again: every option that is not as it would be anyway.
fn command_line(args: &SynthArgs) -> String {
    use clap::ValueEnum;
    let name = |value: Option<clap::builder::PossibleValue>| {
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    };
    let usual = SynthOptions::default();
    let mut line = format!(
        "linecarve synth {} --frames {} --seed {}",
        name(args.scene.to_possible_value()),
        args.frames,
        args.seed
    );
    let mut add = |is_unusual: bool, option: String| {
        if is_unusual {
            line += " ";
            line += &option;
        }
    };
    let (width, height) = args.size;
    add(
        args.size != (usual.width, usual.height),
        format!("--size {width}x{height}"),
    );
    if let Some(focal) = args.focal {
        add(true, format!("--focal {focal}"));
    }
    add(
        args.layout != usual.layout,
        format!("--layout {}", name(args.layout.to_possible_value())),
    );
    let jpeg = ColorFormat::Jpeg {
        quality: args.jpeg_quality,
    };
    add(args.png, "--png".to_owned());
    add(
        !args.png && jpeg != usual.color,
        format!("--jpeg-quality {}", args.jpeg_quality),
    );
    add(
        args.noise != NoiseModel::None,
        format!(
            "--noise {} --noise-strength {}",
            name(args.noise.to_possible_value()),
            args.noise_strength
        ),
    );
    add(
        args.color_noise != usual.color_noise,
        format!("--color-noise {}", args.color_noise),
    );
    add(
        args.exposure_change != usual.exposure_change,
        format!("--exposure-change {}", args.exposure_change),
    );
    line + " --out DIR"
}
