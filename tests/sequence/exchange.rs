//! What is written for other programs reads back the same.

use std::path::Path;
use std::process::Command;

use linecarve::exchange::{
    TrajectoryFile, posed_images, write_colmap, write_trajectory, write_transforms,
};
use linecarve::map_points::PointModel;
use linecarve::sequence::{OpenOptions, Sequence};

use super::support::write_seven_scenes;
use super::writers::{
    write_colmap_text, write_euroc, write_mvs, write_nvm, write_orb_slam, write_pose_list,
};
use super::{Writer, folder_with, open};

/// Whether two sequences have the same poses, in the same order.
pub(crate) fn assert_same(a: &Sequence, b: &Sequence, what: &str) {
    assert_eq!(a.frames().len(), b.frames().len(), "{what}");
    for (x, y) in a.frames().iter().zip(b.frames()) {
        let difference =
            x.world_from_camera.to_homogeneous() - y.world_from_camera.to_homogeneous();
        assert!(difference.amax() < 1e-9, "{what}: {difference}");
    }
}

/// Writes the poses as the program does: EuRoC's are of the body where its mounting is known.
pub(crate) fn write_as_read(sequence: &Sequence, format: TrajectoryFile, path: &Path) {
    let mut images = posed_images(sequence);
    if let (TrajectoryFile::Euroc, Some(mounting)) = (format, sequence.body_from_color()) {
        for image in &mut images {
            image.world_from_camera *= mounting.inverse();
        }
    }
    write_trajectory(path, format, &images).unwrap();
}

/// Demands that two maps, where there are any, have the same points and views, of which the poses and pixels agree.
pub(crate) fn assert_same_map(a: Option<&PointModel>, b: Option<&PointModel>, what: &str) {
    let (Some(a), Some(b)) = (a, b) else {
        assert!(a.is_none() && b.is_none(), "{what}: {a:?} {b:?}");
        return;
    };
    assert_eq!(a.views.len(), b.views.len(), "{what}");
    for (v, w) in a.views.iter().zip(&b.views) {
        let difference =
            v.world_from_camera.to_homogeneous() - w.world_from_camera.to_homogeneous();
        assert!(difference.amax() < 1e-9, "{what}: {difference}");
    }
    assert_eq!(a.points.len(), b.points.len(), "{what}");
    for (p, q) in a.points.iter().zip(&b.points) {
        assert!(
            (p.point_in_world - q.point_in_world).norm() < 1e-9,
            "{what}"
        );
        assert_eq!(p.sightings.len(), q.sightings.len(), "{what}");
        for (s, t) in p.sightings.iter().zip(&q.sightings) {
            assert_eq!(s.view, t.view, "{what}");
            if let (Some(s), Some(t)) = (s.pixel, t.pixel) {
                assert!((s[0] - t[0]).hypot(s[1] - t[1]) < 1e-9, "{what}");
            }
        }
    }
}

/// The sequence with its poses as they are read from the file that they were written to.
pub(crate) fn there_and_back(
    sequence: &Sequence,
    layout: &str,
    format: TrajectoryFile,
    path: &Path,
) -> Sequence {
    write_as_read(sequence, format, path);
    let options = OpenOptions {
        poses: Some(path.to_owned()),
        layout: Some(layout.to_owned()),
        ..OpenOptions::default()
    };
    Sequence::open(sequence.folder(), &options).unwrap()
}

/// Layouts that take poses, with times, with numbers, and with neither.
const TAKING: [(&str, Writer); 4] = [
    ("euroc", write_euroc),
    ("orb-slam", write_orb_slam),
    ("images-and-poses", write_pose_list),
    ("7-scenes", |folder| write_seven_scenes(folder, 5)),
];

#[test]
fn trajectories_come_back_in_every_format() {
    for (name, write) in TAKING {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        let path = folder.path().join("written.txt");
        for format in [
            TrajectoryFile::Tum,
            TrajectoryFile::Euroc,
            TrajectoryFile::Kitti,
            TrajectoryFile::Open3dLog,
        ] {
            let back = there_and_back(&sequence, name, format, &path);
            assert_same(&sequence, &back, &format!("{name}, {format:?}"));
        }
    }
}

#[test]
fn maps_come_back_as_colmap_with_their_tracks() {
    for write in [
        write_colmap_text as Writer,
        write_mvs,
        write_nvm,
        write_euroc,
    ] {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        let out = folder.path().join("written");
        std::fs::create_dir(&out).unwrap();
        write_colmap(&out, &sequence).unwrap();
        let back = open(&out).unwrap();
        assert_eq!(back.layout(), "colmap");
        assert_same(&sequence, &back, sequence.layout());
        let camera = (sequence.stored_color_camera(), back.stored_color_camera());
        assert!((camera.0.cx() - camera.1.cx()).abs() < 1e-9);
        assert_eq!(camera.0.distortion(), camera.1.distortion());
        assert_same_map(sequence.map_points(), back.map_points(), sequence.layout());
    }
}

#[test]
fn transforms_come_back() {
    for write in [write_colmap_text as Writer, write_euroc, |folder: &Path| {
        write_seven_scenes(folder, 5);
    }] {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        write_transforms(&folder.path().join("transforms.json"), &sequence).unwrap();
        let options = OpenOptions {
            layout: Some("transforms-json".to_owned()),
            ..OpenOptions::default()
        };
        let back = Sequence::open(folder.path(), &options).unwrap();
        assert_same(&sequence, &back, sequence.layout());
        let scale = |s: &Sequence| s.depth_calibration().map(|d| d.scale);
        assert_eq!(scale(&sequence), scale(&back));
        // From a folder of its own the images are found just as well.
        let elsewhere = folder_with(|out| {
            write_transforms(&out.join("transforms.json"), &sequence).unwrap();
        });
        let back = open(elsewhere.path()).unwrap();
        assert_same(&sequence, &back, sequence.layout());
        assert!(back.load_gray(0).is_ok());
    }
}

#[test]
fn images_of_several_sizes_keep_their_cameras_in_colmap() {
    let folder = folder_with(write_colmap_text);
    let model = ["", "colmap", "sparse/0"]
        .map(|place| folder.path().join(place))
        .into_iter()
        .find(|place| place.join("cameras.txt").is_file())
        .unwrap();
    let cameras = model.join("cameras.txt");
    let text = std::fs::read_to_string(&cameras).unwrap();
    std::fs::write(&cameras, text + "77 PINHOLE 640 360 500 510 320.5 180.25\n").unwrap();
    let images = model.join("images.txt");
    let text = std::fs::read_to_string(&images).unwrap();
    assert!(text.contains(" 1 view0.png"), "{text}");
    std::fs::write(&images, text.replace(" 1 view0.png", " 77 view0.png")).unwrap();
    let sequence = open(folder.path()).unwrap();
    let out = tempfile::tempdir().unwrap();
    write_colmap(out.path(), &sequence).unwrap();
    let written = std::fs::read_to_string(out.path().join("cameras.txt")).unwrap();
    assert!(
        written.contains("PINHOLE 640 360 500 510 320.5 180.25"),
        "{written}"
    );
    assert_eq!(
        written
            .lines()
            .filter(|line| !line.starts_with('#'))
            .count(),
        2
    );
}

fn convert(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_linecarve"))
        .arg("convert")
        .args(arguments)
        .output()
        .unwrap();
    (
        output.status.code(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

#[test]
fn the_command_chooses_by_the_extension() {
    let folder = folder_with(write_colmap_text);
    let input = folder.path().to_str().unwrap();
    for name in ["a.txt", "a.csv", "a.log", "a.json", "model"] {
        let out = folder.path().join(name);
        let (code, message) = convert(&[input, "--out", out.to_str().unwrap()]);
        assert_eq!(code, Some(0), "{name}: {message}");
        assert!(out.exists(), "{name}");
    }
    let (code, message) = convert(&[input, "--out", "a.xyz"]);
    assert_eq!(code, Some(2));
    assert!(message.contains("--to"), "{message}");
    let (code, message) = convert(&[input, "--out", "a.ply"]);
    assert_eq!(code, Some(2));
    assert!(message.contains("read from files"), "{message}");
}

#[test]
fn meshes_and_lines_change_their_format() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(path("m.obj"), "v 0 0 1\nv 1 0 0\nv 0 1 0.5\nf 1 2 3\n").unwrap();
    std::fs::write(path("l.obj"), "v 0 0 1\nv 1 0 0\nl 1 2\n").unwrap();
    std::fs::write(path("empty.obj"), "v 0 0 1\n").unwrap();
    for from in ["m", "l"] {
        for (a, b) in [("obj", "ply"), ("ply", "glb"), ("glb", "obj")] {
            let input = path(&format!("{from}.{a}"));
            let (code, message) = convert(&[&input, "--out", &path(&format!("{from}.{b}"))]);
            assert_eq!(code, Some(0), "{from} {a} {b}: {message}");
        }
        let shape =
            linecarve::mesh::read_geometry(Path::new(&path(&format!("{from}.obj")))).unwrap();
        let elements = shape.triangles.len() + shape.lines.len();
        let points = shape.positions;
        assert_eq!(elements, 1);
        assert!((points[0] - nalgebra::Point3::new(0.0, 0.0, 1.0)).norm() < 1e-6);
    }
    assert_eq!(
        convert(&[&path("empty.obj"), "--out", &path("e.ply")]).0,
        Some(1)
    );
}
