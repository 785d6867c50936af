//! Columns of trajectory files: which fields are time, position and rotation.

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::super::text::{TextFile, TextLine, parse_number, parse_stamp};
use super::super::{SequenceError, rigid};
use super::PoseFileFormat;

/// What associates a line with an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    /// Its place in the file.
    Order,
    /// A time stamp in this field.
    Stamp(usize),
    /// An image name in the first field.
    Name,
}

/// Which fields have the pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PoseFields {
    /// Position x y z, and quaternion x y z w.
    Quaternion {
        position: [usize; 3],
        rotation: [usize; 4],
    },
    /// Three or four rows of a matrix, from this field on.
    Matrix { first: usize, count: usize },
    /// Rotation vector and translation, camera from world, from this field on.
    RotationVector { first: usize },
}

/// Columns of a trajectory file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Columns {
    pub(super) format: PoseFileFormat,
    /// Number of fields in each line; `None` if it may differ.
    pub(super) count: Option<usize>,
    pub(super) key: Key,
    /// Whether the first field is a running index.
    pub(super) has_index: bool,
    pose: PoseFields,
}

/// Fields of a line. Between commas a field may be empty, so that further fields keep their number, and quoted.
pub(super) fn fields<'a>(row: &TextLine<'a>) -> Vec<&'a str> {
    let text = row.text();
    let by_comma: Vec<&str> = text
        .split(',')
        .map(|field| field.trim().trim_matches('"'))
        .collect();
    let is_table = by_comma.len() > 1
        && by_comma
            .iter()
            .all(|field| !field.contains(char::is_whitespace));
    if !is_table {
        return row.fields().collect();
    }
    match by_comma.split_last() {
        // A comma at the end of the line.
        Some((&"", rest)) => rest.to_vec(),
        _ => by_comma,
    }
}

/// Whether a line is the head of a table: its first fields are no numbers. The second is one after the name of an image.
pub(super) fn is_head(row: &TextLine) -> bool {
    let fields = fields(row);
    let mut first = fields.iter().take(2);
    first.all(|field| parse_number(field).is_none())
}

/// `position` from a field on, then the quaternion.
fn quaternion_from(first: usize, w_first: bool) -> PoseFields {
    let q = first + 3;
    PoseFields::Quaternion {
        position: [first, first + 1, first + 2],
        rotation: if w_first {
            [q + 1, q + 2, q + 3, q]
        } else {
            [q, q + 1, q + 2, q + 3]
        },
    }
}

impl Columns {
    /// `stamp tx ty tz qx qy qz qw`.
    pub(super) fn tum() -> Self {
        Self {
            format: PoseFileFormat::Tum,
            count: Some(8),
            key: Key::Stamp(0),
            has_index: false,
            pose: quaternion_from(1, false),
        }
    }

    /// Detects the columns from the head line, if any, and the first lines; `None` if no format fits. Of several formats with one number of
    /// fields, the first whose rotations are some is taken.
    pub(super) fn detect(file: &TextFile, rows: &[TextLine]) -> Option<Self> {
        if let Some(named) = by_head(file, rows) {
            return Some(named);
        }
        let candidates = candidates(file, rows);
        let matrix = candidates
            .iter()
            .find(|columns| columns.is_transposed(rows));
        if let Some(matrix) = matrix {
            return Some(*matrix);
        }
        candidates
            .iter()
            .find(|columns| columns.fit(rows))
            .or(candidates.first())
            .copied()
    }

    /// Whether the numbers are 4x4 matrices column by column, some of which would pass for other formats.
    fn is_transposed(&self, rows: &[TextLine]) -> bool {
        let PoseFields::Matrix { first, count: 16 } = self.pose else {
            return false;
        };
        rows.iter().all(|row| {
            let fields = fields(row);
            let column = [3, 7, 11, 15].map(|at| fields.get(first + at).map(|f| parse_number(f)));
            column
                == [
                    Some(Some(0.0)),
                    Some(Some(0.0)),
                    Some(Some(0.0)),
                    Some(Some(1.0)),
                ]
        })
    }

    /// Whether the rotations of some lines are rotations.
    fn fit(&self, rows: &[TextLine]) -> bool {
        let is_valid =
            |columns: &Self, row: &TextLine| columns.pose(row).is_ok_and(|pose| pose.is_ok());
        if let PoseFields::RotationVector { .. } = self.pose {
            // Any numbers may be a rotation vector: those that are never a quaternion.
            let unstamped = Self {
                pose: quaternion_from(0, false),
                ..*self
            };
            return rows.iter().all(|row| !is_valid(&unstamped, row));
        }
        rows.iter().all(|row| is_valid(self, row))
    }

    /// The pose of a line. The inner error is an invalid pose, which is skipped.
    pub(super) fn pose(
        &self,
        row: &TextLine,
    ) -> Result<Result<Isometry3<f64>, rigid::RigidTransformError>, SequenceError> {
        let fields = fields(row);
        let number = |at: usize| {
            let field = fields.get(at).copied().unwrap_or_default();
            parse_number(field).ok_or_else(|| {
                row.error(format!(
                    "'{}' is not a number",
                    super::super::text::shorten(field)
                ))
            })
        };
        Ok(match self.pose {
            PoseFields::Quaternion { position, rotation } => {
                let [x, y, z] = position.map(number);
                let [qx, qy, qz, qw] = rotation.map(number);
                rigid::from_translation_quaternion([x?, y?, z?], [qx?, qy?, qz?, qw?])
            }
            PoseFields::Matrix { first, count } => {
                let mut rows = [[0.0; 4], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
                for (at, slot) in rows.iter_mut().flatten().take(count).enumerate() {
                    *slot = number(first + at)?;
                }
                rigid::from_matrix(&rows)
            }
            PoseFields::RotationVector { first } => {
                let [a, b, c] = [0, 1, 2].map(|at| number(first + at));
                let [x, y, z] = [3, 4, 5].map(|at| number(first + at));
                let rotation = Vector3::new(a?, b?, c?);
                let translation = Vector3::new(x?, y?, z?);
                if rotation.iter().chain(&translation).all(|v| v.is_finite()) {
                    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::new(rotation));
                    let camera_from_world =
                        Isometry3::from_parts(Translation3::from(translation), rotation);
                    Ok(camera_from_world.inverse())
                } else {
                    Err(rigid::RigidTransformError::NotFinite)
                }
            }
        })
    }
}

/// The columns that a head line names: position and quaternion, as ROS and others write them.
fn by_head(file: &TextFile, rows: &[TextLine]) -> Option<Columns> {
    /// Ends of the names of position and quaternion, x first.
    const NAMES: [&[&str]; 7] = [
        &[
            "position.x",
            "translation.x",
            "p_rs_r_x",
            "tx",
            "pos_x",
            "p_x",
            "px",
            "x",
        ],
        &[
            "position.y",
            "translation.y",
            "p_rs_r_y",
            "ty",
            "pos_y",
            "p_y",
            "py",
            "y",
        ],
        &[
            "position.z",
            "translation.z",
            "p_rs_r_z",
            "tz",
            "pos_z",
            "p_z",
            "pz",
            "z",
        ],
        &[
            "orientation.x",
            "rotation.x",
            "q_rs_x",
            "qx",
            "quat_x",
            "q_x",
            "rotation_x",
        ],
        &[
            "orientation.y",
            "rotation.y",
            "q_rs_y",
            "qy",
            "quat_y",
            "q_y",
            "rotation_y",
        ],
        &[
            "orientation.z",
            "rotation.z",
            "q_rs_z",
            "qz",
            "quat_z",
            "q_z",
            "rotation_z",
        ],
        &[
            "orientation.w",
            "rotation.w",
            "q_rs_w",
            "qw",
            "quat_w",
            "q_w",
            "rotation_w",
        ],
    ];
    let head = file.lines().find(|row| !row.text().is_empty())?;
    let names: Vec<String> = head
        .text()
        .trim_start_matches(['#', '%'])
        .to_ascii_lowercase()
        .split([',', ' ', '\t', ';'])
        .map(|name| name.trim().trim_matches(['"', '_']).replace('/', "."))
        .filter(|name| !name.is_empty() && !name.starts_with(['[', '(']))
        .collect();
    let count = fields(rows.first()?).len();
    if names.len() != count {
        return None;
    }
    let find = |ends: &[&str]| {
        names.iter().position(|name| {
            ends.iter()
                .any(|end| name == end || (end.contains('.') && name.ends_with(end)))
        })
    };
    let mut found = [0; 7];
    for (slot, ends) in found.iter_mut().zip(NAMES) {
        *slot = find(ends)?;
    }
    let stamp = find(&["header.stamp"])
        .or_else(|| {
            find(&[
                "timestamp",
                "time",
                "stamp",
                "t",
                "%time",
                "time_ns",
                "timestamp_ns",
            ])
        })
        .or_else(|| names.iter().position(|name| name.starts_with("time")));
    let is_named = parse_number(fields(rows.first()?).first()?).is_none();
    let key = match stamp {
        Some(stamp) => Key::Stamp(stamp),
        None if is_named => Key::Name,
        None => Key::Stamp(find(&["frame", "frame_id", "image_id", "index", "id"])?),
    };
    let [x, y, z, qx, qy, qz, qw] = found;
    Some(Columns {
        format: if qw < qx {
            PoseFileFormat::EurocCsv
        } else {
            PoseFileFormat::Tum
        },
        count: Some(count),
        key,
        has_index: false,
        pose: PoseFields::Quaternion {
            position: [x, y, z],
            rotation: [qx, qy, qz, qw],
        },
    })
}

/// The formats with the number of fields of the first lines, in order of preference.
fn candidates(file: &TextFile, rows: &[TextLine]) -> Vec<Columns> {
    let Some(first) = rows.first() else {
        return Vec::new();
    };
    let cells = fields(first);
    let count = cells.len();
    let is_named = cells
        .first()
        .is_some_and(|field| parse_number(field).is_none());
    let is_w_first = w_comes_first(file);
    let has_commas = first.text().contains(',');
    let has_nanoseconds = cells
        .first()
        .and_then(|field| parse_stamp(field))
        .is_some_and(|stamp| stamp.is_nanoseconds);
    let of = |format, count, key, pose| Columns {
        format,
        count,
        key,
        has_index: false,
        pose,
    };
    let exact = Some(count);
    let quaternions = |first: usize, w_first: bool, count: Option<usize>, key: Key| {
        let format = if w_first {
            PoseFileFormat::EurocCsv
        } else {
            PoseFileFormat::Tum
        };
        of(format, count, key, quaternion_from(first, w_first))
    };
    let matrix = |first: usize, numbers: usize, key: Key| {
        let format = if numbers == 12 {
            PoseFileFormat::Kitti
        } else {
            PoseFileFormat::Matrices
        };
        of(
            format,
            exact,
            key,
            PoseFields::Matrix {
                first,
                count: numbers,
            },
        )
    };
    if is_named {
        return match count {
            8 => vec![quaternions(
                1,
                is_w_first.unwrap_or(false),
                exact,
                Key::Name,
            )],
            13 => vec![matrix(1, 12, Key::Name)],
            17 => vec![matrix(1, 16, Key::Name)],
            _ => Vec::new(),
        };
    }
    let stamp = Key::Stamp(0);
    let with_index = || Columns {
        has_index: true,
        ..quaternions(2, false, exact, Key::Stamp(1))
    };
    // With more fields, velocities or covariances follow.
    let longer_w_first = quaternions(1, true, None, stamp);
    let longer = quaternions(1, false, None, stamp);
    match count {
        7 => vec![
            of(
                PoseFileFormat::Unstamped,
                exact,
                Key::Order,
                quaternion_from(0, false),
            ),
            of(
                PoseFileFormat::RotationVectors,
                exact,
                stamp,
                PoseFields::RotationVector { first: 1 },
            ),
        ],
        8 => vec![quaternions(
            1,
            is_w_first.unwrap_or(has_commas && has_nanoseconds),
            exact,
            stamp,
        )],
        9 if is_running_index(rows) && !is_w_first.unwrap_or(false) => {
            vec![with_index(), quaternions(1, false, exact, stamp)]
        }
        9 => vec![Columns {
            count: exact,
            ..quaternions(1, false, exact, stamp)
        }],
        12 => vec![matrix(0, 12, Key::Order)],
        13 => vec![matrix(1, 12, stamp), longer_w_first],
        16 => vec![matrix(0, 16, Key::Order), longer_w_first],
        17 if has_commas || is_w_first == Some(true) => vec![longer_w_first, matrix(1, 16, stamp)],
        17 => vec![matrix(1, 16, stamp)],
        10.. if is_w_first.unwrap_or(has_commas) => vec![longer_w_first],
        10.. => vec![longer],
        _ => Vec::new(),
    }
}

/// Whether w is the first quaternion component according to the head line; `None` if it does not say.
fn w_comes_first(file: &TextFile) -> Option<bool> {
    let head = file
        .text()
        .lines()
        .find(|line| !line.trim().is_empty())?
        .to_ascii_lowercase();
    let position = |names: &[&str]| names.iter().find_map(|name| head.find(name));
    let w = position(&["q_rs_w", "qw", "q_w", "quat_w", "rotation_w"])?;
    let x = position(&["q_rs_x", "qx", "q_x", "quat_x", "rotation_x"])?;
    Some(w < x)
}

/// Whether the first field is a running index.
fn is_running_index(rows: &[TextLine]) -> bool {
    let index = |row: &TextLine| {
        row.fields()
            .next()
            .and_then(|field| field.parse::<u64>().ok())
    };
    rows.windows(2).all(|pair| {
        index(&pair[0])
            .zip(index(&pair[1]))
            .is_some_and(|(a, b)| b > a && b - a < 1000)
    }) && rows
        .first()
        .is_some_and(|row| index(row).is_some_and(|i| i < 1_000_000))
}
