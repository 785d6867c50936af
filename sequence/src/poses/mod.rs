//! Trajectory files in the usual formats, and their association with images.

mod attach;
mod columns;
mod log;
mod read;

pub(super) use attach::{attach, attach_file, sort_and_dedup};
pub(super) use log::{LogEntry, read_log};
pub(super) use read::{candidates, is_trajectory, read_pose_file, read_stamped_quaternions};

use nalgebra::Isometry3;

use super::Warning;
use super::pose_convention::QuaternionOrder;
use super::text::{Stamp, TimeUnit};

/// Formats of trajectory files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PoseFileFormat {
    /// `stamp tx ty tz qx qy qz qw`: TUM, and ORB-SLAM in seconds or nanoseconds.
    Tum,
    /// `stamp, px, py, pz, qw, qx, qy, qz, ...`: EuRoC ground truth, of the body.
    EurocCsv,
    /// The first three rows of a 4x4 matrix in one line; no stamps.
    Kitti,
    /// A 4x4 matrix in one line; no stamps.
    Matrices,
    /// `tx ty tz qx qy qz qw`; no stamps.
    Unstamped,
    /// `stamp`, rotation vector and translation of the world in the camera: ARKitScenes.
    RotationVectors,
    /// Entries of five lines, `i i i+1` and a 4x4 matrix: Open3D and Redwood.
    Open3dLog,
}

impl PoseFileFormat {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Tum => "TUM (stamp tx ty tz qx qy qz qw)",
            Self::EurocCsv => "EuRoC (stamp, px, py, pz, qw, qx, qy, qz, ...)",
            Self::Kitti => "KITTI (3x4 matrices)",
            Self::Matrices => "4x4 matrices",
            Self::Unstamped => "tx ty tz qx qy qz qw, no stamps",
            Self::RotationVectors => {
                "stamp, rotation vector, translation (camera from world, inverted)"
            }
            Self::Open3dLog => "Open3D .log (i i i+1, 4x4 matrix)",
        }
    }

    /// The unit of the stamps of a file: whole numbers of EuRoC's format are nanoseconds, also of a clock that was started a short time
    /// ago; else the notation says it, unless the times would not fit.
    pub(super) fn unit_of(self, rows: &[(Stamp, Isometry3<f64>)]) -> TimeUnit {
        let all = |test: &dyn Fn(&Stamp) -> bool| rows.iter().all(|(stamp, _)| test(stamp));
        if self == Self::EurocCsv && all(&|stamp| stamp.whole_number().is_some()) {
            return TimeUnit::Nanosecond;
        }
        let written = written_unit(rows);
        std::iter::once(written)
            .chain(TimeUnit::ALL)
            .find(|unit| all(&|stamp| stamp.in_nanoseconds(*unit).is_some()))
            .unwrap_or(written)
    }

    /// The quaternion order to test as an alternative; `None` for formats with matrices.
    pub(super) fn other_quaternion_order(self) -> Option<QuaternionOrder> {
        match self {
            Self::Tum | Self::Unstamped => Some(QuaternionOrder::WFirst),
            Self::EurocCsv => Some(QuaternionOrder::WLast),
            Self::Kitti | Self::Matrices | Self::RotationVectors | Self::Open3dLog => None,
        }
    }
}

/// The unit that the first stamp suggests by its notation.
fn written_unit(rows: &[(Stamp, Isometry3<f64>)]) -> TimeUnit {
    rows.first()
        .map_or(TimeUnit::Second, |(stamp, _)| stamp.unit_as_written())
}

/// A trajectory file.
#[derive(Debug)]
pub(super) struct PoseFile {
    pub(super) format: PoseFileFormat,
    pub(super) poses: Poses,
    pub(super) warnings: Vec<Warning>,
}

/// Poses, with what associates them with images.
#[derive(Debug)]
pub(super) enum Poses {
    /// By time, in file order.
    Stamped(Vec<(Stamp, Isometry3<f64>)>),
    /// By image number, in file order. `None` for invalid poses.
    Numbered(Vec<(u64, Option<Isometry3<f64>>)>),
    /// By image name, in file order.
    Named(Vec<(String, Isometry3<f64>)>),
    /// The k-th pose belongs to the k-th image. `None` for invalid poses.
    InOrder(Vec<Option<Isometry3<f64>>>),
}

impl Poses {
    /// Number of valid poses.
    fn valid(&self) -> usize {
        match self {
            Self::Stamped(rows) => rows.len(),
            Self::Named(rows) => rows.len(),
            Self::Numbered(rows) => rows.iter().filter(|row| row.1.is_some()).count(),
            Self::InOrder(rows) => rows.iter().flatten().count(),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Stamped(rows) => rows.len(),
            Self::Named(rows) => rows.len(),
            Self::Numbered(rows) => rows.len(),
            Self::InOrder(rows) => rows.len(),
        }
    }
}
