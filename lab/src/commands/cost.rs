//! `linecarve-lab cost`: the time of a keyframe as the map grows, by stage.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use linecarve::commands::Outcome;
use serde::{Deserialize, Serialize};

use super::benchmarks::flags;
use super::published::publish;
use crate::cli::CostArgs;

/// The part of `report.json` that is read.
#[derive(Deserialize)]
struct Report {
    keyframes: Vec<Keyframe>,
    timing: Timing,
}

#[derive(Deserialize)]
struct Keyframe {
    milliseconds: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
struct Timing {
    peak_memory_mb: Option<f64>,
}

/// What a run costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Cost {
    keyframes: usize,
    stages: Vec<StageCost>,
    peak_memory_mb: Option<f64>,
    /// Processor time of the whole run, from opening the sequence to the files.
    cpu_milliseconds_per_keyframe: Option<f64>,
    rival: Option<RivalCost>,
}

/// Mean milliseconds a keyframe in each part of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct StageCost {
    stage: String,
    milliseconds: Vec<f64>,
    /// Last part over second part; `None` when the stage takes no time.
    growth: Option<f64>,
}

/// The time of another program on the same keyframes.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct RivalCost {
    name: String,
    milliseconds: f64,
}

pub(super) fn run(args: &CostArgs, threads: Option<usize>) -> anyhow::Result<Outcome> {
    ensure!(
        args.parts >= 2,
        "--parts {}: at least 2 are needed",
        args.parts
    );
    let program = match &args.program {
        Some(program) => program.clone(),
        None => beside_this_program()?,
    };
    let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
    let before = cpu_milliseconds_of_children();
    let status = Command::new(&program)
        .arg("reconstruct")
        .arg(&args.sequence)
        .args(flags(&args.selection))
        .args(["--no-picture", "--no-page", "--quiet", "--threads"])
        .arg(threads.unwrap_or(1).to_string())
        .args(&args.pass)
        .arg("--out")
        .arg(folder.path())
        .stderr(Stdio::inherit())
        .stdout(Stdio::null())
        .status()
        .with_context(|| format!("cannot start {}", program.display()))?;
    ensure!(status.success(), "{}: the run failed", program.display());
    let cpu = cpu_milliseconds_of_children().zip(before);
    let path = folder.path().join("report.json");
    let text = std::fs::read_to_string(&path).context("the run wrote no report.json")?;
    let report: Report = serde_json::from_str(&text).context("report.json")?;
    let mut cost = measured(&report, args.parts)?;
    cost.cpu_milliseconds_per_keyframe =
        cpu.map(|(after, before)| (after - before) / cost.keyframes as f64);
    cost.rival = args
        .rival
        .as_deref()
        .map(|rival| rival_cost(rival, folder.path()))
        .transpose()?;
    publish("cost", &table(&cost)?, &cost, &args.output)?;
    Ok(Outcome::Done)
}

/// `linecarve` in the folder of this program, where cargo puts both.
pub(super) fn beside_this_program() -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("cannot find this program")?;
    let program = own.with_file_name(format!("linecarve{}", std::env::consts::EXE_SUFFIX));
    ensure!(
        program.is_file(),
        "{}: not found; build it, or give --program",
        program.display()
    );
    Ok(program)
}

/// Processor time of finished child processes; `None` where the system does not tell.
pub(super) fn cpu_milliseconds_of_children() -> Option<f64> {
    // Fields 16 and 17 of proc(5), counted behind the name in parentheses, in ticks of a hundredth of a second.
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(13);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some(10.0 * (user + system))
}

/// Means by stage and part of the run.
fn measured(report: &Report, parts: usize) -> anyhow::Result<Cost> {
    let count = report.keyframes.len();
    ensure!(
        count >= parts,
        "{count} keyframes are too few for {parts} parts"
    );
    let part = |index: usize| &report.keyframes[index * count / parts..(index + 1) * count / parts];
    let mut names: Vec<&String> = report.keyframes[0].milliseconds.keys().collect();
    let cost = |stage: &str, of: &dyn Fn(&Keyframe) -> f64| {
        let milliseconds: Vec<f64> = (0..parts)
            .map(|index| part(index).iter().map(of).sum::<f64>() / part(index).len() as f64)
            .collect();
        let growth = milliseconds[parts - 1] / milliseconds[1];
        StageCost {
            stage: stage.to_owned(),
            growth: growth.is_finite().then_some(growth),
            milliseconds,
        }
    };
    let of_stage = |name: &String, keyframe: &Keyframe| {
        keyframe.milliseconds.get(name).copied().unwrap_or_default()
    };
    // In the order of the largest share of the last part.
    let mut stages: Vec<StageCost> = names
        .drain(..)
        .map(|name| cost(name, &|keyframe| of_stage(name, keyframe)))
        .filter(|stage| stage.milliseconds.iter().any(|time| *time > 0.0))
        .collect();
    stages.sort_by(|a, b| b.milliseconds[parts - 1].total_cmp(&a.milliseconds[parts - 1]));
    stages.push(cost("all", &|keyframe| {
        keyframe.milliseconds.values().sum()
    }));
    Ok(Cost {
        keyframes: count,
        stages,
        peak_memory_mb: report.timing.peak_memory_mb,
        cpu_milliseconds_per_keyframe: None,
        rival: None,
    })
}

/// Runs `NAME=COMMAND`, whose words are separated by spaces; `{out}` stands for a file that it may write. It prints a JSON
/// object with the mean time of a keyframe at `integrate_ms.mean`.
fn rival_cost(text: &str, folder: &Path) -> anyhow::Result<RivalCost> {
    #[derive(Deserialize)]
    struct Printed {
        integrate_ms: Times,
    }
    #[derive(Deserialize)]
    struct Times {
        mean: f64,
    }
    let (name, command) = text
        .split_once('=')
        .with_context(|| format!("--rival {text}: write it as NAME=COMMAND"))?;
    let out = folder.join("rival.ply");
    let mut words = command
        .split_whitespace()
        .map(|word| word.replace("{out}", &out.to_string_lossy()));
    let program = words
        .next()
        .with_context(|| format!("--rival {text}: write it as NAME=COMMAND"))?;
    let output = Command::new(&program)
        .args(words)
        .env("OMP_NUM_THREADS", "1")
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("--rival: cannot start {program}"))?;
    ensure!(output.status.success(), "--rival {name}: the run failed");
    let printed: Printed = serde_json::from_slice(&output.stdout)
        .with_context(|| format!("--rival {name}: no integrate_ms.mean in its output"))?;
    Ok(RivalCost {
        name: name.to_owned(),
        milliseconds: printed.integrate_ms.mean,
    })
}

fn table(cost: &Cost) -> anyhow::Result<String> {
    let mut out = String::new();
    let parts = cost
        .stages
        .first()
        .map_or(0, |stage| stage.milliseconds.len());
    let numbers: String = (1..=parts)
        .map(|part| format!(" {part} of {parts} |"))
        .collect();
    writeln!(out, "| stage, ms a keyframe |{numbers} last / second |")?;
    writeln!(out, "|---|{}", "---|".repeat(parts + 1))?;
    for stage in &cost.stages {
        let times: String = stage
            .milliseconds
            .iter()
            .map(|time| format!(" {time:.1} |"))
            .collect();
        let growth = stage
            .growth
            .map_or_else(|| "-".to_owned(), |ratio| format!("{ratio:.2}"));
        writeln!(out, "| {} |{times} {growth} |", stage.stage)?;
    }
    write!(out, "\n{} keyframes", cost.keyframes)?;
    if let Some(peak) = cost.peak_memory_mb {
        write!(out, "; peak memory {peak:.0} MB")?;
    }
    if let Some(cpu) = cost.cpu_milliseconds_per_keyframe {
        write!(
            out,
            "; processor time of the whole run {cpu:.0} ms a keyframe"
        )?;
        if let Some(rival) = &cost.rival {
            let (name, time) = (&rival.name, rival.milliseconds);
            write!(out, "; {name} {time:.1} ms, ratio {:.1}", cpu / time)?;
        }
    }
    writeln!(out, ".")?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_the_last_part_over_the_second() {
        let keyframe = |carve: f64| {
            format!("{{\"milliseconds\": {{\"carve\": {carve}, \"fit\": 1, \"features\": 0}}}}")
        };
        let keyframes: Vec<String> = [9.0, 9.0, 2.0, 4.0, 6.0, 9.0].map(keyframe).to_vec();
        let text = format!(
            "{{\"keyframes\": [{}], \"timing\": {{\"peak_memory_mb\": 12}}}}",
            keyframes.join(",")
        );
        let cost = measured(&serde_json::from_str(&text).unwrap(), 3).unwrap();
        let names: Vec<&str> = cost
            .stages
            .iter()
            .map(|stage| stage.stage.as_str())
            .collect();
        assert_eq!(names, ["carve", "fit", "all"]);
        assert_eq!(cost.stages[0].milliseconds, [9.0, 3.0, 7.5]);
        assert_eq!(cost.stages[0].growth, Some(2.5));
        assert_eq!(cost.stages[2].growth, Some(8.5 / 4.0));
        assert!(
            table(&cost)
                .unwrap()
                .contains("| carve | 9.0 | 3.0 | 7.5 | 2.50 |")
        );
        assert!(measured(&serde_json::from_str(&text).unwrap(), 7).is_err());
    }

    #[test]
    fn a_rival_prints_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let script = folder.path().join("rival.json");
        std::fs::write(&script, "{\"views\": 2, \"integrate_ms\": {\"mean\": 9.5}}").unwrap();
        let rival = format!("TSDF=cat {}", script.display());
        let cost = rival_cost(&rival, folder.path()).unwrap();
        assert_eq!((cost.name.as_str(), cost.milliseconds), ("TSDF", 9.5));
        assert!(rival_cost("TSDF", folder.path()).is_err());
    }
}
