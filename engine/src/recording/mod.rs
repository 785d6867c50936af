//! A recording that is ready to be reconstructed: keyframes are chosen, depth and length scale are known.

mod fit;
mod input;
mod layers;
mod origin;
mod precision;
mod prepared;

use std::sync::Arc;

use linecarve_lines::depth::DepthCorrection;
use linecarve_mesh::GltfFrame;
use linecarve_mesh::render::up_direction;
use linecarve_sequence::{Sequence, SparseModel, every_nth, read_keyframe_list, select_keyframes};
use nalgebra::{Isometry3, Vector3};

use crate::front_end::{
    ClassSummary, LayerSummary, PoseSummary, Source, median_feature_depth, median_scene_depth,
};
use crate::options::Options;
use crate::questions::{ROLES_OF_SURFACE, ask};
use crate::run::{ProgressHook, RunDescription};
use crate::tracking::open_or_track;

pub use fit::camera_warning;
pub use input::{Input, RecordingError, Selection, SourceChoice};
pub(crate) use origin::{PointExtent, model_origin};
pub(crate) use precision::Precision;
pub(crate) use prepared::PreparedRecording;

/// A sequence whose keyframes are chosen, with everything that must be known before the first of them.
#[derive(Debug)]
pub struct Recording {
    /// The images, their poses and cameras.
    pub sequence: Sequence,
    /// The parameters of all stages.
    pub options: Options,
    /// What the map is to be made of. A model is moved here from the sequence.
    pub source: Source,
    /// Positions of the keyframes in the sequence; for a model the numbers of its views.
    pub keyframes: Vec<usize>,
    /// Subtracted from all coordinates during computation; zero unless coordinates are far from zero.
    pub origin: Vector3<f64>,
    /// How far poses and images disagree, when depth comes from the images.
    pub poses: Option<PoseSummary>,
    /// How the depth images of keyframes agree with each other, when they were compared.
    pub layers: Option<LayerSummary>,
    /// What each class of confidence of depth images is worth; empty without confidence.
    pub confidence: Vec<ClassSummary>,
    /// Up in the frame of the poses, if it was given.
    pub up: Option<Vector3<f64>>,
    /// Whether poses were found from the images; frames without one are left out.
    pub is_tracked: bool,
    /// What was left out or assumed.
    pub warnings: Vec<String>,
}

impl Recording {
    /// Opens a sequence, chooses keyframes, estimates the length scale and, where depth comes from the images, corrects poses.
    ///
    /// # Errors
    /// When the sequence cannot be read or lacks what was asked for; the text names file and remedy.
    pub fn open(input: &Input, options: Options) -> Result<Self, RecordingError> {
        options.validate()?;
        let noise = options.sensor.relative_noise;
        let opened = open_or_track(
            &input.path,
            &input.open,
            input.track,
            input.accept_as_is,
            noise,
            &input.progress,
        )?;
        let mut warnings: Vec<String> = opened
            .sequence
            .warnings()
            .iter()
            .map(ToString::to_string)
            .collect();
        warnings.extend(opened.warnings);
        if !opened.is_tracked {
            let asked = ask(&opened.sequence, &ROLES_OF_SURFACE, input.accept_as_is)?;
            warnings.extend(asked);
        }
        let source = Source::MapPoints { median_depth: None };
        let mut recording = Self::new(opened.sequence, options, source);
        recording.warnings = warnings;
        recording.is_tracked = opened.is_tracked;
        recording.up = input.up.map(Vector3::from);
        match input.source {
            SourceChoice::MapPoints => match recording.sequence.take_sparse_model() {
                Some(model) => recording.prepare_model(input, model)?,
                None => recording.prepare_features(input)?,
            },
            SourceChoice::Auto | SourceChoice::Sensor | SourceChoice::SemiDense => {
                recording.prepare_lines(input)?;
            }
        }
        Ok(recording)
    }

    /// A sequence without keyframes.
    fn new(sequence: Sequence, options: Options, source: Source) -> Self {
        Self {
            sequence,
            options,
            source,
            keyframes: Vec::new(),
            origin: Vector3::zeros(),
            poses: None,
            layers: None,
            confidence: Vec::new(),
            up: None,
            is_tracked: false,
            warnings: Vec::new(),
        }
    }

    /// The recording of lines whose frames are all keyframes. As for every recording, poses and depth are compared with the images, and
    /// corrected where these contradict them. Without `origin` it is chosen.
    ///
    /// # Errors
    /// When an image cannot be read, and the error is not limited to it.
    pub(crate) fn of_keyframes(
        sequence: Sequence,
        options: Options,
        source: Source,
        is_tracked: bool,
        origin: Option<Vector3<f64>>,
    ) -> Result<Self, RecordingError> {
        let mut recording = Self::new(sequence, options, source);
        recording.keyframes = (0..recording.sequence.frames().len()).collect();
        recording.is_tracked = is_tracked;
        recording.correct_by_images(&ProgressHook::default())?;
        match origin {
            Some(origin) => recording.origin = origin,
            None => recording.choose_origin(recording.length_scale()),
        }
        Ok(recording)
    }

    fn prepare_lines(&mut self, input: &Input) -> Result<(), RecordingError> {
        if self.sequence.frames().is_empty() {
            return Err(RecordingError::Missing(format!(
                "{}: none of the images of the model exists; without images only its points can be used (--from map-points)",
                input.path.display()
            )));
        }
        self.limit_image_size();
        self.choose_depth(input.source)?;
        let median_depth = self.length_scale();
        self.choose_keyframes(input, median_depth)?;
        self.correct_by_images(&input.progress)?;
        self.choose_origin(median_depth);
        Ok(())
    }

    /// Compares the keyframes with each other: their images, or their depth images.
    fn correct_by_images(&mut self, progress: &ProgressHook) -> Result<(), RecordingError> {
        match &self.source {
            Source::Sensor { .. } => self.compare_depth(progress),
            Source::SemiDense(_) if self.options.pose_correction.enabled => {
                self.correct_poses(progress)
            }
            _ => Ok(()),
        }
    }

    /// Takes the source of depth that was asked for.
    fn choose_depth(&mut self, choice: SourceChoice) -> Result<(), RecordingError> {
        let folder = self.sequence.folder().display();
        let missing = |text: String| Err(RecordingError::Missing(text));
        let all: Vec<usize> = (0..self.sequence.frames().len()).collect();
        let has_images = self.sequence.depth_calibration().is_some();
        if choice == SourceChoice::Sensor && !has_images {
            return missing(format!(
                "{folder} has no depth images (layout {}): --depth semi-dense estimates depth from the images",
                self.sequence.layout()
            ));
        }
        let is_semi_dense = choice == SourceChoice::SemiDense || !has_images;
        let found = Source::of_frames(&self.sequence, &all, is_semi_dense, None, &self.options)?;
        let Some(source) = found else {
            return missing(match is_semi_dense {
                true => format!(
                    "{folder}: no depth can be estimated from the images looked at: their edges do not match along the \
                     epipolar lines that the poses give. Are the poses and the calibration right (linecarve info), and does the \
                     camera move sideways?"
                ),
                false => format!(
                    "{folder}: none of the depth images looked at holds a depth: are they the right files? (--depth semi-dense does \
                     without them)"
                ),
            });
        };
        self.source = source;
        Ok(())
    }

    fn prepare_features(&mut self, input: &Input) -> Result<(), RecordingError> {
        self.limit_image_size();
        let all: Vec<usize> = (0..self.sequence.frames().len()).collect();
        let measured = match self.sequence.depth_calibration() {
            Some(_) => median_scene_depth(&self.sequence, &all)?,
            None => None,
        };
        self.source = Source::MapPoints {
            median_depth: measured,
        };
        let selection = &input.selection;
        let chosen = &self.options.keyframes;
        let is_depth_needed = selection.every.is_none()
            && selection.list.is_none()
            && (chosen.translation.is_none() || chosen.min_overlap.is_some());
        let median_depth = match measured {
            Some(depth) => depth,
            None if is_depth_needed => {
                let depth = median_feature_depth(&self.sequence, &self.options.map_points)?;
                depth.ok_or_else(|| {
                    RecordingError::Missing(format!(
                        "{}: how far away the scene is cannot be told from its features (no texture, no motion, or wrong \
                         poses), so keyframes cannot be chosen by motion: give --every N or --min-translation LENGTH",
                        input.path.display()
                    ))
                })?
            }
            // Only the choice by motion needs it.
            None => 1.0,
        };
        self.choose_keyframes(input, median_depth)?;
        self.choose_origin(median_depth);
        Ok(())
    }

    fn prepare_model(
        &mut self,
        input: &Input,
        mut model: SparseModel,
    ) -> Result<(), RecordingError> {
        if let Some(option) = input.selection.given.first() {
            return Err(RecordingError::Missing(format!(
                "{option} has no meaning here: the sequence brings points with the views that see them, and all of them are \
                 carved; leave it out"
            )));
        }
        let mut extent = PointExtent::default();
        let mut precision = Precision::default();
        for point in &model.points {
            extent.add(&point.point_in_world);
            precision.add(point, &model.views);
        }
        if let Some(loss) = precision.loss() {
            let path = input.path.display();
            return Err(RecordingError::Missing(format!("{path}: {loss}")));
        }
        self.shift_to(model_origin(&model.views, &extent));
        self.keyframes = (0..model.views.len()).collect();
        model.translate(&-self.origin);
        self.source = Source::Model(Arc::new(model));
        Ok(())
    }

    /// Has large images loaded smaller.
    fn limit_image_size(&mut self) {
        let longest = self.options.images.longest_side();
        if let Some([stored, loaded]) = self.sequence.limit_image_size(longest) {
            self.warnings.push(format!(
                "images of {} x {} are computed on at {} x {} (--max-image-size 0, or [images] longest_side_px = 0: as they \
                 are, which takes longer)",
                stored.width, stored.height, loaded.width, loaded.height
            ));
        }
    }

    /// The keyframes that the options ask for.
    fn choose_keyframes(&mut self, input: &Input, median_depth: f64) -> Result<(), RecordingError> {
        let selection = &input.selection;
        let count = self.sequence.frames().len();
        let refused = |text: &str| Err(RecordingError::Missing(text.to_owned()));
        self.keyframes = if let Some(n) = selection.every {
            if n == 0 {
                return refused("--every 0: give 1 for every frame");
            }
            every_nth(n, count)
        } else if let Some(path) = &selection.list {
            read_keyframe_list(path, self.sequence.frames())?
        } else {
            let mut task = input.progress.begin("frames", count, "choosing keyframes");
            let report = |frames| task.set(frames);
            let options = &self.options.keyframes;
            select_keyframes(&self.sequence, options, median_depth, report)?
        };
        if let Some(limit) = selection.max_keyframes {
            if limit == 0 {
                return refused("--max-keyframes 0: at least one keyframe is needed");
            }
            self.keyframes.truncate(limit);
        }
        Ok(())
    }

    /// What a run over this recording is. A run of another description cannot go on with its checkpoint.
    pub fn description(&self) -> RunDescription {
        let folder = self.sequence.folder();
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let source = match self.source {
            Source::Sensor { .. } | Source::SemiDense(_) => "lines",
            Source::MapPoints { .. } => "map-points",
            Source::Model(_) => "model",
        };
        let mut text = format!(
            "linecarve {}\nfrom {source} with depth {}\nsequence {}\nlayout {}\noptions {:?}\ncolor camera {:?}\ndepth camera {:?}\n",
            env!("CARGO_PKG_VERSION"),
            self.source.depth_name(),
            folder.display(),
            self.sequence.layout(),
            self.options,
            self.sequence.stored_color_camera(),
            self.sequence.depth_calibration(),
        );
        for class in &self.confidence {
            text += &format!("confidence {} {:?}\n", class.class, class.excess);
        }
        let mut files = Vec::new();
        for (number, frame) in self.keyframes.iter().enumerate() {
            let index = *frame;
            let Some(frame) = self.sequence.frames().get(index) else {
                continue;
            };
            files.extend(self.sequence.files(index));
            let pose = frame.world_from_camera;
            let numbers: Vec<String> = pose
                .rotation
                .coords
                .iter()
                .chain(pose.translation.vector.iter())
                .map(ToString::to_string)
                .collect();
            let name = self.keyframe_name(number);
            text += &format!("keyframe {name} at {}", numbers.join(" "));
            let camera = self.sequence.stored_camera(index);
            if camera != self.sequence.stored_color_camera() {
                text += &format!(" with {camera:?}");
            }
            let correction = self.sequence.depth_correction(index);
            if correction != DepthCorrection::IDENTITY {
                text += &format!(" with {correction:?}");
            }
            text.push('\n');
        }
        RunDescription { text, files }
    }

    /// Name of a keyframe: of its frame, or of its view in a model.
    ///
    /// # Panics
    /// When there is no such keyframe.
    pub fn keyframe_name(&self, number: usize) -> &str {
        let index = self.keyframes[number];
        match self.source.model() {
            Some(model) => &model.views[index].name,
            None => &self.sequence.frames()[index].name,
        }
    }

    /// Pose of each keyframe in the frame of computation: `point_in_map = pose * point_in_camera`.
    pub fn keyframe_poses(&self) -> Vec<Isometry3<f64>> {
        let pose = |&index: &usize| match self.source.model() {
            Some(model) => model.views[index].world_from_camera,
            None => {
                let mut pose = self.sequence.frames()[index].world_from_camera;
                pose.translation.vector -= self.origin;
                pose
            }
        };
        self.keyframes.iter().map(pose).collect()
    }

    /// The frame of glTF files: upright, with the origin of the frame of computation. Up is what was given, else the mean up direction of the
    /// cameras, or the axis of the poses that is within 25 degrees of it.
    pub fn gltf_frame(&self) -> GltfFrame {
        let up = self
            .up
            .unwrap_or_else(|| up_direction(&self.keyframe_poses()));
        GltfFrame::upright(self.origin, &up)
    }

    /// Median scene depth, the length scale of all thresholds; 1 when only the points will tell.
    pub fn length_scale(&self) -> f64 {
        self.source.median_depth().unwrap_or(1.0)
    }

    /// Takes the model out, if there is one.
    pub(crate) fn take_model(&mut self) -> Option<Arc<SparseModel>> {
        let model = self.source.model().cloned()?;
        self.source = Source::MapPoints { median_depth: None };
        Some(model)
    }
}
