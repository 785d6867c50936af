//! `linecarve tables`: the paper's tables of one sequence.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use linecarve_lab::baselines::{FoundSegment, LineDetector, LineDetectorOptions, Method};
use linecarve_lines::depth::EdgeDepthOptions;
use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
use rayon::prelude::*;

use crate::cli::{self, StageArgs, TablesArgs};
use crate::commands::Outcome;
use crate::commands::depth::depth_source;
use crate::commands::run_report::{print_object, print_text};
use crate::commands::sequence::{Prepared, correct, open, prepare};
use crate::mesh::{LineSet, TriangleMesh, read_geometry, write_lines_obj};
use crate::pipeline::{DepthSource, SemiDenseSource};
use crate::progress::{Progress, Verbosity};
use crate::raycast::RayScene;
use crate::report::milliseconds;
use crate::sequence::Sequence;
use crate::tables::images::{ImageEdges, ImageMeasure, Tally, tally};
use crate::tables::methods::{MethodRun, Runs, StageTime, clustered};
use crate::tables::semi_dense;
use crate::tables::surface::{Distances, SurfaceMeasure, measure};
use crate::tables::table::{Row, Tables, ratios};

/// Samples along segments are this share of the scene's median depth apart.
const SAMPLE_SHARE: f64 = 0.005;
/// The methods that need depth.
const WITH_DEPTH: [Method; 3] = [Method::Points, Method::Decoupled, Method::EdgeAided];
/// Straight edges of at least this share of min(width, height) are long.
const LONG_EDGE_SHARE: f64 = 0.1;

pub(super) fn run(args: &TablesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let truth = ground_truth(&args.ground_truth)?;
    let scene = RayScene::new(&truth);
    ensure!(
        scene.triangle_count() > 0,
        "{}: none of its {} triangles has an area; a mesh of the true surface is needed",
        args.ground_truth.display(),
        truth.triangles.len()
    );
    let stages = StageArgs {
        depth: args.depth,
        config: args.config.clone(),
        max_image_size: None,
        format: Vec::new(),
        json: args.json,
    };
    let prepared = prepare(&args.input, &args.selection, &stages, verbosity)?;
    let mut found = run_methods(&prepared, verbosity)?;
    let sequence = &prepared.sequence;
    let mut second = None;
    match &prepared.depth {
        DepthSource::SemiDense(source) => {
            let runs = run_semi_dense(sequence, &prepared, source, &mut found, verbosity)?;
            found.runs.extend(runs);
        }
        DepthSource::Sensor(_) if args.depth == cli::DepthSource::Auto => {
            if let Some(source) = second_source(&prepared, &mut found.warnings) {
                let sequence = corrected(&args.input, &prepared, &mut found, verbosity)?;
                let runs = run_semi_dense(&sequence, &prepared, &source, &mut found, verbosity)?;
                second = Some((sequence, runs));
            }
        }
        DepthSource::Sensor(_) => {}
    }
    let keyframes = found.frames.len();
    let mut rows = Vec::new();
    let given = (None, std::mem::take(&mut found.runs));
    let second = second.map(|(sequence, runs)| (Some(sequence), runs));
    for (other, runs) in std::iter::once(given).chain(second) {
        let sequence = other.as_ref().unwrap_or(&prepared.sequence);
        let runs = with_clusters(runs, &prepared, keyframes)?;
        if let Some(folder) = &args.save {
            save(folder, &runs)?;
        }
        rows.extend(measure_all(
            sequence,
            &prepared,
            &scene,
            &found.frames,
            &runs,
            verbosity,
        )?);
    }
    let folder = prepared.sequence.folder();
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    let tables = Tables {
        generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
        sequence: name.to_string_lossy().into_owned(),
        keyframes,
        ground_truth_triangles: scene.triangle_count(),
        median_depth: prepared.median_depth,
        depth_stages: found.depth_stages,
        ratios: ratios(&rows),
        rows,
        warnings: [prepared.warnings.as_slice(), &found.warnings].concat(),
    };
    if args.json {
        print_object(&tables)?;
    } else {
        print_text(&tables.text())?;
    }
    if tables.rows.iter().all(|row| row.segments == 0) {
        return Ok(Outcome::Negative(format!(
            "no method found a line in {keyframes} keyframe(s): are the images black, blurred or overexposed?"
        )));
    }
    Ok(Outcome::Done)
}

fn ground_truth(path: &Path) -> anyhow::Result<TriangleMesh> {
    let shape = read_geometry(path)?;
    ensure!(
        !shape.triangles.is_empty(),
        "{}: it has no triangles; a mesh of the true surface is needed",
        path.display()
    );
    Ok(shape.into_mesh())
}

/// What all methods made of the keyframes that could be used.
struct Found {
    runs: Vec<MethodRun>,
    /// The frames that were used, by number of the keyframe.
    frames: Vec<usize>,
    depth_stages: Vec<StageTime>,
    warnings: Vec<String>,
}

fn run_methods(prepared: &Prepared, verbosity: Verbosity) -> anyhow::Result<Found> {
    let sequence = &prepared.sequence;
    let options = prepared.options.methods();
    let mut matched = Runs::new(&[Method::Matched], None, &options)?;
    let mut sensor_runs = Runs::new(&WITH_DEPTH, Some("sensor"), &options)?;
    let sensor = match &prepared.depth {
        DepthSource::Sensor(sensor) => Some(sensor),
        DepthSource::SemiDense(_) => None,
    };
    let mut frames = Vec::new();
    let mut warnings = Vec::new();
    let mut depth_milliseconds = 0.0;
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    for &frame in &prepared.keyframes {
        progress.step(|| "methods".to_owned());
        let name = &sequence.frames()[frame].name;
        let loaded = sequence.load_gray(frame).and_then(|image| {
            let depth = match sensor {
                Some(_) => sequence.load_depth(frame)?,
                None => None,
            };
            Ok((image, depth))
        });
        let (image, depth) = match loaded {
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
        matched.push(sequence, frame, number, &image, None)?;
        if let Some((sensor, depth)) = sensor.zip(depth) {
            let start = Instant::now();
            let camera = sequence.color_camera();
            let map = sensor
                .inverse_depth(&depth, camera, image.width(), image.height())
                .with_context(|| format!("frame {name}"))?;
            depth_milliseconds += milliseconds(start.elapsed());
            sensor_runs.push(sequence, frame, number, &image, Some(&map))?;
        }
        frames.push(frame);
    }
    progress.finish();
    ensure!(
        !frames.is_empty(),
        "none of the {} keyframes could be used; first {}",
        prepared.keyframes.len(),
        warnings.first().map_or("", String::as_str)
    );
    let mut found = Found {
        runs: matched.finish(),
        depth_stages: Vec::new(),
        frames,
        warnings,
    };
    if sensor.is_some() {
        found.runs.extend(sensor_runs.finish());
        found.depth_stages.push(StageTime {
            stage: "sensor".to_owned(),
            milliseconds: depth_milliseconds / found.frames.len() as f64,
        });
    }
    Ok(found)
}

/// Semi-dense depth beside that of a sensor, where the images give it.
fn second_source(prepared: &Prepared, warnings: &mut Vec<String>) -> Option<SemiDenseSource> {
    let asked = cli::DepthSource::SemiDense;
    match depth_source(&prepared.sequence, asked, &prepared.options) {
        Ok(scaled) => match scaled.source {
            DepthSource::SemiDense(source) => Some(source),
            DepthSource::Sensor(_) => None,
        },
        Err(error) => {
            warnings.push(format!("without semi-dense depth: {error:#}"));
            None
        }
    }
}

/// The sequence with the poses and the lens that its images have, as a run on depth from images takes them.
fn corrected(
    input: &cli::SequenceArgs,
    prepared: &Prepared,
    found: &mut Found,
    verbosity: Verbosity,
) -> anyhow::Result<Sequence> {
    let mut sequence = open(input)?;
    let options = &prepared.options;
    if options.pose_correction.enabled {
        let warnings = &mut found.warnings;
        correct(&mut sequence, &found.frames, options, warnings, verbosity)?;
    }
    Ok(sequence)
}

/// Runs, and after those whose segments make clusters these.
fn with_clusters(
    runs: Vec<MethodRun>,
    prepared: &Prepared,
    keyframes: usize,
) -> anyhow::Result<Vec<MethodRun>> {
    let mut all = Vec::with_capacity(runs.len() + 1);
    for run in runs {
        let clusters = (run.name == Method::EdgeAided.to_string())
            .then(|| {
                let depth = prepared.median_depth;
                clustered(&run, prepared.options.cluster, depth, keyframes)
            })
            .transpose()?;
        all.push(run);
        all.extend(clusters);
    }
    Ok(all)
}

/// The methods that need depth, with that of neighbouring keyframes.
fn run_semi_dense(
    sequence: &Sequence,
    prepared: &Prepared,
    source: &SemiDenseSource,
    found: &mut Found,
    verbosity: Verbosity,
) -> anyhow::Result<Vec<MethodRun>> {
    let mut options = prepared.options.methods();
    // The depth of an edge pixel was measured on the edge itself: there is no other side to choose.
    options.extract.edge_depth = EdgeDepthOptions::raw();
    let mut runs = Runs::new(&WITH_DEPTH, Some("semi-dense"), &options)?;
    let mut progress = Progress::start("semi-dense", found.frames.len(), verbosity);
    let (maps, time) = semi_dense::maps(sequence, &found.frames, source, prepared.options.edges)?;
    for ((number, &frame), map) in (0..).zip(&found.frames).zip(&maps) {
        progress.step(|| "methods".to_owned());
        let image = sequence.load_gray(frame)?;
        runs.push(sequence, frame, number, &image, Some(map))?;
    }
    progress.finish();
    found.depth_stages.push(StageTime {
        stage: "semi-dense".to_owned(),
        milliseconds: milliseconds(time) / found.frames.len() as f64,
    });
    Ok(runs.finish())
}

/// A row for each run; `sequence` has the poses and images that it was made from.
fn measure_all(
    sequence: &Sequence,
    prepared: &Prepared,
    scene: &RayScene,
    frames: &[usize],
    runs: &[MethodRun],
    verbosity: Verbosity,
) -> anyhow::Result<Vec<Row>> {
    let progress = Progress::start("measure", runs.len(), verbosity);
    let step = SAMPLE_SHARE * prepared.median_depth;
    let sets: Vec<&[FoundSegment]> = runs.iter().map(|run| run.segments.as_slice()).collect();
    let edges = prepared.options.edges;
    let tallies = frames
        .par_iter()
        .enumerate()
        .map(|(number, &frame)| {
            keyframe_tallies(sequence, edges, scene, &sets, number as u32, frame)
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    // From keyframe by keyframe to method by method.
    let mut by_method: Vec<Vec<Tally>> = sets.iter().map(|_| Vec::new()).collect();
    for keyframe in tallies {
        for (method, tally) in by_method.iter_mut().zip(keyframe) {
            method.push(tally);
        }
    }
    let rows = runs
        .iter()
        .zip(by_method)
        .map(|(run, tallies)| {
            if run.points.is_empty() {
                let surface = measure(scene, &run.segments, step);
                Row::new(run, surface, Some(ImageMeasure::new(tallies)))
            } else {
                let distances = run
                    .points
                    .par_iter()
                    .filter_map(|point| Some(scene.closest(point, f64::INFINITY)?.distance))
                    .collect();
                let surface = SurfaceMeasure {
                    ends: Distances::new(distances),
                    along: Distances::default(),
                };
                Row::new(run, surface, None)
            }
        })
        .collect();
    progress.finish();
    Ok(rows)
}

fn keyframe_tallies(
    sequence: &Sequence,
    edges: EdgeOptions,
    scene: &RayScene,
    sets: &[&[FoundSegment]],
    number: u32,
    frame: usize,
) -> anyhow::Result<Vec<Tally>> {
    let image = sequence.load_gray(frame)?;
    let chains = EdgeDetector::new(edges)?.detect(&image);
    let least = LONG_EDGE_SHARE * image.width().min(image.height()) as f64;
    let mut long_edges = LineDetector::new(LineDetectorOptions::default())?.detect(&image, &chains);
    long_edges.retain(|edge| edge.length_px() >= least);
    let edges = ImageEdges {
        keyframe: number,
        camera: sequence.color_camera(),
        world_from_camera: sequence.frames()[frame].world_from_camera,
        chains: &chains,
        long_edges: &long_edges,
    };
    Ok(tally(&edges, scene, sets))
}

/// Writes the lines of every run as OBJ.
fn save(folder: &Path, runs: &[MethodRun]) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for run in runs.iter().filter(|run| !run.segments.is_empty()) {
        let mut name = run.name.replace(", ", "-");
        if let Some(depth) = run.depth {
            name = format!("{name}-{depth}");
        }
        let lines = LineSet::from_segments(run.segments.iter().map(|s| s.ends_in_world));
        write_lines_obj(&folder.join(format!("{name}.obj")), &lines)?;
    }
    Ok(())
}
