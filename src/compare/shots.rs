//! Pictures of compared surfaces from outside and from keyframes.

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::render::{View, up_direction, write_png};

use super::ground_truth::GroundTruth;
use super::pictures::{Gallery, GalleryView};
use super::result::ComparedSurface;
use crate::progress::{Progress, Verbosity};
use crate::sinks::OutputFolder;
use linecarve_engine::Recording;

/// Size of pictures from outside.
const OUTSIDE_SIZE: (u32, u32) = (800, 600);
/// Folder of the pictures.
const PICTURES: &str = "pictures";

/// Pictures of all surfaces from outside and from keyframes.
///
/// # Errors
/// When a picture cannot be drawn or written.
pub(crate) fn write_pictures(
    views: usize,
    recording: &Recording,
    surfaces: &[ComparedSurface],
    truth: Option<&GroundTruth>,
    output: &mut OutputFolder,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let poses = recording.keyframe_poses();
    output.subfolder(PICTURES)?;
    let mut shots: Vec<(String, Option<usize>)> = vec![("outside".to_owned(), None)];
    let count = recording.keyframes.len();
    let views = views.min(count);
    shots.extend((0..views).map(|view| {
        let keyframe = (2 * view + 1) * count / (2 * views);
        (format!("keyframe-{keyframe:06}"), Some(keyframe))
    }));
    let errors = truth.map(|truth| truth.paint(&recording.origin));
    let truth_mesh = truth
        .filter(|truth| !truth.shape.triangles.is_empty())
        .map(|truth| {
            let mut mesh = truth.shape.clone().into_mesh();
            mesh.translate(&-recording.origin);
            mesh
        });
    let gallery = Gallery::new(surfaces, truth_mesh.as_ref());
    let camera = recording.sequence.color_camera();
    let mut progress = Progress::start("pictures", shots.len(), verbosity);
    for (name, keyframe) in shots {
        let view = match keyframe {
            None => fullest(surfaces)
                .and_then(|mesh| View::dollhouse(mesh, &poses, OUTSIDE_SIZE))
                .map(GalleryView::Outside),
            Some(keyframe) => {
                // An image that cannot be read any more, or never could, has no view.
                let photo = recording
                    .sequence
                    .load_color(recording.keyframes[keyframe])
                    .ok();
                photo.map(|photo| {
                    let (width, height) = photo.dimensions();
                    let up = up_direction(&poses);
                    let view = View::from_keyframe(camera, width, height, poses[keyframe], up);
                    GalleryView::Keyframe { view, photo }
                })
            }
        };
        if let Some(view) = view {
            let picture = gallery.draw(&view, errors.as_ref())?;
            write_png(&output.file(&format!("{PICTURES}/{name}.png"))?, &picture)?;
        }
        progress.step(|| name);
    }
    progress.finish();
    Ok(())
}

/// The mesh with the most triangles; `None` when all are empty.
fn fullest(surfaces: &[ComparedSurface]) -> Option<&TriangleMesh> {
    let meshes = surfaces.iter().map(|surface| &surface.mesh);
    meshes
        .filter(|mesh| !mesh.is_empty())
        .max_by_key(|mesh| mesh.triangles.len())
}
