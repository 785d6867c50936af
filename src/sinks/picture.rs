//! The picture that a reconstruction ends with.

use image::imageops::FilterType;
use image::{GenericImage, RgbImage};
use linecarve_mesh::render::{BackFaces, RenderOptions, Renderer, View, up_direction};
use linecarve_mesh::{LineSet, TriangleMesh};
use linecarve_sequence::{ModelView, Sequence};
use nalgebra::{Isometry3, Point3, Vector3};

use super::page_run::view_camera;
use crate::progress::{Progress, Verbosity};
use linecarve_engine::front_end::Keyframe;
use linecarve_engine::map::Map;
use linecarve_engine::texture::frame_of;
use linecarve_engine::{KeyframeUpdate, Reconstruction, Recording, Sink, SinkError};

/// Pixels between panels.
const GAP: u32 = 8;
/// Widest picture of a view of a model: structure from motion likes large images.
const MAX_MODEL_WIDTH: u32 = 960;

/// Finds the keyframe that the picture shows: the first with the most segments or points.
#[derive(Debug, Default)]
pub(crate) struct RichestKeyframe {
    /// Number of elements, and position among the keyframes in the map.
    richest: Option<(usize, usize)>,
}

impl RichestKeyframe {
    /// Its position among the keyframes in the map.
    pub(crate) fn order(&self) -> Option<usize> {
        self.richest.map(|(_, order)| order)
    }
}

impl Sink for RichestKeyframe {
    fn update(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        let elements = match &update.keyframe {
            Keyframe::Lines(keyframe) => keyframe.segments.len(),
            Keyframe::Features(_) | Keyframe::Views(_) => update.map.observed_again,
        };
        if self.richest.is_none_or(|(most, _)| elements > most) {
            self.richest = Some((elements, update.order));
        }
        Ok(())
    }
}

/// Up to three panels side by side: the image of a keyframe, the surface with `marks` over it from the same view, and the surface
/// from outside and above with back faces left out. `None` without a keyframe to draw. All in the frame of computation.
///
/// # Errors
/// When the image of the keyframe cannot be read, or the picture is too large.
pub(crate) fn draw_picture(
    run: &Reconstruction,
    mesh: &TriangleMesh,
    marks: &LineSet,
    richest: Option<usize>,
    verbosity: Verbosity,
) -> anyhow::Result<Option<RgbImage>> {
    let recording = run.recording();
    if let Some((model, _)) = run.map().model() {
        let Some(view) = run.map().richest_view() else {
            return Ok(None);
        };
        let poses = recording.keyframe_poses();
        let Some((photo, view)) = view_of_model(&recording.sequence, &model.views[view], &poses)?
        else {
            return Ok(None);
        };
        return draw_panels(mesh, marks, photo, &view, &poses, verbosity).map(Some);
    }
    let Some(order) = richest else {
        return Ok(None);
    };
    let poses = run.map().adjusted_poses().unwrap_or_else(|| {
        let all = recording.keyframe_poses();
        run.numbers().iter().map(|&number| all[number]).collect()
    });
    let frame = recording.keyframes[run.numbers()[order]];
    let photo = recording.sequence.load_color(frame)?;
    let (width, height) = photo.dimensions();
    let camera = recording.sequence.color_camera();
    let view = View::from_keyframe(camera, width, height, poses[order], up_direction(&poses));
    draw_panels(mesh, marks, Some(photo), &view, &poses, verbosity).map(Some)
}

/// The photo of a view, when the sequence has one, and the view at the size of the picture.
fn view_of_model(
    sequence: &Sequence,
    view: &ModelView,
    poses: &[Isometry3<f64>],
) -> anyhow::Result<Option<(Option<RgbImage>, View)>> {
    let photo = photo_of(sequence, view);
    let drawn = match &photo {
        Some(photo) => Some((sequence.color_camera().clone(), photo.dimensions())),
        None => view_camera(view),
    };
    let Some((camera, size)) = drawn else {
        return Ok(None);
    };
    let factor = (f64::from(MAX_MODEL_WIDTH) / f64::from(size.0)).min(1.0);
    let scaled = |side: u32| ((f64::from(side) * factor).round() as u32).max(1);
    let (width, height) = (scaled(size.0), scaled(size.1));
    let photo =
        photo.map(|photo| image::imageops::resize(&photo, width, height, FilterType::Triangle));
    let inside = View::from_keyframe(
        &camera.without_distortion().scaled(factor)?,
        width,
        height,
        view.world_from_camera,
        up_direction(poses),
    );
    Ok(Some((photo, inside)))
}

/// The image of a view, when the sequence has a frame of that name and it can be read.
fn photo_of(sequence: &Sequence, view: &ModelView) -> Option<RgbImage> {
    let frame = frame_of(sequence, view)?;
    sequence.load_color(frame).ok()
}

fn draw_panels(
    mesh: &TriangleMesh,
    lines: &LineSet,
    photo: Option<RgbImage>,
    inside: &View,
    poses: &[Isometry3<f64>],
    verbosity: Verbosity,
) -> anyhow::Result<RgbImage> {
    let size = (inside.width, inside.height);
    let renderer = Renderer::new(mesh);
    let options = RenderOptions::default();
    let mut progress = Progress::start("picture", 2, verbosity);
    let from_keyframe = renderer.draw(Some(lines), inside, &options, &|_, _| {})?;
    progress.step(String::new);
    let from_outside = match View::dollhouse(mesh, poses, size) {
        Some(view) => {
            let mut options = options;
            options.back_faces = BackFaces::Hidden;
            Some(renderer.draw(None, &view, &options, &|_, _| {})?)
        }
        None => None,
    };
    progress.step(String::new);
    progress.finish();
    let mut panels: Vec<RgbImage> = photo.into_iter().collect();
    panels.push(from_keyframe);
    panels.extend(from_outside);
    side_by_side(&panels)
}

/// Three short lines through each point.
pub(crate) fn crosses(points: &[Point3<f64>], length: f64) -> LineSet {
    LineSet::from_segments(points.iter().flat_map(|point| {
        [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
            let arm = 0.5 * length * axis;
            [point - arm, point + arm]
        })
    }))
}

/// Pictures of one height in a row on white.
fn side_by_side(panels: &[RgbImage]) -> anyhow::Result<RgbImage> {
    let height = panels.iter().map(RgbImage::height).max().unwrap_or(1);
    let width: u32 = panels.iter().map(|panel| panel.width() + GAP).sum();
    let mut picture = RgbImage::from_pixel(
        width.saturating_sub(GAP).max(1),
        height,
        image::Rgb([255; 3]),
    );
    let mut x = 0;
    for panel in panels {
        picture.copy_from(panel, x, 0)?;
        x += panel.width() + GAP;
    }
    Ok(picture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_stand_in_a_row() {
        let panel = |width, value| RgbImage::from_pixel(width, 4, image::Rgb([value; 3]));
        let picture = side_by_side(&[panel(10, 1), panel(6, 2)]).unwrap();
        assert_eq!(picture.dimensions(), (10 + GAP + 6, 4));
        assert_eq!(picture.get_pixel(9, 3).0, [1; 3]);
        assert_eq!(picture.get_pixel(10, 0).0, [255; 3]);
        assert_eq!(picture.get_pixel(10 + GAP, 0).0, [2; 3]);
    }
}
