//! `linecarve-lab texture`: views of a mesh with vertex colours and with its texture, beside frames that are no keyframes.

use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use image::{GenericImage, Rgb, RgbImage};
use linecarve::commands::Outcome;
use linecarve::run::CancelToken;
use linecarve::texture::{alignment, texture};
use linecarve::{Reconstruction, Recording, RunOptions};
use linecarve_lines::camera::Camera;
use linecarve_mesh::TriangleMesh;
use linecarve_mesh::raycast::{RayHit, RayScene};
use linecarve_mesh::texture::{DistortionGrid, TextureView};
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::published::publish;
use super::scored_run::open;
use crate::cli::TextureArgs;

/// Scores of one sequence.
#[derive(Debug, Serialize)]
struct Row {
    sequence: String,
    keyframes: usize,
    triangles: usize,
    atlas: [u32; 2],
    charts: usize,
    unseen_triangles: usize,
    frames: usize,
    /// Share of the pixels that the mesh covers.
    covered: f64,
    /// How far the images of keyframes moved, in pixels.
    moved_px: f64,
    /// Mean PSNR in decibels of frames in their given poses.
    given: Scores,
    /// The same of frames in poses adjusted to the images of the keyframes.
    adjusted: Scores,
    /// Time of the reconstruction and of the texture.
    seconds: [f64; 2],
}

/// Mean PSNR in decibels.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Scores {
    vertex_colors: f64,
    texture: f64,
}

/// A frame as it is scored.
struct Scored {
    colors: Scores,
    covered: f64,
}

/// Rounds of the gain of a view: what the last gain clips is left out. In the kitchen the result is that of a search within 0.01 dB.
const GAIN_ROUNDS: usize = 8;

/// `world_from_camera` of a frame, and its distortion.
type PhotoPose = (Isometry3<f64>, Option<DistortionGrid>);

pub(super) fn run(args: &TextureArgs) -> anyhow::Result<Outcome> {
    let rows: Vec<Row> = args
        .sequences
        .iter()
        .map(|sequence| measure(sequence, args))
        .collect::<anyhow::Result<_>>()?;
    publish("texture", &table(&rows), &rows, &args.output)?;
    Ok(Outcome::Done)
}

fn measure(folder: &Path, args: &TextureArgs) -> anyhow::Result<Row> {
    let started = Instant::now();
    let run = reconstruct(folder, args)?;
    let mesh = run.map().final_surface();
    let reconstructed = started.elapsed().as_secs_f64();
    let (texture, summary) = texture(&run, &mesh)
        .with_context(|| format!("{}: there is no texture", folder.display()))?;
    let textured = started.elapsed().as_secs_f64() - reconstructed;
    ensure!(
        mesh.colors.is_some(),
        "{}: the vertices have no colours",
        folder.display()
    );
    let recording = run.recording();
    let frames = other_frames(recording, args.frames);
    let scene = RayScene::new(&mesh);
    let alignment = alignment(&run, &mesh);
    let camera = recording.sequence.color_camera();
    let mut scores = Vec::new();
    for &frame in &frames {
        let photo = recording.sequence.load_color(frame)?;
        let mut pose = recording.sequence.frames()[frame].world_from_camera;
        pose.translation.vector -= recording.origin;
        let view = TextureView {
            camera: camera.without_distortion(),
            world_from_camera: pose,
        };
        let adjusted = alignment.align(&mesh, &view, &photo);
        let score = |pose: &PhotoPose, folder: Option<&Path>| -> anyhow::Result<_> {
            let hits = hits(&scene, camera, pose, photo.dimensions());
            let vertex = drawn(&hits, |hit| vertex_color(&mesh, hit));
            let textured = drawn(&hits, |hit| texture.color_at(hit.triangle, hit.barycentric));
            if let Some(folder) = folder {
                let name = &recording.sequence.frames()[frame].name;
                save(folder, name, &photo, [&vertex, &textured])?;
            }
            let scores = psnr(&photo, &vertex).zip(psnr(&photo, &textured));
            Ok(scores.map(|(vertex_colors, texture)| Scored {
                colors: Scores {
                    vertex_colors,
                    texture,
                },
                covered: hits.iter().flatten().count() as f64 / hits.len() as f64,
            }))
        };
        let given = score(&(pose, None), None)?;
        scores.extend(given.zip(score(&adjusted, args.save.as_deref())?));
    }
    ensure!(
        !scores.is_empty(),
        "{}: every frame is a keyframe",
        folder.display()
    );
    let mean = |value: &dyn Fn(&(Scored, Scored)) -> f64| {
        scores.iter().map(value).sum::<f64>() / scores.len() as f64
    };
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    Ok(Row {
        sequence: name.to_string_lossy().into_owned(),
        keyframes: run.numbers().len(),
        triangles: mesh.triangles.len(),
        atlas: summary.size,
        charts: summary.charts,
        unseen_triangles: summary.unseen_triangles,
        frames: scores.len(),
        covered: mean(&|(given, _)| given.covered),
        moved_px: summary.moved_px,
        given: Scores {
            vertex_colors: mean(&|(given, _)| given.colors.vertex_colors),
            texture: mean(&|(given, _)| given.colors.texture),
        },
        adjusted: Scores {
            vertex_colors: mean(&|(_, adjusted)| adjusted.colors.vertex_colors),
            texture: mean(&|(_, adjusted)| adjusted.colors.texture),
        },
        seconds: [reconstructed, textured],
    })
}

fn reconstruct(folder: &Path, args: &TextureArgs) -> anyhow::Result<Reconstruction> {
    let recording = open(folder, &args.selection, |_| {})?;
    let mut run = Reconstruction::new(recording, RunOptions::default())?;
    run.run(CancelToken::default(), &mut [])?;
    Ok(run)
}

/// Frames that are no keyframes, at most `count`, evenly spread.
fn other_frames(recording: &Recording, count: usize) -> Vec<usize> {
    let all: Vec<usize> = (0..recording.sequence.frames().len())
        .filter(|frame| recording.keyframes.binary_search(frame).is_err())
        .collect();
    let count = count.min(all.len());
    (0..count)
        .map(|at| all[(2 * at + 1) * all.len() / (2 * count)])
        .collect()
}

/// What each pixel sees of the mesh, in row order; nothing where that is a back face.
fn hits(
    scene: &RayScene,
    camera: &Camera,
    (world_from_camera, distortion): &PhotoPose,
    (width, height): (u32, u32),
) -> Vec<Option<RayHit>> {
    let eye = Point3::from(world_from_camera.translation.vector);
    (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| [f64::from(x), f64::from(y)]))
        .map(|pixel| {
            let [x, y] = match distortion {
                Some(distortion) => distortion.pinhole_from_photo(pixel),
                None => pixel,
            };
            let ray = camera.point_at_depth(&Point2::new(x, y), 1.0).ok()?;
            let direction: Vector3<f64> = world_from_camera.rotation * ray.coords;
            let hit = scene.cast(&eye, &direction, f64::INFINITY)?;
            hit.is_front_face.then_some(hit)
        })
        .collect()
}

/// Colours of the covered pixels.
fn drawn(
    hits: &[Option<RayHit>],
    color: impl Fn(&RayHit) -> [f64; 3] + Sync,
) -> Vec<Option<[f64; 3]>> {
    hits.par_iter()
        .map(|hit| hit.as_ref().map(&color))
        .collect()
}

/// Vertex colours, interpolated in sRGB values as texels are.
fn vertex_color(mesh: &TriangleMesh, hit: &RayHit) -> [f64; 3] {
    let colors = mesh.colors.as_deref().unwrap_or_default();
    let corners = mesh.triangles[hit.triangle as usize].map(|corner| colors[corner as usize]);
    std::array::from_fn(|channel| {
        let parts = corners.iter().zip(hit.barycentric);
        parts
            .map(|(color, share)| f64::from(color[channel]) * share)
            .sum()
    })
}

/// Peak signal-to-noise ratio of the covered pixels in decibels, after the one gain of the view that makes it largest; `None`
/// without covered pixels. The view is clipped as the photograph is.
fn psnr(photo: &RgbImage, view: &[Option<[f64; 3]>]) -> Option<f64> {
    let pairs = || {
        let covered = photo
            .pixels()
            .zip(view)
            .filter_map(|(p, v)| Some((p, v.as_ref()?)));
        covered.flat_map(|(pixel, color)| pixel.0.map(f64::from).into_iter().zip(*color))
    };
    let count = pairs().count();
    let (mut gain, mut least) = (0.0, f64::INFINITY);
    for _ in 0..GAIN_ROUNDS {
        let (mut product, mut square) = (0.0, 0.0);
        // Clipped values do not change with the gain.
        for (truth, value) in pairs().filter(|(_, value)| gain * value < 255.0) {
            product += truth * value;
            square += value * value;
        }
        gain = product / square;
        let error = |(truth, value): (f64, f64)| (truth - (gain * value).min(255.0)).powi(2);
        least = least.min(pairs().map(error).sum());
    }
    let psnr = 10.0 * (255.0 * 255.0 * count as f64 / least).log10();
    (count > 0 && psnr.is_finite()).then_some(psnr)
}

/// A frame and its views side by side as PNG.
fn save(
    folder: &Path,
    name: &str,
    photo: &RgbImage,
    views: [&[Option<[f64; 3]>]; 2],
) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let (width, height) = photo.dimensions();
    let mut picture = RgbImage::new(3 * width, height);
    picture.copy_from(photo, 0, 0)?;
    for (at, view) in views.into_iter().enumerate() {
        let left = (at as u32 + 1) * width;
        for (index, color) in view.iter().enumerate() {
            let color = color.unwrap_or([255.0, 0.0, 255.0]);
            let (x, y) = (index as u32 % width, index as u32 / width);
            picture.put_pixel(left + x, y, Rgb(color.map(|v| v.round() as u8)));
        }
    }
    let name: String = name
        .chars()
        .map(|c| if c.is_alphanumeric() { c } else { '_' })
        .collect();
    let path = folder.join(format!("{name}.png"));
    picture
        .save(&path)
        .with_context(|| format!("cannot write {}", path.display()))
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| sequence | keyframes, frames compared | images moved | triangles, unseen | atlas, charts | covered | frames as given: vertex colours, texture, gain | frames adjusted: vertex colours, texture, gain | seconds: reconstruction, texture |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let gain = |scores: Scores| {
        let Scores {
            vertex_colors,
            texture,
        } = scores;
        format!(
            "{vertex_colors:.2}, {texture:.2}, {:+.2} dB",
            texture - vertex_colors
        )
    };
    for row in rows {
        let [width, height] = row.atlas;
        let [reconstructed, textured] = row.seconds;
        let _ = writeln!(
            text,
            "| {} | {}, {} | {:.2} px | {}, {} | {width} x {height}, {} | {:.0} % | {} | {} | {reconstructed:.1}, {textured:.1} |",
            row.sequence,
            row.keyframes,
            row.frames,
            row.moved_px,
            row.triangles,
            row.unseen_triangles,
            row.charts,
            100.0 * row.covered,
            gain(row.given),
            gain(row.adjusted),
        );
    }
    text
}
