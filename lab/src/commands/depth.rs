//! `linecarve-lab depth`: depth between edges from images alone, beside the depth images.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, ensure};
use linecarve::Recording;
use linecarve::cli::DepthArg;
use linecarve::commands::Outcome;
use linecarve::front_end::{
    Arrival, FrontEnd, FrontEndError, Keyframe, LineKeyframe, group_size, run_in_groups,
};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::{GrayImage, sobel};
use serde::Serialize;

use super::published::publish;
use super::scored_run::open_with;
use crate::cli::DepthArgs;

/// Half the side of the window over which the energy of gradients is summed, in pixels.
const REACH: usize = 8;

/// Noise of the depth camera at unit depth, by which the registration tells surfaces apart.
const TRUTH_NOISE: f64 = 0.002;

/// Places of one share of the images: the third with the least texture, the middle one, that with the most, or all.
#[derive(Debug, Default, Serialize)]
struct Places {
    name: &'static str,
    /// Grid pixels where the depth camera measured something.
    compared: usize,
    /// Those of them with an estimate.
    estimated: usize,
    /// Relative errors of depth, with their sign.
    #[serde(skip)]
    errors: Vec<f64>,
    within_two_sigma: usize,
    /// Median and 90 % quantile of the absolute relative error.
    error: [f64; 2],
    /// Median relative error.
    bias: f64,
}

/// All places of one sequence.
#[derive(Debug, Serialize)]
struct Row {
    sequence: String,
    keyframes: usize,
    places: Vec<Places>,
}

pub(super) fn run(args: &DepthArgs) -> anyhow::Result<Outcome> {
    let rows: Vec<Row> = args
        .sequences
        .iter()
        .map(|sequence| measure(sequence, args))
        .collect::<anyhow::Result<_>>()?;
    publish("depth", &table(&rows), &rows, &args.output)?;
    Ok(Outcome::Done)
}

fn measure(folder: &Path, args: &DepthArgs) -> anyhow::Result<Row> {
    let recording = open_with(folder, &args.selection, DepthArg::SemiDense, |_| {})?;
    let calibration = recording.sequence.depth_calibration();
    let sensor = calibration
        .with_context(|| format!("{}: there are no depth images", folder.display()))?
        .sensor(TRUTH_NOISE, 1.0);
    let keyframes = surfaces(&recording)?;
    let mut places: Vec<Places> = ["least texture", "middle", "most texture", "all"]
        .map(|name| Places {
            name,
            ..Places::default()
        })
        .into();
    for keyframe in &keyframes {
        let depth = recording.sequence.load_depth(keyframe.frame)?;
        let depth = depth.context("a keyframe has no depth image")?;
        let image = recording.sequence.load_gray(keyframe.frame)?;
        let camera = recording.sequence.color_camera();
        let truth = sensor.inverse_depth(&depth, camera, image.width(), image.height())?;
        compare(keyframe, &image, &truth, &mut places);
    }
    for places in &mut places {
        places.summarise();
    }
    ensure!(
        places.iter().all(|places| places.compared > 0),
        "{}: no keyframe has depth between edges and a depth image",
        folder.display()
    );
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    Ok(Row {
        sequence: name.to_string_lossy().into_owned(),
        keyframes: keyframes.len(),
        places,
    })
}

/// The final keyframes of a recording.
fn surfaces(recording: &Recording) -> anyhow::Result<Vec<LineKeyframe>> {
    let (options, frames) = (&recording.options, &recording.keyframes);
    let mut front_end = FrontEnd::new(&recording.source, options, frames.len(), None, false)?;
    let mut keyframes = Vec::new();
    let take = |_, arrival| -> Result<(), FrontEndError> {
        if let Arrival::Final(Ok(Keyframe::Lines(keyframe))) = arrival {
            keyframes.push(*keyframe);
        }
        Ok(())
    };
    let sequence = &recording.sequence;
    run_in_groups(
        &mut front_end,
        sequence,
        frames,
        0,
        group_size(),
        None,
        take,
    )?;
    Ok(keyframes)
}

/// Compares the surface of a keyframe with the depth image, at each pixel of its grid.
fn compare(
    keyframe: &LineKeyframe,
    image: &GrayImage,
    truth: &InverseDepthMap,
    places: &mut [Places],
) {
    let surface = &keyframe.surface;
    let step = surface.step_px() as usize;
    let cells = (0..surface.rows()).flat_map(|row| (0..surface.columns()).map(move |it| (it, row)));
    let mut compared = Vec::new();
    for (column, row) in cells {
        let (x, y) = (column * step + step / 2, row * step + step / 2);
        if x >= image.width() || y >= image.height() {
            continue;
        }
        if let Some(known) = truth.get(x, y) {
            let sample = surface.get(column, row);
            compared.push((texture(image, x, y), f64::from(known.rho), sample));
        }
    }
    compared.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
    let count = compared.len();
    for (rank, (_, truth, sample)) in compared.into_iter().enumerate() {
        for index in [3 * rank / count.max(1), 3] {
            let places = &mut places[index];
            places.compared += 1;
            if let Some(sample) = sample {
                let (rho, sigma) = (f64::from(sample.rho), f64::from(sample.sigma));
                places.estimated += 1;
                places.errors.push(truth / rho - 1.0);
                places.within_two_sigma += usize::from((truth - rho).abs() <= 2.0 * sigma);
            }
        }
    }
}

/// Energy of the gradients around a pixel.
fn texture(image: &GrayImage, x: usize, y: usize) -> f64 {
    let along = |at: usize, end: usize| {
        (at.saturating_sub(REACH).max(1)..(at + REACH + 1).min(end - 1)).step_by(2)
    };
    let pixels =
        along(y, image.height()).flat_map(|y| along(x, image.width()).map(move |x| (x, y)));
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, y) in pixels {
        let (dx, dy) = sobel(image, x, y);
        sum += f64::from(dx * dx + dy * dy);
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

impl Places {
    fn summarise(&mut self) {
        let quantile = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            let at = (share * values.len().saturating_sub(1) as f64) as usize;
            values.get(at).copied().unwrap_or(f64::NAN)
        };
        self.bias = quantile(&mut self.errors, 0.5);
        let mut sizes: Vec<f64> = self.errors.iter().map(|error| error.abs()).collect();
        self.error = [0.5, 0.9].map(|share| quantile(&mut sizes, share));
    }
}

fn table(rows: &[Row]) -> String {
    let mut table = String::from(
        "| sequence | places | covered | relative error, median / p90 | median with its sign | within two sigma |\n|---|---|---|---|---|---|\n",
    );
    let share = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    for row in rows {
        for places in &row.places {
            let [median, p90] = places.error.map(|error| 100.0 * error);
            // Writing to a string cannot fail.
            let _ = writeln!(
                table,
                "| {} | {} | {:.1} % | {median:.2} / {p90:.1} % | {:+.2} % | {:.1} % |",
                row.sequence,
                places.name,
                share(places.estimated, places.compared),
                100.0 * places.bias,
                share(places.within_two_sigma, places.estimated),
            );
        }
    }
    table
}
