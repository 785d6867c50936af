//! `linecarve-lab benchmarks`: time, memory and F of the reconstruction beside those of rivals.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use linecarve::cli::KeyframeArgs;
use linecarve::commands::Outcome;
use linecarve::progress::{Progress, Verbosity};
use linecarve_mesh::read_geometry;
use linecarve_synth::{DepthNoise, SceneKind, SynthOptions, write_sequence};

use super::measure::Measurement;
use super::published::{publish, write_section};
use super::results::{ResultRow, table};
use super::rivals;
use super::scored_run::ground_truth;
use crate::cli::BenchmarksArgs;

/// Keyframe options of the recordings below `LINECARVE_DATA`.
const EVERY_15_CM: [&str; 6] = [
    "--min-translation",
    "0.15",
    "--min-rotation",
    "10",
    "--sharpness-window",
    "1",
];

/// A sequence to run.
struct Benchmark {
    name: String,
    folder: PathBuf,
    /// Options that choose keyframes.
    selection: Vec<String>,
}

pub(super) fn run(
    args: &BenchmarksArgs,
    threads: Option<usize>,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    let rendered = tempfile::tempdir().context("cannot make a temporary folder")?;
    let benchmarks = benchmarks(args, rendered.path())?;
    let mut rivals = match &args.rivals {
        Some(path) => rivals::read(path)?,
        None => Vec::new(),
    };
    ensure!(
        args.rival.is_empty() || benchmarks.len() == 1,
        "--rival belongs to one sequence; --rivals FILE has a sequence for each"
    );
    for text in &args.rival {
        rivals.push(rivals::parse(text, &benchmarks[0].name)?);
    }
    let mut rows = Vec::new();
    let mut progress = Progress::start("sequences", benchmarks.len(), verbosity);
    for benchmark in &benchmarks {
        progress.step(|| benchmark.name.clone());
        rows.push(benchmark.row(threads)?);
        let truth = read_geometry(&ground_truth(&benchmark.folder, None)?)?;
        for rival in rivals
            .iter()
            .filter(|rival| rival.sequence == benchmark.name)
        {
            rows.push(rival.row(&truth)?);
        }
    }
    progress.finish();
    let text = table(&rows)?;
    publish("results", &text, &rows, &args.output)?;
    if let Some(readme) = &args.readme {
        write_section(readme, "results", &text)?;
    }
    Ok(Outcome::Done)
}

/// The sequences given, or those that are published, exact truths first; `rendered` is a folder for those that are rendered.
fn benchmarks(args: &BenchmarksArgs, rendered: &Path) -> anyhow::Result<Vec<Benchmark>> {
    if !args.sequences.is_empty() {
        let named = args.sequences.iter().map(|folder| Benchmark {
            name: folder
                .file_name()
                .unwrap_or(folder.as_os_str())
                .to_string_lossy()
                .into_owned(),
            folder: folder.clone(),
            selection: flags(&args.selection),
        });
        return Ok(named.collect());
    }
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room");
    let mut all = vec![Benchmark {
        name: "sample".to_owned(),
        folder: sample,
        selection: Vec::new(),
    }];
    for (name, scene, frames, [width, height]) in [
        ("noisy room", SceneKind::Room, 60, [640, 480]),
        ("noisy walk", SceneKind::Walk, 14, [480, 360]),
    ] {
        let folder = rendered.join(name);
        let mut options = SynthOptions::default();
        options.scene = scene;
        options.frames = frames;
        options.width = width;
        options.height = height;
        options.noise = DepthNoise::Kinect { strength: 1.0 };
        write_sequence(&options, &folder, &|_, _| {})
            .with_context(|| format!("cannot render the {name}"))?;
        all.push(Benchmark {
            name: name.to_owned(),
            folder,
            selection: Vec::new(),
        });
    }
    if let Some(data) = std::env::var_os("LINECARVE_DATA") {
        for (name, folder) in [
            ("kitchen", "seven-scenes"),
            ("living room", "livingroom-synthetic"),
        ] {
            all.push(Benchmark {
                name: name.to_owned(),
                folder: Path::new(&data).join(folder),
                selection: EVERY_15_CM.map(str::to_owned).to_vec(),
            });
        }
    }
    Ok(all)
}

/// Keyframe options as a command line.
pub(super) fn flags(selection: &KeyframeArgs) -> Vec<String> {
    let list = selection.keyframes.as_ref();
    [
        ("--every", selection.every.map(|n| n.to_string())),
        ("--keyframes", list.map(|path| path.display().to_string())),
        (
            "--min-translation",
            selection.min_translation.map(|length| length.to_string()),
        ),
        (
            "--min-rotation",
            selection.min_rotation.map(|degrees| degrees.to_string()),
        ),
        (
            "--sharpness-window",
            selection.sharpness_window.map(|n| n.to_string()),
        ),
        (
            "--max-keyframes",
            selection.max_keyframes.map(|n| n.to_string()),
        ),
    ]
    .into_iter()
    .filter_map(|(name, value)| Some([name.to_owned(), value?]))
    .flatten()
    .collect()
}

impl Benchmark {
    /// Runs `measure` in a process of its own, so that the peak memory is that of this sequence.
    fn row(&self, threads: Option<usize>) -> anyhow::Result<ResultRow> {
        let program = std::env::current_exe().context("cannot find this program")?;
        let output = Command::new(program)
            .arg("measure")
            .arg(&self.folder)
            .args(&self.selection)
            .args(["--threads", &threads.unwrap_or(1).to_string()])
            .stderr(Stdio::inherit())
            .output()
            .context("cannot start this program")?;
        ensure!(output.status.success(), "{}: the run failed", self.name);
        let measured: Measurement = serde_json::from_slice(&output.stdout)
            .with_context(|| format!("{}: the output of the run", self.name))?;
        Ok(ResultRow {
            sequence: self.name.clone(),
            method: "Linecarve".to_owned(),
            keyframes: Some(measured.keyframes),
            f: measured.f,
            vertices: Some(measured.vertices),
            milliseconds_per_keyframe: Some(measured.milliseconds_per_keyframe),
            seconds: Some(measured.seconds),
            peak_memory_mb: measured.peak_memory_mb,
            source: None,
        })
    }
}
