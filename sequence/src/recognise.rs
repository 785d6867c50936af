//! The known layouts, and which of them a folder has.

use std::path::Path;

use super::layout::{Folder, Layout, PoseSource};
use super::layouts::orb_slam::{ImagesAndPoses, OrbSlam};
use super::layouts::{
    arkit_scenes::ArkitScenes, depth_anything::DepthAnything, images, mvsnet::MvsNet,
    polycam::Polycam, record3d::Record3d,
};
use super::layouts::{colmap::Colmap, euroc::Euroc, kitti::Kitti, nvm::Nvm, openmvs::OpenMvs};
use super::layouts::{open3d_log::Open3dLog, seven_scenes::SevenScenes, tum::TumRgbd};
use super::layouts::{
    pose_folder::PoseFolder, replica::Replica, stella::Stella, stray_scanner::StrayScanner,
    transforms::Transforms,
};
use super::{SequenceError, foreign};

/// The known layouts in order of preference. Add new layouts here.
static LAYOUTS: [&dyn Layout; 20] = [
    &SevenScenes,
    &TumRgbd,
    &Open3dLog,
    &Colmap,
    &Nvm,
    &OpenMvs,
    &Transforms,
    &Stella,
    &OrbSlam,
    &Euroc,
    &Kitti,
    &StrayScanner,
    &Record3d,
    &Polycam,
    &ArkitScenes,
    &DepthAnything,
    &MvsNet,
    &Replica,
    &PoseFolder,
    &ImagesAndPoses,
];

/// Lists a folder, or the folder of a file that a layout accepts.
pub(super) fn input_folder(path: &Path) -> Result<Folder, SequenceError> {
    let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
    let name = path.file_name().and_then(|name| name.to_str());
    match name.filter(|_| is_file) {
        Some(name) if LAYOUTS.iter().any(|layout| layout.recognises_file(name)) => {
            Folder::of_file(path, name)
        }
        _ => Folder::list(path),
    }
}

/// Detects the layout of a folder, unless `forced` names it; also returns the other layouts that match.
pub(super) fn recognise(
    folder: &Folder,
    forced: Option<&str>,
    source: PoseSource,
) -> Result<(&'static dyn Layout, Vec<&'static str>), SequenceError> {
    if folder.names().is_empty() {
        return Err(SequenceError::EmptyFolder {
            folder: folder.path().to_owned(),
        });
    }
    let fits = |layout: &&dyn Layout| match folder.file() {
        Some(name) => layout.recognises_file(name),
        None if source == PoseSource::External => layout.recognises_with_external_poses(folder),
        None => layout.recognises(folder),
    };
    let others = |chosen: &str| {
        LAYOUTS
            .iter()
            .filter(|layout| layout.name() != chosen && fits(layout))
            .map(|layout| layout.name())
            .collect()
    };
    if let Some(name) = forced {
        let layout = LAYOUTS
            .iter()
            .copied()
            .find(|layout| layout.name() == name)
            .ok_or_else(|| SequenceError::UnknownLayoutName {
                name: name.to_owned(),
                known: layout_names().join(", "),
            })?;
        if source == PoseSource::External && !layout.accepts_external_poses() {
            return Err(poses_refused(folder, layout));
        }
        return Ok((layout, others(name)));
    }
    let recognised = || LAYOUTS.iter().copied().filter(fits);
    let takes =
        |layout: &&dyn Layout| source == PoseSource::Layout || layout.accepts_external_poses();
    if let Some(layout) = recognised().find(takes) {
        return Ok((layout, others(layout.name())));
    }
    if let Some(layout) = recognised().next() {
        return Err(poses_refused(folder, layout));
    }
    let looked_for: Vec<String> = LAYOUTS
        .iter()
        .map(|layout| format!("{} ({})", layout.expected_files(), layout.name()))
        .collect();
    Err(SequenceError::UnknownLayout {
        folder: folder.path().to_owned(),
        looked_for: looked_for.join("; "),
        found: first_names(folder.names()),
        hint: subfolder_hint(folder),
    })
}

/// The names of all layouts, in order of preference.
pub(super) fn layout_names() -> Vec<&'static str> {
    LAYOUTS.iter().map(|layout| layout.name()).collect()
}

fn poses_refused(folder: &Folder, layout: &dyn Layout) -> SequenceError {
    SequenceError::Content {
        path: folder.path().to_owned(),
        problem: format!(
            "is a {} model, whose poses belong to its points and cameras: omit --poses, or give a folder of images",
            layout.name()
        ),
    }
}

/// Refuses a folder without poses whose images lie in a sequence with poses one folder down.
pub(super) fn check_no_sequence_inside(folder: &Folder) -> Result<(), SequenceError> {
    let inside = images::color_folder(folder).filter(|path| path.as_path() != folder.path());
    let Some(inside) = inside.and_then(|path| Folder::list(path.as_path()).ok()) else {
        return Ok(());
    };
    match layout_of(&inside) {
        None => Ok(()),
        Some(layout) => Err(SequenceError::Content {
            path: folder.path().to_owned(),
            problem: format!(
                "has no poses, but {} is a sequence with poses ({}): give that folder",
                inside.path().display(),
                layout.name()
            ),
        }),
    }
}

fn layout_of(folder: &Folder) -> Option<&'static dyn Layout> {
    LAYOUTS
        .iter()
        .copied()
        .find(|layout| layout.recognises(folder))
}

/// The first few names and the number of the others.
fn first_names(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let mut text = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN {
        text += &format!(" and {} more", names.len() - SHOWN);
    }
    text
}

/// Data sets are often folders of sequences: suggests the first that can be opened. Else says what a file of another program is.
fn subfolder_hint(folder: &Folder) -> String {
    const MAX_TRIED: usize = 50;
    for name in folder.names().iter().take(MAX_TRIED) {
        let path = folder.path().join(name);
        if let Ok(inside) = Folder::list(&path)
            && let Some(layout) = layout_of(&inside)
        {
            return format!("; {} is a sequence ({})", path.display(), layout.name());
        }
    }
    for name in folder.names().iter().take(MAX_TRIED) {
        let path = folder.path().join(name);
        if let Some(kind) = foreign::kind_of(&path).filter(|kind| kind.is_source()) {
            return format!(
                "; {} is {}, which is not read: {}",
                path.display(),
                kind.what,
                kind.remedy_for(&path)
            );
        }
    }
    String::new()
}
