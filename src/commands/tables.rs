//! `linecarve tables`: the paper's tables of one sequence.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, ensure};
use linecarve_lines::baselines::{FoundSegment, LineDetector, LineDetectorOptions, Method};
use linecarve_lines::edges::EdgeDetector;
use rayon::prelude::*;

use crate::cli::{DepthSource, StageArgs, TablesArgs};
use crate::commands::Outcome;
use crate::commands::run_report::{print_object, print_text};
use crate::commands::sequence::{Prepared, prepare};
use crate::mesh::{LineSet, TriangleMesh, read_geometry, write_lines_obj};
use crate::progress::{Progress, Verbosity};
use crate::raycast::RayScene;
use crate::report::milliseconds;
use crate::tables::images::{ImageEdges, ImageMeasure, Tally, tally};
use crate::tables::methods::{MethodRun, Runs, StageTime, clustered};
use crate::tables::surface::{Distances, SurfaceMeasure, measure};
use crate::tables::table::{Row, Tables, ratios};

/// Samples along segments are this share of the scene's median depth apart.
const SAMPLE_SHARE: f64 = 0.005;
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
        depth: DepthSource::Auto,
        config: args.config.clone(),
        format: Vec::new(),
        json: args.json,
    };
    let prepared = prepare(&args.input, &args.selection, &stages, verbosity)?;
    let mut found = run_methods(&prepared, verbosity)?;
    let keyframes = found.frames.len();
    for index in (0..found.runs.len()).rev() {
        if found.runs[index].name == Method::EdgeAided.to_string() {
            let clusters = clustered(
                &found.runs[index],
                prepared.options.cluster,
                prepared.median_depth,
                keyframes,
            )?;
            found.runs.insert(index + 1, clusters);
        }
    }
    if let Some(folder) = &args.save {
        save(folder, &found.runs)?;
    }
    let rows = measure_all(&prepared, &scene, &found, verbosity)?;
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
    let with_depth = [Method::Points, Method::Decoupled, Method::EdgeAided];
    let mut sensor = Runs::new(&with_depth, Some("sensor"), &options)?;
    let mut frames = Vec::new();
    let mut warnings = Vec::new();
    let mut depth_milliseconds = 0.0;
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    for &frame in &prepared.keyframes {
        progress.step(|| "methods".to_owned());
        let loaded = sequence
            .load_gray(frame)
            .and_then(|image| Ok((image, sequence.load_depth(frame)?)));
        let (image, depth) = match loaded {
            Ok((image, Some(depth))) => (image, depth),
            Ok((_, None)) => {
                warnings.push(format!(
                    "left out: frame {} has no depth image",
                    sequence.frames()[frame].name
                ));
                continue;
            }
            Err(error) if error.is_limited_to_frame() => {
                warnings.push(format!("left out: {error}"));
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let start = Instant::now();
        let map = prepared
            .sensor()?
            .inverse_depth(
                &depth,
                sequence.color_camera(),
                image.width(),
                image.height(),
            )
            .with_context(|| format!("frame {}", sequence.frames()[frame].name))?;
        depth_milliseconds += milliseconds(start.elapsed());
        let number = frames.len() as u32;
        matched.push(sequence, frame, number, &image, None)?;
        sensor.push(sequence, frame, number, &image, Some(&map))?;
        frames.push(frame);
    }
    progress.finish();
    ensure!(
        !frames.is_empty(),
        "none of the {} keyframes could be used; first {}",
        prepared.keyframes.len(),
        warnings.first().map_or("", String::as_str)
    );
    let mut runs = matched.finish();
    runs.extend(sensor.finish());
    Ok(Found {
        runs,
        depth_stages: vec![StageTime {
            stage: "sensor".to_owned(),
            milliseconds: depth_milliseconds / frames.len() as f64,
        }],
        frames,
        warnings,
    })
}

fn measure_all(
    prepared: &Prepared,
    scene: &RayScene,
    found: &Found,
    verbosity: Verbosity,
) -> anyhow::Result<Vec<Row>> {
    let progress = Progress::start("measure", found.runs.len(), verbosity);
    let step = SAMPLE_SHARE * prepared.median_depth;
    let sets: Vec<&[FoundSegment]> = found
        .runs
        .iter()
        .map(|run| run.segments.as_slice())
        .collect();
    let tallies = found
        .frames
        .par_iter()
        .enumerate()
        .map(|(number, &frame)| keyframe_tallies(prepared, scene, &sets, number as u32, frame))
        .collect::<anyhow::Result<Vec<_>>>()?;
    // From keyframe by keyframe to method by method.
    let mut by_method: Vec<Vec<Tally>> = sets.iter().map(|_| Vec::new()).collect();
    for keyframe in tallies {
        for (method, tally) in by_method.iter_mut().zip(keyframe) {
            method.push(tally);
        }
    }
    let rows = found
        .runs
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
    prepared: &Prepared,
    scene: &RayScene,
    sets: &[&[FoundSegment]],
    number: u32,
    frame: usize,
) -> anyhow::Result<Vec<Tally>> {
    let sequence = &prepared.sequence;
    let image = sequence.load_gray(frame)?;
    let chains = EdgeDetector::new(prepared.options.edges)?.detect(&image);
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
