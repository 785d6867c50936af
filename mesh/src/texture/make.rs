//! All steps from photographs to a texture.

use serde::Serialize;

use super::align::align_photos;
use super::chart::lay_out;
use super::exposure::{darken, gains};
use super::fill::{Sources, fill};
use super::label::{choose, neighbours};
use super::observe::observe;
use super::photo::LoadPhoto;
use super::quality::rate;
use super::spread::spread;
use super::types::{Texture, TextureOptions, TextureView};
use crate::TriangleMesh;

/// What a texture is made of.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TextureSummary {
    /// Width and height of the image in texels.
    pub size: [u32; 2],
    /// Charts: parts of the image.
    pub charts: usize,
    /// Views whose photographs could be read.
    pub views: usize,
    /// Triangles that no view sees. They have the colours of their vertices.
    pub unseen_triangles: usize,
    /// How far the photographs moved when their poses were adjusted to each other: root mean square, in their pixels.
    pub moved_px: f64,
    /// Gains that multiply the sRGB values of each view: red, green, blue. 1 for views that could not be read.
    #[serde(skip)]
    pub gains: Vec<[f32; 3]>,
}

/// The texture of a mesh from photographs of it, whose poses are [adjusted](align_photos) first; `None` when no photograph can be read, the mesh has no triangles,
/// or more charts than an atlas can hold.
///
/// `load` reads the photograph of a view by its index, undistorted, and returns `None` when it is missing. It is called three times
/// for each view, from any thread. Mesh and poses have one frame; triangles are seen from the side from which their corners
/// are counter-clockwise.
///
/// The result is the same for any number of threads.
///
/// # Complexity
/// That of [`align_photos`], and O(views x (triangles + pixels)) time. Memory holds one photograph a thread, at most 16 observations a triangle, and 24 bytes
/// a texel.
pub fn texture_mesh(
    mesh: &TriangleMesh,
    views: &[TextureView],
    load: &LoadPhoto<'_>,
    options: &TextureOptions,
) -> Option<(Texture, TextureSummary)> {
    let alignment = align_photos(mesh, views, load);
    let views: &[TextureView] = &alignment.views;
    let distortions = &alignment.distortions;
    let mut observations = observe(mesh, views, distortions, load);
    let read = observations.sizes.iter().flatten().count();
    if read == 0 || mesh.triangles.is_empty() {
        return None;
    }
    let mut gains = gains(&observations.of_triangle, views.len());
    rate(&mut observations.of_triangle, &gains);
    let brightness = darken(&mut gains, |view| observations.sizes[view].is_some());
    let neighbours = neighbours(&mesh.triangles);
    let seam_cost = options.seam_cost as f32;
    let labels = choose(&observations.of_triangle, &neighbours, seam_cost);
    let layout = lay_out(
        mesh,
        views,
        &observations,
        &labels,
        &neighbours,
        options.max_texels,
    )?;
    let sources = Sources {
        mesh,
        views,
        distortions,
        load,
        of_triangle: &observations.of_triangle,
        labels: &labels,
        gains: &gains,
        brightness,
        clay: options.clay,
    };
    let (mut image, is_filled) = fill(&sources, &layout);
    spread(&mut image, &is_filled);
    let summary = TextureSummary {
        size: layout.size,
        charts: layout.charts,
        views: read,
        unseen_triangles: labels.iter().filter(|label| label.is_none()).count(),
        moved_px: alignment.moved_px,
        gains,
    };
    let corners = layout.corners;
    let file = None;
    Some((
        Texture {
            image,
            corners,
            file,
        },
        summary,
    ))
}
