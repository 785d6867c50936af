//! A posed image sequence, opened from its files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::OnceLock;

use linecarve_lines::camera::{Camera, CameraCorrection, CameraError};
use linecarve_lines::depth::{DepthCorrection, DepthSensor, SensorNoise};
use nalgebra::Isometry3;

use super::calibration::{ConfidenceImages, ImageSize};
use super::confidence::ConfidenceNoise;
use super::container::Containers;
use super::depth_values::DepthValues;
use super::downsampling::Downsampling;
use super::pose_convention::{Extrinsics, PoseConvention, QuaternionOrder};
use super::sparse_model::SparseModel;
use super::stereo::StereoPair;
use super::undistortion::{Undistortion, pinhole_of};
use super::unread::UnreadFile;
use super::warning::Warning;

/// A posed image of a sequence and its depth image, as paths. Nothing is decoded yet.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Frame name in the layout, without folder and extension (`frame-000003`, `1305031102.175304`).
    pub name: String,
    /// Time of the colour image in nanoseconds; the image number if the layout has no time.
    pub timestamp_ns: i64,
    /// Colour camera pose: `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: Isometry3<f64>,
    /// Path of the colour or grey image.
    pub color: PathBuf,
    /// Path of the depth image; `None` if this frame has none.
    pub depth: Option<PathBuf>,
    /// Path of the image of the right camera; `None` if this frame has none.
    pub right: Option<PathBuf>,
}

/// Calibration of the depth images.
#[derive(Debug, Clone)]
pub struct DepthCalibration {
    /// Pinhole camera of the depth images that [`Sequence::load_depth`] returns; equals the colour camera if depth is
    /// registered.
    pub camera: Camera,
    /// Raw value of one pose unit (1000 for millimetres with poses in metres).
    pub scale: f64,
    /// What raw values measure; images that are loaded have depth.
    pub values: DepthValues,
    /// Whether raw depths are floating-point values, which are not rounded; otherwise integers.
    pub is_float: bool,
    /// `point_in_color = color_from_depth * point_in_depth`; identity when registered.
    pub color_from_depth: Isometry3<f64>,
    /// Whether depth is registered: depth and colour pixels with equal coordinates show the same point.
    pub registered: bool,
}

impl DepthCalibration {
    /// The depth sensor: this camera with a standard deviation of `relative_noise * median_depth` at the median scene
    /// depth, in pose units.
    pub fn sensor(&self, relative_noise: f64, median_depth: f64) -> DepthSensor {
        let step = match (self.is_float, self.values) {
            (true, _) => 0.0,
            (false, DepthValues::Depth | DepthValues::Distance) => 1.0 / self.scale,
            (false, DepthValues::InverseDepth) => median_depth * median_depth / self.scale,
        };
        DepthSensor {
            camera: self.camera.clone(),
            color_from_depth: self.color_from_depth,
            is_registered: self.registered,
            noise: SensorNoise::relative_at(relative_noise, median_depth, step),
        }
    }
}

/// A posed image sequence. Frames are in recording order. A sparse model whose images are missing has no frames.
///
/// ```no_run
/// use std::path::Path;
/// use linecarve_sequence::{OpenOptions, Sequence};
///
/// let sequence = Sequence::open(Path::new("kitchen"), &OpenOptions::default())?;
/// for warning in sequence.warnings() {
///     eprintln!("{warning}");
/// }
/// for index in 0..sequence.frames().len() {
///     let image = sequence.load_gray(index)?;
///     let depth = sequence.load_depth(index)?;
///     println!("{} x {}, depth: {}", image.width(), image.height(), depth.is_some());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Sequence {
    pub(super) folder: PathBuf,
    pub(super) layout: &'static str,
    pub(super) frames: Vec<Frame>,
    /// Pinhole camera of the images without lens distortion.
    pub(super) color_camera: Camera,
    /// Camera of the images as stored.
    pub(super) stored_color_camera: Camera,
    pub(super) color_source: String,
    pub(super) color_size: ImageSize,
    /// Source of the expected colour image size, for messages.
    pub(super) color_size_source: String,
    pub(super) depth: Option<DepthCalibration>,
    /// Folder with the standard deviation of each depth.
    pub(super) sigma_folder: Option<PathBuf>,
    /// Images with the confidence of each depth.
    pub(super) confidence: Option<ConfidenceImages>,
    /// Bounds of the ranks of confidence without classes, once they are asked for.
    pub(super) confidence_bounds: OnceLock<Vec<f32>>,
    /// What each class of confidence is worth, if that was measured.
    pub(super) confidence_noise: Option<ConfidenceNoise>,
    /// Corrections of depth by frame index, where there are any.
    pub(super) depth_corrections: BTreeMap<usize, DepthCorrection>,
    pub(super) stored_depth_size: Option<ImageSize>,
    /// Whether depth images, of a size of their own, show what their colour images show.
    pub(super) depth_has_color_view: bool,
    /// Size of depth images whose files do not say it.
    pub(super) raw_depth_size: Option<ImageSize>,
    /// Archives that hold images.
    pub(super) containers: Containers,
    pub(super) color_undistortion: Option<Undistortion>,
    /// Downsampling, applied after undistortion.
    pub(super) downsampling: Option<Downsampling>,
    pub(super) depth_undistortion: Option<Undistortion>,
    pub(super) stereo: Option<StereoPair>,
    /// Whether no file calibrates the camera.
    pub(super) has_assumed_camera: bool,
    /// Whether the camera is a default of the layout.
    pub(super) has_default_camera: bool,
    /// Additional cameras; their images are resampled to the main camera.
    pub(super) other_cameras: Vec<Camera>,
    /// Image sizes of the additional cameras.
    pub(super) other_sizes: Vec<ImageSize>,
    /// Index into `other_cameras` for each frame; `None` for the main camera.
    pub(super) camera_of_frame: Vec<Option<u32>>,
    /// Poses as stored in the files; `pose_convention` says how they are interpreted.
    pub(super) recorded_poses: Vec<Isometry3<f64>>,
    /// Poses that fit the images where they differ from those of the frames, by index.
    pub(super) fitted_poses: BTreeMap<usize, Isometry3<f64>>,
    /// Whether frames have poses of their own.
    pub(super) has_poses: bool,
    /// Whether time stamps are times rather than image numbers.
    pub(super) has_time: bool,
    pub(super) pose_convention: PoseConvention,
    pub(super) sidecar_pose_convention: Option<String>,
    pub(super) extrinsics: Extrinsics,
    pub(super) other_quaternion: Option<QuaternionOrder>,
    pub(super) sparse_model: Option<SparseModel>,
    pub(super) unread: Vec<UnreadFile>,
    /// Entries of the folder that were read.
    pub(super) read_entries: BTreeSet<String>,
    pub(super) warnings: Vec<Warning>,
    pub(super) conventions: Vec<String>,
}

impl Sequence {
    /// The folder that was opened.
    pub fn folder(&self) -> &std::path::Path {
        &self.folder
    }

    /// Name of the detected layout.
    pub fn layout(&self) -> &'static str {
        self.layout
    }

    /// The frames in recording order; empty if only the sparse model can be used.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Whether frames have poses, read or [set](Self::set_poses); otherwise all have the identity.
    pub fn has_poses(&self) -> bool {
        self.has_poses
    }

    /// Replaces the colour camera poses of some frames, given by frame index.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn set_poses(&mut self, poses: impl IntoIterator<Item = (usize, Isometry3<f64>)>) {
        self.has_poses = true;
        for (index, world_from_camera) in poses {
            self.frames[index].world_from_camera = world_from_camera;
            self.fitted_poses.remove(&index);
        }
    }

    /// Sets poses, by frame index, that fit the images of other frames better than those of the [frames](Self::frames), which say
    /// where a frame is in the world. [`set_poses`](Self::set_poses) takes them back.
    pub fn set_fitted_poses(&mut self, poses: impl IntoIterator<Item = (usize, Isometry3<f64>)>) {
        self.fitted_poses.extend(poses);
    }

    /// Corrects the depth of frames, by frame index, from now on: what is loaded is corrected.
    pub fn set_depth_corrections(
        &mut self,
        corrections: impl IntoIterator<Item = (usize, DepthCorrection)>,
    ) {
        self.depth_corrections.extend(corrections);
    }

    /// The correction of the depth of a frame.
    pub fn depth_correction(&self, index: usize) -> DepthCorrection {
        let correction = self.depth_corrections.get(&index);
        correction.copied().unwrap_or_default()
    }

    /// The pose with which a frame is matched with others.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn fitted_pose(&self, index: usize) -> &Isometry3<f64> {
        let fitted = self.fitted_poses.get(&index);
        fitted.unwrap_or(&self.frames[index].world_from_camera)
    }

    /// Keeps some frames, given by ascending frame index.
    pub fn retain_frames(&mut self, indices: &[usize]) {
        let kept = |index: usize| indices.binary_search(&index).is_ok();
        self.fitted_poses = std::mem::take(&mut self.fitted_poses)
            .into_iter()
            .filter_map(|(index, pose)| Some((indices.binary_search(&index).ok()?, pose)))
            .collect();
        self.depth_corrections = std::mem::take(&mut self.depth_corrections)
            .into_iter()
            .filter_map(|(index, one)| Some((indices.binary_search(&index).ok()?, one)))
            .collect();
        let mut index = 0;
        self.frames.retain(|_| {
            index += 1;
            kept(index - 1)
        });
        let mut index = 0;
        self.recorded_poses.retain(|_| {
            index += 1;
            kept(index - 1)
        });
        let mut index = 0;
        self.camera_of_frame.retain(|_| {
            index += 1;
            kept(index - 1)
        });
    }

    /// Whether the files calibrate lens distortion, or the images come from several cameras.
    pub fn has_known_distortion(&self) -> bool {
        let stored = &self.stored_color_camera;
        !stored.is_pinhole() || self.other_cameras.iter().any(|camera| camera != stored)
    }

    /// Corrects the camera of all stored images, which was given as a pinhole.
    ///
    /// # Errors
    /// If the corrected camera is none.
    pub fn correct_color_camera(
        &mut self,
        correction: &CameraCorrection,
    ) -> Result<(), CameraError> {
        let corrected = correction.applied_to(&self.stored_color_camera)?;
        self.set_stored_color_camera(corrected)
    }

    /// Replaces the camera of all stored images, which are undistorted when loaded. Updates [`color_camera`](Self::color_camera).
    ///
    /// # Errors
    /// If images are reduced, and the camera of the reduced ones is none.
    pub fn set_stored_color_camera(&mut self, stored: Camera) -> Result<(), CameraError> {
        for other in &mut self.other_cameras {
            other.clone_from(&stored);
        }
        self.color_undistortion = Undistortion::new(&stored, self.color_size);
        self.color_camera = pinhole_of(&stored, self.color_undistortion.as_ref());
        self.stored_color_camera = stored;
        if let Some(depth) = self.depth.as_mut().filter(|depth| depth.registered) {
            depth.camera.clone_from(&self.color_camera);
        }
        if let Some(downsampling) = &mut self.downsampling {
            downsampling.set_source_camera(&self.color_camera)?;
        }
        Ok(())
    }

    /// Pinhole camera of the images that [`Sequence::load_gray`] and [`Sequence::load_color`] return.
    pub fn color_camera(&self) -> &Camera {
        match &self.downsampling {
            Some(downsampling) => &downsampling.camera,
            None => &self.color_camera,
        }
    }

    /// Camera of the stored images, with lens distortion.
    pub fn stored_color_camera(&self) -> &Camera {
        &self.stored_color_camera
    }

    /// Whether frame time stamps are times rather than image numbers.
    pub fn has_time(&self) -> bool {
        self.has_time
    }

    /// The pose convention set by the sidecar, as keys of its `[poses]` table; `None` if it equals that of the format.
    /// Frame poses are already converted, so exported poses must not be read with this convention.
    pub fn sidecar_pose_convention(&self) -> Option<&str> {
        self.sidecar_pose_convention.as_deref()
    }

    /// Extrinsics of the colour camera on the tracked body, if known: `point_in_body = body_from_color * point_in_color`.
    pub fn body_from_color(&self) -> Option<&Isometry3<f64>> {
        self.extrinsics.body_from_color.as_ref()
    }

    /// Camera of one frame's stored image, with lens distortion. It differs from [`Sequence::stored_color_camera`] only
    /// in models of several cameras.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn stored_camera(&self, index: usize) -> &Camera {
        self.camera_of_frame[index]
            .and_then(|at| self.other_cameras.get(at as usize))
            .unwrap_or(&self.stored_color_camera)
    }

    /// Size of one frame's stored image. It differs from the main camera's only in models with a size for each image, such as those of
    /// COLMAP's `image_undistorter`, whose images are resampled to the main camera when loaded.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn stored_size(&self, index: usize) -> ImageSize {
        self.camera_of_frame[index]
            .and_then(|at| self.other_sizes.get(at as usize))
            .copied()
            .unwrap_or(self.color_size)
    }

    /// Whether no file calibrates the camera, and [`OpenOptions::assumed_focal`](super::OpenOptions::assumed_focal) gives its focal length.
    pub fn has_assumed_camera(&self) -> bool {
        self.has_assumed_camera
    }

    /// The file or default that the colour camera comes from.
    pub fn color_camera_source(&self) -> &str {
        &self.color_source
    }

    /// Size of the colour images as loaded.
    pub fn color_size(&self) -> ImageSize {
        match &self.downsampling {
            Some(downsampling) => downsampling.size,
            None => self.color_size,
        }
    }

    /// Downsamples loaded images by the smallest integer factor that leaves no side longer than `longest_side` pixels.
    /// Updates [`color_camera`](Self::color_camera). Images to whose pixels depth is registered keep their size. Returns the stored and
    /// the loaded size if they differ.
    pub fn limit_image_size(&mut self, longest_side: u32) -> Option<[ImageSize; 2]> {
        self.downsampling = match &self.depth {
            Some(depth) if depth.registered => None,
            _ => Downsampling::new(&self.color_camera, self.color_size, longest_side),
        };
        let downsampling = self.downsampling.as_ref()?;
        Some([self.color_size, downsampling.size])
    }

    /// Calibration of the depth images; `None` if no frame has one.
    pub fn depth_calibration(&self) -> Option<&DepthCalibration> {
        self.depth.as_ref()
    }

    /// The sparse model of the layout, if it has one: points and the views that observe them.
    pub fn sparse_model(&self) -> Option<&SparseModel> {
        self.sparse_model.as_ref()
    }

    /// Moves the sparse model out; the sequence has none afterwards.
    pub fn take_sparse_model(&mut self) -> Option<SparseModel> {
        self.sparse_model.take()
    }

    /// Non-fatal problems found while reading, for the user.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The conventions under which the files were read, one sentence each.
    pub fn conventions(&self) -> &[String] {
        &self.conventions
    }
}
