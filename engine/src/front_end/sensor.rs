//! Keyframes with depth from depth images, each independent of the others.

use std::time::{Duration, Instant};

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::DepthSensor;
use linecarve_lines::image::{GrayImage, Plane};
use linecarve_lines::{ExtractError, ExtractOptions, SegmentExtractor};
use linecarve_sequence::{ColorImage, DepthImage, LoadedDepth, Sequence};
use nalgebra::Isometry3;

use super::colors::KeyframeColors;
use super::error::FrontEndError;
use super::keyframe::{Keyframe, LineKeyframe};
use super::{Arrivals, Group, prepare_independent};
use crate::run::{Checkpoint, StageTimes, milliseconds};

/// Extracts segments from frames. Reuses memory, so each thread has its own.
#[derive(Clone)]
pub struct SensorFrontEnd {
    sensor: DepthSensor,
    extractor: SegmentExtractor,
}

/// The images of one keyframe.
#[derive(Clone, Copy)]
pub(crate) struct KeyframeImages<'a> {
    pub(crate) gray: &'a GrayImage,
    pub(crate) color: &'a ColorImage,
    /// In units of the poses; unknown values are 0.
    pub(crate) depth: &'a Plane<f32>,
    /// Standard deviation of each depth.
    pub(crate) sigma: Option<&'a Plane<f32>>,
    /// Number of depth values that were removed as unmeasurable.
    pub(crate) unmeasurable: usize,
    /// Time that loading took.
    pub(crate) loading: Duration,
}

impl SensorFrontEnd {
    /// A front end for frames with depth images of the camera `sensor`.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(sensor: DepthSensor, options: ExtractOptions) -> Result<Self, ExtractError> {
        Ok(Self {
            sensor,
            extractor: SegmentExtractor::new(options)?,
        })
    }

    pub(super) fn prepare(
        &self,
        sequence: &Sequence,
        group: Group<'_>,
        checkpoint: Option<&Checkpoint>,
    ) -> Arrivals {
        prepare_independent(
            self,
            group,
            checkpoint,
            |front_end, number, frame| front_end.process(sequence, frame, number as u32),
            |keyframe| Keyframe::Lines(Box::new(keyframe)),
        )
    }

    /// Standard deviation of each depth: that of the sensor, and what exceeds it as a share of the depth.
    fn deviations(&self, depth: &DepthImage, mut excess: DepthImage) -> DepthImage {
        let pairs = excess.samples_mut().iter_mut().zip(depth.samples());
        for (excess, &z) in pairs.filter(|(_, z)| **z > 0.0) {
            let z = f64::from(z);
            let relative = (self.sensor.noise.sigma(1.0 / z) * z).hypot(f64::from(*excess));
            *excess = (relative * z) as f32;
        }
        excess
    }

    /// Loads one frame and extracts its segments, which carry the number `keyframe`.
    ///
    /// # Errors
    /// When an image cannot be read, or depth and colour are incompatible.
    pub fn process(
        &mut self,
        sequence: &Sequence,
        frame: usize,
        keyframe: u32,
    ) -> Result<LineKeyframe, FrontEndError> {
        let name = || sequence.frames()[frame].name.clone();
        let start = Instant::now();
        let (image, color) = sequence.load_gray_and_color(frame)?;
        let LoadedDepth {
            depth,
            unmeasurable,
            excess,
        } = sequence
            .load_depth_with_excess(frame)?
            .ok_or_else(|| FrontEndError::WithoutDepth { frame: name() })?;
        let sigma = match sequence.load_depth_sigma(frame)? {
            Some(sigma) => Some(sigma),
            None => excess.map(|excess| self.deviations(&depth, excess)),
        };
        let images = KeyframeImages {
            gray: &image,
            color: &color,
            depth: &depth,
            sigma: sigma.as_ref(),
            unmeasurable,
            loading: start.elapsed(),
        };
        let pose = sequence.frames()[frame].world_from_camera;
        self.extract(
            &images,
            sequence.color_camera(),
            pose,
            (frame, keyframe),
            name,
        )
    }

    /// Extracts the segments of a frame in memory.
    ///
    /// # Errors
    /// When depth and colour are incompatible.
    pub(crate) fn extract(
        &mut self,
        images: &KeyframeImages<'_>,
        camera: &Camera,
        world_from_camera: Isometry3<f64>,
        (frame, keyframe): (usize, u32),
        name: impl Fn() -> String,
    ) -> Result<LineKeyframe, FrontEndError> {
        let start = Instant::now();
        let KeyframeImages {
            gray: image,
            color,
            depth,
            mut unmeasurable,
            ..
        } = *images;
        let colors = KeyframeColors::of(color);
        let far = |depth: &&f32| **depth > 0.0 && !self.sensor.noise.can_measure(**depth);
        unmeasurable += depth.samples().iter().filter(far).count();
        let (width, height) = (image.width(), image.height());
        let map = match images.sigma {
            Some(sigma) => self
                .sensor
                .inverse_depth_with_sigma(depth, sigma, camera, width, height),
            None => self.sensor.inverse_depth(depth, camera, width, height),
        };
        let map = map.map_err(|source| FrontEndError::Depth {
            frame: name(),
            source,
        })?;
        let registered = start.elapsed();
        let extraction = self
            .extractor
            .extract(image, Some(color.as_raw()), &map, camera, keyframe)
            .map_err(|source| FrontEndError::Extract {
                frame: name(),
                source,
            })?;
        Ok(LineKeyframe {
            frame,
            world_from_camera,
            segments: extraction.segments,
            edge_points: Vec::new(),
            surface: extraction.surface,
            unmeasurable_depths: unmeasurable,
            colors,
            edge_chains: extraction.chains,
            edge_pixels: extraction.edge_pixels,
            edge_pixels_with_depth: extraction.edge_pixels_with_depth,
            times: StageTimes {
                load: milliseconds(images.loading),
                depth: milliseconds(
                    registered + extraction.durations.edge_depth + extraction.durations.samples,
                ),
                edges: milliseconds(extraction.durations.edges),
                fit: milliseconds(extraction.durations.fit),
                ..StageTimes::default()
            },
        })
    }
}
