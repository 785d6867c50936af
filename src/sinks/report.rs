//! `report.json` and what a run tells on standard error while it goes.

use std::time::Instant;

use anyhow::Context;
use serde::Serialize;

use super::keyframe_reports::KeyframeReports;
use crate::progress::Verbosity;
use crate::report::{
    KeyframeReport, Report, ResultSummary, SequenceSummary, StageTimes, TimingSummary, write_report,
};
use crate::sinks::output_folder::OutputFolder;
use crate::standard_error::say;
use linecarve_engine::configuration::Configuration;
use linecarve_engine::front_end::{FrontEndError, unmeasurable_warning};
use linecarve_engine::map::{Map, SurfaceChange};
use linecarve_engine::run::{Cancelled, peak_mb};
use linecarve_engine::{KeyframeUpdate, Recording, Sink, SinkError, Source};

/// Collects the report of a run and shows its progress.
pub(crate) struct RunLog {
    report: Report<Configuration>,
    verbosity: Verbosity,
    keyframes: KeyframeReports,
    resumed_keyframes: usize,
}

impl Sink for RunLog {
    fn update(
        &mut self,
        recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        self.keyframes.update(recording, map, update)
    }

    fn skipped(&mut self, number: usize, fault: &FrontEndError) {
        self.keyframes.skipped(number, fault);
    }

    fn finished(
        &mut self,
        recording: &Recording,
        map: &Map,
        change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        self.keyframes.finished(recording, map, change)
    }
}

impl RunLog {
    /// Begins a run of a command over a recording. Warnings of its preparation are printed.
    pub(crate) fn begin(
        command: &'static str,
        recording: &Recording,
        verbosity: Verbosity,
    ) -> Self {
        if verbosity > Verbosity::Quiet {
            for warning in &recording.warnings {
                say!("warning: {warning}");
            }
        }
        if verbosity >= Verbosity::Verbose {
            for convention in recording.sequence.conventions() {
                say!("assumed: {convention}");
            }
        }
        let folder = recording.sequence.folder();
        let name = folder
            .file_name()
            .unwrap_or(folder.as_os_str())
            .to_string_lossy();
        let count = recording.keyframes.len();
        let (from, unit) = match &recording.source {
            Source::Sensor { .. } | Source::SemiDense(_) => ("lines", "keyframes"),
            Source::MapPoints { .. } => ("map-points", "keyframes"),
            Source::Model(_) => ("map-points", "views"),
        };
        Self {
            report: Report {
                generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
                command,
                from,
                sequence: SequenceSummary {
                    name: name.into_owned(),
                    layout: recording.sequence.layout().to_owned(),
                    frames: recording.sequence.frames().len(),
                    keyframes: count,
                    skipped: 0,
                    depth: recording.source.depth_name(),
                    median_depth: recording.source.median_depth().unwrap_or(0.0),
                    origin: recording.origin.into(),
                    up: recording.gltf_frame().up().into(),
                    poses: recording.poses,
                    layers: recording.layers,
                    confidence: recording.confidence.clone(),
                },
                preset: recording.options.preset(),
                parameters: Configuration::of(&recording.options),
                keyframes: Vec::new(),
                result: ResultSummary::default(),
                warnings: recording.warnings.clone(),
                timing: TimingSummary::default(),
            },
            verbosity,
            keyframes: KeyframeReports::new(unit, count, verbosity),
            resumed_keyframes: 0,
        }
    }

    /// Notes what ended the run before its last keyframe, and says so.
    pub(crate) fn interrupted(&mut self, cause: &Cancelled, has_checkpoint: bool) -> String {
        let (done, chosen) = (self.keyframes.reports.len(), self.report.sequence.keyframes);
        let message = format!(
            "ended early, after {done} of {chosen} keyframes: {cause}; they are saved, {}",
            cause.remedy(has_checkpoint)
        );
        self.report.warnings.push(message.clone());
        message
    }

    /// Notes how many keyframes were taken from an interrupted run, and prints it.
    pub(crate) fn set_resumed(&mut self, keyframes: usize) {
        self.resumed_keyframes = keyframes;
        if keyframes > 0 && self.verbosity > Verbosity::Quiet {
            say!("resumed: {keyframes} keyframe(s) of the interrupted run were not computed again");
        }
    }

    /// Sets the median depth that the run found itself.
    pub(crate) fn set_median_depth(&mut self, median_depth: Option<f64>) {
        self.report.sequence.median_depth = median_depth.unwrap_or(0.0);
    }

    /// What the keyframes so far did.
    pub(crate) fn keyframes(&self) -> &[KeyframeReport] {
        &self.keyframes.reports
    }

    /// The warnings so far.
    pub(crate) fn warnings(&self) -> &[String] {
        &self.report.warnings
    }

    /// The counts at the end.
    pub(crate) fn result(&mut self) -> &mut ResultSummary {
        &mut self.report.result
    }

    /// Adds a warning and says it.
    pub(crate) fn warn(&mut self, warning: String) {
        if self.verbosity > Verbosity::Quiet {
            say!("warning: {warning}");
        }
        self.report.warnings.push(warning);
    }

    /// Ends the run: warns of what was left out, writes `report.json`, prints it when asked, says a summary.
    ///
    /// # Errors
    /// When the report cannot be written.
    pub(crate) fn write(
        mut self,
        output: &mut OutputFolder,
        started: Instant,
        print_json: bool,
    ) -> anyhow::Result<()> {
        let chosen = self.report.sequence.keyframes;
        if let Some(first) = self.keyframes.skipped.first().cloned() {
            let count = self.keyframes.skipped.len();
            self.report.sequence.skipped = count;
            self.warn(format!(
                "{count} of {chosen} keyframes were left out; first left out: {first}"
            ));
        }
        if let Some(warning) = unmeasurable_warning(self.keyframes.unmeasurable_depths) {
            self.warn(warning);
        }
        self.report.keyframes = std::mem::take(&mut self.keyframes.reports);
        let path = output.file("report.json")?;
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
            resumed_keyframes: self.resumed_keyframes,
            peak_memory_mb: peak_mb(),
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
            line += &format!("; {} points, {} rays", result.points, result.rays);
        }
        if result.points > 0 || result.vertices > 0 {
            line += &format!(
                "; {} vertices, {} triangles",
                result.vertices, result.triangles
            );
        }
        say!(
            "{line}; {:.1} ms a keyframe, {:.1} s in all; {}",
            timing.mean_milliseconds.total(),
            timing.seconds,
            output.root().display()
        );
    }
}

/// One JSON object on standard output.
pub(crate) fn print_object(value: &impl Serialize) -> anyhow::Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    print_text(&text)
}

/// Text on standard output. A reader that has gone away, as `head` does, is no fault.
pub(crate) fn print_text(text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot write to standard output"),
    }
}
