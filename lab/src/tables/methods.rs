//! Every line method run on the same keyframes.

use std::time::Instant;

use crate::baselines::{
    Findings, FoundSegment, LineMethod, Method, MethodError, MethodOptions, PaperClusterOptions,
    PaperClusterer, PosedKeyframe,
};
use linecarve_lines::cluster::{ClusterOptions, ClusterOptionsError, SegmentClusterer};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;
use nalgebra::Point3;
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
    /// Time of its stages.
    pub stages: Vec<StageTime>,
}

/// Runs methods side by side, one keyframe after another.
pub struct Runs {
    depth: Option<&'static str>,
    methods: Vec<(Box<dyn LineMethod>, Findings)>,
    keyframes: u32,
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
            .map(|method| Ok((method.build(options)?, Findings::default())))
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
        depth: Option<&InverseDepthMap>,
    ) -> Result<(), MethodError> {
        let keyframe = PosedKeyframe {
            number,
            image,
            depth,
            camera: sequence.color_camera(),
            world_from_camera: sequence.frames()[frame].world_from_camera,
        };
        for (method, findings) in &mut self.methods {
            method.add(&keyframe, findings)?;
        }
        self.keyframes += 1;
        Ok(())
    }

    /// The results, in the order of the methods.
    pub fn finish(self) -> Vec<MethodRun> {
        let keyframes = f64::from(self.keyframes.max(1));
        self.methods
            .into_iter()
            .map(|(mut method, mut findings)| {
                method.finish(&mut findings);
                let kind = method.method();
                MethodRun {
                    name: kind.to_string(),
                    depth: self.depth.filter(|_| kind.needs_depth()),
                    point_grays: findings.points.iter().map(|p| p.gray).collect(),
                    points: findings.points.iter().map(|p| p.point_in_world).collect(),
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
        segments.for_each(|ends| clusterer.insert(ends));
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
        stages,
    })
}
