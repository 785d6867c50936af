//! The picture that a reconstruction ends with.

use std::path::Path;

use image::{GenericImage, RgbImage};
use nalgebra::{Isometry3, Point3, Vector3};

use crate::progress::{Progress, Verbosity};
use linecarve_mesh::render::{BackFaces, RenderOptions, Renderer, View, up_direction, write_png};
use linecarve_mesh::{LineSet, TriangleMesh};
use linecarve_sequence::Sequence;

/// Pixels between panels.
const GAP: u32 = 8;

/// From where the picture is taken.
pub(super) struct Shot<'a> {
    /// For the photo beside the surface.
    pub(super) sequence: &'a Sequence,
    /// Which frame.
    pub(super) frame: usize,
    /// Its pose, in the frame of the mesh.
    pub(super) world_from_camera: Isometry3<f64>,
    /// Poses of all keyframes, in the frame of the mesh.
    pub(super) poses: &'a [Isometry3<f64>],
}

/// Writes three panels side by side: a keyframe's image, the surface and the clusters over it from the same view, and
/// the surface from outside and above with the faces that turn away left out.
pub(super) fn write_overview(
    path: &Path,
    mesh: &TriangleMesh,
    clusters: &LineSet,
    shot: &Shot<'_>,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let photo = shot.sequence.load_color(shot.frame)?;
    let (width, height) = photo.dimensions();
    let inside = View::from_keyframe(
        shot.sequence.color_camera(),
        width,
        height,
        shot.world_from_camera,
        up_direction(shot.poses),
    );
    write_panels(
        path,
        mesh,
        clusters,
        Some(photo),
        &inside,
        shot.poses,
        verbosity,
    )
}

/// Writes up to three panels side by side: a photo when there is one, the surface with lines over it from `inside`, and the
/// surface from outside and above, from the side of the cameras `poses`.
pub(super) fn write_panels(
    path: &Path,
    mesh: &TriangleMesh,
    lines: &LineSet,
    photo: Option<RgbImage>,
    inside: &View,
    poses: &[Isometry3<f64>],
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let size = (inside.width, inside.height);
    let renderer = Renderer::new(mesh);
    let options = RenderOptions::default();
    let mut progress = Progress::start("picture", 2, verbosity);
    let from_keyframe = renderer.draw(Some(lines), inside, &options, &|_, _| {})?;
    progress.step(String::new);
    let outside = View::dollhouse(mesh, poses, size);
    let from_outside = match outside {
        Some(view) => {
            let options = RenderOptions {
                back_faces: BackFaces::Hidden,
                ..options
            };
            Some(renderer.draw(None, &view, &options, &|_, _| {})?)
        }
        None => None,
    };
    progress.step(String::new);
    progress.finish();

    let mut panels: Vec<RgbImage> = photo.into_iter().collect();
    panels.push(from_keyframe);
    panels.extend(from_outside);
    write_png(path, &side_by_side(&panels)?)?;
    Ok(())
}

/// Three short lines through each point.
pub(super) fn crosses(points: &[Point3<f64>], length: f64) -> LineSet {
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
