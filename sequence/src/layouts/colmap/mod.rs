//! COLMAP: `cameras`, `images` and `points3D` as text or binary, in the folder itself, in `colmap/` or in `sparse/`.
//!
//! Of several models in numbered folders the one with the most images is read, unless [`OpenOptions::model`](super::super::OpenOptions::model) names another.
//!
//! The images of a dense workspace have its depth maps.
//!
//! With `fused.ply` as input, the points are those of the dense cloud.
//!
//! `rigs` and `frames` of newer versions are redundant to `images` and are not read.

mod binary;
mod builder;
mod camera;
mod dense_cloud;
mod depth_maps;
mod facing;
mod fused;
mod numbered;
mod text;

use std::path::{Path, PathBuf};

use super::super::layout::{Folder, Layout, PoseSource, Recording};
use super::super::model::StoredModel;
use super::super::{SequenceError, Warning};
use super::images;
use builder::ModelBuilder;
use numbered::{models_in, others_left_out};

pub use dense_cloud::{DenseCloud, SkippedPoints};

/// Reader of COLMAP.
pub(in super::super) struct Colmap;

/// Folders of a model, relative to the sequence, in order of preference.
const MODEL_FOLDERS: [&str; 8] = [
    "",
    "colmap",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap/0",
    "sparse/0",
    "sparse",
    "dense/sparse",
];

/// File format of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ModelFormat {
    Binary,
    Text,
}

type Reader = fn(&Path, &mut ModelBuilder) -> Result<(), SequenceError>;

impl ModelFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Binary => "bin",
            Self::Text => "txt",
        }
    }

    /// The readers of cameras, points and images.
    fn readers(self) -> [Reader; 3] {
        match self {
            Self::Binary => [
                binary::read_cameras,
                binary::read_points,
                binary::read_images,
            ],
            Self::Text => [text::read_cameras, text::read_points, text::read_images],
        }
    }
}

/// Reads `cameras`, `images` and, if it exists, `points3D`; with a dense cloud the points are those of the cloud.
fn read_model(
    folder: &Path,
    format: ModelFormat,
    cloud: Option<&Path>,
) -> Result<StoredModel, SequenceError> {
    let file = |name: &str| folder.join(format!("{name}.{}", format.extension()));
    let [read_cameras, read_points, read_images] = format.readers();
    let mut model = ModelBuilder::default();
    read_cameras(&file("cameras"), &mut model)?;
    // Points come first, since images refer to them.
    let points = file("points3D");
    if points.is_file() && cloud.is_none() {
        read_points(&points, &mut model)?;
    }
    read_images(&file("images"), &mut model)?;
    let Some(cloud) = cloud else {
        return Ok(model.finish());
    };
    let points = fused::read_cloud(cloud, &model.views())?;
    let mut model = model.finish();
    model.points = points;
    Ok(model)
}

/// Reads `cameras` and `images` alone, and the view of each image in the order of their ids.
fn read_images_only(
    folder: &Path,
    format: ModelFormat,
) -> Result<(StoredModel, Vec<u32>), SequenceError> {
    let file = |name: &str| folder.join(format!("{name}.{}", format.extension()));
    let [read_cameras, _, read_images] = format.readers();
    let mut model = ModelBuilder::default();
    read_cameras(&file("cameras"), &mut model)?;
    read_images(&file("images"), &mut model)?;
    let views = model.views();
    Ok((model.finish(), views))
}

fn format_of(folder: &Path) -> Option<ModelFormat> {
    // COLMAP prefers binary files as well.
    [ModelFormat::Binary, ModelFormat::Text]
        .into_iter()
        .find(|format| {
            ["cameras", "images"].iter().all(|name| {
                folder
                    .join(format!("{name}.{}", format.extension()))
                    .is_file()
            })
        })
}

/// A model, and a warning that names others.
struct FoundModel {
    path: PathBuf,
    format: ModelFormat,
    others: Option<Warning>,
}

/// The folder of a model that the user names, relative to the sequence or by its number.
///
/// # Errors
/// What models there are, when none has this name.
pub(in super::super) fn model_named(folder: &Folder, name: &str) -> Result<PathBuf, String> {
    let parents = || {
        MODEL_FOLDERS
            .iter()
            .filter_map(|folder| folder.strip_suffix('0'))
    };
    let of_number = parents().map(|parent| folder.path().join(parent).join(name));
    let found = std::iter::once(folder.path().join(name))
        .chain(of_number)
        .find(|path| format_of(path).is_some());
    found.ok_or_else(|| {
        let known: Vec<String> = MODEL_FOLDERS
            .iter()
            .filter(|name| !name.is_empty() && !name.ends_with('0'))
            .map(|name| folder.path().join(name))
            .filter(|path| format_of(path).is_some())
            .chain(parents().flat_map(|parent| {
                let models = models_in(&folder.path().join(parent));
                models.into_iter().map(|model| model.path)
            }))
            .map(|path| match path.strip_prefix(folder.path()) {
                Ok(inside) => inside.display().to_string(),
                Err(_) => path.display().to_string(),
            })
            .collect();
        let known = match known.is_empty() {
            true => "there is none".to_owned(),
            false => format!("give one of {}", known.join(", ")),
        };
        format!("--model {name} is no COLMAP model of this folder, with cameras and images as .txt or .bin: {known}")
    })
}

fn find_model(folder: &Folder) -> Option<FoundModel> {
    if let Some(path) = folder.model() {
        return Some(FoundModel {
            path: path.to_owned(),
            format: format_of(path)?,
            others: None,
        });
    }
    MODEL_FOLDERS.iter().find_map(|name| {
        if let Some(parent) = name.strip_suffix("0") {
            let models = models_in(&folder.path().join(parent));
            let others = others_left_out(&models);
            let largest = models.into_iter().next()?;
            return Some(FoundModel {
                path: largest.path,
                format: largest.format,
                others,
            });
        }
        let path = if name.is_empty() {
            folder.path().to_owned()
        } else {
            folder.path().join(name)
        };
        format_of(&path).map(|format| FoundModel {
            path,
            format,
            others: None,
        })
    })
}

impl Layout for Colmap {
    fn name(&self) -> &'static str {
        "colmap"
    }

    fn expected_files(&self) -> &'static str {
        "cameras and images as .txt or .bin, in the folder, colmap/ or sparse/0/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        find_model(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        fused::is_cloud(name)
    }

    fn accepts_external_poses(&self) -> bool {
        false
    }

    fn read(&self, folder: &Folder, _origin: PoseSource) -> Result<Recording, SequenceError> {
        let FoundModel {
            path,
            format,
            others,
        } = find_model(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no COLMAP model: put cameras and images, as .txt or .bin, into this folder, colmap/ or sparse/0/"
                .to_owned(),
        })?;
        for name in [
            MODEL_FOLDERS[1],
            "sparse",
            "dense",
            "cameras.txt",
            "cameras.bin",
            "images.txt",
            "images.bin",
            "points3D.txt",
            "points3D.bin",
        ] {
            folder.claim(name);
        }
        let cloud = fused::named_cloud(folder);
        let model = read_model(&path, format, cloud.as_deref())?;
        let mut recording = into_recording(model, folder, &path)?;
        recording.warnings.extend(others);
        depth_maps::add_to(&mut recording, &path);
        folder.claim("stereo");
        images::add_depth_beside(folder, &mut recording)?;
        recording.conventions.push(format!(
            "poses: COLMAP {} in {}, camera from world, inverted; pixels are shifted by half a pixel, since COLMAP's first \
             pixel centre is (0.5, 0.5)",
            match format {
                ModelFormat::Binary => "binary",
                ModelFormat::Text => "text",
            },
            path.display()
        ));
        Ok(recording)
    }
}

/// Converts the model; looks for images in the usual folders beside and above it.
fn into_recording(
    model: StoredModel,
    folder: &Folder,
    model_path: &Path,
) -> Result<Recording, SequenceError> {
    let mut roots = Vec::new();
    // If the model folder itself is opened, images are beside or above it.
    let absolute = std::fs::canonicalize(model_path).ok();
    let above = absolute
        .iter()
        .flat_map(|path| path.ancestors().skip(1).take(3));
    for base in std::iter::once(folder.path()).chain(above) {
        for name in [
            "images",
            "",
            "image",
            "rgb",
            "color",
            "dense/images",
            "input",
        ] {
            let root = if name.is_empty() {
                base.to_owned()
            } else {
                base.join(name)
            };
            if root.is_dir() && !roots.contains(&root) {
                roots.push(root);
            }
        }
    }
    model.into_recording(model_path, &roots)
}
