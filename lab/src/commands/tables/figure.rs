//! `linecarve-lab figure`: the panels of the paper's figure of results.

use std::path::Path;

use anyhow::{Context, ensure};
use image::{Rgb, RgbImage, imageops};
use linecarve::cli::StageArgs;
use linecarve::commands::Outcome;
use linecarve::commands::input::{input, parameters};
use linecarve::progress::Verbosity;
use linecarve::{Recording, Source};
use linecarve_lab::tables::methods::MethodRun;
use linecarve_mesh::render::{
    Background, RenderOptions, Renderer, View, up_direction, with_caption, write_png,
};
use linecarve_mesh::{LineSet, TriangleMesh};
use nalgebra::{Isometry3, Point3, Translation3};

use super::methods;
use crate::cli::FigureArgs;

/// Panels of lines: file, method, caption.
const LINES: [(&str, &str, &str); 6] = [
    ("matched", "matched", "matched (Line3D++)"),
    ("decoupled", "decoupled", "decoupled"),
    ("paper", "paper", "Algorithm 1 to the letter"),
    (
        "paper-clustered",
        "paper, clustered",
        "Algorithm 1, clustered",
    ),
    ("edge-aided", "edge-aided", "edge-aided"),
    (
        "clustered",
        "edge-aided, clustered",
        "edge-aided, clustered",
    ),
];
/// Panels side by side.
const COLUMNS: u32 = 4;
/// Space between panels.
const GAP_PX: u32 = 8;
/// More points than this cost time and show nothing more.
const MOST_POINTS: usize = 400_000;

pub(in crate::commands) fn run(args: &FigureArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    ensure!(
        args.back.is_finite() && args.back >= 0.0,
        "--back {}: give a length of at least 0",
        args.back
    );
    let stages = StageArgs {
        depth: args.depth,
        config: args.config.clone(),
        preset: None,
        max_image_size: None,
        up: None,
        format: Vec::new(),
        json: false,
    };
    let input = input(&args.input, &args.selection, args.depth.into(), verbosity);
    let recording = Recording::open(&input, parameters(&stages, &args.selection)?)?;
    let mut results = methods::run(&recording, verbosity)?;
    if let Source::SemiDense(source) = &recording.source {
        let runs = methods::run_semi_dense(&recording, source, &mut results, verbosity)?;
        results.runs.extend(runs);
    }
    let runs = std::mem::take(&mut results.runs);
    let runs = methods::with_clusters(runs, &recording, results.frames.len())?;
    if verbosity > Verbosity::Quiet {
        for warning in recording.warnings.iter().chain(&results.warnings) {
            eprintln!("warning: {warning}");
        }
    }
    if runs.iter().all(|run| run.segments.is_empty()) {
        return Ok(Outcome::Negative(
            "no method found a line: there is nothing to draw".to_owned(),
        ));
    }
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let frame = frame(&recording, &results.frames, args.frame.as_deref())?;
    let view = view(&recording, frame, args)?;
    let (width, height) = (view.width, view.height);
    let photo = recording.sequence.load_gray(frame)?;
    let photo = RgbImage::from_fn(photo.width() as u32, photo.height() as u32, |x, y| {
        Rgb([photo.row(y as usize)[x as usize]; 3])
    });
    let mut panels = vec![(
        "image",
        "image".to_owned(),
        letterbox(&photo, width, height),
    )];
    let points = runs.iter().find(|run| !run.points.is_empty());
    let cloud = points.map(cloud_of).unwrap_or_default();
    let count = points.map_or(0, |run| run.points.len());
    panels.push((
        "cloud",
        format!("cloud: {count} points"),
        draw(&cloud, &view, 1.6)?,
    ));
    for (file, method, caption) in LINES {
        let run = runs.iter().find(|run| run.name == method);
        let segments = run.map_or(&[][..], |run| &run.segments);
        let lines = LineSet::from_segments(segments.iter().map(|found| found.ends_in_world));
        let caption = format!("{caption}: {} lines", segments.len());
        panels.push((file, caption, draw(&lines, &view, 1.3)?));
    }
    save(&args.out, &panels)?;
    Ok(Outcome::Done)
}

/// The frame by name or index, or the middle keyframe.
fn frame(recording: &Recording, used: &[usize], wanted: Option<&str>) -> anyhow::Result<usize> {
    let frames = recording.sequence.frames();
    let Some(wanted) = wanted else {
        return Ok(used[used.len() / 2]);
    };
    let named = frames.iter().position(|frame| frame.name == wanted);
    named
        .or_else(|| wanted.parse().ok())
        .filter(|index| *index < frames.len())
        .with_context(|| {
            format!(
                "--frame {wanted}: neither a name (such as {}) nor an index below {}",
                frames.first().map_or("", |frame| &frame.name),
                frames.len()
            )
        })
}

/// The view of a frame from further back.
fn view(recording: &Recording, frame: usize, args: &FigureArgs) -> anyhow::Result<View> {
    let sequence = &recording.sequence;
    let poses: Vec<Isometry3<f64>> = sequence
        .frames()
        .iter()
        .map(|frame| frame.world_from_camera)
        .collect();
    let back = args.back * methods::median_depth(recording);
    let size = sequence.color_size();
    Ok(View::from_keyframe(
        sequence.color_camera(),
        size.width,
        size.height,
        poses[frame] * Translation3::new(0.0, 0.0, -back),
        up_direction(&poses),
    ))
}

/// Points as lines from each to itself, which are drawn as dots.
fn cloud_of(run: &MethodRun) -> LineSet {
    let step = run.points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<Point3<f64>> = run.points.iter().step_by(step).copied().collect();
    let grays = run.point_grays.iter().step_by(step);
    // White points on a white ground are not seen.
    let colors = grays.map(|gray| [(f32::from(*gray) * 0.8) as u8; 3]);
    LineSet {
        lines: (0..points.len() as u32)
            .map(|index| [index, index])
            .collect(),
        colors: Some(colors.collect()),
        points,
    }
}

fn draw(lines: &LineSet, view: &View, width_px: f64) -> anyhow::Result<RgbImage> {
    let nothing = TriangleMesh::default();
    let mut options = RenderOptions::default();
    options.line_width_px = width_px;
    options.line_color = [24, 40, 72];
    options.background = Background::Plain([255; 3]);
    let lines = (!lines.lines.is_empty()).then_some(lines);
    Ok(Renderer::new(&nothing).draw(lines, view, &options, &|_, _| {})?)
}

/// A picture scaled to fit into a size, on white.
fn letterbox(picture: &RgbImage, width: u32, height: u32) -> RgbImage {
    let scale = (f64::from(width) / f64::from(picture.width()))
        .min(f64::from(height) / f64::from(picture.height()));
    let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    let (wide, high) = (side(picture.width()), side(picture.height()));
    let resized = imageops::resize(picture, wide, high, imageops::FilterType::Triangle);
    let mut result = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let (left, top) = (
        (width - wide.min(width)) / 2,
        (height - high.min(height)) / 2,
    );
    imageops::replace(&mut result, &resized, i64::from(left), i64::from(top));
    result
}

/// Writes every panel, and all of them as `figure.png`.
fn save(folder: &Path, panels: &[(&str, String, RgbImage)]) -> anyhow::Result<()> {
    let mut captioned = Vec::new();
    for (name, caption, picture) in panels {
        write_png(&folder.join(format!("{name}.png")), picture)?;
        captioned.push(with_caption(picture, caption));
    }
    let (width, height) = captioned[0].dimensions();
    let rows = (captioned.len() as u32).div_ceil(COLUMNS);
    let across = |count: u32, side: u32| count * (side + GAP_PX) + GAP_PX;
    let mut sheet =
        RgbImage::from_pixel(across(COLUMNS, width), across(rows, height), Rgb([255; 3]));
    for (index, picture) in (0..).zip(&captioned) {
        let left = across(index % COLUMNS, width);
        let top = across(index / COLUMNS, height);
        imageops::replace(&mut sheet, picture, i64::from(left), i64::from(top));
    }
    write_png(&folder.join("figure.png"), &sheet)?;
    Ok(())
}
