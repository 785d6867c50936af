//! Depth maps of COLMAP's dense workspace, `stereo/depth_maps/NAME.geometric.bin`, beside `images/` and `sparse/`.

use std::path::{Path, PathBuf};

use super::super::super::layout::Recording;
use super::super::super::warning::WarningCounter;

/// Folder of the maps, beside that of the model.
const FOLDER: &str = "stereo/depth_maps";

/// Endings after the name of the image, in order of preference: maps that agree with each other come first.
const ENDINGS: [&str; 2] = ["geometric.bin", "photometric.bin"];

/// Gives each frame the depth map of its image, if the model is of a dense workspace.
pub(super) fn add_to(recording: &mut Recording, model: &Path) {
    let model = std::fs::canonicalize(model).unwrap_or_else(|_| model.to_owned());
    let Some(folder) = model.parent().map(|workspace| workspace.join(FOLDER)) else {
        return;
    };
    if !folder.is_dir() {
        return;
    }
    let mut without = WarningCounter::default();
    let (mut used, total) = ([false; 2], recording.frames.len());
    for frame in &mut recording.frames {
        match map_of(&folder, &frame.color) {
            Some((ending, path)) => {
                used[ending] = true;
                frame.depth = Some(path);
            }
            None => without.add(frame.name.clone()),
        }
    }
    if without.count() == total {
        return;
    }
    let used: Vec<&str> = ENDINGS
        .iter()
        .zip(used)
        .filter(|(_, is)| *is)
        .map(|(ending, _)| *ending)
        .collect();
    recording.calibration.depth_has_color_view = true;
    recording.conventions.push(format!(
        "depth: {} of COLMAP's dense workspace ({}), in the unit of the model",
        folder.display(),
        used.join(" and ")
    ));
    recording
        .warnings
        .extend(without.into_warning(total, "images have no depth map"));
}

/// The map of an image, whose name may have folders.
fn map_of(folder: &Path, image: &Path) -> Option<(usize, PathBuf)> {
    let parts: Vec<_> = image.iter().collect();
    // The longest part of the path that names a map is the name of the image in the model.
    (1..parts.len().min(5)).rev().find_map(|count| {
        let name: PathBuf = parts[parts.len() - count..].iter().collect();
        ENDINGS.iter().enumerate().find_map(|(at, ending)| {
            let path = folder.join(format!("{}.{ending}", name.display()));
            path.is_file().then_some((at, path))
        })
    })
}
