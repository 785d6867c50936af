//! Exported files are read back unchanged.

use std::path::Path;

use linecarve_sequence::SparseModel;
use linecarve_sequence::export::{
    TrajectoryFormat, posed_images, write_colmap, write_trajectory, write_transforms,
};
use linecarve_sequence::{OpenOptions, Sequence};

use super::support::write_seven_scenes;
use super::writers::{
    write_colmap_text, write_euroc, write_mvs, write_nvm, write_orb_slam, write_pose_list,
};
use super::{Writer, folder_with, open};

/// Asserts that two sequences have the same poses, in the same order.
pub(crate) fn assert_same(a: &Sequence, b: &Sequence, what: &str) {
    assert_eq!(a.frames().len(), b.frames().len(), "{what}");
    for (x, y) in a.frames().iter().zip(b.frames()) {
        let difference =
            x.world_from_camera.to_homogeneous() - y.world_from_camera.to_homogeneous();
        assert!(difference.amax() < 1e-9, "{what}: {difference}");
    }
}

/// Writes the poses as the program does: EuRoC's are of the body if its extrinsics are known.
pub(crate) fn write_as_read(sequence: &Sequence, format: TrajectoryFormat, path: &Path) {
    let mut images = posed_images(sequence);
    if let (TrajectoryFormat::Euroc, Some(body_from_color)) = (format, sequence.body_from_color()) {
        for image in &mut images {
            image.world_from_camera *= body_from_color.inverse();
        }
    }
    write_trajectory(path, format, &images).unwrap();
}

/// Asserts that two sparse models, if any, have the same views, points and observations.
pub(crate) fn assert_same_map(a: Option<&SparseModel>, b: Option<&SparseModel>, what: &str) {
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
        assert_eq!(p.observations.len(), q.observations.len(), "{what}");
        for (s, t) in p.observations.iter().zip(&q.observations) {
            assert_eq!(s.view, t.view, "{what}");
            if let (Some(s), Some(t)) = (s.pixel, t.pixel) {
                assert!((s[0] - t[0]).hypot(s[1] - t[1]) < 1e-9, "{what}");
            }
        }
    }
}

/// The sequence with its poses exported and read back.
fn round_trip(
    sequence: &Sequence,
    layout: &str,
    format: TrajectoryFormat,
    path: &Path,
) -> Sequence {
    write_as_read(sequence, format, path);
    let mut options = OpenOptions::default();
    options.poses = Some(path.to_owned());
    options.layout = Some(layout.to_owned());
    Sequence::open(sequence.folder(), &options).unwrap()
}

/// Layouts that accept external poses: with times, with numbers, and with neither.
const ACCEPTING: [(&str, Writer); 4] = [
    ("euroc", write_euroc),
    ("orb-slam", write_orb_slam),
    ("images-and-poses", write_pose_list),
    ("7-scenes", |folder| write_seven_scenes(folder, 5)),
];

#[test]
fn trajectories_survive_a_round_trip_in_every_format() {
    for (name, write) in ACCEPTING {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        let path = folder.path().join("written.txt");
        for format in [
            TrajectoryFormat::Tum,
            TrajectoryFormat::Euroc,
            TrajectoryFormat::Kitti,
            TrajectoryFormat::Open3dLog,
        ] {
            let back = round_trip(&sequence, name, format, &path);
            assert_same(&sequence, &back, &format!("{name}, {format:?}"));
        }
    }
}

#[test]
fn sparse_models_survive_a_round_trip_as_colmap() {
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
        assert_same_map(
            sequence.sparse_model(),
            back.sparse_model(),
            sequence.layout(),
        );
    }
}

#[test]
fn transforms_survive_a_round_trip() {
    for write in [write_colmap_text as Writer, write_euroc, |folder: &Path| {
        write_seven_scenes(folder, 5);
    }] {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        write_transforms(&folder.path().join("transforms.json"), &sequence).unwrap();
        let mut options = OpenOptions::default();
        options.layout = Some("transforms-json".to_owned());
        let back = Sequence::open(folder.path(), &options).unwrap();
        assert_same(&sequence, &back, sequence.layout());
        let scale = |s: &Sequence| s.depth_calibration().map(|d| d.scale);
        assert_eq!(scale(&sequence), scale(&back));
        // Images are also found from another folder.
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
