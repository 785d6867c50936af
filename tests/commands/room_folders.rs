//! A rendered room, written as the layouts that have depth, in the right convention or another one.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::program::small_sequence;

/// Frames of a rendered room, which the layouts below are written from.
pub(crate) struct Room {
    folder: tempfile::TempDir,
    pub(crate) sequence: Sequence,
    pub(crate) poses: Vec<Isometry3<f64>>,
}

impl Room {
    pub(crate) fn new(frames: usize) -> Self {
        let folder = small_sequence(frames, "tum");
        let sequence =
            Sequence::open(&folder.path().join("sequence"), &OpenOptions::default()).unwrap();
        let poses = sequence
            .frames()
            .iter()
            .map(|frame| frame.world_from_camera)
            .collect();
        Self {
            folder,
            sequence,
            poses,
        }
    }

    pub(crate) fn truth(&self) -> PathBuf {
        self.folder
            .path()
            .join("sequence/ground-truth-observed.ply")
    }

    /// Copies image `frame` to a path without extension.
    pub(crate) fn copy_color(&self, frame: usize, stem: &Path) {
        let from = &self.sequence.frames()[frame].color;
        copy(from, &with_extension_of(from, stem));
    }

    /// Writes the depth of a frame as a 16-bit PNG of some units a metre.
    fn write_depth(&self, frame: usize, path: &Path, how: &Writing, units: f64) {
        let depth = self.sequence.load_depth(frame).unwrap().unwrap();
        let (width, height) = (depth.width() as u32, depth.height() as u32);
        let camera = self.sequence.color_camera();
        let units = how.depth * units;
        let columns = depth.width();
        let raw: Vec<u16> = (0..depth.samples().len())
            .map(|at| {
                let shown = if how.has_mirrored_depth {
                    at - at % columns + (columns - 1 - at % columns)
                } else {
                    at - at % columns + (at % columns + columns - how.moved_depth) % columns
                };
                let z = f64::from(depth.samples()[shown]);
                let x = ((at % depth.width()) as f64 - camera.cx()) / camera.fx();
                let y = ((at / depth.width()) as f64 - camera.cy()) / camera.fy();
                let value = match how.values {
                    Values::Inverse if z > 0.0 => 10.0 / z,
                    Values::Distance => z * (1.0 + x * x + y * y).sqrt(),
                    Values::Depth | Values::Inverse => z,
                };
                (value * units).round() as u16
            })
            .collect();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(width, height, raw)
            .unwrap()
            .save(path)
            .unwrap();
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to.parent().unwrap()).unwrap();
    std::fs::copy(from, to).unwrap();
}

fn with_extension_of(image: &Path, stem: &Path) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(".");
    name.push(image.extension().unwrap());
    PathBuf::from(name)
}

/// How a folder is written: each number differs from the convention of the layout when it is broken.
#[derive(Clone, Copy)]
pub(crate) struct Writing {
    /// Factor on the depth units of the layout.
    pub(crate) depth: f64,
    /// What depth images measure in place of depth: its inverse, or the distance along the ray.
    pub(crate) values: Values,
    /// Factor on positions.
    pub(crate) unit: f64,
    pub(crate) is_inverse: bool,
    /// Where the axes of the poses point in the image.
    pub(crate) axes: Axes,
    /// Whether all frames have the first pose.
    pub(crate) is_still: bool,
    /// Whether each pose has a rotation of its own.
    pub(crate) is_scrambled: bool,
    /// Pixels by which depth images are moved to the right.
    pub(crate) moved_depth: usize,
    /// Whether depth images are mirrored from left to right.
    pub(crate) has_mirrored_depth: bool,
    pub(crate) is_w_first: bool,
    /// Factor on the focal length.
    pub(crate) focal: f64,
    /// Factor on that in y alone.
    pub(crate) aspect: f64,
    /// The pose of a frame is that of the frame so many before.
    pub(crate) shift: usize,
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Axes {
    /// x right, y down, z forward.
    Camera,
    /// x right, y up, z backward.
    OpenGl,
    /// Of a robot: x forward, y left, z up.
    Body,
    /// x right, y up, z forward, in a left-handed world.
    Unity,
}

impl Axes {
    /// The pose with these axes of a camera.
    fn pose(self, camera: &Isometry3<f64>) -> Isometry3<f64> {
        let [right, down, forward] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let (columns, mirror) = match self {
            Self::Camera => return *camera,
            Self::OpenGl => ([right, -down, -forward], 1.0),
            Self::Body => ([forward, -right, -down], 1.0),
            Self::Unity => ([right, -down, forward], -1.0),
        };
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, mirror, 1.0));
        let rotation = mirror
            * camera.rotation.to_rotation_matrix().matrix()
            * Matrix3::from_columns(&columns);
        Isometry3::from_parts(
            (mirror * camera.translation.vector).into(),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
        )
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Values {
    Depth,
    Inverse,
    Distance,
}

pub(crate) const RIGHT: Writing = Writing {
    depth: 1.0,
    values: Values::Depth,
    unit: 1.0,
    is_inverse: false,
    axes: Axes::Camera,
    is_still: false,
    has_mirrored_depth: false,
    is_scrambled: false,
    moved_depth: 0,
    is_w_first: false,
    focal: 1.0,
    aspect: 1.0,
    shift: 0,
};

impl Writing {
    fn poses(&self, room: &Room) -> Vec<Isometry3<f64>> {
        (0..room.poses.len())
            .map(|at| {
                let at = if self.is_still {
                    0
                } else {
                    at.saturating_sub(self.shift)
                };
                let mut pose = self.axes.pose(&room.poses[at]);
                if self.is_scrambled {
                    let turn = Vector3::new(0.3, 1.0, -0.5) * (1.3 * at as f64);
                    pose.rotation *= UnitQuaternion::from_scaled_axis(turn);
                }
                if self.is_inverse {
                    pose = pose.inverse();
                }
                pose.translation.vector *= self.unit;
                pose
            })
            .collect()
    }

    pub(crate) fn camera(&self, room: &Room) -> [f64; 4] {
        let camera = room.sequence.color_camera();
        [
            self.focal * camera.fx(),
            self.focal * self.aspect * camera.fy(),
            camera.cx(),
            camera.cy(),
        ]
    }

    fn quaternion_line(&self, pose: &Isometry3<f64>) -> String {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let q = if self.is_w_first {
            [q.w, q.x, q.y, q.z]
        } else {
            [q.x, q.y, q.z, q.w]
        };
        format!(
            "{} {} {} {} {} {} {}",
            t.x, t.y, t.z, q[0], q[1], q[2], q[3]
        )
    }
}

pub(crate) fn matrix_lines(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    (0..4).fold(String::new(), |mut text, r| {
        let row: Vec<String> = (0..4).map(|c| matrix[(r, c)].to_string()).collect();
        writeln!(text, "{}", row.join(" ")).unwrap();
        text
    })
}

pub(crate) fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

pub(crate) fn sidecar([fx, fy, cx, cy]: [f64; 4]) -> String {
    format!("[color]\nfx = {fx:?}\nfy = {fy:?}\ncx = {cx:?}\ncy = {cy:?}\n")
}

fn intrinsics_text([fx, fy, cx, cy]: [f64; 4]) -> String {
    format!("{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n")
}

pub(crate) type Writer = fn(&Room, &Writing, &Path);

pub(crate) fn write_tum(room: &Room, how: &Writing, out: &Path) {
    let mut lists = [String::new(), String::new(), String::new()];
    for (at, pose) in how.poses(room).iter().enumerate() {
        let stamp = format!("{}.500000", 1000 + at);
        room.copy_color(at, &out.join(format!("rgb/{stamp}")));
        room.write_depth(at, &out.join(format!("depth/{stamp}.png")), how, 5000.0);
        let image = room.sequence.frames()[at].color.extension().unwrap();
        writeln!(lists[0], "{stamp} rgb/{stamp}.{}", image.to_str().unwrap()).unwrap();
        writeln!(lists[1], "{stamp} depth/{stamp}.png").unwrap();
        writeln!(lists[2], "{stamp} {}", how.quaternion_line(pose)).unwrap();
    }
    for (name, list) in ["rgb.txt", "depth.txt", "groundtruth.txt"]
        .iter()
        .zip(lists)
    {
        write(&out.join(name), &list);
    }
    write(&out.join("linecarve.toml"), &sidecar(how.camera(room)));
}

fn write_seven_scenes(room: &Room, how: &Writing, out: &Path) {
    for (at, pose) in how.poses(room).iter().enumerate() {
        let part = |name: &str| out.join(format!("frame-{at:06}.{name}"));
        room.copy_color(at, &part("color"));
        room.write_depth(at, &part("depth.png"), how, 1000.0);
        write(&part("pose.txt"), &matrix_lines(pose));
    }
    write(
        &out.join("camera-intrinsics.txt"),
        &intrinsics_text(how.camera(room)),
    );
}

fn write_open3d(room: &Room, how: &Writing, out: &Path) {
    let mut log = String::new();
    for (at, pose) in how.poses(room).iter().enumerate() {
        room.copy_color(at, &out.join(format!("image/{at:05}")));
        room.write_depth(at, &out.join(format!("depth/{at:05}.png")), how, 1000.0);
        write!(log, "{at} {at} {}\n{}", at + 1, matrix_lines(pose)).unwrap();
    }
    write(&out.join("trajectory.log"), &log);
    let size = room.sequence.color_size();
    let [fx, fy, cx, cy] = how.camera(room);
    let json = format!(
        "{{\"width\": {}, \"height\": {}, \"intrinsic_matrix\": [{fx}, 0, 0, 0, {fy}, 0, {cx}, {cy}, 1]}}",
        size.width, size.height
    );
    write(&out.join("camera.json"), &json);
}

pub(crate) fn write_scannet(room: &Room, how: &Writing, out: &Path) {
    for (at, pose) in how.poses(room).iter().enumerate() {
        room.copy_color(at, &out.join(format!("color/{at}")));
        room.write_depth(at, &out.join(format!("depth/{at}.png")), how, 1000.0);
        write(&out.join(format!("pose/{at}.txt")), &matrix_lines(pose));
    }
    write(
        &out.join("intrinsics.txt"),
        &intrinsics_text(how.camera(room)),
    );
}

fn write_replica(room: &Room, how: &Writing, out: &Path) {
    let mut lines = String::new();
    for (at, pose) in how.poses(room).iter().enumerate() {
        room.copy_color(at, &out.join(format!("results/frame{at:06}")));
        let depth = out.join(format!("results/depth{at:06}.png"));
        room.write_depth(at, &depth, how, 6553.5);
        lines += &(matrix_lines(pose).replace('\n', " ") + "\n");
    }
    write(&out.join("traj.txt"), &lines);
    let size = room.sequence.color_size();
    let [fx, fy, cx, cy] = how.camera(room);
    let json = format!(
        "{{\"camera\": {{\"w\": {}, \"h\": {}, \"fx\": {fx}, \"fy\": {fy}, \"cx\": {cx}, \"cy\": {cy}, \"scale\": 6553.5}}}}",
        size.width, size.height
    );
    write(&out.join("cam_params.json"), &json);
}

fn write_pose_list(room: &Room, how: &Writing, out: &Path) {
    let mut lines = String::new();
    for (at, pose) in how.poses(room).iter().enumerate() {
        room.copy_color(at, &out.join(format!("rgb/{at}")));
        room.write_depth(at, &out.join(format!("depth/{at}.png")), how, 1000.0);
        writeln!(lines, "{}", how.quaternion_line(pose)).unwrap();
    }
    write(&out.join("poses.txt"), &lines);
    write(&out.join("linecarve.toml"), &sidecar(how.camera(room)));
}

fn write_transforms(room: &Room, how: &Writing, out: &Path) {
    // The axes of this layout are those of OpenGL.
    let opengl = Writing {
        axes: match how.axes {
            Axes::Camera => Axes::OpenGl,
            Axes::OpenGl => Axes::Camera,
            axes => axes,
        },
        ..*how
    };
    let [fx, fy, cx, cy] = how.camera(room);
    let frames: Vec<serde_json::Value> = opengl
        .poses(room)
        .iter()
        .enumerate()
        .map(|(at, pose)| {
            room.copy_color(at, &out.join(format!("images/{at}")));
            room.write_depth(at, &out.join(format!("depth/{at}.png")), how, 1000.0);
            let matrix = pose.to_homogeneous();
            let rows: Vec<Vec<f64>> = (0..4)
                .map(|r| (0..4).map(|c| matrix[(r, c)]).collect())
                .collect();
            serde_json::json!({
                "file_path": format!("images/{at}"), "depth_file_path": format!("depth/{at}.png"), "transform_matrix": rows,
            })
        })
        .collect();
    let file = serde_json::json!({
        "fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5, "depth_unit_scale_factor": 0.001, "frames": frames,
    });
    write(&out.join("transforms.json"), &file.to_string());
}

/// Layouts with depth, and whether their poses have quaternions.
pub(crate) const LAYOUTS: [(&str, Writer, bool); 7] = [
    ("tum", write_tum, true),
    ("7-scenes", write_seven_scenes, false),
    ("open3d", write_open3d, false),
    ("scannet", write_scannet, false),
    ("replica", write_replica, false),
    ("poses.txt", write_pose_list, true),
    ("transforms", write_transforms, false),
];
