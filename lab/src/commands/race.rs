//! `linecarve-lab race`: meshes of dense clouds beside those of other programs.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context, ensure};
use linecarve::commands::Outcome;
use linecarve_mesh::evaluate::{EvaluationOptions, evaluate_observed};
use linecarve_mesh::{Shape, read_geometry};
use serde::{Deserialize, Serialize};

use super::cost::{beside_this_program, cpu_milliseconds_of_children};
use super::published::publish;
use super::scored_run::f_scores;
use super::sources::Sources;
use crate::cli::RaceArgs;

/// How often the memory of a run is read.
const PAUSE: Duration = Duration::from_millis(10);
/// Names the folder of the recordings; paths may begin with it.
const DATA: &str = "LINECARVE_DATA";

/// A file of races.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RaceFile {
    race: Vec<Race>,
}

/// A cloud and the meshes of it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Race {
    /// What the cloud is called.
    cloud: String,
    /// What `linecarve mesh` reads; relative to the file, or below `$LINECARVE_DATA`, as all paths.
    input: PathBuf,
    /// The true surface.
    truth: PathBuf,
    /// Distances of F, in units of the truth.
    thresholds: Vec<f64>,
    /// Further options of `linecarve mesh`.
    #[serde(default)]
    options: Vec<String>,
    #[serde(default)]
    rival: Vec<Rival>,
}

/// Another program: a mesh that is scored like ours, or quoted F.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rival {
    name: String,
    mesh: Option<PathBuf>,
    /// Quoted F at the thresholds, in place of a mesh; NaN where it is not known.
    f: Option<Vec<f64>>,
    vertices: Option<usize>,
    user_seconds: Option<f64>,
    peak_memory_mb: Option<f64>,
    /// Origin of quoted figures.
    source: Option<String>,
}

/// A row of the table.
#[derive(Debug, Clone, Serialize)]
struct Row {
    cloud: String,
    program: String,
    thresholds: Vec<f64>,
    f: Vec<f64>,
    vertices: Option<usize>,
    user_seconds: Option<f64>,
    peak_memory_mb: Option<f64>,
    source: Option<String>,
}

pub(super) fn run(args: &RaceArgs, threads: Option<usize>) -> anyhow::Result<Outcome> {
    let races = read(&args.races)?;
    let program = match &args.program {
        Some(program) => program.clone(),
        None => beside_this_program()?,
    };
    let mut rows = Vec::new();
    for race in &races {
        let truth = read_geometry(&race.truth)?;
        rows.push(race.own_row(&program, &truth, threads.unwrap_or(1))?);
        for rival in &race.rival {
            rows.push(race.rival_row(rival, &truth)?);
        }
    }
    publish("race", &table(&rows)?, &rows, &args.output)?;
    Ok(Outcome::Done)
}

fn read(path: &Path) -> anyhow::Result<Vec<Race>> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file: RaceFile = toml::from_str(&text).with_context(|| path.display().to_string())?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let data = std::env::var_os(DATA).unwrap_or_default();
    let whole = |path: &Path| match path.strip_prefix(format!("${DATA}")) {
        Ok(rest) => Path::new(&data).join(rest),
        Err(_) => folder.join(path),
    };
    let mut races = file.race;
    for race in &mut races {
        race.input = whole(&race.input);
        race.truth = whole(&race.truth);
        for rival in &mut race.rival {
            let of = format!("{}: {} on {}", path.display(), rival.name, race.cloud);
            ensure!(
                rival.mesh.is_some() != rival.f.is_some(),
                "{of}: give either mesh or f"
            );
            let is_quoted = rival.f.is_some() || rival.user_seconds.is_some();
            ensure!(
                !is_quoted || rival.source.is_some(),
                "{of}: quoted figures need their source"
            );
            let count = rival.f.as_ref().map_or(race.thresholds.len(), Vec::len);
            ensure!(
                count == race.thresholds.len(),
                "{of}: {count} values of F for {} thresholds",
                race.thresholds.len()
            );
            rival.mesh = rival.mesh.take().map(|mesh| whole(&mesh));
        }
    }
    Ok(races)
}

impl Race {
    fn score(&self, mesh: &Shape, truth: &Shape) -> anyhow::Result<Vec<f64>> {
        let mut options = EvaluationOptions::default();
        options.thresholds.clone_from(&self.thresholds);
        Ok(f_scores(&evaluate_observed(mesh, None, truth, &options)?))
    }

    /// Runs `linecarve mesh` in a process of its own.
    fn own_row(&self, program: &Path, truth: &Shape, threads: usize) -> anyhow::Result<Row> {
        let folder = tempfile::tempdir().context("cannot create a temporary folder")?;
        let out = folder.path().join("mesh.ply");
        let before = cpu_milliseconds_of_children();
        let child = Command::new(program)
            .args(["mesh", "--quiet", "--threads", &threads.to_string()])
            .args(&self.options)
            .arg("--out")
            .arg(&out)
            .arg(&self.input)
            .stdout(Stdio::null())
            .stderr(Stdio::inherit())
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let peak_memory_mb = watch(child, &self.cloud)?;
        let cpu = cpu_milliseconds_of_children().zip(before);
        let mesh = read_geometry(&out)?;
        Ok(Row {
            cloud: self.cloud.clone(),
            program: "Linecarve".to_owned(),
            thresholds: self.thresholds.clone(),
            f: self.score(&mesh, truth)?,
            vertices: Some(mesh.positions.len()),
            user_seconds: cpu.map(|(after, before)| (after - before) / 1000.0),
            peak_memory_mb,
            source: None,
        })
    }

    fn rival_row(&self, rival: &Rival, truth: &Shape) -> anyhow::Result<Row> {
        let mut row = Row {
            cloud: self.cloud.clone(),
            program: rival.name.clone(),
            thresholds: self.thresholds.clone(),
            f: rival.f.clone().unwrap_or_default(),
            vertices: rival.vertices,
            user_seconds: rival.user_seconds,
            peak_memory_mb: rival.peak_memory_mb,
            source: rival.source.clone(),
        };
        if let Some(path) = &rival.mesh {
            let mesh = read_geometry(path)?;
            let scores = self.score(&mesh, truth);
            row.f = scores.with_context(|| path.display().to_string())?;
            row.vertices = Some(mesh.positions.len());
        }
        Ok(row)
    }
}

/// Waits for a run; returns its peak memory, where the system says it.
fn watch(mut child: Child, cloud: &str) -> anyhow::Result<Option<f64>> {
    let status_file = format!("/proc/{}/status", child.id());
    let mut peak = None;
    let status = loop {
        let text = std::fs::read_to_string(&status_file).unwrap_or_default();
        let line = text.lines().find(|line| line.starts_with("VmHWM:"));
        let kilobytes = line.and_then(|line| line.split_ascii_whitespace().nth(1)?.parse().ok());
        peak = kilobytes.map(|kilobytes: f64| kilobytes / 1024.0).or(peak);
        if let Some(status) = child.try_wait()? {
            break status;
        }
        std::thread::sleep(PAUSE);
    };
    ensure!(status.success(), "{cloud}: the run failed");
    Ok(peak)
}

/// The table, with the sources of quoted figures below.
fn table(rows: &[Row]) -> Result<String, std::fmt::Error> {
    let mut text = String::from(
        "| cloud | program | F | at | vertices | user seconds | peak memory, MB |\n|---|---|---|---|---|---|---|\n",
    );
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    let number =
        |value: Option<f64>, digits: usize| or_dash(value.map(|v| format!("{v:.digits$}")));
    let mut sources = Sources::default();
    for row in rows {
        let program = sources.marked(&row.program, row.source.as_deref());
        let thresholds: Vec<String> = row.thresholds.iter().map(f64::to_string).collect();
        writeln!(
            text,
            "| {} | {program} | {} | {} | {} | {} | {} |",
            row.cloud,
            super::scores(&row.f),
            thresholds.join(" / "),
            or_dash(row.vertices.map(|n| n.to_string())),
            number(row.user_seconds, 1),
            number(row.peak_memory_mb, 0),
        )?;
    }
    Ok(text + &sources.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_races_names_clouds_and_rivals() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("race.toml");
        let race = "[[race]]\ncloud = \"city\"\ninput = \"city\"\ntruth = \"city/truth.ply\"\nthresholds = [0.05, 0.1]\n\n\
                    [[race.rival]]\nname = \"other\"\nf = [0.5, nan]\nuser_seconds = 90.0\n";
        std::fs::write(&path, race).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("source"));
        std::fs::write(&path, format!("{race}source = \"a paper\"\n")).unwrap();
        let races = read(&path).unwrap();
        assert_eq!(races[0].input, folder.path().join("city"));
        let truth = Shape::default();
        let row = races[0].rival_row(&races[0].rival[0], &truth).unwrap();
        let text = table(&[row]).unwrap();
        assert!(
            text.contains("| city | other [1] | 0.500 / - | 0.05 / 0.1 | - | 90.0 | - |"),
            "{text}"
        );
        let wrong = race.replace("[0.5, nan]", "[0.5]") + "source = \"a paper\"\n";
        std::fs::write(&path, wrong).unwrap();
        assert!(
            read(&path)
                .unwrap_err()
                .to_string()
                .contains("1 values of F for 2")
        );
    }

    #[test]
    fn the_races_in_the_repository_are_valid() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("race.toml");
        assert!(!read(&path).unwrap().is_empty());
    }
}
