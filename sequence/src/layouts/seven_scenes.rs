//! 7-Scenes and similar data sets: `frame-NNNNNN.color.png`, `frame-NNNNNN.depth.png`, `frame-NNNNNN.pose.txt` in one folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::super::calibration::{CalibratedCamera, Calibration};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, rigid};
use super::scan_info;

/// Reader of 7-Scenes.
pub(in super::super) struct SevenScenes;

/// Optional 3x3 intrinsic matrix of TSDF-Fusion and 3DMatch.
const INTRINSICS: &str = "camera-intrinsics.txt";

/// The files of one frame.
#[derive(Default)]
struct FrameFiles {
    color: Option<PathBuf>,
    depth: Option<PathBuf>,
    pose: Option<PathBuf>,
}

impl Layout for SevenScenes {
    fn name(&self) -> &'static str {
        "7-scenes"
    }

    fn expected_files(&self) -> &'static str {
        "frame-NNNNNN.color.jpg or .png with frame-NNNNNN.pose.txt"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.names().iter().any(|name| part_of(name).is_some())
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let mut by_number: BTreeMap<(u64, &str), FrameFiles> = BTreeMap::new();
        for name in folder.names() {
            let Some((frame, number, part)) = part_of(name) else {
                continue;
            };
            folder.claim(name);
            let files = by_number.entry((number, frame)).or_default();
            let slot = match part {
                FilePart::Color => &mut files.color,
                FilePart::Depth => &mut files.depth,
                FilePart::Pose => &mut files.pose,
            };
            // Names are sorted, so .jpg precedes .png on every file system.
            slot.get_or_insert_with(|| folder.path().join(name));
        }
        let mut out = FrameCollector::default();
        let total = by_number.len();
        let has_depth = by_number.values().any(|files| files.depth.is_some());
        for ((number, frame), files) in by_number {
            out.add(frame, number, files, has_depth, source)?;
        }
        if out.frames.is_empty() {
            let (path, reason) = (folder.path().to_owned(), out.reason(total));
            return Err(match source {
                PoseSource::Layout => SequenceError::UnusablePoses { path, reason },
                PoseSource::External => SequenceError::NoFrames {
                    folder: path,
                    reason,
                },
            });
        }
        let calibration = intrinsics(folder)?;
        let mut warnings = Vec::new();
        let poses = total - out.pose_missing.count() - out.color_missing.count();
        warnings.extend(
            out.pose_missing
                .into_warning(total, "frames have no pose and were skipped"),
        );
        warnings.extend(
            out.color_missing
                .into_warning(total, "frames have no colour image and were skipped"),
        );
        warnings.extend(
            out.not_finite
                .into_warning(poses, "poses are not finite and were skipped"),
        );
        warnings.extend(
            out.not_rigid
                .into_warning(poses, "poses are not rigid transforms and were skipped"),
        );
        warnings.extend(
            out.depth_missing
                .into_warning(out.frames.len(), "frames have no depth image"),
        );
        let mut recording = Recording::new(out.frames, calibration);
        recording.warnings = warnings;
        recording.note_numbers_and_matrices(source);
        Ok(recording)
    }
}

#[derive(Default)]
struct FrameCollector {
    frames: Vec<RecordedFrame>,
    pose_missing: WarningCounter,
    color_missing: WarningCounter,
    depth_missing: WarningCounter,
    not_finite: WarningCounter,
    not_rigid: WarningCounter,
    first_problem: Option<String>,
}

impl FrameCollector {
    fn add(
        &mut self,
        frame: &str,
        number: u64,
        files: FrameFiles,
        has_depth: bool,
        source: PoseSource,
    ) -> Result<(), SequenceError> {
        let Some(color) = files.color else {
            self.color_missing.add(frame);
            return Ok(());
        };
        let pose = match (source, files.pose) {
            (PoseSource::External, _) => None,
            (PoseSource::Layout, None) => {
                self.pose_missing.add(frame);
                return Ok(());
            }
            (PoseSource::Layout, Some(path)) => match read_pose(&path)? {
                Ok(pose) => Some(pose),
                Err(problem) => {
                    if problem == rigid::RigidTransformError::NotFinite {
                        self.not_finite.add(frame);
                    } else {
                        self.not_rigid.add(format!("{frame} {problem}"));
                    }
                    self.first_problem
                        .get_or_insert_with(|| format!("{} {problem}", path.display()));
                    return Ok(());
                }
            },
        };
        if has_depth && files.depth.is_none() {
            self.depth_missing.add(frame);
        }
        self.frames.push(RecordedFrame {
            name: frame.to_owned(),
            timestamp_ns: i64::try_from(number).unwrap_or(i64::MAX),
            pose,
            color,
            depth: files.depth,
            right: None,
            camera: None,
        });
        Ok(())
    }

    /// Why no frame is usable.
    fn reason(&self, total: usize) -> String {
        let mut text = format!(
            "of {total} frames {} have no colour image, {} no pose, {} a pose that is not finite, {} a pose that is not a \
             rigid transform",
            self.color_missing.count(),
            self.pose_missing.count(),
            self.not_finite.count(),
            self.not_rigid.count()
        );
        if let Some(problem) = &self.first_problem {
            text += &format!(" (first: {problem})");
        }
        text + "; poses must be 4x4 matrices, world from camera, with the last row 0 0 0 1"
    }
}

enum FilePart {
    Color,
    Depth,
    Pose,
}

/// Splits a file name into frame name, number and part.
fn part_of(name: &str) -> Option<(&str, u64, FilePart)> {
    let (frame, rest) = name.split_once('.')?;
    let digits = frame.strip_prefix("frame-")?;
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let number = digits.parse().ok()?;
    let part = match image_stem(rest) {
        Some("color") => FilePart::Color,
        Some("depth") => FilePart::Depth,
        None if rest == "pose.txt" => FilePart::Pose,
        _ => return None,
    };
    Some((frame, number, part))
}

/// Reads a 4x4 matrix. The inner error is an invalid pose, which is skipped.
pub(super) fn read_pose(
    path: &Path,
) -> Result<Result<Isometry3<f64>, rigid::RigidTransformError>, SequenceError> {
    let matrix = read_matrix::<4>(path)?;
    Ok(rigid::from_matrix(&matrix))
}

/// Reads `N` rows of `N` numbers.
fn read_matrix<const N: usize>(path: &Path) -> Result<[[f64; N]; N], SequenceError> {
    let file = TextFile::read(path)?;
    let mut matrix = [[0.0; N]; N];
    let mut count = 0;
    for row in file.rows() {
        let Some(slot) = matrix.get_mut(count) else {
            return Err(row.error(format!("expected a matrix of {N} rows, found more")));
        };
        *slot = row.numbers()?;
        count += 1;
    }
    if count < N {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "expected a matrix of {N} rows of {N} numbers, found {count} rows (truncated?): copy the file again, or \
                 remove it to skip the frame"
            ),
        });
    }
    Ok(matrix)
}

fn intrinsics(folder: &Folder) -> Result<Calibration, SequenceError> {
    for name in scan_info::NAMES {
        if folder.names().iter().all(|other| other != name) {
            continue;
        }
        let path = folder.path().join(name);
        let file = TextFile::read(&path)?;
        if scan_info::is_one(&file) {
            folder.claim(name);
            return scan_info::read(&file, &path);
        }
    }
    let color = match folder.entry(INTRINSICS) {
        Some(path) => {
            let k = read_matrix::<3>(&path)?;
            let content = |problem: String| SequenceError::Content {
                path: path.clone(),
                problem,
            };
            let zeros = [k[0][1], k[1][0], k[2][0], k[2][1], k[2][2] - 1.0];
            if zeros
                .iter()
                .any(|value| value.is_nan() || value.abs() > 1e-6)
            {
                return Err(content(
                    "is not an intrinsic matrix [fx 0 cx; 0 fy cy; 0 0 1]".to_owned(),
                ));
            }
            let camera = Camera::pinhole(k[0][0], k[1][1], k[0][2], k[1][2])
                .map_err(|error| content(error.to_string()))?;
            CalibratedCamera::known(camera, None, INTRINSICS)
        }
        None => {
            let camera = Camera::pinhole(585.0, 585.0, 320.0, 240.0).map_err(|error| {
                SequenceError::Content {
                    path: folder.path().to_owned(),
                    problem: error.to_string(),
                }
            })?;
            let warning = format!(
                "no {INTRINSICS}: the depth camera of 7-Scenes is assumed for both images (f 585, c 320 240), though its \
                 depth is not registered to colour; give both cameras in linecarve.toml"
            );
            CalibratedCamera::default_vga(camera, "default of 7-Scenes", warning)
        }
    };
    Ok(Calibration::of_color(Some(color)))
}
