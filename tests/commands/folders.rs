//! Folders as people have them: a wrong convention, a file that is not read or a file of another program ends in an error that names it and
//! the remedy, never in a wrong surface with exit status 0.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::Isometry3;

use crate::program::{expect_status, linecarve, small_sequence, stderr, text};

/// Frames of a rendered room, which the layouts below are written from.
struct Room {
    folder: tempfile::TempDir,
    sequence: Sequence,
    poses: Vec<Isometry3<f64>>,
}

impl Room {
    fn new(frames: usize) -> Self {
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

    fn truth(&self) -> PathBuf {
        self.folder
            .path()
            .join("sequence/ground-truth-observed.ply")
    }

    /// Copies image `frame` to a path without extension.
    fn copy_color(&self, frame: usize, stem: &Path) {
        let from = &self.sequence.frames()[frame].color;
        copy(from, &with_extension_of(from, stem));
    }

    /// Writes the depth of a frame as a 16-bit PNG of some units a metre.
    fn write_depth(&self, frame: usize, path: &Path, how: &Writing, units: f64) {
        let depth = self.sequence.load_depth(frame).unwrap().unwrap();
        let (width, height) = (depth.width() as u32, depth.height() as u32);
        let camera = self.sequence.color_camera();
        let units = how.depth * units;
        let raw: Vec<u16> = depth
            .samples()
            .iter()
            .enumerate()
            .map(|(at, z)| {
                let z = f64::from(*z);
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
struct Writing {
    /// Factor on the depth units of the layout.
    depth: f64,
    /// What depth images measure in place of depth: its inverse, or the distance along the ray.
    values: Values,
    /// Factor on positions.
    unit: f64,
    is_inverse: bool,
    is_opengl: bool,
    is_w_first: bool,
    /// Factor on the focal length.
    focal: f64,
    /// The pose of a frame is that of the frame so many before.
    shift: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum Values {
    Depth,
    Inverse,
    Distance,
}

const RIGHT: Writing = Writing {
    depth: 1.0,
    values: Values::Depth,
    unit: 1.0,
    is_inverse: false,
    is_opengl: false,
    is_w_first: false,
    focal: 1.0,
    shift: 0,
};

impl Writing {
    fn poses(&self, room: &Room) -> Vec<Isometry3<f64>> {
        let flip = nalgebra::UnitQuaternion::from_axis_angle(
            &nalgebra::Vector3::x_axis(),
            std::f64::consts::PI,
        );
        (0..room.poses.len())
            .map(|at| {
                let mut pose = room.poses[at.saturating_sub(self.shift)];
                if self.is_opengl {
                    pose.rotation *= flip;
                }
                if self.is_inverse {
                    pose = pose.inverse();
                }
                pose.translation.vector *= self.unit;
                pose
            })
            .collect()
    }

    fn camera(&self, room: &Room) -> [f64; 4] {
        let camera = room.sequence.color_camera();
        [
            self.focal * camera.fx(),
            self.focal * camera.fy(),
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

fn matrix_lines(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    (0..4).fold(String::new(), |mut text, r| {
        let row: Vec<String> = (0..4).map(|c| matrix[(r, c)].to_string()).collect();
        writeln!(text, "{}", row.join(" ")).unwrap();
        text
    })
}

fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

fn sidecar([fx, fy, cx, cy]: [f64; 4]) -> String {
    format!("[color]\nfx = {fx:?}\nfy = {fy:?}\ncx = {cx:?}\ncy = {cy:?}\n")
}

fn intrinsics_text([fx, fy, cx, cy]: [f64; 4]) -> String {
    format!("{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n")
}

type Writer = fn(&Room, &Writing, &Path);

fn write_tum(room: &Room, how: &Writing, out: &Path) {
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

fn write_scannet(room: &Room, how: &Writing, out: &Path) {
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
    let opengl = Writing {
        is_opengl: !how.is_opengl,
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
const LAYOUTS: [(&str, Writer, bool); 7] = [
    ("tum", write_tum, true),
    ("7-scenes", write_seven_scenes, false),
    ("open3d", write_open3d, false),
    ("scannet", write_scannet, false),
    ("replica", write_replica, false),
    ("poses.txt", write_pose_list, true),
    ("transforms", write_transforms, false),
];

/// What is broken, how, and what the error must say.
const FAULTS: [(&str, Writing, &str); 9] = [
    (
        "scale",
        Writing {
            depth: 0.2,
            ..RIGHT
        },
        "[depth]",
    ),
    (
        "inverse depth",
        Writing {
            values: Values::Inverse,
            ..RIGHT
        },
        "values = \"inverse-depth\"",
    ),
    (
        "distance",
        Writing {
            values: Values::Distance,
            ..RIGHT
        },
        "values = \"distance\"",
    ),
    (
        "unit",
        Writing {
            unit: 1000.0,
            ..RIGHT
        },
        "[depth]",
    ),
    (
        "inverse",
        Writing {
            is_inverse: true,
            ..RIGHT
        },
        "direction = \"inverse\"",
    ),
    (
        "axes",
        Writing {
            is_opengl: true,
            ..RIGHT
        },
        "axes",
    ),
    (
        "quaternion",
        Writing {
            is_w_first: true,
            ..RIGHT
        },
        "quaternion = \"w-first\"",
    ),
    (
        "focal length",
        Writing {
            focal: 1.5,
            ..RIGHT
        },
        "fx =",
    ),
    ("join", Writing { shift: 1, ..RIGHT }, "the next image"),
];

/// Reconstructs every frame; the output of the program and the mesh.
fn reconstruct(sequence: &Path, more: &[&str]) -> (std::process::Output, PathBuf) {
    let out = sequence.with_extension("out");
    let mut arguments = vec![
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--final-only",
        "--no-picture",
        "--no-page",
        "--out",
        text(&out),
    ];
    arguments.extend(more);
    let output = linecarve(arguments);
    (output, out.join("mesh.ply"))
}

/// F at 5 cm against the surface that the frames see.
fn f_score(mesh: &Path, truth: &Path) -> f64 {
    let output = expect_status(
        0,
        [
            "evaluate",
            text(mesh),
            "--ground-truth",
            text(truth),
            "--thresholds",
            "0.05",
            "--samples",
            "20000",
            "--json",
        ],
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let score = found.pointer("/at/0/f").and_then(serde_json::Value::as_f64);
    score.unwrap_or_else(|| panic!("{found}"))
}

#[test]
fn a_broken_convention_is_never_a_wrong_surface_in_silence() {
    let room = Room::new(10);
    let folder = tempfile::tempdir().unwrap();
    let mut table = String::new();
    let mut is_wrong = false;
    for (layout, write, has_quaternions) in LAYOUTS {
        let right = folder.path().join(format!("{layout}-right"));
        write(&room, &RIGHT, &right);
        let (output, mesh) = reconstruct(&right, &[]);
        assert!(output.status.success(), "{layout}: {}", stderr(&output));
        let whole = f_score(&mesh, &room.truth());
        assert!(whole > 0.3, "{layout}: F {whole}");
        for (fault, how, words) in FAULTS {
            if fault == "quaternion" && !has_quaternions {
                continue;
            }
            let broken = folder.path().join(format!("{layout}-{fault}"));
            write(&room, &how, &broken);
            let (output, mesh) = reconstruct(&broken, &[]);
            let said = stderr(&output);
            let is_right = match output.status.code() {
                Some(2) => said.contains(words) && said.contains("--accept-as-is"),
                Some(0) => f_score(&mesh, &room.truth()) > 0.9 * whole,
                _ => false,
            };
            is_wrong |= !is_right;
            writeln!(
                table,
                "{layout:<12} {fault:<12} {:?} {is_right} {said}",
                output.status.code()
            )
            .unwrap();
            std::fs::remove_dir_all(broken).unwrap();
        }
    }
    assert!(!is_wrong, "{table}");
}

/// The file of the intrinsics in each layout that has one of its own.
const CALIBRATIONS: [(&str, &str); 6] = [
    ("tum", "linecarve.toml"),
    ("7-scenes", "camera-intrinsics.txt"),
    ("open3d", "camera.json"),
    ("scannet", "intrinsics.txt"),
    ("replica", "cam_params.json"),
    ("poses.txt", "linecarve.toml"),
];

#[test]
fn a_missing_calibration_is_never_a_wrong_surface_in_silence() {
    let room = Room::new(10);
    let folder = tempfile::tempdir().unwrap();
    for (layout, write, _) in LAYOUTS {
        let Some((_, file)) = CALIBRATIONS.iter().find(|(name, _)| *name == layout) else {
            continue;
        };
        let broken = folder.path().join(layout);
        write(&room, &RIGHT, &broken);
        std::fs::remove_file(broken.join(file)).unwrap();
        let (output, _) = reconstruct(&broken, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{layout}: {said}");
        assert!(
            said.contains("linecarve.toml") || said.contains("--calibration"),
            "{layout}: {said}"
        );
    }
}

#[test]
fn accept_as_is_goes_on_with_a_warning() {
    let room = Room::new(6);
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("scale");
    write_tum(
        &room,
        &Writing {
            depth: 0.2,
            ..RIGHT
        },
        &broken,
    );
    let (output, _) = reconstruct(&broken, &["--accept-as-is"]);
    let said = stderr(&output);
    assert!(
        output.status.success() && said.contains("scale = 1000.0"),
        "{said}"
    );
}

#[test]
fn poses_that_are_not_read_stop_the_run_before_tracking() {
    let room = Room::new(6);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording");
    write_scannet(&room, &RIGHT, &path);
    std::fs::rename(path.join("pose"), path.join("cams")).unwrap();
    let (output, _) = reconstruct(&path, &[]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("cams") && said.contains("--accept-as-is"),
        "{said}"
    );
    // `track` needs no poses, but depth.
    let depth = path.join("sparse_depth");
    std::fs::rename(path.join("depth"), &depth).unwrap();
    let output = expect_status(
        2,
        [
            "track",
            text(&path),
            "--out",
            text(&folder.path().join("out")),
        ],
    );
    let said = stderr(&output);
    assert!(
        said.contains("sparse_depth") && !said.contains("cams"),
        "{said}"
    );
}

#[test]
fn numbered_poses_that_count_from_another_number_are_joined_in_order() {
    let room = Room::new(24);
    let folder = tempfile::tempdir().unwrap();
    // Images count from 1, the log from 0.
    {
        let path = folder.path().join("from-0");
        let mut log = String::new();
        for at in 0..room.poses.len() {
            room.copy_color(at, &path.join(format!("images/{:06}", at + 1)));
            let (number, pose) = (at, room.poses[at]);
            write!(
                log,
                "{number} {number} {}\n{}",
                number + 1,
                matrix_lines(&pose)
            )
            .unwrap();
        }
        write(&path.join("Room_COLMAP_SfM.log"), &log);
        write(&path.join("camera.toml"), &sidecar(RIGHT.camera(&room)));
        let mut options = OpenOptions::default();
        options.poses = Some(path.join("Room_COLMAP_SfM.log"));
        options.calibration = Some(path.join("camera.toml"));
        let sequence = Sequence::open(&path.join("images"), &options).unwrap();
        let said: String = sequence
            .warnings()
            .iter()
            .map(|w| format!("{w}\n"))
            .collect();
        assert!(said.contains("joined in order"), "{said}");
        for frame in sequence.frames() {
            let number: usize = frame.name.parse().unwrap();
            let off = frame.world_from_camera.inverse() * room.poses[number - 1];
            assert!(off.translation.vector.norm() < 1e-6, "{}", frame.name);
        }
    }
}

#[test]
fn files_of_other_programs_are_named_with_the_way_in() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, words) in [
        (
            "clip.mkv",
            b"\x1A\x45\xDF\xA3....matroska".as_slice(),
            ["Matroska", "ffmpeg -i"],
        ),
        ("clip.avi", b"RIFF\0\0\0\0AVI LIST", ["AVI", "ffmpeg -i"]),
        (
            "recording.bag",
            b"#ROSBAG V2.0\n",
            ["ROS 1", "--poses FILE"],
        ),
        (
            "reconstruction.json",
            b"[{\"cameras\": {\"c\": {\"projection_type\": 1}}}]",
            ["OpenSfM", "export_colmap"],
        ),
        (
            "cameras.sfm",
            b"{\"views\": [], \"poses\": []}",
            ["Meshroom", "exportColmap"],
        ),
        ("bundle.out", b"# Bundle file v0.3\n", ["Bundler", "COLMAP"]),
        (
            "sfm_data.json",
            b"{\"sfm_data_version\": \"0.3\"}",
            ["OpenMVG", "Colmap"],
        ),
        (
            "cameras.xml",
            b"<document version=\"2\"><chunk/></document>",
            ["Metashape", "COLMAP"],
        ),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        for command in ["info", "reconstruct"] {
            let mut arguments = vec![command, text(&path)];
            let out = folder.path().join("out");
            if command == "reconstruct" {
                arguments.extend(["--out", text(&out)]);
            }
            let said = stderr(&expect_status(2, arguments));
            assert!(
                words.iter().all(|word| said.contains(word)),
                "{command}: {said}"
            );
            assert!(said.contains(name), "{said}");
        }
    }
}
