//! Every line method run on the same keyframes.

use std::time::Instant;

use crate::baselines::{
    Findings, FoundSegment, LineMethod, Method, MethodError, MethodOptions, PosedKeyframe,
};
use linecarve_lines::cluster::{ClusterOptions, ClusterOptionsError, SegmentClusterer};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;
use linecarve_lines::paper::{PaperClusterOptions, PaperClusterer};
use nalgebra::{Point2, Point3};
use serde::Serialize;

use linecarve::run::milliseconds;
use linecarve_sequence::Sequence;

/// Time of a stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Milliseconds a keyframe.
    pub milliseconds: f64,
}

/// The results of a method on a sequence.
#[derive(Debug, Clone)]
pub struct MethodRun {
    /// Name of the method; `edge-aided, clustered` for the clusters of edge-aided segments.
    pub name: String,
    /// Source of the depth; `None` for a method that uses none.
    pub depth: Option<&'static str>,
    /// Its line segments.
    pub segments: Vec<FoundSegment>,
    /// Its points, for a method that yields points.
    pub points: Vec<Point3<f64>>,
    /// Grey levels of the points.
    pub point_grays: Vec<u8>,
    /// The measured points at the pixels of the ends of its segments, for a method that needs depth.
    pub depths_at_ends: Vec<Point3<f64>>,
    /// Time of its stages.
    pub stages: Vec<StageTime>,
}

/// Runs methods side by side, one keyframe after another.
pub struct Runs {
    depth: Option<&'static str>,
    methods: Vec<Running>,
    keyframes: u32,
}

/// A method with what it has found.
struct Running {
    method: Box<dyn LineMethod>,
    findings: Findings,
    depths_at_ends: Vec<Point3<f64>>,
}

impl Runs {
    /// The given methods on depth of the given source.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        methods: &[Method],
        depth: Option<&'static str>,
        options: &MethodOptions,
    ) -> Result<Self, MethodError> {
        let methods = methods
            .iter()
            .map(|method| {
                Ok(Running {
                    method: method.build(options)?,
                    findings: Findings::default(),
                    depths_at_ends: Vec::new(),
                })
            })
            .collect::<Result<_, MethodError>>()?;
        Ok(Self {
            depth,
            methods,
            keyframes: 0,
        })
    }

    /// Adds the next keyframe to every method; its segments get `number`.
    ///
    /// # Errors
    /// When a method cannot use it.
    pub fn push(
        &mut self,
        sequence: &Sequence,
        frame: usize,
        number: u32,
        image: &GrayImage,
        rgb: Option<&[u8]>,
        depth: Option<&InverseDepthMap>,
    ) -> Result<(), MethodError> {
        let keyframe = PosedKeyframe {
            number,
            image,
            rgb,
            depth,
            camera: sequence.color_camera(),
            world_from_camera: sequence.frames()[frame].world_from_camera,
        };
        for running in &mut self.methods {
            let known = running.findings.segments.len();
            running.method.add(&keyframe, &mut running.findings)?;
            let ends = running.findings.segments[known..]
                .iter()
                .flat_map(|segment| segment.ends_in_world);
            let measured = ends.filter_map(|end| measured_at(&keyframe, &end));
            running.depths_at_ends.extend(measured);
        }
        self.keyframes += 1;
        Ok(())
    }

    /// The results, in the order of the methods.
    pub fn finish(self) -> Vec<MethodRun> {
        let keyframes = f64::from(self.keyframes.max(1));
        self.methods
            .into_iter()
            .map(|running| {
                let (mut method, mut findings) = (running.method, running.findings);
                method.finish(&mut findings);
                let kind = method.method();
                MethodRun {
                    name: kind.to_string(),
                    depth: self.depth.filter(|_| kind.needs_depth()),
                    point_grays: findings.points.iter().map(|p| p.gray).collect(),
                    points: findings.points.iter().map(|p| p.point_in_world).collect(),
                    depths_at_ends: running.depths_at_ends,
                    stages: findings
                        .stages
                        .iter()
                        .map(|(stage, time)| StageTime {
                            stage: (*stage).to_owned(),
                            milliseconds: milliseconds(*time) / keyframes,
                        })
                        .collect(),
                    segments: findings.segments,
                }
            })
            .collect()
    }
}

/// The point that the depth of a keyframe gives at the pixel of a point in the world, or at the nearest pixel beside it with a depth.
fn measured_at(keyframe: &PosedKeyframe<'_>, point: &Point3<f64>) -> Option<Point3<f64>> {
    let local = keyframe.world_from_camera.inverse_transform_point(point);
    let at = keyframe.camera.project(&local)?;
    let (x, y) = (at.x.round(), at.y.round());
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy)));
    let pixels = around.map(|(dx, dy)| Point2::new(x + f64::from(dx), y + f64::from(dy)));
    let (pixel, depth) = pixels
        .filter(|pixel| pixel.x >= 0.0 && pixel.y >= 0.0)
        .filter_map(|pixel| {
            let measured = keyframe.depth?.get(pixel.x as usize, pixel.y as usize)?;
            Some((pixel, measured.depth()))
        })
        .min_by(|(p, _), (q, _)| (p - at).norm_squared().total_cmp(&(q - at).norm_squared()))?;
    let measured = keyframe.camera.point_at_depth(&pixel, depth).ok()?;
    Some(keyframe.world_from_camera * measured)
}

/// The lines of the clusters of segments: those of the product, or those of the paper for [`Method::Paper`].
///
/// # Errors
/// When an option is out of range.
pub fn cluster_lines(
    method: Method,
    segments: impl Iterator<Item = [Point3<f64>; 2]>,
    options: ClusterOptions,
    median_depth: f64,
) -> Result<Vec<[Point3<f64>; 2]>, ClusterOptionsError> {
    if method == Method::Paper {
        let mut clusterer = PaperClusterer::new(PaperClusterOptions::with_unit(median_depth));
        for ends in segments {
            clusterer.insert(ends);
        }
        return Ok(clusterer.lines().collect());
    }
    let mut clusterer = SegmentClusterer::new(options, median_depth)?;
    let mut events = Vec::new();
    for ends in segments {
        events.clear();
        clusterer.insert(ends, &mut events);
    }
    let clusters = clusterer.clusters();
    Ok(clusters.map(|(_, c)| c.representative.ends).collect())
}

/// The clusters of a method's segments as a run of their own; the time is divided by `keyframes`.
///
/// # Errors
/// When an option is out of range.
pub fn clustered(
    run: &MethodRun,
    method: Method,
    options: ClusterOptions,
    median_depth: f64,
    keyframes: usize,
) -> Result<MethodRun, ClusterOptionsError> {
    let start = Instant::now();
    let ends = run.segments.iter().map(|segment| segment.ends_in_world);
    let lines = cluster_lines(method, ends, options, median_depth)?;
    let mut stages = run.stages.clone();
    stages.push(StageTime {
        stage: "cluster".to_owned(),
        milliseconds: milliseconds(start.elapsed()) / keyframes.max(1) as f64,
    });
    Ok(MethodRun {
        name: format!("{}, clustered", run.name),
        depth: run.depth,
        segments: lines
            .into_iter()
            .map(|ends_in_world| FoundSegment {
                ends_in_world,
                keyframe: None,
            })
            .collect(),
        points: Vec::new(),
        point_grays: Vec::new(),
        depths_at_ends: Vec::new(),
        stages,
    })
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use linecarve_lines::depth::InverseDepth;
    use nalgebra::Isometry3;

    use super::*;

    #[test]
    fn what_was_measured_at_a_point_is_at_its_pixel_or_beside_it() {
        let camera = Camera::pinhole(10.0, 10.0, 4.0, 3.0).unwrap();
        let image = GrayImage::new(9, 7, vec![0; 63]).unwrap();
        let mut depth = InverseDepthMap::unknown(9, 7).unwrap();
        depth.set(4, 3, InverseDepth::new(0.5, 0.01));
        let keyframe = PosedKeyframe {
            number: 0,
            image: &image,
            rgb: None,
            depth: Some(&depth),
            camera: &camera,
            world_from_camera: Isometry3::translation(5.0, 0.0, 0.0),
        };
        let measured = Point3::new(5.0, 0.0, 2.0);
        // At the pixel with a depth, beside it, and two pixels away; the depth of the point does not matter.
        for (x, z, expected) in [
            (0.0, 1.0, Some(measured)),
            (0.4, 4.0, Some(measured)),
            (0.8, 4.0, None),
            (0.0, -1.0, None),
        ] {
            let found = measured_at(&keyframe, &Point3::new(5.0 + x, 0.0, z));
            assert_eq!(found, expected, "{x} at {z}");
        }
    }
}
