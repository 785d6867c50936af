//! Builds the Delaunay tetrahedra of a point file and prints what it took, as one JSON object.
//!
//! ```text
//! cargo run --release -p linecarve-carving --example tetrahedralize -- POINTS [--mode bulk|incremental|remove]
//! ```
//!
//! Without arguments it runs on generated points.

use std::error::Error;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use linecarve_carving::{Changes, Insertion, Tetrahedralization, VertexId};
use nalgebra::Point3;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const HELP: &str = "\
Delaunay tetrahedra of a point file; prints one JSON object.

usage: tetrahedralize [POINTS] [--mode bulk|incremental|remove] [--from N] [--cells FILE] [--threads N]

POINTS         .bin: little-endian f64 x y z triples; anything else: text, one `x y z` a line (# comments).
               Without it, 20000 random points in the unit cube.
--mode         what is timed (default bulk):
  bulk         all points at once, spatial sort included
  incremental  one insertion after another in spatial order (sort included), each reporting the cells that it
               destroyed and created
  remove       after an untimed bulk, removal of every tenth vertex in random order
--from N       incremental: the first N points of the file go in beforehand, untimed
--cells FILE   writes the finite cells: four increasing point indices a line, lines sorted; a position that occurs
               more than once goes by its first index
--threads N    accepted for comparison with other programs; the tetrahedralisation is serial
";

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    Bulk,
    Incremental,
    Remove,
}

struct Options {
    points: Option<PathBuf>,
    mode: Mode,
    from: usize,
    cells: Option<PathBuf>,
}

/// `None` when help was asked for.
fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Option<Options>, String> {
    let mut options = Options {
        points: None,
        mode: Mode::Bulk,
        from: 0,
        cells: None,
    };
    while let Some(argument) = arguments.next() {
        let mut value = || {
            arguments
                .next()
                .ok_or(format!("{argument} needs a value; see --help"))
        };
        match argument.as_str() {
            "--help" | "-h" => return Ok(None),
            "--mode" => {
                options.mode = match value()?.as_str() {
                    "bulk" => Mode::Bulk,
                    "incremental" => Mode::Incremental,
                    "remove" => Mode::Remove,
                    other => {
                        return Err(format!(
                            "unknown mode {other}: use bulk, incremental or remove"
                        ));
                    }
                }
            }
            "--from" => options.from = number(&argument, &value()?)?,
            "--threads" => drop(number(&argument, &value()?)?),
            "--cells" => options.cells = Some(value()?.into()),
            flag if flag.starts_with('-') => {
                return Err(format!("unknown option {flag}; see --help"));
            }
            _ if options.points.is_some() => {
                return Err(format!("a second point file {argument}; see --help"));
            }
            _ => options.points = Some(argument.into()),
        }
    }
    if options.from > 0 && options.mode != Mode::Incremental {
        return Err("--from needs --mode incremental".into());
    }
    Ok(Some(options))
}

fn number(option: &str, text: &str) -> Result<usize, String> {
    text.parse()
        .map_err(|_| format!("{option} {text}: expected a whole number"))
}

fn read_points(path: &Path) -> Result<Vec<Point3<f64>>, String> {
    let name = path.display();
    let bytes = std::fs::read(path).map_err(|error| format!("{name}: {error}"))?;
    if path.extension().is_some_and(|extension| extension == "bin") {
        let length = bytes.len();
        let (triples, rest) = bytes.as_chunks::<24>();
        if !rest.is_empty() {
            return Err(format!(
                "{name}: {length} bytes are not a multiple of 24 (x y z of 8 bytes each)"
            ));
        }
        let coordinate = |raw: &[u8; 24], i: usize| {
            let mut eight = [0; 8];
            eight.copy_from_slice(&raw[8 * i..8 * i + 8]);
            f64::from_le_bytes(eight)
        };
        let point = |raw| Point3::new(coordinate(raw, 0), coordinate(raw, 1), coordinate(raw, 2));
        return Ok(triples.iter().map(point).collect());
    }
    let text = String::from_utf8(bytes)
        .map_err(|_| format!("{name}: not text; name binary files .bin"))?;
    let mut points = vec![];
    for (line, content) in text.lines().enumerate() {
        let content = content.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let numbers: Result<Vec<f64>, _> = content.split_whitespace().map(str::parse).collect();
        match numbers.as_deref() {
            Ok(&[x, y, z]) => points.push(Point3::new(x, y, z)),
            _ => {
                return Err(format!(
                    "{name}:{}: expected three numbers `x y z`",
                    line + 1
                ));
            }
        }
    }
    Ok(points)
}

fn sample_points() -> Vec<Point3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..20_000)
        .map(|_| Point3::new(rng.random(), rng.random(), rng.random()))
        .collect()
}

/// What a run leaves behind.
struct Run {
    tetrahedra: Tetrahedralization,
    outcomes: Vec<Insertion>,
    operations: usize,
    seconds: f64,
    cells_destroyed: usize,
}

fn run(points: &[Point3<f64>], options: &Options) -> Result<Run, Box<dyn Error>> {
    let first = match options.mode {
        Mode::Bulk | Mode::Remove => points.len(),
        Mode::Incremental => options.from.min(points.len()),
    };
    let mut changes = Changes::new();
    let mut cells_destroyed = 0;
    let mut operations = points.len();
    let mut start = Instant::now();
    let (mut tetrahedra, mut outcomes) = Tetrahedralization::from_points(&points[..first])?;
    let mut seconds = start.elapsed().as_secs_f64();
    match options.mode {
        Mode::Bulk => {}
        Mode::Incremental => {
            operations = points.len() - first;
            let mut later = vec![];
            start = Instant::now();
            tetrahedra.insert_batch_with(
                &points[first..],
                &mut later,
                &mut changes,
                |_, _, changes| {
                    cells_destroyed += changes.destroyed.len();
                },
            )?;
            seconds = start.elapsed().as_secs_f64();
            outcomes.extend(later);
        }
        Mode::Remove => {
            let mut chosen: Vec<VertexId> = tetrahedra.vertices().step_by(10).collect();
            chosen.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
            operations = chosen.len();
            start = Instant::now();
            for &vertex in &chosen {
                tetrahedra.remove(vertex, &mut changes)?;
                cells_destroyed += changes.destroyed.len();
            }
            seconds = start.elapsed().as_secs_f64();
        }
    }
    Ok(Run {
        tetrahedra,
        outcomes,
        operations,
        seconds,
        cells_destroyed,
    })
}

/// Finite cells as increasing indices into the input, sorted.
fn sorted_cells(run: &Run) -> Vec<[usize; 4]> {
    let mut index_of = vec![usize::MAX; run.tetrahedra.vertex_capacity()];
    for (index, outcome) in run.outcomes.iter().enumerate() {
        let first = &mut index_of[outcome.vertex().index()];
        *first = index.min(*first);
    }
    let finite = run
        .tetrahedra
        .cells()
        .filter(|&c| !run.tetrahedra.is_ghost(c));
    let mut cells: Vec<_> = finite
        .map(|c| {
            let mut corners = run.tetrahedra.cell_vertices(c).map(|v| index_of[v.index()]);
            corners.sort_unstable();
            corners
        })
        .collect();
    cells.sort_unstable();
    cells
}

fn write_cells(path: &Path, cells: &[[usize; 4]]) -> std::io::Result<()> {
    let mut file = BufWriter::new(std::fs::File::create(path)?);
    for [a, b, c, d] in cells {
        writeln!(file, "{a} {b} {c} {d}")?;
    }
    file.flush()
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

fn report(arguments: impl Iterator<Item = String>) -> Result<String, Box<dyn Error>> {
    let Some(options) = parse(arguments)? else {
        return Ok(HELP.into());
    };
    let points = match &options.points {
        Some(path) => read_points(path)?,
        None => sample_points(),
    };
    let run = run(&points, &options)?;
    let peak_rss_mb = peak_rss_mb();
    if let Some(path) = &options.cells {
        let failure = |error| format!("{}: {error}", path.display());
        write_cells(path, &sorted_cells(&run)).map_err(failure)?;
    }
    let object = serde_json::json!({
        "points": points.len(),
        "vertices": run.tetrahedra.vertex_count(),
        "dimension": run.tetrahedra.dimension(),
        "finite_cells": run.tetrahedra.finite_cell_count(),
        "infinite_cells": run.tetrahedra.ghost_cell_count(),
        "mode": match options.mode {
            Mode::Bulk => "bulk",
            Mode::Incremental => "incremental",
            Mode::Remove => "remove",
        },
        "threads": 1,
        "operations": run.operations,
        "seconds": run.seconds,
        "cells_destroyed": run.cells_destroyed,
        "peak_rss_mb": peak_rss_mb,
    });
    Ok(format!("{object}\n"))
}

fn main() -> ExitCode {
    match report(std::env::args().skip(1)) {
        Ok(text) => match std::io::stdout().write_all(text.as_bytes()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(_) => ExitCode::FAILURE,
        },
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
