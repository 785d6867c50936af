//! What keyframes with depth images say about each other before anything is carved: where their layers lie, and what each class of
//! confidence is worth.

use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_sequence::{ClassNoise, DepthClasses, DepthImage, FrameError, Sequence};
use linecarve_tracking::{DepthLayer, LayerAlignment, LayerModel};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::Serialize;

use super::FrontEndError;
use super::confidence_noise::{ClassHistogram, ClassSummary, class_summaries};

/// Columns of the pixels of a keyframe that are asked for their class.
const COLUMNS: usize = 80;
/// Frames that tell how common classes are, evenly spread over the keyframes.
const COUNTED_FRAMES: usize = 9;
/// The best classes that together have one in so many pixels are those that others are compared with.
const REFERENCE: usize = 4;

/// How the layers of keyframes lie to each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LayerSummary {
    /// Keyframes with depth.
    pub keyframes: usize,
    /// Overlaps of two keyframes that were looked at.
    pub overlaps: usize,
    /// Those of them that were held back to judge by.
    pub held_back: usize,
    /// Median distance between held-back layers as given, as a share of the depth.
    pub distance: f64,
    /// The same with corrected layers.
    pub corrected_distance: f64,
    /// The same by the noise of depth alone.
    pub noise: f64,
    /// What is corrected: `poses`, `scales` of the depth, its `shifts` (with scales) or `inverse-shifts`; `none`. Depth is corrected with poses or
    /// alone, which the motion of the cameras tells.
    pub corrected: &'static str,
    /// RMS motion of the cameras by the correction, in units of the poses.
    pub translation: f64,
    /// RMS rotation, in degrees.
    pub rotation_deg: f64,
    /// RMS relative change of the scale.
    pub scale: f64,
}

impl LayerSummary {
    /// The summary of an alignment of layers.
    pub fn of(layers: &[DepthLayer], alignment: &LayerAlignment) -> Self {
        let count = layers.len().max(1) as f64;
        let (mut translation, mut rotation, mut scale) = (0.0, 0.0, 0.0);
        for (layer, placement) in layers.iter().zip(&alignment.placements) {
            let motion = layer.given().inv_mul(&placement.world_from_camera);
            translation += motion.translation.vector.norm_squared() / count;
            rotation += motion.rotation.angle().powi(2) / count;
            scale += placement.depth.scale.ln().powi(2) / count;
        }
        Self {
            keyframes: layers.len(),
            overlaps: alignment.overlaps.len(),
            held_back: alignment.held_back,
            distance: alignment.before,
            corrected_distance: alignment.after,
            noise: alignment.noise,
            corrected: match alignment.model {
                None => "none",
                Some(LayerModel::Poses) => "poses",
                Some(LayerModel::Scales) => "scales",
                Some(LayerModel::ScalesAndInverseShifts) => "inverse-shifts",
                Some(LayerModel::ScalesAndShifts) => "shifts",
            },
            translation: translation.sqrt(),
            rotation_deg: rotation.sqrt().to_degrees(),
            scale: scale.sqrt(),
        }
    }
}

/// A point in the frame of the depth camera, and its class of confidence.
type ClassPoint = (Vector3<f32>, u8);

/// Depth of keyframes, reduced; lists have an entry for each keyframe.
#[derive(Debug, Clone, Default)]
pub struct KeyframeDepths {
    /// Positions of the frames in the sequence.
    pub frames: Vec<usize>,
    /// Depth of the classes that others are compared with.
    pub layers: Vec<DepthLayer>,
    /// Points spread over the image; none without confidence.
    points: Vec<Vec<ClassPoint>>,
}

/// Reads the depth of `frames`. Frames whose own images cannot be used are left out.
///
/// # Errors
/// When an error is not limited to one frame.
///
/// # Complexity
/// Decoding of each depth image; memory for 80 columns of each.
pub fn read_keyframe_depth(
    sequence: &Sequence,
    frames: &[usize],
    noise: SensorNoise,
) -> Result<KeyframeDepths, FrontEndError> {
    let reference = reference_class(sequence, frames)?;
    let read: Vec<Option<(DepthLayer, Vec<ClassPoint>)>> = frames
        .par_iter()
        .map(|&frame| match read_one(sequence, frame, noise, reference) {
            Err(error) if error.is_limited_to_frame() => Ok(None),
            read => read,
        })
        .collect::<Result<_, _>>()?;
    let mut keyframes = KeyframeDepths::default();
    for (&frame, read) in frames.iter().zip(read) {
        if let Some((layer, points)) = read {
            keyframes.frames.push(frame);
            keyframes.layers.push(layer);
            keyframes.points.push(points);
        }
    }
    Ok(keyframes)
}

fn read_one(
    sequence: &Sequence,
    frame: usize,
    noise: SensorNoise,
    reference: u8,
) -> Result<Option<(DepthLayer, Vec<ClassPoint>)>, FrontEndError> {
    let loaded = sequence.load_depth_classes(frame)?;
    let (Some((mut depth, classes)), Some(calibration)) = (loaded, sequence.depth_calibration())
    else {
        return Ok(None);
    };
    let camera = &calibration.camera;
    let points = match &classes {
        Some(classes) => points_with_classes(&depth, classes, |x, y, z| {
            let ray = [
                (x - camera.cx()) / camera.fx(),
                (y - camera.cy()) / camera.fy(),
            ];
            Vector3::new((ray[0] * z) as f32, (ray[1] * z) as f32, z as f32)
        }),
        None => Vec::new(),
    };
    if let Some(classes) = &classes {
        for (depth, class) in depth.samples_mut().iter_mut().zip(classes.samples()) {
            if *class < reference {
                *depth = 0.0;
            }
        }
    }
    let sensor = DepthSensor::registered(camera, noise);
    let map = sensor
        .inverse_depth(&depth, camera, depth.width(), depth.height())
        .map_err(|source| FrontEndError::Depth {
            frame: sequence.frames()[frame].name.clone(),
            source,
        })?;
    let world_from_depth =
        sequence.frames()[frame].world_from_camera * calibration.color_from_depth;
    let layer = DepthLayer::new(&map, camera, &world_from_depth);
    Ok(Some((layer, points)))
}

fn points_with_classes(
    depth: &DepthImage,
    classes: &DepthClasses,
    point: impl Fn(f64, f64, f64) -> Vector3<f32>,
) -> Vec<ClassPoint> {
    let step = (depth.width() / COLUMNS).max(1);
    let mut points = Vec::new();
    for y in (step / 2..depth.height()).step_by(step) {
        for x in (step / 2..depth.width()).step_by(step) {
            if let (Some(&z), Some(&class)) = (depth.get(x, y), classes.get(x, y))
                && z > 0.0
            {
                points.push((point(x as f64, y as f64, f64::from(z)), class));
            }
        }
    }
    points
}

/// The lowest of the best classes that together have a quarter of the pixels with depth; 0 without confidence.
fn reference_class(sequence: &Sequence, frames: &[usize]) -> Result<u8, FrameError> {
    if !sequence.has_confidence() {
        return Ok(0);
    }
    let mut counts = [0_usize; 256];
    let samples = frames.len().min(COUNTED_FRAMES);
    for sample in 0..samples {
        let frame = frames[(2 * sample + 1) * frames.len() / (2 * samples)];
        let (depth, classes) = match sequence.load_depth_classes(frame) {
            Ok(Some((depth, Some(classes)))) => (depth, classes),
            Ok(_) => continue,
            Err(error) if error.is_limited_to_frame() => continue,
            Err(error) => return Err(error),
        };
        let pixels = depth.samples().iter().zip(classes.samples());
        for (_, class) in pixels.filter(|(depth, _)| **depth > 0.0) {
            counts[usize::from(*class)] += 1;
        }
    }
    let all: usize = counts.iter().sum();
    let mut above = 0;
    for class in (0..=u8::MAX).rev() {
        above += counts[usize::from(class)];
        if above > 0 && REFERENCE * above >= all {
            return Ok(class);
        }
    }
    Ok(0)
}

/// What each class of confidence is worth, by the distances of its points from the layers of other keyframes. `None` without confidence.
///
/// # Complexity
/// Linear in the points, for each overlap.
pub fn measure_confidence(
    keyframes: &KeyframeDepths,
    alignment: &LayerAlignment,
) -> Option<Vec<ClassSummary>> {
    if keyframes.points.iter().all(Vec::is_empty) {
        return None;
    }
    let placed: Vec<DepthLayer> = (keyframes.layers)
        .par_iter()
        .zip(&alignment.placements)
        .map(|(layer, placement)| layer.corrected(placement))
        .collect();
    let both = |[a, b]: &[usize; 2]| [[*a, *b], [*b, *a]];
    let overlaps: Vec<[usize; 2]> = alignment.overlaps.iter().flat_map(both).collect();
    let histograms: Vec<ClassHistogram> = overlaps
        .par_chunks(overlaps.len().div_ceil(64).max(1))
        .map(|overlaps| {
            let mut histogram = ClassHistogram::default();
            for [from, to] in overlaps {
                let placement = &alignment.placements[*from];
                let motion = placed[*to].given().inv_mul(&placement.world_from_camera);
                for (point, class) in &keyframes.points[*from] {
                    let point: Vector3<f64> = point.cast();
                    let Some(z) = placement.depth.depth(point.z) else {
                        continue;
                    };
                    let moved = motion * nalgebra::Point3::from(point * (z / point.z));
                    let distance = placed[*to].distance(&moved.coords);
                    histogram.add(*class, distance);
                }
            }
            histogram
        })
        .collect();
    let mut sum = ClassHistogram::default();
    for points in &keyframes.points {
        sum.count_pixels(points.iter().map(|(_, class)| *class));
    }
    for histogram in &histograms {
        sum.merge(histogram);
    }
    Some(class_summaries(&sum))
}

/// The classes of a table, for the sequence.
pub fn class_noise(classes: &[ClassSummary]) -> Vec<ClassNoise> {
    let noise = |summary: &ClassSummary| ClassNoise {
        class: summary.class,
        excess: summary.excess,
    };
    classes.iter().map(noise).collect()
}
