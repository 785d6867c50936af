//! Semi-dense depth against the depth camera of a sequence: coverage, error, calibration of sigma, time; and pictures.
//!
//! `cargo run --release -p linecarve-lab --example semi_dense -- SEQUENCE [--out DIR] [--step N] [--translation LENGTH] [--no-confirm] [--k1 K1]`
//!
//! The depth images serve only as reference. Depth is estimated from neighbouring keyframes and checked against their depth
//! maps. The reference at an edge is the near side of a depth jump, as in the library; a second set of figures uses the
//! nearest value within 2 pixels, so that a pixel on the wrong side of an outline is no error. `--k1` is a radial distortion
//! that is removed from images that the sequence gives as those of a pinhole.

#![allow(clippy::print_stdout, reason = "the figures are the output")]

#[allow(dead_code)]
#[path = "../../../lines/tests/support/sequence.rs"]
mod sequence;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use sequence::Sequence;

use linecarve_lines::camera::{Camera, Distortion, UndistortionMap};
use linecarve_lines::depth::semi_dense::{
    ConsistencyOptions, DepthView, MatchView, NeighbourOptions, SemiDense, SemiDenseDepth,
    SemiDenseOptions, ViewGeometry, choose_neighbours, enforce_consistency,
};
use linecarve_lines::depth::{
    DepthSensor, EdgeDepthOptions, EdgeDepths, InverseDepthMap, SensorNoise,
};
use linecarve_lines::edges::EdgeDetector;

/// Keyframes before and after one that may be its neighbours.
const REACH: usize = 8;
/// Or after this much rotation a view becomes a keyframe.
const TURN_RAD: f64 = 0.1745;

pub(crate) type AnyError = Box<dyn Error>;

struct Arguments {
    sequence: PathBuf,
    out: Option<PathBuf>,
    step: usize,
    translation: f64,
    is_confirmed: bool,
    k1: f64,
    options: SemiDenseOptions,
}

fn arguments() -> Result<Arguments, AnyError> {
    let mut parsed = Arguments {
        sequence: PathBuf::new(),
        out: None,
        step: 1,
        translation: 0.15,
        is_confirmed: true,
        k1: 0.0,
        options: SemiDenseOptions::default(),
    };
    let mut all = std::env::args().skip(1);
    while let Some(argument) = all.next() {
        let mut value = || all.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--out" => parsed.out = Some(value()?.into()),
            "--step" => parsed.step = value()?.parse::<usize>()?.max(1),
            "--translation" => parsed.translation = value()?.parse()?,
            "--k1" => parsed.k1 = value()?.parse()?,
            "--no-confirm" => parsed.is_confirmed = false,
            "--epipolar-sigma" => parsed.options.epipolar_sigma_px = value()?.parse()?,
            "--agreeing" => parsed.options.least_agreeing = value()?.parse()?,
            "--residual" => parsed.options.largest_residual = value()?.parse()?,
            "--rival" => parsed.options.largest_rival_share = value()?.parse()?,
            "--seeds" => parsed.options.seed_spacing_px = value()?.parse()?,
            "--hidden" => parsed.options.hidden_pose_error = value()?.parse()?,
            "--no-alignment" => parsed.options.align_neighbours = false,
            _ => parsed.sequence = argument.into(),
        }
    }
    Ok(parsed)
}

/// Errors of one keyframe, or of all.
#[derive(Default)]
struct Tally {
    edge_pixels: usize,
    known: usize,
    compared: usize,
    errors: Vec<f64>,
    nearest_errors: Vec<f64>,
    within_two_sigma: usize,
    nearest_within: usize,
    sigmas: Vec<f64>,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.edge_pixels += other.edge_pixels;
        self.known += other.known;
        self.compared += other.compared;
        self.errors.extend(&other.errors);
        self.nearest_errors.extend(&other.nearest_errors);
        self.within_two_sigma += other.within_two_sigma;
        self.nearest_within += other.nearest_within;
        self.sigmas.extend(&other.sigmas);
    }

    fn line(&self) -> String {
        let quantile = |values: &[f64], share: f64| {
            let mut sorted = values.to_vec();
            sorted.sort_by(f64::total_cmp);
            let index = (share * sorted.len().saturating_sub(1) as f64) as usize;
            100.0 * sorted.get(index).copied().unwrap_or(f64::NAN)
        };
        let share = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        let wrong = self.errors.iter().filter(|error| **error > 0.1).count();
        format!(
            "covered {:5.1} %  error median {:5.2} p90 {:6.2} %  (nearest {:5.2} {:6.2})  > 10 %: {:4.1} %  sigma median {:5.2} %  within 2 sigma {:5.1} % (nearest {:5.1})",
            share(self.known, self.edge_pixels),
            quantile(&self.errors, 0.5),
            quantile(&self.errors, 0.9),
            quantile(&self.nearest_errors, 0.5),
            quantile(&self.nearest_errors, 0.9),
            share(wrong, self.compared),
            quantile(&self.sigmas, 0.5),
            share(self.within_two_sigma, self.compared),
            share(self.nearest_within, self.compared),
        )
    }
}

/// The map that undistorts images of the size of `first`; the sequence gets the camera of the undistorted images.
fn undistort(
    sequence: &mut Sequence,
    first: &sequence::View,
    k1: f64,
) -> Result<UndistortionMap, AnyError> {
    let image = sequence.gray(first)?;
    let (width, height) = (image.width(), image.height());
    let of = &sequence.color_camera;
    let lens = Distortion::radial(k1);
    let stored = Camera::with_distortion(of.fx(), of.fy(), of.cx(), of.cy(), lens)?;
    sequence.color_camera = UndistortionMap::inscribed_camera(&stored, width, height);
    Ok(UndistortionMap::new(
        &stored,
        &sequence.color_camera,
        width,
        height,
    )?)
}

fn main() -> Result<(), AnyError> {
    let arguments = arguments()?;
    let mut sequence = Sequence::open(&arguments.sequence)?;
    let keyframes = sequence.keyframes(arguments.translation, TURN_RAD);
    let mut detector = EdgeDetector::default();
    let mut views = Vec::new();
    let mut references = Vec::new();
    let undistortion = match keyframes.first().filter(|_| arguments.k1 != 0.0) {
        Some(first) => Some(undistort(&mut sequence, first, arguments.k1)?),
        None => None,
    };
    for keyframe in &keyframes {
        let image = sequence.gray(keyframe)?;
        let image = match &undistortion {
            Some(map) => map.resample(&image),
            None => image,
        };
        let pose = &keyframe.world_from_camera;
        views.push(MatchView::new(
            &image,
            &sequence.color_camera,
            pose,
            &mut detector,
        )?);
        let depth = sequence.depth(keyframe)?;
        references.push(sensor(&sequence).inverse_depth(
            &depth,
            &sequence.color_camera,
            image.width(),
            image.height(),
        )?);
    }
    let mut medians: Vec<f64> = references
        .iter()
        .filter_map(InverseDepthMap::median_depth)
        .collect();
    medians.sort_by(f64::total_cmp);
    let median_depth = *medians
        .get(medians.len() / 2)
        .ok_or("the sequence has no depth")?;
    let estimator = SemiDense::new(arguments.options)?;
    let (depths, neighbours, milliseconds) = estimate(&views, &estimator, median_depth)?;
    println!(
        "{} keyframes, median depth {median_depth:.3}, {milliseconds:.1} ms a keyframe on {} thread(s)",
        views.len(),
        rayon::current_num_threads()
    );
    let mut total = Tally::default();
    for own in (0..views.len()).step_by(arguments.step) {
        let mut map = depths[own].map.clone();
        let mut dropped = 0;
        if arguments.is_confirmed {
            let witnesses: Vec<DepthView> = depths[own]
                .pairs
                .iter()
                .zip(&depths[own].corrections)
                .map(|(pair, correction)| {
                    let other = neighbours[own][pair.neighbour];
                    DepthView {
                        view: &views[other],
                        map: &depths[other].map,
                        correction: *correction,
                    }
                })
                .collect();
            dropped = enforce_consistency(
                &views[own],
                &mut map,
                &witnesses,
                &ConsistencyOptions::default(),
            );
        }
        let reference = &references[own];
        let tally = compare(&views[own], &map, reference);
        let mean = |value: fn(&linecarve_lines::depth::semi_dense::PairReport) -> f64| {
            depths[own].pairs.iter().map(value).sum::<f64>() / depths[own].pairs.len().max(1) as f64
        };
        println!(
            "{:>4} {:>18} {}  neighbours {} fused {} dropped {dropped}  epipolar {:.2} px turned {:.2} px residual {:.1} gain {:.2}",
            own,
            keyframes[own].name,
            tally.line(),
            depths[own].pairs.len(),
            depths[own].fused,
            mean(|pair| pair.epipolar_sigma_px),
            mean(|pair| pair.correction_rad) * sequence.color_camera.mean_focal_px(),
            mean(|pair| pair.residual_sigma),
            mean(|pair| pair.gain),
        );
        if let Some(out) = &arguments.out {
            std::fs::create_dir_all(out)?;
            picture(
                &views[own],
                &map,
                reference,
                median_depth,
                &out.join(format!("{own:04}.png")),
            )?;
        }
        total.add(&tally);
    }
    println!("all  {}", total.line());
    Ok(())
}

fn sensor(sequence: &Sequence) -> DepthSensor {
    DepthSensor {
        camera: sequence.depth_camera.clone(),
        color_from_depth: sequence.color_from_depth,
        is_registered: sequence.is_registered,
        noise: SensorNoise::relative_at(SensorNoise::STRUCTURED_LIGHT_RELATIVE, 2.0, 0.001),
    }
}

type Estimates = (Vec<SemiDenseDepth>, Vec<Vec<usize>>, f64);

fn estimate(
    views: &[MatchView],
    estimator: &SemiDense,
    median_depth: f64,
) -> Result<Estimates, AnyError> {
    let geometries: Vec<ViewGeometry> = views.iter().map(MatchView::geometry).collect();
    let start = Instant::now();
    let mut depths = Vec::new();
    let mut neighbours = Vec::new();
    for own in 0..views.len() {
        let around: Vec<usize> = (own.saturating_sub(REACH)..(own + REACH + 1).min(views.len()))
            .filter(|&other| other != own)
            .collect();
        let candidates: Vec<&ViewGeometry> = around.iter().map(|&i| &geometries[i]).collect();
        let chosen: Vec<usize> = choose_neighbours(
            &geometries[own],
            &candidates,
            median_depth,
            &NeighbourOptions::default(),
        )
        .into_iter()
        .map(|position| around[position])
        .collect();
        let others: Vec<&MatchView> = chosen.iter().map(|&i| &views[i]).collect();
        depths.push(estimator.estimate(&views[own], &others, None)?);
        neighbours.push(chosen);
    }
    let milliseconds = 1e3 * start.elapsed().as_secs_f64() / views.len().max(1) as f64;
    Ok((depths, neighbours, milliseconds))
}

fn compare(view: &MatchView, map: &InverseDepthMap, reference: &InverseDepthMap) -> Tally {
    let mut truth = EdgeDepths::default();
    truth.compute(reference, view.chains(), &EdgeDepthOptions::default());
    let mut tally = Tally {
        edge_pixels: view.chains().pixels().len(),
        ..Tally::default()
    };
    for (position, &[x, y]) in view.chains().pixels().iter().enumerate() {
        let (x, y) = (usize::from(x), usize::from(y));
        let Some(found) = map.get(x, y) else { continue };
        tally.known += 1;
        let Some(expected) = truth.get(position) else {
            continue;
        };
        tally.compared += 1;
        let relative = |rho: f32| (f64::from(found.rho) / f64::from(rho) - 1.0).abs();
        let deviation = |rho: f32| (found.rho - rho).abs() / found.sigma;
        tally.errors.push(relative(expected.rho));
        tally.within_two_sigma += usize::from(deviation(expected.rho) <= 2.0);
        let mut nearest = expected.rho;
        for row in y.saturating_sub(2)..=y + 2 {
            for column in x.saturating_sub(2)..=x + 2 {
                if let Some(sample) = reference.get(column, row)
                    && (sample.rho - found.rho).abs() < (nearest - found.rho).abs()
                {
                    nearest = sample.rho;
                }
            }
        }
        tally.nearest_errors.push(relative(nearest));
        tally.nearest_within += usize::from(deviation(nearest) <= 2.0);
        tally.sigmas.push(f64::from(found.sigma / found.rho));
    }
    tally
}

/// Left: edge pixels with depth by colour (near red, far blue), those without in grey. Right: error against the reference
/// (green 0 to red 10 %).
fn picture(
    view: &MatchView,
    map: &InverseDepthMap,
    reference: &InverseDepthMap,
    median_depth: f64,
    path: &Path,
) -> Result<(), AnyError> {
    let (width, height) = (map.width(), map.height());
    let mut truth = EdgeDepths::default();
    truth.compute(reference, view.chains(), &EdgeDepthOptions::default());
    let mut picture = image::RgbImage::new(2 * width as u32, height as u32);
    for y in 0..height {
        for x in 0..width {
            let level = view.smoothed().row(y)[x] / 4;
            picture.put_pixel(x as u32, y as u32, image::Rgb([level; 3]));
            picture.put_pixel((x + width) as u32, y as u32, image::Rgb([level; 3]));
        }
    }
    for (position, &[x, y]) in view.chains().pixels().iter().enumerate() {
        let found = map.get(usize::from(x), usize::from(y));
        let (x, y) = (u32::from(x), u32::from(y));
        let Some(found) = found else {
            picture.put_pixel(x, y, image::Rgb([130; 3]));
            continue;
        };
        let near = (f64::from(found.rho) * median_depth / 2.0).clamp(0.0, 1.0);
        let ramp =
            |center: f64| (255.0 * (1.5 - 4.0 * (near - center).abs()).clamp(0.0, 1.0)) as u8;
        picture.put_pixel(x, y, image::Rgb([ramp(0.75), ramp(0.5), ramp(0.25)]));
        if let Some(expected) = truth.get(position) {
            let error = (f64::from(found.rho / expected.rho) - 1.0).abs() / 0.1;
            let red = (255.0 * error.clamp(0.0, 1.0)) as u8;
            picture.put_pixel(x + width as u32, y, image::Rgb([red, 255 - red, 0]));
        }
    }
    picture.save(path)?;
    Ok(())
}
