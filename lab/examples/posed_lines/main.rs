//! Segments of a posed sequence with sensor depth, as an OBJ in world coordinates, with pictures of some keyframes.
//!
//! ```text
//! cargo run --release -p linecarve-lab --example posed_lines -- SEQUENCE OUT_FOLDER [--paper] [--raw] [key=value ...]
//! ```
//!
//! SEQUENCE is a folder in the 7-Scenes layout with its depth camera's poses, or one with an Open3D `trajectory.log`.
//! Keyframes are chosen every 0.15 units or 10 degrees. The harness uses the library `linecarve-lines` alone and reads sequences
//! with a small reader of its own.

#[path = "../../../lines/tests/support/sequence.rs"]
mod sequence;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use linecarve_lines::PaperOptions;
use linecarve_lines::cluster::{ClusterOptions, SegmentClusterer};
use linecarve_lines::depth::{DepthSensor, EdgeDepthOptions, SensorNoise};
use linecarve_lines::fit::{DepthModel, Segment};
use linecarve_lines::image::GrayImage;
use linecarve_lines::{ExtractOptions, SegmentExtractor};
use sequence::{Sequence, View};

pub(crate) type AnyError = Box<dyn std::error::Error>;

struct Settings {
    sequence: PathBuf,
    out: PathBuf,
    options: ExtractOptions,
    relative_noise: f64,
    step: f64,
    turn_rad: f64,
    pictures: usize,
    farthest: f64,
    shortest_px: f64,
    offset_share: f64,
}

fn settings() -> Result<Settings, AnyError> {
    let mut folders = Vec::new();
    let mut settings = Settings {
        sequence: PathBuf::new(),
        out: PathBuf::new(),
        options: ExtractOptions::default(),
        relative_noise: SensorNoise::STRUCTURED_LIGHT_RELATIVE,
        step: 0.15,
        turn_rad: 10.0_f64.to_radians(),
        pictures: 3,
        farthest: f64::INFINITY,
        shortest_px: 0.0,
        offset_share: ClusterOptions::default().offset_share,
    };
    for argument in std::env::args().skip(1) {
        let fit = &mut settings.options.fit;
        let edge_depth = &mut settings.options.edge_depth;
        if argument == "--paper" {
            settings.options.paper = Some(PaperOptions::with_unit(1.0));
        } else if argument == "--raw" {
            *edge_depth = EdgeDepthOptions::raw();
        } else if let Some((key, value)) = argument.split_once('=') {
            let number = || value.parse::<f64>();
            match key {
                "window" => fit.window_share = number()?,
                "e1" => fit.image_tolerance_share = number()?,
                "e2" => fit.depth_tolerance_share = number()?,
                "gate" => fit.depth_gate_sigmas = number()?,
                "depth_model" => {
                    fit.depth_model = if value == "depth" {
                        DepthModel::Depth
                    } else {
                        DepthModel::InverseDepth
                    }
                }
                "share" => fit.minimum_inlier_share = number()?,
                "angle" => fit.minimum_view_angle_rad = number()?.to_radians(),
                "radius" => edge_depth.radius_px = value.parse()?,
                "smooth" => edge_depth.smoothing_radius_px = value.parse()?,
                "jump_sigmas" => edge_depth.jump_sigmas = number()?,
                "jump_relative" => edge_depth.jump_relative = number()?,
                "support" => edge_depth.least_support = value.parse()?,
                "noise" => settings.relative_noise = number()?,
                "step" => settings.step = number()?,
                "turn" => settings.turn_rad = number()?.to_radians(),
                "pictures" => settings.pictures = value.parse()?,
                "far" => settings.farthest = number()?,
                "offset" => settings.offset_share = number()?,
                "shortest" => settings.shortest_px = number()?,
                _ => return Err(format!("unknown setting {key}").into()),
            }
        } else {
            folders.push(PathBuf::from(argument));
        }
    }
    let [sequence, out] = <[PathBuf; 2]>::try_from(folders)
        .map_err(|_| "usage: posed_lines SEQUENCE OUT_FOLDER [--paper] [--raw] [key=value ...]")?;
    Ok(Settings {
        sequence,
        out,
        ..settings
    })
}

fn main() -> Result<(), AnyError> {
    let settings = settings()?;
    std::fs::create_dir_all(&settings.out)?;
    let sequence = Sequence::open(&settings.sequence)?;
    let keyframes = sequence.keyframes(settings.step, settings.turn_rad);
    let mut extractor = SegmentExtractor::new(settings.options)?;
    let mut all: Vec<(Segment, usize)> = Vec::new();
    let (mut edge_pixels, mut with_depth, mut inliers) = (0, 0, 0);
    let mut times = [Duration::ZERO; 4];
    let mut medians = Vec::new();
    for (index, view) in keyframes.iter().enumerate() {
        let image = sequence.gray(view)?;
        let depth = sequence.depth(view)?;
        let start = std::time::Instant::now();
        let median = median_depth(depth.samples());
        medians.push(median);
        let sensor = DepthSensor {
            camera: sequence.depth_camera.clone(),
            color_from_depth: sequence.color_from_depth,
            is_registered: sequence.is_registered,
            noise: SensorNoise::relative_at(settings.relative_noise, median, 0.001),
        };
        let map = sensor.inverse_depth(
            &depth,
            &sequence.color_camera,
            image.width(),
            image.height(),
        )?;
        times[3] += start.elapsed();
        let mut extraction =
            extractor.extract(&image, None, &map, &sequence.color_camera, index as u32)?;
        extraction.segments.retain(|s| {
            s.length_px() >= settings.shortest_px
                && s.ends_in_camera.iter().all(|e| e.z < settings.farthest)
        });
        edge_pixels += extraction.edge_pixels;
        with_depth += extraction.edge_pixels_with_depth;
        inliers += extraction
            .segments
            .iter()
            .map(|s| s.inliers as usize)
            .sum::<usize>();
        times[0] += extraction.durations.edges;
        times[1] += extraction.durations.edge_depth;
        times[2] += extraction.durations.fit;
        if settings.pictures > 0 && index % keyframes.len().div_ceil(settings.pictures) == 0 {
            picture(
                &image,
                &extraction.segments,
                &settings.out.join(format!("segments-{}.png", view.name)),
            )?;
        }
        all.extend(extraction.segments.into_iter().map(|s| (s, index)));
    }
    write_obj(&all, &keyframes, &settings.out)?;
    write_clusters(
        &all,
        &keyframes,
        &medians,
        settings.offset_share,
        &settings.out,
    )?;
    let n = keyframes.len().max(1) as u32;
    let mut lengths: Vec<f64> = all.iter().map(|(s, _)| s.length_px()).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    eprintln!(
        "{} keyframes, {} segments, median length {:.1} px, mean {:.1} px, edge pixels {edge_pixels} ({:.1} % with depth, {:.1} % explained)",
        keyframes.len(),
        all.len(),
        lengths.get(lengths.len() / 2).copied().unwrap_or(0.0),
        lengths.iter().sum::<f64>() / lengths.len().max(1) as f64,
        100.0 * with_depth as f64 / edge_pixels.max(1) as f64,
        100.0 * inliers as f64 / edge_pixels.max(1) as f64,
    );
    eprintln!(
        "per keyframe: edges {:.2?}, edge depth {:.2?}, fit {:.2?}, registration {:.2?}",
        times[0] / n,
        times[1] / n,
        times[2] / n,
        times[3] / n
    );
    Ok(())
}

fn median_depth(samples: &[f32]) -> f64 {
    let mut known: Vec<f32> = samples.iter().copied().filter(|&z| z > 0.0).collect();
    if known.is_empty() {
        return 1.0;
    }
    let middle = known.len() / 2;
    f64::from(*known.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Clusters the segments in their order and writes the representatives of those with at least three members.
fn write_clusters(
    all: &[(Segment, usize)],
    keyframes: &[View],
    medians: &[f64],
    offset_share: f64,
    out: &std::path::Path,
) -> Result<(), AnyError> {
    let mut sorted = medians.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0);
    let mut options = ClusterOptions::default();
    options.offset_share = offset_share;
    let mut clusterer = SegmentClusterer::new(options, median)?;
    let mut events = Vec::new();
    let start = std::time::Instant::now();
    for (segment, keyframe) in all {
        clusterer.insert(
            segment.ends_in_world(&keyframes[*keyframe].world_from_camera),
            &mut events,
        );
    }
    let elapsed = start.elapsed();
    let mut text = String::new();
    let mut count = 0;
    for (_, cluster) in clusterer.clusters() {
        for end in &cluster.representative.ends {
            writeln!(text, "v {:.6} {:.6} {:.6}", end.x, end.y, end.z)?;
        }
        count += 1;
        writeln!(text, "l {} {}", 2 * count - 1, 2 * count)?;
    }
    std::fs::write(out.join("clusters.obj"), text)?;
    let members: u32 = clusterer.clusters().map(|(_, cluster)| cluster.size).sum();
    eprintln!(
        "{count} clusters of {members} segments (of {} clusters in all), {:.2?} a segment",
        clusterer.all_clusters().count(),
        elapsed / all.len().max(1) as u32
    );
    Ok(())
}

fn write_obj(
    all: &[(Segment, usize)],
    keyframes: &[View],
    out: &std::path::Path,
) -> Result<(), AnyError> {
    let mut text = String::new();
    let mut current = None;
    for (segment, keyframe) in all {
        if current.replace(*keyframe) != Some(*keyframe) {
            writeln!(text, "g kf{keyframe}")?;
        }
        for end in segment.ends_in_world(&keyframes[*keyframe].world_from_camera) {
            writeln!(text, "v {:.6} {:.6} {:.6}", end.x, end.y, end.z)?;
        }
    }
    for index in 0..all.len() {
        writeln!(text, "l {} {}", 2 * index + 1, 2 * index + 2)?;
    }
    std::fs::write(out.join("segments.obj"), text)?;
    Ok(())
}

/// The image at double size with each segment in its own colour.
fn picture(
    image: &GrayImage,
    segments: &[Segment],
    path: &std::path::Path,
) -> Result<(), AnyError> {
    let (width, height) = (image.width() as u32, image.height() as u32);
    let mut canvas = image::RgbImage::from_fn(2 * width, 2 * height, |x, y| {
        let grey = image.row((y / 2) as usize)[(x / 2) as usize];
        image::Rgb([grey / 2 + 64; 3])
    });
    for (index, segment) in segments.iter().enumerate() {
        let hue = (index * 67 % 360) as f64;
        let channel = |shift: f64| {
            let angle = (hue + shift).to_radians();
            (127.0 + 128.0 * angle.cos()).clamp(0.0, 255.0) as u8
        };
        let color = image::Rgb([channel(0.0), channel(120.0), channel(240.0)]);
        let [a, b] = segment.ends_px.map(|p| p.coords * 2.0);
        let steps = (b - a).norm().ceil().max(1.0) as usize;
        for step in 0..=steps {
            let p = a + (b - a) * (step as f64 / steps as f64);
            let (x, y) = (p.x.round() as i64, p.y.round() as i64);
            if x >= 0 && y >= 0 && x < i64::from(2 * width) && y < i64::from(2 * height) {
                canvas.put_pixel(x as u32, y as u32, color);
            }
        }
    }
    canvas.save(path)?;
    Ok(())
}
