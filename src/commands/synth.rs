//! `linecarve synth`: a rendered sequence with exact ground truth, or the points of a city.

use std::sync::Mutex;

use crate::cli::{NoiseModel, SynthArgs};
use crate::commands::Outcome;
use crate::progress::{Progress, Verbosity};
use crate::standard_error::say;
use linecarve_synth::{
    CityOptions, ColorFormat, DepthNoise, SynthOptions, write_city, write_sequence,
};

pub(super) fn run(args: &SynthArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let (width, height) = args.size;
    let Some(scene) = args.scene.rendered() else {
        return city(args, verbosity);
    };
    let mut options = SynthOptions::default();
    options.scene = scene;
    options.frames = args.frames;
    options.width = width;
    options.height = height;
    options.focal_px = args.focal;
    options.layout = args.layout.into();
    options.color = if args.png {
        ColorFormat::Png
    } else {
        ColorFormat::Jpeg {
            quality: args.jpeg_quality,
        }
    };
    options.noise = match args.noise {
        NoiseModel::None => DepthNoise::Exact,
        NoiseModel::Kinect => DepthNoise::Kinect {
            strength: args.noise_strength,
        },
    };
    options.color_noise = args.color_noise;
    options.exposure_change = args.exposure_change;
    options.blur = args.blur;
    options.rolling_shutter = args.rolling_shutter;
    options.stereo_baseline = args.stereo;
    options.seed = args.seed;
    let progress = Mutex::new(Progress::start("frames", args.frames as usize, verbosity));
    let summary = write_sequence(&options, &args.out, &|done, _| {
        if let Ok(mut progress) = progress.lock() {
            progress.set(done, String::new);
        }
    })?;
    if verbosity > Verbosity::Quiet {
        say!(
            "{} frames, {} triangles of ground truth of which {:.0} % were seen; {}",
            summary.frames,
            summary.triangles,
            100.0 * summary.observed_share,
            args.out.display()
        );
    }
    Ok(Outcome::Done)
}

fn city(args: &SynthArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let options = CityOptions::new(args.points, args.seed);
    let rays = write_city(&options, &args.out)?;
    if verbosity > Verbosity::Quiet {
        let (points, cloud) = (args.points, args.out.join("fused.ply"));
        say!("{points} points, {rays} rays; {}", cloud.display());
    }
    Ok(Outcome::Done)
}
