//! Every line method run on the same keyframes.

use std::time::Instant;

use crate::baselines::{
    Findings, FoundSegment, LineMethod, Method, MethodError, MethodOptions, PosedKeyframe,
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

/// The clusters of a method's segments as a run of their own; the time is divided by `keyframes`.
///
/// # Errors
/// When an option is out of range.
pub fn clustered(
    run: &MethodRun,
    options: ClusterOptions,
    median_depth: f64,
    keyframes: usize,
) -> Result<MethodRun, ClusterOptionsError> {
    let start = Instant::now();
    let mut clusterer = SegmentClusterer::new(options, median_depth)?;
    let mut events = Vec::new();
    for segment in &run.segments {
        events.clear();
        clusterer.insert(segment.ends_in_world, &mut events);
    }
    let mut stages = run.stages.clone();
    stages.push(StageTime {
        stage: "cluster".to_owned(),
        milliseconds: milliseconds(start.elapsed()) / keyframes.max(1) as f64,
    });
    Ok(MethodRun {
        name: format!("{}, clustered", run.name),
        depth: run.depth,
        segments: clusterer
            .clusters()
            .map(|(_, cluster)| FoundSegment {
                ends_in_world: cluster.representative.ends,
                keyframe: None,
            })
            .collect(),
        points: Vec::new(),
        stages,
    })
}
