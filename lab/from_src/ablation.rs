//! What each switch of the reconstruction is worth: every switch on every sequence, scored against the ground truth beside
//! it, as one table and as JSON.
//!
//! ```text
//! cargo build --release
//! cargo run --example ablation -- SEQUENCE... [--out DIR] [--program FILE] [--only TEXT] [-- KEYFRAME-OPTIONS]
//! ```
//!
//! A SEQUENCE is a folder with `ground-truth-observed.ply` or `ground-truth.ply` in it. What follows the second `--` goes to
//! `reconstruct` and `evaluate` alike, such as `--min-translation 0.15`. The runs are those of the program itself, one
//! thread each, so that a row can be repeated by hand with the configuration that is kept in DIR.

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

const VOTES: &str = "[carving]\nlabels = \"votes\"\n";
const CUT: &str = "[carving]\nlabels = \"cut\"\n";
const NOT_JOINED: &str = "[landmarks]\njoin = false\n";
const ENDS: &str = "[segment_points]\nspacing_px = 10000.0\n";
const CONFORMING: &str = "[segment_points]\nconforming = true\n";
const NO_PLANES: &str = "[surface_points]\nenabled = false\n";
const NO_CORRECTIONS: &str = "[surface_points]\ncorrection_sigmas = inf\n";
const UNMEASURED: &str = "[surface]\nleast_measured_share = 0.0\n";
const SEGMENTS: &str = "segment_weight = 1\n";
const TRIANGULATIONS: &str = "triangulation_weight = 1\n";

/// Lines alone leave wide cells, which want more weight on their shape than the default.
const SHAPE: &str = "[carving.cut]\nquality_weight = 0.2\n";

/// Name of a row, and the parts of its configuration. The first is the paper: two points a segment, each for itself.
const SWITCHES: [(&str, &[&str]); 21] = [
    (
        "ends of segments, not joined; votes",
        &[VOTES, NOT_JOINED, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "ends of segments; votes",
        &[VOTES, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "ends and whole segments; votes",
        &[VOTES, SEGMENTS, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "points along segments; votes",
        &[VOTES, NO_PLANES, UNMEASURED],
    ),
    (
        "points along and whole segments; votes",
        &[VOTES, SEGMENTS, NO_PLANES, UNMEASURED],
    ),
    (
        "ends of segments; cut",
        &[CUT, SHAPE, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "ends and whole segments; cut",
        &[CUT, SEGMENTS, SHAPE, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "points along segments; cut",
        &[CUT, SHAPE, NO_PLANES, UNMEASURED],
    ),
    (
        "points along and whole segments; cut",
        &[CUT, SEGMENTS, SHAPE, NO_PLANES, UNMEASURED],
    ),
    ("points on planes, too; votes", &[VOTES, UNMEASURED]),
    (
        "planes and whole segments; votes",
        &[VOTES, SEGMENTS, UNMEASURED],
    ),
    (
        "planes, whole segments and triangulations; votes",
        &[VOTES, SEGMENTS, TRIANGULATIONS, UNMEASURED],
    ),
    ("points on planes, too; cut", &[CUT, UNMEASURED]),
    (
        "planes and whole segments; cut",
        &[CUT, SEGMENTS, UNMEASURED],
    ),
    ("measured triangles; votes", &[VOTES]),
    (
        "measured triangles; cut, no corrections",
        &[CUT, NO_CORRECTIONS],
    ),
    ("measured triangles; cut: the default", &[CUT]),
    (
        "measured triangles, segments conforming; cut",
        &[CUT, CONFORMING],
    ),
    (
        "measured triangles and whole segments; cut",
        &[CUT, SEGMENTS],
    ),
    (
        "measured triangles and edges of triangulations; cut",
        &[CUT, TRIANGULATIONS],
    ),
    (
        "measured triangles, whole segments and edges of triangulations; cut",
        &[CUT, SEGMENTS, TRIANGULATIONS],
    ),
];

/// What the command line asks for.
struct Arguments {
    sequences: Vec<PathBuf>,
    out: PathBuf,
    program: PathBuf,
    only: String,
    passed_on: Vec<String>,
}

fn arguments() -> Result<Arguments, String> {
    let mut parsed = Arguments {
        sequences: Vec::new(),
        out: PathBuf::from("out/ablation"),
        program: PathBuf::from("target/release/linecarve"),
        only: String::new(),
        passed_on: Vec::new(),
    };
    let mut given = std::env::args().skip(1);
    while let Some(argument) = given.next() {
        let mut value = || {
            given
                .next()
                .ok_or_else(|| format!("{argument} needs a value"))
        };
        match argument.as_str() {
            "--out" => parsed.out = value()?.into(),
            "--program" => parsed.program = value()?.into(),
            "--only" => parsed.only = value()?,
            "--" => parsed.passed_on.extend(given.by_ref()),
            option if option.starts_with('-') => return Err(format!("unknown option {option}")),
            folder => parsed.sequences.push(folder.into()),
        }
    }
    if parsed.sequences.is_empty() {
        return Err("name at least one folder with a sequence and its ground-truth.ply".to_owned());
    }
    Ok(parsed)
}

/// The surface that a sequence is scored against.
fn ground_truth(sequence: &Path) -> Result<PathBuf, String> {
    ["ground-truth-observed.ply", "ground-truth.ply"]
        .map(|name| sequence.join(name))
        .into_iter()
        .find(|path| path.is_file())
        .ok_or_else(|| format!("{}: no ground-truth.ply in it", sequence.display()))
}

/// Runs the program and returns what it prints.
fn run(program: &Path, arguments: &[&str]) -> Result<Vec<u8>, Box<dyn Error>> {
    let output = Command::new(program)
        .args(arguments)
        .output()
        .map_err(|error| {
            format!(
                "{}: {error} (build it first, or name it with --program)",
                program.display()
            )
        })?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        return Err(format!("{}: {message}", arguments.join(" ")).into());
    }
    Ok(output.stdout)
}

fn text(path: &Path) -> Result<&str, String> {
    path.to_str()
        .ok_or_else(|| format!("{}: the path is not UTF-8", path.display()))
}

/// One row: a switch on a sequence.
fn row(
    arguments: &Arguments,
    sequence: &Path,
    name: &str,
    configuration: &str,
) -> Result<Value, Box<dyn Error>> {
    let label = sequence
        .file_name()
        .map_or_else(|| "sequence".into(), |name| name.to_string_lossy());
    let folder = arguments.out.join(format!(
        "{label}-{}",
        name.replace([' ', ',', ';', ':'], "-")
    ));
    std::fs::create_dir_all(&folder)?;
    let config = folder.join("switch.toml");
    std::fs::write(&config, configuration)?;
    let passed_on = || arguments.passed_on.iter().map(String::as_str);

    let mut reconstruct = vec!["reconstruct", text(sequence)?, "--out", text(&folder)?];
    reconstruct.extend([
        "--config",
        text(&config)?,
        "--threads",
        "1",
        "--format",
        "ply",
    ]);
    reconstruct.extend(["--final-only", "--no-picture", "--no-page", "--quiet"]);
    reconstruct.extend(passed_on());
    run(&arguments.program, &reconstruct)?;
    let report: Value = serde_json::from_slice(&std::fs::read(folder.join("report.json"))?)?;

    let (mesh, truth) = (folder.join("mesh.ply"), ground_truth(sequence)?);
    let score = |observed: bool| -> Result<Value, Box<dyn Error>> {
        let mut evaluate = vec!["evaluate", text(&mesh)?, "--ground-truth", text(&truth)?];
        evaluate.extend(["--json", "--quiet"]);
        if observed {
            evaluate.extend(["--observed", text(sequence)?]);
            evaluate.extend(passed_on());
        }
        Ok(serde_json::from_slice(&run(
            &arguments.program,
            &evaluate,
        )?)?)
    };
    let (whole, observed) = (score(false)?, score(true)?);
    let stages = &report["timing"]["mean_milliseconds"];
    let milliseconds: f64 = stages
        .as_object()
        .into_iter()
        .flat_map(|stages| stages.values())
        .filter_map(Value::as_f64)
        .sum();
    let f = |score: &Value, at: usize| score["at"][at]["f"].clone();
    Ok(json!({
        "sequence": label,
        "switch": name,
        "accuracy": whole["accuracy"]["mean"],
        "completeness": whole["completeness"]["mean"],
        "f_whole": [f(&whole, 0), f(&whole, 1), f(&whole, 2)],
        "f_observed": [f(&observed, 0), f(&observed, 1), f(&observed, 2)],
        "vertices": whole["shape"]["vertices"],
        "milliseconds_per_keyframe": milliseconds,
    }))
}

fn print(out: &mut impl Write, row: &Value) -> std::io::Result<()> {
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let scores = |key: &str| {
        let scores: Vec<String> = (0..3)
            .map(|at| format!("{:.3}", number(&row[key][at])))
            .collect();
        scores.join(" / ")
    };
    writeln!(
        out,
        "| {} | {} | {:.1} | {:.1} | {} | {} | {} | {:.0} |",
        row["sequence"].as_str().unwrap_or_default(),
        row["switch"].as_str().unwrap_or_default(),
        1e3 * number(&row["accuracy"]),
        1e3 * number(&row["completeness"]),
        scores("f_whole"),
        scores("f_observed"),
        row["vertices"],
        number(&row["milliseconds_per_keyframe"]),
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    std::fs::create_dir_all(&arguments.out)?;
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "| sequence | switch | accuracy, 0.001 | completeness, 0.001 | F at 0.02 / 0.05 / 0.10, whole | observed | vertices | ms a keyframe |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|")?;
    let mut rows = Vec::new();
    for sequence in &arguments.sequences {
        for (name, parts) in SWITCHES {
            if name.contains(&arguments.only) {
                let row = row(&arguments, sequence, name, &parts.concat())?;
                print(&mut out, &row)?;
                out.flush()?;
                rows.push(row);
            }
        }
    }
    let file = arguments.out.join("ablation.json");
    std::fs::write(&file, serde_json::to_vec_pretty(&rows)?)?;
    writeln!(out, "\nas JSON: {}", file.display())?;
    Ok(())
}
