//! Trajectories as other tools write them.

use std::fmt::Write;
use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence, TimedPoses, TrajectoryAlignment};
use nalgebra::Isometry3;

use crate::folder_with;
use crate::support::{color_image, poses, sidecar};

const FRAMES: usize = 4;

/// Images whose names are times.
fn write_images(root: &Path) {
    std::fs::create_dir_all(root.join("rgb")).unwrap();
    for (at, pose) in poses(FRAMES).iter().enumerate() {
        color_image(pose)
            .save(root.join(format!("rgb/{}.500000.png", 1_000_000 + at)))
            .unwrap();
    }
    std::fs::write(root.join("linecarve.toml"), sidecar()).unwrap();
}

/// The numbers of a pose in the orders that formats have.
struct Numbers {
    position: String,
    x_first: String,
    w_first: String,
    rows: String,
}

fn numbers(pose: &Isometry3<f64>) -> Numbers {
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    let matrix = pose.to_homogeneous();
    let rows: Vec<String> = (0..12)
        .map(|i| matrix[(i / 4, i % 4)].to_string())
        .collect();
    Numbers {
        position: format!("{} {} {}", t.x, t.y, t.z),
        x_first: format!("{} {} {} {}", q.x, q.y, q.z, q.w),
        w_first: format!("{} {} {} {}", q.w, q.x, q.y, q.z),
        rows: rows.join(" "),
    }
}

/// A line of a pose, by number of the frame.
type Line = fn(usize, &Isometry3<f64>) -> String;

const COVARIANCE: &str = "0.1 0 0 0.1 0 0.1 0.2 0 0 0.2 0 0.2";

#[test]
fn trajectories_of_other_tools_are_read() {
    let formats: [(&str, &str, Line); 12] = [
        (
            "rtabmap with ids",
            "#timestamp x y z qx qy qz qw id\n",
            |at, pose| {
                let n = numbers(pose);
                format!(
                    "{}.5 {} {} {}",
                    1_000_000 + at,
                    n.position,
                    n.x_first,
                    7 * at + 1
                )
            },
        ),
        ("OpenVINS", "", |at, pose| {
            let n = numbers(pose);
            format!(
                "{}.5 {} {} {COVARIANCE}",
                1_000_000 + at,
                n.position,
                n.x_first
            )
        }),
        ("VINS", "", |at, pose| {
            let n = numbers(pose);
            let line = format!(
                "{}500000000 {} {} 0.1 0.2 0.3",
                1_000_000 + at,
                n.position,
                n.w_first
            );
            line.replace(' ', ",") + ","
        }),
        (
            "rostopic echo -p",
            "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,\
             field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n",
            |at, pose| {
                let n = numbers(pose);
                let stamp = format!("{}500000000", 1_000_000 + at);
                let frame_id = if at % 2 == 0 { "" } else { "world" };
                let numbers = format!("{} {}", n.position, n.x_first).replace(' ', ",");
                format!("{stamp},{at},{stamp},{frame_id},{numbers}")
            },
        ),
        ("stamp and rows", "", |at, pose| {
            format!("{}.5 {}", 1_000_000 + at, numbers(pose).rows)
        }),
        ("stamp and matrix", "", |at, pose| {
            format!("{}.5 {} 0 0 0 1", 1_000_000 + at, numbers(pose).rows)
        }),
        ("ARKitScenes", "", |at, pose| {
            let camera = pose.inverse();
            let (r, t) = (camera.rotation.scaled_axis(), camera.translation.vector);
            format!(
                "{}.5 {} {} {} {} {} {}",
                1_000_000 + at,
                r.x,
                r.y,
                r.z,
                t.x,
                t.y,
                t.z
            )
        }),
        ("names", "", |at, pose| {
            let n = numbers(pose);
            format!(
                "images/{}.500000.jpg {} {}",
                1_000_000 + at,
                n.position,
                n.x_first
            )
        }),
        ("names and rows", "", |at, pose| {
            format!("{}.500000.png {}", 1_000_000 + at, numbers(pose).rows)
        }),
        ("an index", "", |at, pose| {
            let n = numbers(pose);
            format!("{at} {}.5 {} {}", 1_000_000 + at, n.position, n.x_first)
        }),
        (
            "a head with w first",
            "time tx ty tz qw qx qy qz\n",
            |at, pose| {
                let n = numbers(pose);
                format!("{}.5 {} {}", 1_000_000 + at, n.position, n.w_first)
            },
        ),
        ("KITTI", "", |_, pose| numbers(pose).rows),
    ];
    for (name, head, line) in formats {
        let folder = folder_with(write_images);
        let path = folder.path().join("trajectory-of-tool.txt");
        let mut text = head.to_owned();
        for (at, pose) in poses(FRAMES).iter().enumerate() {
            writeln!(text, "{}", line(at, pose)).unwrap();
        }
        std::fs::write(&path, text).unwrap();
        let mut options = OpenOptions::default();
        options.poses = Some(path);
        let sequence = Sequence::open(folder.path(), &options)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(sequence.frames().len(), FRAMES, "{name}");
        for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
            let off = frame.world_from_camera.inverse() * pose;
            assert!(
                off.translation.vector.norm() < 1e-5 && off.rotation.angle() < 1e-5,
                "{name}: {}",
                frame.name
            );
        }
    }
}

#[test]
fn coverage_counts_the_poses_that_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // The truth at 100 Hz; three estimates between its times.
    let at = |k: f64| format!("{} {} {} 0 0 0 1", 0.01 * k, (0.3 * k).sin(), 0.02 * k * k);
    let (mut tum, mut euroc, mut kitti, mut times) = (
        String::new(),
        "#timestamp, p_x, ...\n".to_owned(),
        String::new(),
        String::new(),
    );
    for k in 0..30 {
        let numbers = at(f64::from(k));
        writeln!(tum, "{} {numbers}", 100.0 + 0.01 * f64::from(k)).unwrap();
        let position = numbers.trim_end_matches(" 0 0 0 1").replace(' ', ",");
        let stamp = 100_000_000_000_i64 + 10_000_000 * i64::from(k) + 1_000_000_000_000_000_000;
        writeln!(euroc, "{stamp},{position},1,0,0,0,0,0,0,0,0,0,0,0,0").unwrap();
        let [x, y, z]: [&str; 3] = position.split(',').collect::<Vec<_>>().try_into().unwrap();
        writeln!(kitti, "1 0 0 {x} 0 1 0 {y} 0 0 1 {z}").unwrap();
        writeln!(times, "{}", 100.0 + 0.01 * f64::from(k)).unwrap();
    }
    let estimate = |shift: &str| {
        [3, 11, 25].iter().fold(String::new(), |text, k| {
            text + &format!(
                "{shift}{:.3} {}\n",
                100.004 + 0.01 * f64::from(*k),
                at(f64::from(*k))
            )
        })
    };
    std::fs::write(path("estimate.txt"), estimate("")).unwrap();
    std::fs::write(path("late.txt"), estimate("1000000")).unwrap();
    std::fs::write(path("truth.txt"), tum).unwrap();
    std::fs::write(path("truth.csv"), euroc).unwrap();
    std::fs::create_dir(path("kitti")).unwrap();
    std::fs::write(path("kitti/poses.txt"), &kitti).unwrap();
    let read = |name: &str| TimedPoses::read(&path(name)).unwrap();
    let compare = |name: &str, estimate: &str| {
        read(estimate)
            .compare_with(&read(name), TrajectoryAlignment::None)
            .unwrap()
    };
    let without_times =
        read("estimate.txt").compare_with(&read("kitti/poses.txt"), TrajectoryAlignment::None);
    assert!(without_times.unwrap_err().to_string().contains("times.txt"));
    // As many poses as the reference: by number.
    let same = read("truth.txt")
        .compare_with(&read("kitti/poses.txt"), TrajectoryAlignment::None)
        .unwrap();
    assert!(same.pairs == 30 && same.position.max < 1e-9);
    std::fs::write(path("kitti/times.txt"), times).unwrap();
    for (truth, estimate) in [
        ("truth.txt", "estimate.txt"),
        ("kitti/poses.txt", "estimate.txt"),
    ] {
        let found = compare(truth, estimate);
        assert_eq!((found.pairs, found.frames), (3, 30), "{truth}");
        assert!(
            (found.coverage - 0.1).abs() < 1e-12,
            "{truth}: {}",
            found.coverage
        );
        assert!(found.position.max < 1e-9, "{truth}");
    }
    assert_eq!(read("truth.csv").poses.len(), 30);
    let first = read("truth.csv").poses[0].0;
    assert_eq!(first, 1_000_000_100_000_000_000);
    let found = compare("truth.csv", "late.txt");
    assert!((found.coverage - 0.1).abs() < 1e-12, "{}", found.coverage);
}
