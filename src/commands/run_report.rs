//! What a run tells about itself while it goes and at its end.

use std::time::Instant;

use anyhow::Context;
use nalgebra::Vector3;

use crate::commands::interrupt::Interrupted;
use crate::commands::output::OutputFolder;
use crate::commands::sequence::Prepared;
use crate::memory;
use crate::pipeline::{FrontEndError, Keyframe, Options};
use crate::progress::{Progress, Verbosity};
use crate::report::{
    KeyframeReport, PoseSummary, Report, ResultSummary, SequenceSummary, StageTimes, TimingSummary,
    write_report,
};
use linecarve_sequence::Sequence;

/// What a run is about to do.
pub(super) struct RunHeader<'a> {
    pub(super) command: &'static str,
    /// What the surface is made from.
    pub(super) from: &'static str,
    pub(super) sequence: &'a Sequence,
    /// Number of keyframes chosen.
    pub(super) keyframes: usize,
    /// Where depth comes from.
    pub(super) depth: &'static str,
    /// Median depth of the scene in units of the poses, 0 as long as it is not known.
    pub(super) median_depth: f64,
    pub(super) origin: Vector3<f64>,
    /// What the images say about the poses, when that was asked.
    pub(super) poses: Option<PoseSummary>,
    pub(super) options: &'a Options,
    pub(super) warnings: &'a [String],
}

/// Collects the report of a run, and decides what becomes of keyframes that cannot be used.
pub(super) struct RunLog {
    report: Report<Options>,
    verbosity: Verbosity,
    skipped: Vec<String>,
}

impl RunLog {
    /// Begins a run from lines; the warnings of its preparation are said.
    pub(super) fn new(command: &'static str, prepared: &Prepared, verbosity: Verbosity) -> Self {
        let header = RunHeader {
            command,
            from: "lines",
            sequence: &prepared.sequence,
            keyframes: prepared.keyframes.len(),
            depth: prepared.depth.name(),
            median_depth: prepared.median_depth,
            origin: prepared.origin,
            poses: prepared.poses,
            options: &prepared.options,
            warnings: &prepared.warnings,
        };
        Self::begin(&header, verbosity)
    }

    /// Begins a run; the warnings of its preparation are said.
    pub(super) fn begin(header: &RunHeader<'_>, verbosity: Verbosity) -> Self {
        if verbosity > Verbosity::Quiet {
            for warning in header.warnings {
                eprintln!("warning: {warning}");
            }
        }
        if verbosity >= Verbosity::Verbose {
            for convention in header.sequence.conventions() {
                eprintln!("assumed: {convention}");
            }
        }
        let folder = header.sequence.folder();
        let name = folder
            .file_name()
            .unwrap_or(folder.as_os_str())
            .to_string_lossy();
        Self {
            report: Report {
                generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
                command: header.command,
                from: header.from,
                sequence: SequenceSummary {
                    name: name.into_owned(),
                    layout: header.sequence.layout().to_owned(),
                    frames: header.sequence.frames().len(),
                    keyframes: header.keyframes,
                    skipped: 0,
                    depth: header.depth,
                    median_depth: header.median_depth,
                    origin: header.origin.into(),
                    poses: header.poses,
                },
                parameters: header.options.clone(),
                keyframes: Vec::with_capacity(header.keyframes),
                result: ResultSummary::default(),
                warnings: header.warnings.to_vec(),
                timing: TimingSummary::default(),
            },
            verbosity,
            skipped: Vec::new(),
        }
    }

    /// The keyframe, or `None` when its own images are at fault, which is counted and told.
    ///
    /// # Errors
    /// When the fault is not this keyframe's alone.
    pub(super) fn accept(
        &mut self,
        keyframe: Result<Keyframe, FrontEndError>,
        progress: &Progress,
    ) -> anyhow::Result<Option<Keyframe>> {
        self.accept_unless(keyframe, FrontEndError::is_limited_to_frame, progress)
    }

    /// A keyframe of any kind, or `None` when its fault is limited to it, which is counted and told.
    ///
    /// # Errors
    /// When the fault is not this keyframe's alone.
    pub(super) fn accept_unless<T, E>(
        &mut self,
        keyframe: Result<T, E>,
        is_limited_to_frame: impl FnOnce(&E) -> bool,
        progress: &Progress,
    ) -> anyhow::Result<Option<T>>
    where
        E: std::error::Error + Send + Sync + 'static,
    {
        match keyframe {
            Ok(keyframe) => Ok(Some(keyframe)),
            Err(error) if is_limited_to_frame(&error) => {
                let message = format!("left out: {error}");
                progress.say(Verbosity::Verbose, &message);
                self.skipped.push(message);
                Ok(None)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Notes what ended the run before its last keyframe, and says so.
    pub(super) fn interrupted(&mut self, cause: &Interrupted, remedy: &str) -> String {
        let (done, chosen) = (self.report.keyframes.len(), self.report.sequence.keyframes);
        let message = format!(
            "ended early, after {done} of {chosen} keyframes: {cause}; they are saved, {remedy}"
        );
        self.report.warnings.push(message.clone());
        message
    }

    /// Sets the median depth that the run found itself.
    pub(super) fn set_median_depth(&mut self, median_depth: Option<f64>) {
        self.report.sequence.median_depth = median_depth.unwrap_or(0.0);
    }

    /// Adds what one keyframe did.
    pub(super) fn push(&mut self, keyframe: KeyframeReport) {
        self.report.keyframes.push(keyframe);
    }

    /// What the keyframes so far did.
    pub(super) fn keyframes(&self) -> &[KeyframeReport] {
        &self.report.keyframes
    }

    /// The warnings so far.
    pub(super) fn warnings(&self) -> &[String] {
        &self.report.warnings
    }

    /// The counts at the end.
    pub(super) fn result(&mut self) -> &mut ResultSummary {
        &mut self.report.result
    }

    /// Adds a warning and says it.
    pub(super) fn warn(&mut self, warning: String) {
        if self.verbosity > Verbosity::Quiet {
            eprintln!("warning: {warning}");
        }
        self.report.warnings.push(warning);
    }

    /// Where on the way everything was lost, for a run that ends with nothing.
    pub(super) fn reason_for_nothing(&self) -> String {
        let sum = |count: fn(&KeyframeReport) -> usize| -> usize {
            self.report.keyframes.iter().map(count).sum()
        };
        let keyframes = self.report.keyframes.len();
        if keyframes == 0 {
            return format!(
                "none of the {} keyframes could be read",
                self.report.sequence.keyframes
            );
        }
        let pixels = sum(|keyframe| keyframe.edge_pixels);
        if pixels == 0 {
            return format!(
                "the images of {keyframes} keyframe(s) have no edges: black, blurred or overexposed?"
            );
        }
        let with_depth: f64 = self
            .report
            .keyframes
            .iter()
            .map(|keyframe| keyframe.edge_depth_share * keyframe.edge_pixels as f64)
            .sum();
        if with_depth < 1.0 {
            let remedy = if self.report.sequence.depth == "sensor" {
                "do depth and colour belong together?"
            } else {
                "too few keyframes, no parallax between them, or wrong poses?"
            };
            return format!(
                "none of {pixels} edge pixels in {keyframes} keyframe(s) has a depth: {remedy}"
            );
        }
        let segments = sum(|keyframe| keyframe.segments);
        if segments == 0 {
            return format!(
                "no straight segment on {pixels} edge pixels in {keyframes} keyframe(s): is the depth scale right?"
            );
        }
        format!(
            "{segments} segments of {keyframes} keyframe(s) enclose no occupied space that another ray has left; more \
             keyframes from other places would help"
        )
    }

    /// To be asked when all keyframes are through, before anything is written.
    ///
    /// # Errors
    /// When not one keyframe could be used, naming the first fault.
    pub(super) fn demand_a_keyframe(&self) -> anyhow::Result<()> {
        let chosen = self.report.sequence.keyframes;
        match self.skipped.first() {
            Some(first) if self.skipped.len() == chosen => {
                anyhow::bail!("{chosen} of {chosen} keyframes cannot be used; first {first}")
            }
            _ => Ok(()),
        }
    }

    /// Ends the run: warns of what was left out, writes `report.json`, prints it when asked, says a summary.
    ///
    /// # Errors
    /// When the report cannot be written.
    pub(super) fn write(
        mut self,
        output: &mut OutputFolder,
        started: Instant,
        print_json: bool,
    ) -> anyhow::Result<()> {
        let chosen = self.report.sequence.keyframes;
        if let Some(first) = self.skipped.first().cloned() {
            let count = self.skipped.len();
            self.report.sequence.skipped = count;
            self.warn(format!(
                "{count} of {chosen} keyframes were left out; first {first}"
            ));
        }
        let path = output.file("report.json");
        self.report.result.files = output.written().to_vec();
        self.report.timing = self.timing(started);
        write_report(&path, &self.report)?;
        if print_json {
            print_object(&self.report)?;
        }
        self.say_summary(output);
        Ok(())
    }

    fn timing(&self, started: Instant) -> TimingSummary {
        let mut sum = StageTimes::default();
        for keyframe in &self.report.keyframes {
            sum.add(&keyframe.milliseconds);
        }
        TimingSummary {
            mean_milliseconds: sum.divided_by(self.report.keyframes.len()),
            seconds: started.elapsed().as_secs_f64(),
            peak_memory_mb: memory::peak_mb(),
        }
    }

    fn say_summary(&self, output: &OutputFolder) {
        if self.verbosity == Verbosity::Quiet {
            return;
        }
        let result = &self.report.result;
        let timing = &self.report.timing;
        let mut line = format!("{} keyframes", self.report.keyframes.len());
        if self.report.from == "lines" {
            line += &format!(
                ", {} segments in {} clusters",
                result.segments, result.clusters
            );
        }
        if result.points > 0 {
            line += &format!(
                "; {} points, {} rays, {} vertices, {} triangles",
                result.points, result.rays, result.vertices, result.triangles
            );
        }
        eprintln!(
            "{line}; {:.1} ms a keyframe, {:.1} s in all; {}",
            timing.mean_milliseconds.total(),
            timing.seconds,
            output.root().display()
        );
    }
}

/// The entry of a keyframe in the report, as far as the front end knows it.
pub(super) fn keyframe_report(keyframe: &Keyframe, sequence: &Sequence) -> KeyframeReport {
    KeyframeReport {
        frame: sequence.frames()[keyframe.frame].name.clone(),
        index: keyframe.frame,
        edge_chains: keyframe.edge_chains,
        edge_pixels: keyframe.edge_pixels,
        edge_depth_share: if keyframe.edge_pixels == 0 {
            0.0
        } else {
            keyframe.edge_pixels_with_depth as f64 / keyframe.edge_pixels as f64
        },
        segments: keyframe.segments.len(),
        milliseconds: keyframe.times,
        ..KeyframeReport::default()
    }
}

/// One JSON object on standard output.
pub(super) fn print_object(value: &impl serde::Serialize) -> anyhow::Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    print_text(&text)
}

/// Text on standard output. A reader that has gone away, as `head` does, is no fault.
pub(super) fn print_text(text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot write to standard output"),
    }
}
