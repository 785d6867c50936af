//! The line methods on depth images and on semi-dense depth.

use std::time::Instant;

use anyhow::{Context, ensure};
use linecarve::front_end::{SemiDenseSource, median_depth_from_images};
use linecarve::progress::{Progress, Verbosity};
use linecarve::run::milliseconds;
use linecarve::{Input, Recording, Selection, SourceChoice};
use linecarve_lab::baselines::{Method, MethodOptions};
use linecarve_lab::tables::methods::{MethodRun, Runs, StageTime, clustered};
use linecarve_lines::paper::PaperOptions;

use super::semi_dense;

/// The methods that need depth.
const WITH_DEPTH: [Method; 5] = [
    Method::Points,
    Method::Decoupled,
    Method::Ransac,
    Method::Paper,
    Method::EdgeAided,
];

/// The results of all methods on the keyframes that could be used.
pub(super) struct Results {
    pub(super) runs: Vec<MethodRun>,
    /// The frames that were used, by number of the keyframe.
    pub(super) frames: Vec<usize>,
    pub(super) depth_stages: Vec<StageTime>,
    pub(super) warnings: Vec<String>,
}

/// Median scene depth, which recordings of lines have.
pub(super) fn median_depth(recording: &Recording) -> f64 {
    recording.length_scale()
}

fn method_options(recording: &Recording) -> MethodOptions {
    MethodOptions {
        extract: recording.options.extract(median_depth(recording)),
        paper: PaperOptions::with_unit(median_depth(recording)),
        ..MethodOptions::default()
    }
}

/// Runs matching on all keyframes that can be used and, where there are depth images, the methods that need depth.
pub(super) fn run(recording: &Recording, verbosity: Verbosity) -> anyhow::Result<Results> {
    let sequence = &recording.sequence;
    let options = method_options(recording);
    let mut matched = Runs::new(&[Method::Matched], None, &options)?;
    let mut sensor_runs = Runs::new(&WITH_DEPTH, Some("sensor"), &options)?;
    let sensor = recording.source.sensor();
    let mut frames = Vec::new();
    let mut warnings = Vec::new();
    let mut depth_milliseconds = 0.0;
    let mut progress = Progress::start("keyframes", recording.keyframes.len(), verbosity);
    for &frame in &recording.keyframes {
        progress.step(|| "methods".to_owned());
        let name = &sequence.frames()[frame].name;
        let loaded = sequence.load_gray_and_color(frame).and_then(|images| {
            let depth = match sensor {
                Some(_) => sequence.load_depth(frame)?,
                None => None,
            };
            Ok((images, depth))
        });
        let ((image, color), depth) = match loaded {
            Ok((_, None)) if sensor.is_some() => {
                warnings.push(format!("left out: frame {name} has no depth image"));
                continue;
            }
            Ok(loaded) => loaded,
            Err(error) if error.is_limited_to_frame() => {
                warnings.push(format!("left out: {error}"));
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let number = frames.len() as u32;
        matched.push(sequence, frame, number, &image, None, None)?;
        if let Some((sensor, depth)) = sensor.zip(depth) {
            let start = Instant::now();
            let camera = sequence.color_camera();
            let map = sensor
                .inverse_depth(&depth, camera, image.width(), image.height())
                .with_context(|| format!("frame {name}"))?;
            depth_milliseconds += milliseconds(start.elapsed());
            let rgb = Some(color.as_raw().as_slice());
            sensor_runs.push(sequence, frame, number, &image, rgb, Some(&map))?;
        }
        frames.push(frame);
    }
    progress.finish();
    ensure!(
        !frames.is_empty(),
        "none of the {} keyframes could be used; first {}",
        recording.keyframes.len(),
        warnings.first().map_or("", String::as_str)
    );
    let mut results = Results {
        runs: matched.finish(),
        depth_stages: Vec::new(),
        frames,
        warnings,
    };
    if sensor.is_some() {
        results.runs.extend(sensor_runs.finish());
        results.depth_stages.push(StageTime {
            stage: "sensor".to_owned(),
            milliseconds: depth_milliseconds / results.frames.len() as f64,
        });
    }
    Ok(results)
}

/// Semi-dense depth in addition to depth images, where the images give it.
pub(super) fn second_source(
    recording: &Recording,
    warnings: &mut Vec<String>,
) -> Option<SemiDenseSource> {
    let (sequence, options) = (&recording.sequence, recording.options.semi_dense);
    let all: Vec<usize> = (0..sequence.frames().len()).collect();
    let missing = match median_depth_from_images(sequence, &all, &options.matching) {
        Ok(Some(median_depth)) => {
            return Some(SemiDenseSource {
                options,
                median_depth,
            });
        }
        Ok(None) => {
            "the edges of the images do not match along the epipolar lines of the poses".to_owned()
        }
        Err(error) => error.to_string(),
    };
    warnings.push(format!("without semi-dense depth: {missing}"));
    None
}

/// The recording with poses and lens corrected by its images, as a run on semi-dense depth takes them.
pub(super) fn corrected(
    input: Input,
    recording: &Recording,
    results: &mut Results,
    verbosity: Verbosity,
) -> anyhow::Result<Recording> {
    let mut every_frame = input;
    every_frame.selection = Selection::default();
    every_frame.selection.every = Some(1);
    every_frame.source = SourceChoice::Sensor;
    let mut corrected = Recording::open(&every_frame, recording.options.clone())?;
    corrected.keyframes.clone_from(&results.frames);
    if corrected.options.pose_correction.enabled {
        let known = corrected.warnings.len();
        corrected.correct_poses(&verbosity.hook())?;
        results
            .warnings
            .extend_from_slice(&corrected.warnings[known..]);
    }
    Ok(corrected)
}

/// The runs, each run of edge-aided segments and of the paper followed by its clusters.
pub(super) fn with_clusters(
    runs: Vec<MethodRun>,
    recording: &Recording,
    keyframes: usize,
) -> anyhow::Result<Vec<MethodRun>> {
    let mut all = Vec::with_capacity(runs.len() + 1);
    for run in runs {
        let clusters = [Method::EdgeAided, Method::Paper]
            .into_iter()
            .find(|method| run.name == method.to_string())
            .map(|method| {
                let options = recording.options.cluster;
                clustered(&run, method, options, median_depth(recording), keyframes)
            })
            .transpose()?;
        all.push(run);
        all.extend(clusters);
    }
    Ok(all)
}

/// The methods that need depth, on semi-dense depth of the frames used.
pub(super) fn run_semi_dense(
    recording: &Recording,
    source: &SemiDenseSource,
    results: &mut Results,
    verbosity: Verbosity,
) -> anyhow::Result<Vec<MethodRun>> {
    let sequence = &recording.sequence;
    let mut options = method_options(recording);
    options.extract = options.extract.for_semi_dense();
    let mut runs = Runs::new(&WITH_DEPTH, Some("semi-dense"), &options)?;
    let mut progress = Progress::start("semi-dense", results.frames.len(), verbosity);
    let (maps, time) =
        semi_dense::maps(sequence, &results.frames, source, recording.options.edges)?;
    for ((number, &frame), map) in (0..).zip(&results.frames).zip(&maps) {
        progress.step(|| "methods".to_owned());
        let image = sequence.load_gray(frame)?;
        runs.push(sequence, frame, number, &image, None, Some(map))?;
    }
    progress.finish();
    results.depth_stages.push(StageTime {
        stage: "semi-dense".to_owned(),
        milliseconds: milliseconds(time) / results.frames.len() as f64,
    });
    Ok(runs.finish())
}
