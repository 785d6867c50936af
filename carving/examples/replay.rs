//! Replays a recorded sequence of keyframes and changes through a carver and prints what it took, as one JSON object.
//!
//! ```text
//! cargo run --release -p linecarve-carving --example replay -- EVENTS.jsonl [--mesh OUT.obj] [--check]
//! ```
//!
//! Without arguments it runs on a generated sequence.

#![allow(clippy::disallowed_methods)] // A made-up scene may differ between platforms.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::{BufWriter, Write};
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use linecarve_carving::internals::Snapshot;
use linecarve_carving::{
    Carver, CarverOptions, CommitReport, CutOptions, ExportOptions, Hull, IndexedMesh, Labels,
    PointId, Transaction, TransactionError, ViewId, Votes,
};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

const HELP: &str = "\
Replays keyframes and changes through a carver; prints one JSON object.

usage: replay [EVENTS.jsonl] [--mesh OUT.obj] [--check] [--threshold N] [--labels votes|cut] [--hull keep|drop]

EVENTS.jsonl   one JSON object a line:
  {\"keyframe\":i,\"camera\":[x,y,z],\"new_points\":[[id,x,y,z],...],\"observations\":[id,...]}
                   new points are seen by their own keyframe, observations are older points seen again
  {\"remove_points\":[id,...]}
  {\"move_points\":[[id,x,y,z],...]}
  {\"move_views\":[[keyframe,x,y,z],...]}
               Without it, 40 generated keyframes in a box.
--mesh FILE    writes the final surface as OBJ
--check        also builds the final state from scratch, in two orders, and fails on any difference (exit 1)
--threshold N  crossing weight from which a cell is free (default 1)
--labels KIND  votes (default), or cut: a minimum cut with soft visibility
--hull         whether the surface is closed along the hull of the points (default drop)
";

#[derive(Default)]
struct Options {
    events: Option<PathBuf>,
    mesh: Option<PathBuf>,
    check: bool,
    carver: CarverOptions,
}

/// `None` when help was asked for.
fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Option<Options>, String> {
    let mut options = Options::default();
    options.carver.labels = Labels::Votes(Votes::default());
    while let Some(argument) = arguments.next() {
        let mut value = || {
            arguments
                .next()
                .ok_or(format!("{argument} needs a value; see --help"))
        };
        match argument.as_str() {
            "--help" | "-h" => return Ok(None),
            "--check" => options.check = true,
            "--mesh" => options.mesh = Some(value()?.into()),
            "--threshold" => {
                let text = value()?;
                let threshold = text
                    .parse::<NonZeroU64>()
                    .map_err(|_| format!("--threshold {text}: expected a whole number from 1"))?;
                options.carver.labels = Labels::Votes(Votes { threshold });
            }
            "--labels" => {
                options.carver.labels = match value()?.as_str() {
                    "votes" => Labels::Votes(Votes::default()),
                    "cut" => Labels::Cut(CutOptions::default()),
                    other => return Err(format!("--labels {other}: use votes or cut")),
                }
            }
            "--hull" => {
                options.carver.hull = match value()?.as_str() {
                    "keep" => Hull::Keep,
                    "drop" => Hull::Drop,
                    other => return Err(format!("--hull {other}: use keep or drop")),
                }
            }
            flag if flag.starts_with('-') => {
                return Err(format!("unknown option {flag}; see --help"));
            }
            _ if options.events.is_some() => {
                return Err(format!("a second event file {argument}; see --help"));
            }
            _ => options.events = Some(argument.into()),
        }
    }
    Ok(Some(options))
}

/// One line of an event file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    keyframe: Option<u64>,
    camera: Option<[f64; 3]>,
    #[serde(default)]
    new_points: Vec<(u64, f64, f64, f64)>,
    #[serde(default)]
    observations: Vec<u64>,
    #[serde(default)]
    remove_points: Vec<u64>,
    #[serde(default)]
    move_points: Vec<(u64, f64, f64, f64)>,
    #[serde(default)]
    move_views: Vec<(u64, f64, f64, f64)>,
}

/// Ids of the file and ids of the carver.
#[derive(Default)]
struct Names {
    points: BTreeMap<u64, PointId>,
    views: BTreeMap<u64, ViewId>,
}

impl Names {
    fn point(&self, id: u64) -> Result<PointId, String> {
        self.points
            .get(&id)
            .copied()
            .ok_or(format!("point {id} is unknown or was removed"))
    }

    /// Adds the events of a line to a transaction.
    fn enter(&mut self, transaction: &mut Transaction<'_>, line: &Line) -> Result<(), String> {
        let refused = |what: String| move |error: TransactionError| format!("{what}: {error}");
        match (line.keyframe, line.camera) {
            (Some(keyframe), Some([x, y, z])) => {
                if self.views.contains_key(&keyframe) {
                    return Err(format!("keyframe {keyframe} occurs twice"));
                }
                let view = transaction
                    .add_view(Point3::new(x, y, z))
                    .map_err(refused(format!("keyframe {keyframe}")))?;
                self.views.insert(keyframe, view);
                for &(id, x, y, z) in &line.new_points {
                    if self.points.contains_key(&id) {
                        return Err(format!("new point {id} exists already"));
                    }
                    let point = transaction
                        .add_point(Point3::new(x, y, z))
                        .map_err(refused(format!("point {id}")))?;
                    self.points.insert(id, point);
                }
                let seen = line.new_points.iter().map(|(id, ..)| id);
                for &id in seen.chain(&line.observations) {
                    transaction
                        .add_observation(view, self.point(id)?, 1)
                        .map_err(refused(format!("observation of point {id}")))?;
                }
            }
            (None, None) if line.new_points.is_empty() && line.observations.is_empty() => {}
            _ => {
                return Err(
                    "new_points and observations need both keyframe and camera, and these each other"
                        .into(),
                );
            }
        }
        for &id in &line.remove_points {
            let refused = refused(format!("remove point {id}"));
            transaction.remove_point(self.point(id)?).map_err(refused)?;
            self.points.remove(&id);
        }
        for &(id, x, y, z) in &line.move_points {
            transaction
                .move_point(self.point(id)?, Point3::new(x, y, z))
                .map_err(refused(format!("move point {id}")))?;
        }
        for &(keyframe, x, y, z) in &line.move_views {
            let view = self.views.get(&keyframe).copied();
            let view = view.ok_or(format!("keyframe {keyframe} is unknown"))?;
            transaction
                .move_view(view, Point3::new(x, y, z))
                .map_err(refused(format!("move keyframe {keyframe}")))?;
        }
        Ok(())
    }
}

/// Totals over a run.
#[derive(Default)]
struct Totals {
    insertion_s: f64,
    carving_s: f64,
    surface_s: f64,
    keyframe_ms: Vec<f64>,
    keyframe_rays: Vec<usize>,
    change_ms: Vec<f64>,
    triangles_added: usize,
    triangles_removed: usize,
    duplicates: usize,
}

impl Totals {
    fn count(&mut self, report: &CommitReport) {
        self.insertion_s += report.times.tetrahedra.as_secs_f64();
        self.carving_s += report.times.carving.as_secs_f64();
        self.surface_s += report.times.surface.as_secs_f64();
        self.triangles_added += report.surface.added.len();
        self.triangles_removed += report.surface.removed.len();
        self.duplicates += report.duplicates;
    }
}

fn replay(carver: &mut Carver, text: &str, name: &str) -> Result<Totals, String> {
    let mut names = Names::default();
    let mut totals = Totals::default();
    for (index, content) in text.lines().enumerate() {
        if content.trim().is_empty() {
            continue;
        }
        let located = |error: String| format!("{name}:{}: {error}", index + 1);
        let line: Line = serde_json::from_str(content).map_err(|e| located(e.to_string()))?;
        let start = Instant::now();
        let mut transaction = carver.transaction();
        names.enter(&mut transaction, &line).map_err(located)?;
        let report = transaction
            .commit()
            .map_err(|error| located(error.to_string()))?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        if line.keyframe.is_some() {
            totals.keyframe_ms.push(milliseconds);
            totals
                .keyframe_rays
                .push(line.new_points.len() + line.observations.len());
        } else {
            totals.change_ms.push(milliseconds);
        }
        totals.count(&report);
    }
    Ok(totals)
}

/// A camera on a circle in a box of random points, each seen by every fourth keyframe.
fn sample_events() -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut text = String::new();
    let mut known = 0u64;
    let mut removed = Vec::new();
    for keyframe in 0..40u64 {
        let angle = keyframe as f64 / 40.0 * std::f64::consts::TAU;
        let camera = [1.5 * angle.cos(), 1.0 * angle.sin(), 0.2];
        let new_points: Vec<(u64, f64, f64, f64)> = (0..50)
            .map(|i| {
                let mut p: [f64; 3] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
                p[rng.random_range(0..3)] = if rng.random() { 1.0 } else { -1.0 };
                (known + i, 3.0 * p[0], 2.0 * p[1], 1.5 * p[2])
            })
            .collect();
        let observations: Vec<u64> = (0..known)
            .filter(|id| id % 4 == keyframe % 4 && !removed.contains(id))
            .collect();
        let line = serde_json::json!({
            "keyframe": keyframe,
            "camera": camera,
            "new_points": new_points,
            "observations": observations,
        });
        text += &format!("{line}\n");
        known += 50;
        if keyframe % 10 == 9 {
            let gone = [known - 7, known - 90];
            removed.extend(gone);
            text += &format!("{}\n", serde_json::json!({"remove_points": gone}));
            let line = serde_json::json!({"move_views": [[keyframe - 4, 0.1, 0.2, 0.3]]});
            text += &format!("{line}\n");
        }
    }
    text
}

fn write_obj(path: &Path, mesh: &IndexedMesh) -> std::io::Result<()> {
    let mut file = BufWriter::new(std::fs::File::create(path)?);
    for v in &mesh.vertices {
        writeln!(file, "v {} {} {}", v.x, v.y, v.z)?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(file, "f {} {} {}", a + 1, b + 1, c + 1)?;
    }
    file.flush()
}

/// The first difference between two states that should be equal.
fn first_difference(found: &Snapshot, expected: &Snapshot) -> Option<String> {
    if found == expected {
        return None;
    }
    let cells = found.cells.iter().zip(&expected.cells);
    if let Some((found, expected)) = cells.into_iter().find(|(a, b)| a != b) {
        return Some(format!("cell {found:?}, from scratch {expected:?}"));
    }
    Some(format!(
        "{} cells and {} triangles, from scratch {} and {}",
        found.cells.len(),
        found.mesh.triangles.len(),
        expected.cells.len(),
        expected.mesh.triangles.len()
    ))
}

/// Builds the state from scratch in two orders; an error describes a difference.
fn check(carver: &Carver) -> Result<(), String> {
    carver.check_surface().map_err(|error| error.to_string())?;
    let state = carver.snapshot();
    for reverse in [false, true] {
        if let Some(difference) = first_difference(&state, &carver.rebuilt(reverse).snapshot()) {
            let order = if reverse { "reverse" } else { "given" };
            return Err(format!(
                "differs from scratch in {order} order: {difference}"
            ));
        }
    }
    Ok(())
}

/// High-water mark of resident memory, where the system reports it.
fn peak_rss_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes / 1024.0)
}

/// The text to print, and whether the check found a difference.
fn report(arguments: impl Iterator<Item = String>) -> Result<(String, bool), Box<dyn Error>> {
    let Some(options) = parse(arguments)? else {
        return Ok((HELP.into(), true));
    };
    let (name, text) = match &options.events {
        Some(path) => {
            let name = path.display().to_string();
            let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
            (name, text)
        }
        None => ("sample".into(), sample_events()),
    };
    let mut carver = Carver::new(options.carver);
    let totals = replay(&mut carver, &text, &name)?;
    let peak_rss_mb = peak_rss_mb();
    if let Some(path) = &options.mesh {
        let failure = |error| format!("{}: {error}", path.display());
        write_obj(path, &carver.mesh(&ExportOptions::default())).map_err(failure)?;
    }
    let difference = options.check.then(|| check(&carver).err()).flatten();
    let seconds = totals.insertion_s + totals.carving_s + totals.surface_s;
    let mut object = serde_json::json!({
        "keyframes": carver.view_count(),
        "points": carver.point_count(),
        "duplicate_points": totals.duplicates,
        "vertices": carver.tetrahedra().vertex_count(),
        "cells": carver.tetrahedra().finite_cell_count(),
        "rays": carver.ray_count(),
        "crossings": carver.crossing_count(),
        "faces": carver.triangle_count(),
        "insertion_s": totals.insertion_s,
        "carving_s": totals.carving_s,
        "surface_s": totals.surface_s,
        "seconds": seconds,
        "microseconds_per_ray": seconds * 1e6 / carver.ray_count().max(1) as f64,
        "triangles_added": totals.triangles_added,
        "triangles_removed": totals.triangles_removed,
        "keyframe_ms": totals.keyframe_ms,
        "keyframe_rays": totals.keyframe_rays,
        "change_ms": totals.change_ms,
        "crossing_mb": carver.crossing_bytes() as f64 / f64::from(1 << 20),
        "peak_rss_mb": peak_rss_mb,
    });
    if options.check {
        object["check"] = match &difference {
            None => "equal to a build from scratch in two orders".into(),
            Some(difference) => difference.as_str().into(),
        };
    }
    Ok((format!("{object}\n"), difference.is_none()))
}

fn main() -> ExitCode {
    match report(std::env::args().skip(1)) {
        Ok((text, equal)) => match std::io::stdout().write_all(text.as_bytes()) {
            Ok(()) if equal => ExitCode::SUCCESS,
            _ => ExitCode::FAILURE,
        },
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
