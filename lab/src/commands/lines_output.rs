//! The files of `linecarve-lab lines`.

use std::path::PathBuf;
use std::time::Instant;

use linecarve::Recording;
use linecarve::cli::LinesArgs;
use linecarve::configuration::Configuration;
use linecarve::report::{
    KeyframeReport, Report, ResultSummary, SequenceSummary, StageTimes, TimingSummary, write_report,
};
use linecarve::run::peak_mb;
use linecarve::sinks::Format;
use linecarve_lab::baselines::{Findings, Method};
use linecarve_lab::tables::methods::cluster_lines;
use linecarve_mesh::{
    Geometry, GlbPart, LineSet, TriangleMesh, write_glb, write_lines_obj, write_lines_ply,
    write_mesh_ply,
};
use linecarve_sequence::export::{PosedImage, TrajectoryFormat, posed_images, write_trajectory};

use super::print_json;

/// Colours of segments and clusters, as the product has them.
const SEGMENT: [u8; 3] = [222, 88, 40];
const CLUSTER: [u8; 3] = [32, 96, 200];

/// Writes the results of a method to the output folder.
pub(super) struct Output<'a> {
    args: &'a LinesArgs,
    recording: &'a Recording,
    method: Method,
    result: ResultSummary,
}

impl<'a> Output<'a> {
    pub(super) fn new(args: &'a LinesArgs, recording: &'a Recording, method: Method) -> Self {
        Self {
            args,
            recording,
            method,
            result: ResultSummary::default(),
        }
    }

    /// Writes points, poses, segments and clusters, where there are any.
    pub(super) fn write_findings(&mut self, findings: &Findings) -> anyhow::Result<()> {
        let origin = self.recording.origin;
        if !findings.points.is_empty() {
            let mut cloud = TriangleMesh {
                positions: findings.points.iter().map(|p| p.point_in_world).collect(),
                triangles: Vec::new(),
                colors: Some(findings.points.iter().map(|p| [p.gray; 3]).collect()),
            };
            cloud.translate(&origin);
            write_mesh_ply(&self.file("points.ply"), &cloud)?;
            self.result.points = cloud.positions.len();
        }
        if findings.segments.is_empty() {
            return Ok(());
        }
        self.write_corrected_poses()?;
        let ends = findings.segments.iter().map(|s| s.ends_in_world);
        let mut segments = LineSet::from_segments(ends.clone());
        segments.translate(&origin);
        self.result.segments = segments.lines.len();
        self.write_lines("segments", SEGMENT, &segments)?;
        if self.method == Method::Matched {
            // A matched line comes from several keyframes already.
            return Ok(());
        }
        let median_depth = self.recording.length_scale();
        let options = self.recording.options.cluster;
        let lines = cluster_lines(self.method, ends, options, median_depth)?;
        let mut clusters = LineSet::from_segments(lines);
        clusters.translate(&origin);
        self.result.clusters = clusters.lines.len();
        self.write_lines("clusters", CLUSTER, &clusters)
    }

    /// Writes `report.json`, and prints it where asked.
    pub(super) fn write_report(
        mut self,
        keyframes: Vec<KeyframeReport>,
        warnings: Vec<String>,
        started: Instant,
    ) -> anyhow::Result<()> {
        let path = self.file("report.json");
        let recording = self.recording;
        let sequence = &recording.sequence;
        let mut sum = StageTimes::default();
        for keyframe in &keyframes {
            sum.add(&keyframe.milliseconds);
        }
        let folder = sequence.folder();
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        let report = Report {
            generator: concat!("linecarve-lab ", env!("CARGO_PKG_VERSION")).to_owned(),
            command: command(self.method),
            from: "lines",
            sequence: SequenceSummary {
                name: name.to_string_lossy().into_owned(),
                layout: sequence.layout().to_owned(),
                frames: sequence.frames().len(),
                keyframes: recording.keyframes.len(),
                skipped: recording.keyframes.len() - keyframes.len(),
                depth: recording.source.depth_name(),
                median_depth: recording.source.median_depth().unwrap_or(0.0),
                origin: recording.origin.into(),
                up: recording.gltf_frame().up().into(),
                layers: None,
                confidence: Vec::new(),
                poses: recording.poses,
            },
            preset: recording.options.preset(),
            parameters: Configuration::of(&recording.options),
            result: self.result,
            warnings,
            timing: TimingSummary {
                mean_milliseconds: sum.divided_by(keyframes.len()),
                seconds: started.elapsed().as_secs_f64(),
                resumed_keyframes: 0,
                peak_memory_mb: peak_mb(),
            },
            keyframes,
        };
        write_report(&path, &report)?;
        if self.args.stages.json {
            print_json(&report)?;
        }
        Ok(())
    }

    /// The path of a file that is about to be written.
    fn file(&mut self, name: &str) -> PathBuf {
        self.result.files.push(name.to_owned());
        self.args.out.join(name)
    }

    fn write_lines(
        &mut self,
        name: &'static str,
        color: [u8; 3],
        lines: &LineSet,
    ) -> anyhow::Result<()> {
        let mut formats = self.args.stages.formats();
        formats.sort_unstable();
        formats.dedup();
        for format in formats {
            match format {
                Format::Glb => {
                    let geometry = Geometry::Lines(lines);
                    let part = GlbPart {
                        name,
                        geometry,
                        color,
                    };
                    let path = self.file(&format!("{name}.glb"));
                    write_glb(&path, &[part], &self.recording.origin)?;
                }
                Format::Obj => write_lines_obj(&self.file(&format!("{name}.obj")), lines)?,
                Format::Ply => write_lines_ply(&self.file(&format!("{name}.ply")), lines)?,
            }
        }
        Ok(())
    }

    /// Writes `poses.txt` where the images corrected the poses.
    fn write_corrected_poses(&mut self) -> anyhow::Result<()> {
        let recording = self.recording;
        if !recording.poses.is_some_and(|poses| poses.is_corrected) {
            return Ok(());
        }
        let images = posed_images(&recording.sequence);
        let keyframes = recording
            .keyframes
            .iter()
            .map(|&frame| images[frame].clone());
        let keyframes: Vec<PosedImage> = keyframes.collect();
        write_trajectory(&self.file("poses.txt"), TrajectoryFormat::Tum, &keyframes)?;
        Ok(())
    }
}

/// The command as the report names it.
fn command(method: Method) -> &'static str {
    match method {
        Method::EdgeAided => "lines",
        Method::Decoupled => "lines --method decoupled",
        Method::Ransac => "lines --method ransac",
        Method::Paper => "lines --method paper",
        Method::Matched => "lines --method matched",
        Method::Points => "lines --method points",
    }
}

/// Why a method found nothing.
pub(super) fn nothing(method: Method, keyframes: usize) -> String {
    match method {
        Method::Matched if keyframes < 3 => format!(
            "no line was found: {keyframes} keyframe(s) were used, but a line must be seen by at least three"
        ),
        Method::Matched => format!(
            "no line was found that three of {keyframes} keyframes agree on: are the poses right, and do the keyframes \
             overlap?"
        ),
        Method::Points => format!(
            "no pixel of {keyframes} keyframe(s) has both a strong gradient and a depth: are the images black, blurred or \
             overexposed?"
        ),
        Method::EdgeAided | Method::Decoupled | Method::Ransac | Method::Paper => format!(
            "no segment was found in {keyframes} keyframe(s): are the images black, blurred or overexposed, and do depth \
             and colour belong together?"
        ),
    }
}
