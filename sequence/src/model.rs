//! Sparse models as read from a file, and their conversion to a recording. Shared by the readers of models.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3};

use super::calibration::{CalibratedCamera, Calibration};
use super::layout::{RecordedFrame, Recording, image_stem};
use super::text::parse_stamp;
use super::warning::WarningCounter;
use super::{SequenceError, Warning};
use crate::sparse_model::{ModelObservation, ModelPoint, ModelView, SparseModel};

/// A sparse model as read from a file. Observations refer to images by their index in `images`.
#[derive(Debug, Default)]
pub(super) struct StoredModel {
    pub(super) cameras: Vec<CalibratedCamera>,
    pub(super) images: Vec<ModelImage>,
    pub(super) points: Vec<ModelPoint>,
}

/// A posed image of a model.
#[derive(Debug)]
pub(super) struct ModelImage {
    /// Image name in the model, sub-folders included.
    pub(super) name: String,
    /// Index into [`StoredModel::cameras`].
    pub(super) camera: u32,
    pub(super) world_from_camera: Isometry3<f64>,
    /// Time, if the model has one.
    pub(super) timestamp_ns: Option<i64>,
}

/// Collects points and their observations, which may come in any order and repeatedly.
#[derive(Debug, Default)]
pub(super) struct PointBuilder {
    points: Vec<ModelPoint>,
    index_of: HashMap<u64, u32>,
}

impl PointBuilder {
    /// Adds a point. Of several points with one id the first is kept.
    pub(super) fn add(&mut self, id: u64, point_in_world: Point3<f64>, color: Option<[u8; 3]>) {
        let index = self.points.len() as u32;
        self.index_of.entry(id).or_insert_with(|| {
            self.points.push(ModelPoint {
                point_in_world,
                color,
                observations: Vec::new(),
            });
            index
        });
    }

    /// Adds an observation; unknown points are ignored.
    pub(super) fn add_observation(&mut self, id: u64, view: u32, pixel: Option<[f64; 2]>) {
        if let Some(&at) = self.index_of.get(&id) {
            self.points[at as usize]
                .observations
                .push(ModelObservation { view, pixel });
        }
    }

    /// The points, in the order they were added.
    pub(super) fn finish(self) -> Vec<ModelPoint> {
        self.points
    }
}

impl StoredModel {
    /// Sorts images by time if all have one, else by name (numbers in names by value). Returns the new index of each.
    pub(super) fn sort_images(&mut self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.images.len() as u32).collect();
        let images = &self.images;
        order.sort_by(|&a, &b| {
            let (a, b) = (&images[a as usize], &images[b as usize]);
            match (a.timestamp_ns, b.timestamp_ns) {
                (Some(x), Some(y)) if x != y => x.cmp(&y),
                _ => compare_names(&a.name, &b.name),
            }
        });
        let mut new_index = vec![0_u32; order.len()];
        for (new, &old) in (0_u32..).zip(&order) {
            new_index[old as usize] = new;
        }
        let mut images: Vec<Option<ModelImage>> = self.images.drain(..).map(Some).collect();
        self.images = order
            .iter()
            .filter_map(|&old| images[old as usize].take())
            .collect();
        new_index
    }

    /// The views, in the order of the images.
    pub(super) fn views(&mut self) -> Vec<ModelView> {
        let view = |image: ModelImage| {
            let camera = self.cameras.get(image.camera as usize);
            ModelView {
                name: image.name,
                world_from_camera: image.world_from_camera,
                camera: camera.map(|camera| camera.camera.clone()),
                size_px: camera
                    .and_then(|camera| camera.size)
                    .map(|size| [size.width, size.height]),
            }
        };
        std::mem::take(&mut self.images)
            .into_iter()
            .map(view)
            .collect()
    }

    /// Sorts images and renumbers the observations. Keeps one observation a view for each point. Skips points that are not finite.
    fn normalise(&mut self, warnings: &mut Vec<Warning>) {
        let new_index = self.sort_images();
        let total = self.points.len();
        let mut not_finite = WarningCounter::default();
        let mut number = 0;
        self.points.retain(|point| {
            number += 1;
            let is_finite = point.point_in_world.iter().all(|v| v.is_finite());
            if !is_finite {
                not_finite.add(format!("point {number}"));
            }
            is_finite
        });
        warnings.extend(not_finite.into_warning(total, "points are not finite and were skipped"));
        for point in &mut self.points {
            point
                .observations
                .retain(|observation| (observation.view as usize) < new_index.len());
            for observation in &mut point.observations {
                observation.view = new_index[observation.view as usize];
                observation.pixel = observation
                    .pixel
                    .filter(|pixel| pixel.iter().all(|v| v.is_finite()));
            }
            // Of several observations by one view the first with a pixel is kept.
            point
                .observations
                .sort_by_key(|observation| (observation.view, observation.pixel.is_none()));
            point
                .observations
                .dedup_by_key(|observation| observation.view);
            point.observations.shrink_to_fit();
        }
    }

    /// Converts the model to a recording: images found in the best of `roots` become frames.
    ///
    /// # Errors
    /// If the model has no posed image, or neither an image file nor a point.
    pub(super) fn into_recording(
        mut self,
        model_path: &Path,
        roots: &[PathBuf],
    ) -> Result<Recording, SequenceError> {
        let nothing = |problem: &str| SequenceError::Content {
            path: model_path.to_owned(),
            problem: problem.to_owned(),
        };
        if self.images.is_empty() {
            return Err(nothing("has no posed image: run the reconstruction again"));
        }
        let mut warnings = Vec::new();
        self.normalise(&mut warnings);
        let root = best_root(&self.images, roots);
        let names = frame_names(&self.images);
        let has_stamps = self.images.iter().all(|image| {
            image.timestamp_ns.is_some()
                || parse_stamp(file_stem(&image.name)).is_some_and(|stamp| stamp.is_nanoseconds)
        });
        let main = main_camera(&self.images, &self.cameras);
        let mut missing = WarningCounter::default();
        let mut frames = Vec::new();
        for ((number, image), name) in (0_i64..).zip(&self.images).zip(names) {
            let Some(color) = root.and_then(|root| find_image(root, &image.name)) else {
                missing.add(image.name.clone());
                continue;
            };
            let timestamp_ns = if has_stamps {
                image.timestamp_ns.or_else(|| {
                    parse_stamp(file_stem(&image.name)).and_then(|stamp| stamp.as_written_ns())
                })
            } else {
                None
            };
            frames.push(RecordedFrame {
                name,
                timestamp_ns: timestamp_ns.unwrap_or(number),
                pose: Some(image.world_from_camera),
                color,
                depth: None,
                right: None,
                camera: (image.camera != main).then_some(image.camera),
            });
        }
        if frames.is_empty() && self.points.is_empty() {
            return Err(nothing(&format!(
                "has no points, and none of its {} images exists (looked in {}; first: {}): give the workspace or model that has points, or put the \
                 images into one of these folders",
                self.images.len(),
                roots
                    .iter()
                    .map(|root| root.display().to_string())
                    .collect::<Vec<_>>()
                    .join(", "),
                self.images[0].name
            )));
        }
        let total = self.images.len();
        let what = if frames.is_empty() {
            "images of the model do not exist; only its points can be used"
        } else {
            "images of the model do not exist and were skipped"
        };
        warnings.extend(missing.into_warning(total, what));
        let color = self.cameras.get(main as usize).cloned();
        let views = self.views();
        let mut recording = Recording::new(frames, Calibration::of_color(color));
        recording.has_time = has_stamps;
        recording.cameras = self.cameras;
        recording.warnings = warnings;
        if !self.points.is_empty() {
            recording.sparse_model = Some(SparseModel {
                views,
                points: self.points,
            });
        }
        Ok(recording)
    }
}

/// The camera used by most images. Where most images have another size: the camera whose view the most images show; of equal ones that with
/// the smallest field of view, then the first.
fn main_camera(images: &[ModelImage], cameras: &[CalibratedCamera]) -> u32 {
    /// Candidates, as each is compared with all images.
    const MAX_CANDIDATES: usize = 100;
    let most_used = most_used_camera(images, cameras.len());
    let size = |number: u32| cameras.get(number as usize).and_then(|camera| camera.size);
    let of_main_size = images
        .iter()
        .filter(|image| size(image.camera) == size(most_used));
    if 2 * of_main_size.count() > images.len() {
        return most_used;
    }
    let shown = |candidate: &CalibratedCamera| {
        let own = images
            .iter()
            .filter_map(|image| cameras.get(image.camera as usize));
        own.filter(|own| own.covers(candidate)).count()
    };
    let field = |camera: &CalibratedCamera| {
        let side = |side: u32, focal: f64| f64::from(side) / focal;
        camera.size.map_or(f64::INFINITY, |size| {
            side(size.width, camera.camera.fx()) * side(size.height, camera.camera.fy())
        })
    };
    let step = images.len().div_ceil(MAX_CANDIDATES).max(1);
    let candidates = images.iter().step_by(step).map(|image| image.camera);
    candidates
        .filter_map(|number| Some((number, cameras.get(number as usize)?)))
        .map(|(number, camera)| (shown(camera), field(camera), number))
        .max_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then(b.2.cmp(&a.2)))
        .map_or(most_used, |(_, _, number)| number)
}

/// The camera used by most images; the first of equal ones.
fn most_used_camera(images: &[ModelImage], cameras: usize) -> u32 {
    let mut uses = vec![0_usize; cameras];
    for image in images {
        if let Some(count) = uses.get_mut(image.camera as usize) {
            *count += 1;
        }
    }
    let most = uses.iter().copied().max().unwrap_or(0);
    uses.iter().position(|&count| count == most).unwrap_or(0) as u32
}

/// The folder that contains the most of a sample of the images.
fn best_root<'a>(images: &[ModelImage], roots: &'a [PathBuf]) -> Option<&'a PathBuf> {
    const MAX_TRIED: usize = 20;
    let step = images.len().div_ceil(MAX_TRIED).max(1);
    let hits = |root: &PathBuf| {
        images
            .iter()
            .step_by(step)
            .filter(|image| find_image(root, &image.name).is_some())
            .count()
    };
    let mut best: Option<(&PathBuf, usize)> = None;
    for root in roots {
        let count = hits(root);
        if best.is_none_or(|(_, most)| count > most) {
            best = Some((root, count));
        }
    }
    best.map(|(root, _)| root)
}

/// Path of an image file, if it exists. Of absolute names, and of names with `..`, only the file name is used: a model must
/// not read files outside of the folder.
fn find_image(root: &Path, name: &str) -> Option<PathBuf> {
    let name = name.replace('\\', "/");
    let relative = Path::new(&name);
    let is_inside = relative.components().all(|part| {
        matches!(
            part,
            std::path::Component::Normal(_) | std::path::Component::CurDir
        )
    });
    let path = if is_inside {
        root.join(relative)
    } else {
        root.join(relative.file_name()?)
    };
    path.is_file().then_some(path)
}

/// Last component of a name, without extension.
fn file_stem(name: &str) -> &str {
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    image_stem(last).unwrap_or(last)
}

/// Frame names without folder and extension; with the folder if they would not be unique.
fn frame_names(images: &[ModelImage]) -> Vec<String> {
    let mut stems: Vec<&str> = images.iter().map(|image| file_stem(&image.name)).collect();
    stems.sort_unstable();
    let are_unique = stems.windows(2).all(|pair| pair[0] != pair[1]);
    images
        .iter()
        .map(|image| {
            if are_unique {
                file_stem(&image.name).to_owned()
            } else {
                image_stem(&image.name).unwrap_or(&image.name).to_owned()
            }
        })
        .collect()
}

/// Natural order of names: runs of digits compare by value (`frame2` before `frame10`).
pub(super) fn compare_names(a: &str, b: &str) -> Ordering {
    let (mut a_rest, mut b_rest) = (a, b);
    loop {
        let (Some(x), Some(y)) = (a_rest.chars().next(), b_rest.chars().next()) else {
            return a_rest.len().cmp(&b_rest.len()).then_with(|| a.cmp(b));
        };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let (x_digits, x_after) = split_digits(a_rest);
            let (y_digits, y_after) = split_digits(b_rest);
            let (x_value, y_value) = (
                x_digits.trim_start_matches('0'),
                y_digits.trim_start_matches('0'),
            );
            let order = x_value
                .len()
                .cmp(&y_value.len())
                .then_with(|| x_value.cmp(y_value));
            if order != Ordering::Equal {
                return order;
            }
            (a_rest, b_rest) = (x_after, y_after);
        } else {
            if x != y {
                return x.cmp(&y);
            }
            (a_rest, b_rest) = (&a_rest[x.len_utf8()..], &b_rest[y.len_utf8()..]);
        }
    }
}

fn split_digits(text: &str) -> (&str, &str) {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    text.split_at(end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_in_names_compare_by_value() {
        let mut names = ["b1", "a10.png", "a2.png", "a02.png", "a", "a2"];
        names.sort_by(|a, b| compare_names(a, b));
        assert_eq!(names, ["a", "a2", "a02.png", "a2.png", "a10.png", "b1"]);
    }

    #[test]
    fn names_do_not_leave_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("images");
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(folder.path().join("secret.png"), "x").unwrap();
        std::fs::write(inside.join("a.png"), "x").unwrap();
        assert!(find_image(&inside, "../secret.png").is_none());
        assert!(find_image(&inside, "/elsewhere/a.png").is_some());
        assert!(find_image(&inside, "a.png").is_some());
    }

    proptest! {
        #[test]
        fn the_order_of_names_is_total(names in prop::collection::vec("[a0-9.]{0,6}", 3)) {
            let [a, b, c] = [&names[0], &names[1], &names[2]];
            prop_assert_eq!(compare_names(a, b), compare_names(b, a).reverse());
            if compare_names(a, b).is_le() && compare_names(b, c).is_le() {
                prop_assert!(compare_names(a, c).is_le());
            }
            prop_assert_eq!(compare_names(a, b) == Ordering::Equal, a == b);
        }
    }
}
