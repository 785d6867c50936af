//! stella_vslam and OpenVSLAM: a MessagePack map (`*.msg`) of keyframes, key points and landmarks, in the folder of the
//! images.
//!
//! Stored poses are camera from world with quaternions x y z w; key points are undistorted.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::Point3;
use rmpv::Value;

use super::super::bytes::read_file;
use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::model::{ModelImage, PointBuilder, StoredModel};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, associate, rigid};
use super::{images, tum};

/// Reader of stella_vslam.
pub(in super::super) struct Stella;

fn is_map(name: &str) -> bool {
    name.ends_with(".msg") || name.ends_with(".msgpack")
}

fn map_path(folder: &Folder) -> Option<PathBuf> {
    if let Some(name) = folder.file() {
        return Some(folder.path().join(name));
    }
    let mut maps = folder.names().iter().filter(|name| is_map(name));
    let only = maps.next().filter(|_| maps.next().is_none());
    only.and_then(|name| folder.entry(name))
}

impl Layout for Stella {
    fn name(&self) -> &'static str {
        "stella-vslam"
    }

    fn expected_files(&self) -> &'static str {
        "one map *.msg"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        map_path(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        is_map(name)
    }

    fn accepts_external_poses(&self) -> bool {
        false
    }

    fn read(&self, folder: &Folder, _origin: PoseSource) -> Result<Recording, SequenceError> {
        let path = map_path(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no map *.msg, or several: give the file itself".to_owned(),
        })?;
        let bytes = read_file(&path)?;
        let map = decode(&path, &bytes)?;
        let (model, stamps) = model_of(&path, &map)?;
        let mut recording = model.into_recording(&path, &[])?;
        // The map has no image names, so drop the warning about missing images and associate images by time.
        let warning_count = recording.warnings.len();
        recording.warnings.truncate(warning_count.saturating_sub(1));
        if images::color_folder(folder).is_some() {
            attach_images(folder, &stamps, &mut recording)?;
        } else {
            recording.warnings.push(Warning::statement(
                "there are no images in the folder of the map; only its points can be used",
            ));
        }
        recording.conventions.push(format!(
            "poses: {}, camera from world, inverted; each image belongs to the nearest keyframe within 0.02 s",
            path.display()
        ));
        Ok(recording)
    }
}

fn decode(path: &Path, bytes: &[u8]) -> Result<Value, SequenceError> {
    let mut rest = bytes;
    let value = rmpv::decode::read_value(&mut rest).map_err(|error| SequenceError::Byte {
        path: path.to_owned(),
        offset: (bytes.len() - rest.len()) as u64,
        problem: format!("is not a MessagePack map of stella_vslam: {error}"),
    })?;
    Ok(value)
}

/// A value of the map with its path, for messages.
struct Node<'a> {
    value: &'a Value,
    name: String,
}

impl<'a> Node<'a> {
    fn get(&self, key: &str) -> Option<Node<'a>> {
        let entries = self.value.as_map()?;
        let (_, value) = entries
            .iter()
            .find(|(name, _)| name.as_str() == Some(key))?;
        Some(Node {
            value,
            name: format!("{}.{key}", self.name),
        })
    }

    fn need(&self, key: &str) -> Result<Node<'a>, String> {
        self.get(key)
            .ok_or_else(|| format!("{} has no {key}", self.name))
    }

    fn entries(&self) -> Result<impl Iterator<Item = (&'a str, Node<'a>)> + use<'a>, String> {
        let entries = self
            .value
            .as_map()
            .ok_or_else(|| format!("{} is not a table", self.name))?;
        let name = self.name.clone();
        Ok(entries.iter().filter_map(move |(key, value)| {
            let key = key.as_str()?;
            let name = format!("{name}.{key}");
            Some((key, Node { value, name }))
        }))
    }

    fn items(&self) -> Result<&'a [Value], String> {
        self.value
            .as_array()
            .map(Vec::as_slice)
            .ok_or_else(|| format!("{} is not a list", self.name))
    }

    fn number(&self) -> Result<f64, String> {
        number(self.value).ok_or_else(|| format!("{} is not a number", self.name))
    }

    fn numbers<const N: usize>(&self) -> Result<[f64; N], String> {
        let items = self.items()?;
        let values: Vec<f64> = items.iter().filter_map(number).collect();
        <[f64; N]>::try_from(values).map_err(|_| format!("{} is not {N} numbers", self.name))
    }
}

fn number(value: &Value) -> Option<f64> {
    // Integers are accepted as well.
    value.as_f64()
}

/// The model, and the time of each keyframe in nanoseconds.
fn model_of(path: &Path, map: &Value) -> Result<(StoredModel, Vec<i64>), SequenceError> {
    let root = Node {
        value: map,
        name: "map".to_owned(),
    };
    build(&root, path).map_err(|problem| SequenceError::Content {
        path: path.to_owned(),
        problem,
    })
}

fn build(root: &Node, path: &Path) -> Result<(StoredModel, Vec<i64>), String> {
    let mut model = StoredModel::default();
    let mut camera_of = BTreeMap::new();
    for (name, node) in root.need("cameras")?.entries()? {
        camera_of.insert(name.to_owned(), model.cameras.len() as u32);
        model.cameras.push(camera(&node, path)?);
    }
    let mut points = PointBuilder::default();
    for (id, node) in root.need("landmarks")?.entries()? {
        let id: u64 = id
            .parse()
            .map_err(|_| format!("{} is not a landmark number", node.name))?;
        points.add(id, Point3::from(node.need("pos_w")?.numbers::<3>()?), None);
    }
    let mut stamps = Vec::new();
    for (id, node) in root.need("keyframes")?.entries()? {
        let camera_name = node.need("cam")?;
        let camera = *camera_name
            .value
            .as_str()
            .and_then(|name| camera_of.get(name))
            .ok_or_else(|| format!("{} names an unknown camera", camera_name.name))?;
        let camera_from_world = rigid::from_translation_quaternion(
            node.need("trans_cw")?.numbers()?,
            node.need("rot_cw")?.numbers()?,
        )
        .map_err(|problem| format!("the pose of {} {problem}", node.name))?;
        let seconds = node.need("ts")?.number()?;
        if !(seconds.is_finite() && seconds.abs() < 9e9) {
            return Err(format!(
                "{}.ts = {seconds} is not a time in seconds",
                node.name
            ));
        }
        let timestamp_ns = (seconds * 1e9).round() as i64;
        let view = model.images.len() as u32;
        stamps.push(timestamp_ns);
        model.images.push(ModelImage {
            name: format!("keyframe {id}"),
            camera,
            world_from_camera: camera_from_world.inverse(),
            timestamp_ns: Some(timestamp_ns),
        });
        observations(
            &node,
            view,
            &model.cameras[camera as usize].camera,
            &mut points,
        )?;
    }
    model.points = points.finish();
    Ok((model, stamps))
}

/// Adds the key points with a landmark; -1 marks none.
fn observations(
    keyframe: &Node,
    view: u32,
    camera: &Camera,
    points: &mut PointBuilder,
) -> Result<(), String> {
    let Some(landmarks) = keyframe.get("lm_ids") else {
        return Ok(());
    };
    let key_points = match keyframe.get("undist_keypts") {
        Some(node) => node.items()?,
        None => &[],
    };
    for (at, landmark) in landmarks.items()?.iter().enumerate() {
        let Some(id) = landmark.as_u64() else {
            continue;
        };
        let pixel = key_points.get(at).and_then(|value| {
            let node = Node {
                value,
                name: String::new(),
            };
            let [u, v] = node.get("pt")?.numbers::<2>().ok()?;
            let ray = Point3::new(
                (u - camera.cx()) / camera.fx(),
                (v - camera.cy()) / camera.fy(),
                1.0,
            );
            camera.project(&ray).map(|seen| [seen.x, seen.y])
        });
        points.add_observation(id, view, pixel);
    }
    Ok(())
}

fn camera(node: &Node, path: &Path) -> Result<CalibratedCamera, String> {
    let model = node
        .get("model_type")
        .and_then(|node| node.value.as_str().map(str::to_ascii_lowercase))
        .unwrap_or_else(|| "perspective".to_owned());
    let optional = |key: &str| match node.get(key) {
        Some(value) => value.number(),
        None => Ok(0.0),
    };
    let [k1, k2, k3, k4, p1, p2] = [
        optional("k1")?,
        optional("k2")?,
        optional("k3")?,
        optional("k4")?,
        optional("p1")?,
        optional("p2")?,
    ];
    let distortion = match model.as_str() {
        "perspective" if [k1, k2, p1, p2, k3].iter().all(|value| *value == 0.0) => Distortion::None,
        "perspective" => Distortion::RadialTangential { k1, k2, p1, p2, k3 },
        "fisheye" => Distortion::KannalaBrandt { k1, k2, k3, k4 },
        other => {
            return Err(format!(
                "{} has the model {other}: only perspective and fisheye are supported",
                node.name
            ));
        }
    };
    let [fx, fy, cx, cy] = [
        node.need("fx")?.number()?,
        node.need("fy")?.number()?,
        node.need("cx")?.number()?,
        node.need("cy")?.number()?,
    ];
    let camera = Camera::with_distortion(fx, fy, cx, cy, distortion)
        .map_err(|error| format!("{}: {error}", node.name))?;
    let (width, height) = (optional("cols")?, optional("rows")?);
    let is_size = |value: f64| (1.0..1e6).contains(&value);
    let size = (is_size(width) && is_size(height)).then_some(ImageSize {
        width: width as u32,
        height: height as u32,
    });
    Ok(CalibratedCamera::known(
        camera,
        size,
        path.display().to_string(),
    ))
}

/// Adds a frame for each keyframe with an image of its time.
fn attach_images(
    folder: &Folder,
    stamps: &[i64],
    recording: &mut Recording,
) -> Result<(), SequenceError> {
    let mut warnings = Vec::new();
    let listing = images::list(folder, &mut warnings)?;
    let mut available = listing.frames;
    available.sort_by_key(|frame| frame.timestamp_ns);
    available.dedup_by_key(|frame| frame.timestamp_ns);
    let mut order: Vec<i64> = stamps.to_vec();
    order.sort_unstable();
    order.dedup();
    let image_stamps: Vec<i64> = available.iter().map(|frame| frame.timestamp_ns).collect();
    let partners = associate::nearest_unique(&order, &image_stamps, tum::MAX_DIFFERENCE_NS);
    let views = recording
        .sparse_model
        .as_ref()
        .map(|model| model.views.as_slice())
        .unwrap_or_default();
    // Views and stamps are both sorted by time; keyframes with equal times are ambiguous.
    let mut missing = WarningCounter::default();
    let mut frames = Vec::new();
    if views.len() == order.len() && listing.has_time {
        for (view, partner) in views.iter().zip(partners) {
            let Some(at) = partner else {
                missing.add(view.name.clone());
                continue;
            };
            let image = &available[at];
            frames.push(RecordedFrame {
                name: image.name.clone(),
                timestamp_ns: image.timestamp_ns,
                pose: Some(view.world_from_camera),
                color: image.color.clone(),
                depth: image.depth.clone(),
                right: None,
                camera: None,
            });
        }
    } else {
        warnings.push(Warning::statement(
            "the images have no times: only points can be used; give times as image names, times.txt or rgb.txt",
        ));
    }
    warnings.extend(missing.into_warning(
        order.len(),
        "keyframes have no image within 0.02 s and were skipped",
    ));
    recording.has_time = true;
    recording.frames = frames;
    recording.warnings.extend(warnings);
    Ok(())
}
