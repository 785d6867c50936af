//! Writers of small sequences in the layouts of SLAM systems and structure from motion: the scene of `support`, with points
//! on its back wall.

use std::fmt::Write;
use std::path::Path;

use nalgebra::{Isometry3, Point3};

use super::support::{FOCAL, SIZE, color_image, depth_image, poses};

/// Principal point; the centre of the first pixel is (0, 0).
const CENTRE: [f64; 2] = [(SIZE.0 as f64 - 1.0) / 2.0, (SIZE.1 as f64 - 1.0) / 2.0];

/// Number of frames of each sequence.
pub(crate) const FRAMES: usize = 6;

/// Time of a frame in nanoseconds.
pub(crate) fn stamp_ns(i: usize) -> i64 {
    1_403_715_274_312_143_104 + 50_000_000 * i as i64
}

/// Points of the back wall.
pub(crate) fn points() -> Vec<Point3<f64>> {
    (0..40)
        .map(|i| {
            let (column, row) = (i % 8, i / 8);
            Point3::new(
                -1.2 + 0.35 * f64::from(column),
                -1.0 + 0.45 * f64::from(row),
                3.0,
            )
        })
        .collect()
}

/// Index and pixel of the points observed from a pose.
fn seen(pose: &Isometry3<f64>) -> Vec<(usize, [f64; 2])> {
    points()
        .iter()
        .enumerate()
        .filter_map(|(index, point)| {
            let p = pose.inverse() * point;
            let [x, y] = [FOCAL * p.x / p.z + CENTRE[0], FOCAL * p.y / p.z + CENTRE[1]];
            let inside = p.z > 0.0
                && (0.0..f64::from(SIZE.0 - 1)).contains(&x)
                && (0.0..f64::from(SIZE.1 - 1)).contains(&y);
            inside.then_some((index, [x, y]))
        })
        .collect()
}

pub(crate) fn write_images(folder: &Path, names: &[String]) {
    std::fs::create_dir_all(folder).unwrap();
    for (name, pose) in names.iter().zip(poses(names.len())) {
        color_image(&pose).save(folder.join(name)).unwrap();
    }
}

fn plain_names() -> Vec<String> {
    (0..FRAMES).map(|i| format!("view{i}.png")).collect()
}

fn camera_line(model: &str, extra: &str) -> String {
    format!(
        "1 {model} {} {} {FOCAL} {FOCAL} {} {}{extra}\n",
        SIZE.0,
        SIZE.1,
        CENTRE[0] + 0.5,
        CENTRE[1] + 0.5
    )
}

/// COLMAP as text, ids neither contiguous nor sorted.
pub(crate) fn write_colmap_text(folder: &Path) {
    write_images(&folder.join("images"), &plain_names());
    let model = folder.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    let mut images = "# two lines an image\n".to_owned();
    let mut tracks = vec![String::new(); points().len()];
    for (i, pose) in poses(FRAMES).iter().enumerate().rev() {
        let camera = pose.inverse();
        let (q, t) = (camera.rotation.coords, camera.translation.vector);
        writeln!(
            images,
            "{} {} {} {} {} {} {} {} 1 view{i}.png",
            10 * i + 7,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z
        )
        .unwrap();
        images += "1.5 2.5 -1";
        for (place, (index, [x, y])) in seen(pose).into_iter().enumerate() {
            write!(images, " {} {} {}", x + 0.5, y + 0.5, 100 + index).unwrap();
            write!(tracks[index], " {} {}", 10 * i + 7, place + 1).unwrap();
        }
        images += "\n";
    }
    let mut text = String::new();
    for (index, (point, track)) in points().iter().zip(&tracks).enumerate() {
        let (x, y, z) = (point.x, point.y, point.z);
        writeln!(text, "{} {x} {y} {z} 10 20 30 0.5{track}", 100 + index).unwrap();
    }
    std::fs::write(model.join("cameras.txt"), camera_line("PINHOLE", "")).unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), text).unwrap();
}

/// COLMAP as binary files, beside text files that must not be looked at, with rigs and frames of newer versions.
pub(crate) fn write_colmap_binary(folder: &Path) {
    write_images(folder, &plain_names());
    let model = folder.join("colmap");
    std::fs::create_dir_all(&model).unwrap();
    let mut cameras = Vec::new();
    cameras.extend(1_u64.to_le_bytes());
    cameras.extend(5_u32.to_le_bytes());
    cameras.extend(1_u32.to_le_bytes());
    for side in [SIZE.0, SIZE.1] {
        cameras.extend(u64::from(side).to_le_bytes());
    }
    for value in [FOCAL, FOCAL, CENTRE[0] + 0.5, CENTRE[1] + 0.5] {
        cameras.extend(value.to_le_bytes());
    }
    let mut images = (FRAMES as u64).to_le_bytes().to_vec();
    let mut tracks: Vec<Vec<(u32, u32)>> = vec![Vec::new(); points().len()];
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        let camera = pose.inverse();
        let (q, t) = (camera.rotation.coords, camera.translation.vector);
        images.extend((i as u32 + 1).to_le_bytes());
        for value in [q.w, q.x, q.y, q.z, t.x, t.y, t.z] {
            images.extend(value.to_le_bytes());
        }
        images.extend(5_u32.to_le_bytes());
        images.extend(format!("view{i}.png\0").bytes());
        let seen = seen(pose);
        images.extend((seen.len() as u64 + 1).to_le_bytes());
        for value in [1.0_f64, 2.0] {
            images.extend(value.to_le_bytes());
        }
        images.extend(u64::MAX.to_le_bytes());
        for (place, (index, [x, y])) in seen.into_iter().enumerate() {
            for value in [x + 0.5, y + 0.5] {
                images.extend(value.to_le_bytes());
            }
            images.extend((100 + index as u64).to_le_bytes());
            tracks[index].push((i as u32 + 1, place as u32 + 1));
        }
    }
    let mut text = (points().len() as u64).to_le_bytes().to_vec();
    for (index, (point, track)) in points().iter().zip(&tracks).enumerate() {
        text.extend((100 + index as u64).to_le_bytes());
        for value in [point.x, point.y, point.z] {
            text.extend(value.to_le_bytes());
        }
        text.extend([10, 20, 30]);
        text.extend(0.5_f64.to_le_bytes());
        text.extend((track.len() as u64).to_le_bytes());
        for (image, place) in track {
            text.extend(image.to_le_bytes());
            text.extend(place.to_le_bytes());
        }
    }
    std::fs::write(model.join("cameras.bin"), cameras).unwrap();
    std::fs::write(model.join("images.bin"), images).unwrap();
    std::fs::write(model.join("points3D.bin"), text).unwrap();
    for name in ["cameras.txt", "images.txt", "rigs.bin", "frames.bin"] {
        std::fs::write(model.join(name), "not looked at").unwrap();
    }
}

/// VisualSFM, with names that hold blanks and measurements relative to the middle.
pub(crate) fn write_nvm(folder: &Path) {
    let names: Vec<String> = (0..FRAMES).map(|i| format!("my view {i}.png")).collect();
    write_images(folder, &names);
    let mut text = format!("NVM_V3\n\n{FRAMES}\n");
    for (name, pose) in names.iter().zip(poses(FRAMES)) {
        let q = pose.rotation.inverse().coords;
        let c = pose.translation.vector;
        writeln!(
            text,
            "{name}\t{FOCAL} {} {} {} {} {} {} {} 0 0",
            q.w, q.x, q.y, q.z, c.x, c.y, c.z
        )
        .unwrap();
    }
    writeln!(text, "\n{}", points().len()).unwrap();
    for (index, point) in points().iter().enumerate() {
        let mut measurements = Vec::new();
        for (i, pose) in poses(FRAMES).iter().enumerate() {
            for (_, [x, y]) in seen(pose).into_iter().filter(|(at, _)| *at == index) {
                let (x, y) = (x - CENTRE[0], y - CENTRE[1]);
                measurements.push(format!("{i} 0 {x} {y}"));
            }
        }
        let (x, y, z) = (point.x, point.y, point.z);
        let count = measurements.len();
        writeln!(
            text,
            "{x} {y} {z} 10 20 30 {count} {}",
            measurements.join(" ")
        )
        .unwrap();
    }
    text += "\n0\n";
    std::fs::write(folder.join("model.nvm"), text).unwrap();
}

/// OpenMVS, the camera mounted off the platform.
pub(crate) fn write_mvs(folder: &Path) {
    let names: Vec<String> = (0..FRAMES).map(|i| format!("{i:05}.png")).collect();
    write_images(&folder.join("images"), &names);
    let mut out = b"MVSI".to_vec();
    for value in [3_u32, 0] {
        out.extend(value.to_le_bytes());
    }
    let text = |out: &mut Vec<u8>, text: &str| {
        out.extend((text.len() as u64).to_le_bytes());
        out.extend(text.bytes());
    };
    let numbers = |out: &mut Vec<u8>, values: &[f64]| {
        for value in values {
            out.extend(value.to_le_bytes());
        }
    };
    out.extend(1_u64.to_le_bytes());
    text(&mut out, "platform");
    out.extend(1_u64.to_le_bytes());
    text(&mut out, "camera");
    out.extend(SIZE.0.to_le_bytes());
    out.extend(SIZE.1.to_le_bytes());
    numbers(
        &mut out,
        &[FOCAL, 0.0, CENTRE[0], 0.0, FOCAL, CENTRE[1], 0.0, 0.0, 1.0],
    );
    numbers(&mut out, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let mount = Isometry3::translation(0.5, 0.0, 0.0);
    numbers(&mut out, &[0.5, 0.0, 0.0]);
    out.extend((FRAMES as u64).to_le_bytes());
    for pose in poses(FRAMES) {
        let platform = pose * mount.inverse();
        let rotation = platform.rotation.inverse().to_rotation_matrix();
        let rows: Vec<f64> = rotation.matrix().transpose().iter().copied().collect();
        numbers(&mut out, &rows);
        numbers(&mut out, platform.translation.vector.as_slice());
    }
    out.extend((FRAMES as u64).to_le_bytes());
    for (i, name) in (0_u32..).zip(&names) {
        text(&mut out, &format!("images/{name}"));
        for value in [0, 0, i, i] {
            out.extend(value.to_le_bytes());
        }
    }
    out.extend((points().len() as u64).to_le_bytes());
    for (index, point) in points().iter().enumerate() {
        for value in [point.x, point.y, point.z] {
            out.extend((value as f32).to_le_bytes());
        }
        let views: Vec<u32> = (0_u32..)
            .zip(poses(FRAMES))
            .filter(|(_, pose)| seen(pose).iter().any(|(at, _)| *at == index))
            .map(|(i, _)| i)
            .collect();
        out.extend((views.len() as u64).to_le_bytes());
        for view in views {
            out.extend(view.to_le_bytes());
            out.extend(1_f32.to_le_bytes());
        }
    }
    out.extend(0_u64.to_le_bytes());
    out.extend((points().len() as u64).to_le_bytes());
    for _ in points() {
        out.extend([30, 20, 10]);
    }
    std::fs::write(folder.join("scene.mvs"), out).unwrap();
}

/// nerfstudio, with depth, one file named without its extension.
pub(crate) fn write_transforms(folder: &Path) {
    write_images(&folder.join("images"), &plain_names());
    std::fs::create_dir_all(folder.join("depth")).unwrap();
    let mut frames = Vec::new();
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        depth_image(pose, 1000.0)
            .save(folder.join(format!("depth/{i}.png")))
            .unwrap();
        let mut matrix = pose.to_homogeneous();
        for column in [1, 2] {
            matrix.column_mut(column).scale_mut(-1.0);
        }
        let rows: Vec<String> = matrix
            .row_iter()
            .map(|row| format!("[{}, {}, {}, {}]", row[0], row[1], row[2], row[3]))
            .collect();
        let name = if i == 2 {
            "view2".to_owned()
        } else {
            format!("view{i}.png")
        };
        frames.push(format!(
            "{{\"file_path\": \"./images/{name}\", \"depth_file_path\": \"depth/{i}.png\", \"transform_matrix\": [{}]}}",
            rows.join(", ")
        ));
    }
    let text = format!(
        "{{\"camera_model\": \"OPENCV\", \"fl_x\": {FOCAL}, \"fl_y\": {FOCAL}, \"cx\": {}, \"cy\": {}, \"w\": {}, \"h\": {},\n\
         \"depth_unit_scale_factor\": 0.001,\n\"frames\": [\n{}\n]}}",
        CENTRE[0] + 0.5,
        CENTRE[1] + 0.5,
        SIZE.0,
        SIZE.1,
        frames.join(",\n")
    );
    std::fs::write(folder.join("transforms.json"), text).unwrap();
}

/// stella_vslam, key points and landmarks included.
pub(crate) fn write_stella(folder: &Path) {
    use rmpv::Value;
    let names: Vec<String> = (0..FRAMES)
        .map(|i| format!("{}.png", stamp_ns(i)))
        .collect();
    write_images(&folder.join("images"), &names);
    let table = |entries: Vec<(String, Value)>| {
        Value::Map(
            entries
                .into_iter()
                .map(|(key, value)| (Value::from(key), value))
                .collect(),
        )
    };
    let list = |values: &[f64]| Value::Array(values.iter().map(|v| Value::from(*v)).collect());
    let camera = table(vec![
        ("model_type".into(), Value::from("Perspective")),
        ("cols".into(), Value::from(SIZE.0)),
        ("rows".into(), Value::from(SIZE.1)),
        ("fx".into(), Value::from(FOCAL)),
        ("fy".into(), Value::from(FOCAL)),
        ("cx".into(), Value::from(CENTRE[0])),
        ("cy".into(), Value::from(CENTRE[1])),
    ]);
    let keyframes = poses(FRAMES)
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let camera = pose.inverse();
            let seen = seen(pose);
            let key_points = seen
                .iter()
                .map(|(_, pixel)| table(vec![("pt".into(), list(pixel))]))
                .collect();
            let ids = seen.iter().map(|(index, _)| Value::from(*index as i64));
            let ids = ids.chain([Value::from(-1)]).collect();
            let entry = table(vec![
                ("ts".into(), Value::from(stamp_ns(i) as f64 / 1e9)),
                ("cam".into(), Value::from("left")),
                ("rot_cw".into(), list(camera.rotation.coords.as_slice())),
                (
                    "trans_cw".into(),
                    list(camera.translation.vector.as_slice()),
                ),
                ("undist_keypts".into(), Value::Array(key_points)),
                ("lm_ids".into(), Value::Array(ids)),
            ]);
            (format!("{}", 3 * i), entry)
        })
        .collect();
    let landmarks = points()
        .iter()
        .enumerate()
        .map(|(i, point)| {
            let entry = table(vec![("pos_w".into(), list(point.coords.as_slice()))]);
            (i.to_string(), entry)
        })
        .collect();
    let map = table(vec![
        ("cameras".into(), table(vec![("left".into(), camera)])),
        ("keyframes".into(), table(keyframes)),
        ("landmarks".into(), table(landmarks)),
    ]);
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, &map).unwrap();
    std::fs::write(folder.join("map.msg"), bytes).unwrap();
}

/// ORB-SLAM3: keyframes in nanoseconds, settings of its first version, points without what sees them.
pub(crate) fn write_orb_slam(folder: &Path) {
    let names: Vec<String> = (0..FRAMES)
        .map(|i| format!("{}.png", stamp_ns(i)))
        .collect();
    write_images(&folder.join("rgb"), &names);
    let mut text = String::new();
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        writeln!(
            text,
            "{}.000000 {} {} {} {} {} {} {}",
            stamp_ns(i),
            t.x,
            t.y,
            t.z,
            q.x,
            q.y,
            q.z,
            q.w
        )
        .unwrap();
    }
    std::fs::write(folder.join("kf_run.txt"), text).unwrap();
    let settings = format!(
        "%YAML:1.0\n---\nFile.version: \"1.0\"\nCamera.type: \"PinHole\"\nCamera1.fx: {FOCAL:?}\nCamera1.fy: {FOCAL:?}\n\
         Camera1.cx: {:?}\nCamera1.cy: {:?}\nCamera1.k1: 0.0\nCamera.width: {}\nCamera.height: {}\n\
         RGBD.DepthMapFactor: 5000.0\nT: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: f\n   data: [1.0]\n",
        CENTRE[0], CENTRE[1], SIZE.0, SIZE.1
    );
    std::fs::write(folder.join("settings.yaml"), settings).unwrap();
}

/// EuRoC with the ground truth of a body that is not the camera.
pub(crate) fn write_euroc(folder: &Path) {
    let camera = folder.join("mav0/cam0");
    let names: Vec<String> = (0..FRAMES)
        .map(|i| format!("{}.png", stamp_ns(i)))
        .collect();
    write_images(&camera.join("data"), &names);
    let list: String = (0..FRAMES)
        .map(|i| format!("{0},{0}.png\n", stamp_ns(i)))
        .collect();
    std::fs::write(
        camera.join("data.csv"),
        format!("#timestamp [ns],filename\n{list}"),
    )
    .unwrap();
    let body_from_camera = body_from_camera();
    let rows: Vec<String> = body_from_camera
        .to_homogeneous()
        .transpose()
        .iter()
        .map(|v| format!("{v:?}"))
        .collect();
    let sensor = format!(
        "%YAML:1.0\n# camera\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\nrate_hz: 20\n\
         resolution: [{}, {}]\ncamera_model: pinhole\nintrinsics: [{FOCAL:?}, {FOCAL:?}, {:?}, {:?}] #fu, fv, cu, cv\n\
         distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n",
        rows.join(", "),
        SIZE.0,
        SIZE.1,
        CENTRE[0],
        CENTRE[1]
    );
    std::fs::write(camera.join("sensor.yaml"), sensor).unwrap();
    let truth = folder.join("mav0/state_groundtruth_estimate0");
    std::fs::create_dir_all(&truth).unwrap();
    let mut text = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
        .to_owned();
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        let body = pose * body_from_camera.inverse();
        let (t, q) = (body.translation.vector, body.rotation.coords);
        writeln!(
            text,
            "{},{},{},{},{},{},{},{},0,0,0,0,0,0,0,0,0",
            stamp_ns(i) + 3_000_000,
            t.x,
            t.y,
            t.z,
            q.w,
            q.x,
            q.y,
            q.z
        )
        .unwrap();
    }
    std::fs::write(truth.join("data.csv"), text).unwrap();
}

/// How the camera of [`write_euroc`] is mounted.
pub(crate) fn body_from_camera() -> Isometry3<f64> {
    Isometry3::new(
        nalgebra::Vector3::new(0.05, -0.02, 0.01),
        nalgebra::Vector3::new(0.0, 0.1, 1.5),
    )
}

/// Distance between the cameras of [`write_kitti`].
pub(crate) const BASELINE: f64 = 0.25;

/// KITTI odometry with grey and colour pairs; the left colour camera is not at the origin of the poses.
pub(crate) fn write_kitti(folder: &Path) {
    let names: Vec<String> = (0..FRAMES).map(|i| format!("{i:06}.png")).collect();
    let mut calibration = String::new();
    for (camera, shift) in [0.0, -BASELINE, 0.06, 0.06 - BASELINE].iter().enumerate() {
        let images = folder.join(format!("image_{camera}"));
        std::fs::create_dir_all(&images).unwrap();
        for (name, pose) in names.iter().zip(poses(FRAMES)) {
            let displaced = pose * Isometry3::translation(-shift, 0.0, 0.0);
            color_image(&displaced).save(images.join(name)).unwrap();
        }
        writeln!(
            calibration,
            "P{camera}: {FOCAL:e} 0 {} {:e} 0 {FOCAL:e} {} 0 0 0 1 0",
            CENTRE[0],
            FOCAL * shift,
            CENTRE[1]
        )
        .unwrap();
    }
    calibration += "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n";
    std::fs::write(folder.join("calib.txt"), calibration).unwrap();
    let times: String = (0..FRAMES)
        .map(|i| format!("{:e}\n", 0.1 * i as f64))
        .collect();
    std::fs::write(folder.join("times.txt"), times).unwrap();
    let rows: String = poses(FRAMES)
        .iter()
        .map(|pose| {
            let matrix = pose.to_homogeneous().transpose();
            let row: Vec<String> = matrix.iter().take(12).map(|v| format!("{v:e}")).collect();
            row.join(" ") + "\n"
        })
        .collect();
    std::fs::write(folder.join("poses.txt"), rows).unwrap();
}

/// Numbered images, depth, and a trajectory without stamps; the camera in a sidecar.
pub(crate) fn write_pose_list(folder: &Path) {
    let names: Vec<String> = (1..=FRAMES).map(|i| format!("{i}.png")).collect();
    write_images(&folder.join("color"), &names);
    std::fs::create_dir_all(folder.join("depth")).unwrap();
    let mut text = String::new();
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        depth_image(pose, 1000.0)
            .save(folder.join(format!("depth/{}.png", i + 1)))
            .unwrap();
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        writeln!(
            text,
            "{} {} {} {} {} {} {}",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w
        )
        .unwrap();
    }
    std::fs::write(folder.join("pose.txt"), text).unwrap();
    std::fs::write(folder.join("linecarve.toml"), super::support::sidecar()).unwrap();
}
