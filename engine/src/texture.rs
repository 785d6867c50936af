//! The texture of the mesh that a run ends with, from the images of its keyframes.

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::texture::{
    PhotoAlignment, Texture, TextureOptions, TextureSummary, TextureView, align_photos,
    texture_mesh,
};
use linecarve_sequence::{ModelView, Sequence};

use crate::reconstruction::Reconstruction;

/// The texture of `mesh`, which is in the frame of computation; `None` when no image of a keyframe can be read,
/// or the mesh has more triangles than an atlas can hold.
///
/// The images are read from disk again, one a thread at a time; their poses are adjusted to each other first.
pub fn texture(run: &Reconstruction, mesh: &TriangleMesh) -> Option<(Texture, TextureSummary)> {
    let (views, frames) = views(run);
    let sequence = &run.recording().sequence;
    let load = |view: usize| sequence.load_color(frames[view]?).ok();
    texture_mesh(mesh, &views, &load, &TextureOptions::default())
}

/// The images of the keyframes adjusted to each other on `mesh`, as [`texture`] does.
pub fn alignment(run: &Reconstruction, mesh: &TriangleMesh) -> PhotoAlignment {
    let (views, frames) = views(run);
    let sequence = &run.recording().sequence;
    let load = |view: usize| sequence.load_color(frames[view]?).ok();
    align_photos(mesh, &views, &load)
}

/// The keyframes as views of the mesh, and their frames.
fn views(run: &Reconstruction) -> (Vec<TextureView>, Vec<Option<usize>>) {
    let recording = run.recording();
    let sequence = &recording.sequence;
    let all = recording.keyframe_poses();
    let poses = run.map().adjusted_poses().unwrap_or_else(|| {
        let numbers = run.numbers().iter();
        numbers.map(|&number| all[number]).collect()
    });
    let frames: Vec<Option<usize>> = run
        .numbers()
        .iter()
        .map(|&number| match recording.source.model() {
            Some(model) => frame_of(sequence, &model.views[recording.keyframes[number]]),
            None => Some(recording.keyframes[number]),
        })
        .collect();
    let views = poses
        .into_iter()
        .map(|world_from_camera| TextureView {
            camera: sequence.color_camera().without_distortion(),
            world_from_camera,
        })
        .collect();
    (views, frames)
}

/// The frame of a sequence with the name of a view of its model.
pub fn frame_of(sequence: &Sequence, view: &ModelView) -> Option<usize> {
    let name = std::path::Path::new(&view.name);
    let stem = name.file_stem().unwrap_or(name.as_os_str());
    sequence.frames().iter().position(|frame| {
        frame.name == view.name || std::path::Path::new(&frame.name).file_stem() == Some(stem)
    })
}
