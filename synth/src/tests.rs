mod cameras;

use std::collections::BTreeMap;
use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::{Point2, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::noise::sensor_depth;
use super::write::write_selected;
use super::*;
use linecarve_mesh::raycast::RayScene;
use linecarve_sequence::{OpenOptions, Sequence};

fn small(scene: SceneKind) -> SynthOptions {
    SynthOptions {
        scene,
        frames: 3,
        width: 96,
        height: 72,
        ..SynthOptions::default()
    }
}

fn write(options: &SynthOptions, out: &Path) -> SynthSummary {
    write_sequence(options, out, &|_, _| {}).unwrap()
}

/// All files below a folder with their bytes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            for (inner, bytes) in contents(&path) {
                files.insert(format!("{name}/{inner}"), bytes);
            }
        } else {
            files.insert(name, std::fs::read(&path).unwrap());
        }
    }
    files
}

#[test]
fn depth_in_the_corner_is_that_of_the_three_planes() {
    let scene = Scene::corner();
    let options = small(SceneKind::Corner);
    let camera = options.camera().unwrap();
    let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);
    for pose in scene.poses(3, 5) {
        let photo = photographer.render(&pose);
        for (index, depth) in photo.depth.iter().enumerate() {
            let (x, y) = (index % 96, index / 96);
            let ray = Vector3::new(
                (x as f64 - camera.cx()) / camera.fx(),
                (y as f64 - camera.cy()) / camera.fy(),
                1.0,
            );
            let along = pose.rotation * ray;
            let eye = pose.translation.vector;
            // The nearest of the three planes along the ray at which the other coordinates lie within the walls.
            let expected = (0..3)
                .map(|axis| -eye[axis] / along[axis])
                .filter(|t| *t > 0.0)
                .filter(|t| (eye + along * *t).iter().all(|v| *v > -1e-9 && *v < 2.0))
                .min_by(f64::total_cmp);
            match (depth, expected) {
                (Some(depth), Some(expected)) => assert!((depth - expected).abs() < 1e-12),
                (found, expected) => assert_eq!(found.is_some(), expected.is_some()),
            }
        }
    }
}

#[test]
fn a_known_point_is_seen_where_the_pose_says() {
    let scene = Scene::corner();
    let options = small(SceneKind::Corner);
    let camera = options.camera().unwrap();
    let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);
    let mut compared = 0;
    for pose in scene.poses(3, 5) {
        let photo = photographer.render(&pose);
        for floor_point in [Point3::new(0.5, 0.6, 0.0), Point3::new(0.0, 0.4, 0.7)] {
            let in_camera = pose.inverse() * floor_point;
            let pixel = camera.project(&in_camera).unwrap();
            let (x, y) = (pixel.x.round(), pixel.y.round());
            if x < 0.0 || y < 0.0 || x > 95.0 || y > 71.0 {
                continue;
            }
            let depth = photo.depth[y as usize * 96 + x as usize].unwrap();
            // Half a pixel of a surface under 80 degrees at two metres.
            assert!(
                (depth - in_camera.z).abs() < 0.06,
                "{depth} {}",
                in_camera.z
            );
            compared += 1;
        }
    }
    assert!(compared >= 4);
}

#[test]
fn from_the_path_no_surface_is_seen_from_behind_and_the_room_has_no_hole() {
    for kind in SceneKind::ALL {
        let scene = Scene::new(kind);
        let mesh = scene.mesh();
        mesh.validate().unwrap();
        let rays = RayScene::new(&mesh);
        assert_eq!(rays.ignored_triangles(), 0);
        let mut random = ChaCha8Rng::seed_from_u64(9);
        for pose in scene.poses(20, 1) {
            let eye = Point3::from(pose.translation.vector);
            for _ in 0..500 {
                let direction = Vector3::from_fn(|_, _| random.random::<f64>() * 2.0 - 1.0);
                let hit = rays.cast(&eye, &direction, f64::INFINITY);
                if let Some(hit) = hit {
                    let point = eye + direction * hit.distance;
                    assert!(
                        hit.is_front_face,
                        "{kind:?}: the surface at {point} is turned away"
                    );
                } else {
                    let is_open = matches!(kind, SceneKind::Boxes | SceneKind::Corner);
                    assert!(is_open, "{kind:?}: a hole towards {direction}");
                }
            }
        }
    }
}

#[test]
fn the_path_keeps_away_from_everything() {
    for kind in SceneKind::ALL {
        let scene = Scene::new(kind);
        let rays = RayScene::new(&scene.mesh());
        // A walk of 36 metres.
        let frames = if kind == SceneKind::Walk { 1000 } else { 60 };
        let poses = scene.poses(frames, 3);
        for pair in poses.windows(2) {
            let eye = Point3::from(pair[0].translation.vector);
            assert!(
                rays.closest(&eye, 0.25).is_none(),
                "{kind:?}: too near at {eye}"
            );
            let step = (pair[1].translation.vector - pair[0].translation.vector).norm();
            let turn = pair[0].rotation.angle_to(&pair[1].rotation);
            assert!(step < 0.25 && turn < 0.25, "{kind:?}: {step} m, {turn} rad");
        }
    }
}

/// A wall across the view at a constant depth, with a step in the middle column.
fn stepped_wall(near: f64, far: f64) -> RenderedFrame {
    let (width, height) = (640_u32, 200_u32);
    let depth = (0..width * height)
        .map(|index| Some(if index % width < width / 2 { near } else { far }))
        .collect();
    RenderedFrame {
        width,
        height,
        light: vec![[0.5; 3]; (width * height) as usize],
        depth,
    }
}

#[test]
fn sensor_noise_has_the_statistics_of_its_model() {
    let step = 585.0 * 0.075 / 0.125;
    for (depth, strength) in [(1.5, 1.0), (3.0, 1.0), (3.0, 3.0)] {
        let photo = stepped_wall(depth, depth);
        let measured = sensor_depth(&photo, strength, 7, 0);
        let exact = step / depth;
        let errors: Vec<f64> = measured
            .iter()
            .map(|d| {
                let steps = step / d.expect("an even wall loses nothing");
                assert!(
                    (steps - steps.round()).abs() < 1e-9,
                    "disparity is in whole steps"
                );
                steps - exact
            })
            .collect();
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let deviation = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / count).sqrt();
        // One exact value is rounded always the same way: the distribution of round(exact + noise) is summed up.
        let sigma = strength / 6.0;
        let density = |x: f64| (-0.5 * (x / sigma).powi(2)).exp();
        let (mut total, mut first, mut second) = (0.0, 0.0, 0.0);
        for sample in -6000..=6000 {
            let x = f64::from(sample) / 1000.0 * sigma;
            let error = (exact + x).round() - exact;
            total += density(x);
            first += density(x) * error;
            second += density(x) * error * error;
        }
        let expected_mean = first / total;
        let expected_deviation = (second / total - expected_mean.powi(2)).sqrt();
        assert!(
            (mean - expected_mean).abs() < 0.01,
            "{mean} {expected_mean}"
        );
        assert!(
            (deviation - expected_deviation).abs() < 0.01,
            "{deviation} {expected_deviation}"
        );
    }
}

#[test]
fn the_sensor_loses_pixels_at_jumps_and_beyond_its_range_alone() {
    let photo = stepped_wall(1.0, 2.0);
    let measured = sensor_depth(&photo, 1.0, 7, 4);
    let lost_in = |columns: std::ops::Range<usize>| {
        let lost = measured
            .iter()
            .enumerate()
            .filter(|(index, depth)| columns.contains(&(index % 640)) && depth.is_none())
            .count();
        lost as f64 / (columns.len() * 200) as f64
    };
    assert_eq!(lost_in(0..310), 0.0);
    assert_eq!(lost_in(330..640), 0.0);
    assert!((lost_in(318..322) - 0.45).abs() < 0.06);
    for depth in [0.2, 7.0] {
        let nothing = sensor_depth(&stepped_wall(depth, depth), 1.0, 7, 0);
        assert!(nothing.iter().all(Option::is_none));
    }
    assert_eq!(measured, sensor_depth(&photo, 1.0, 7, 4));
    assert_ne!(measured, sensor_depth(&photo, 1.0, 7, 5));
    assert_ne!(measured, sensor_depth(&photo, 1.0, 8, 4));
}

#[test]
fn every_layout_is_read_back_as_it_was_rendered() {
    for layout in [
        SequenceLayout::Tum,
        SequenceLayout::SevenScenes,
        SequenceLayout::Open3d,
    ] {
        let folder = tempfile::tempdir().unwrap();
        let options = SynthOptions {
            layout,
            color: ColorFormat::Png,
            ..small(SceneKind::Boxes)
        };
        write(&options, folder.path());
        let sequence = Sequence::open(folder.path(), &OpenOptions::default()).unwrap();
        let scene = Scene::boxes();
        let camera = options.camera().unwrap();
        let poses = scene.poses(options.frames, options.seed);
        assert_eq!(sequence.frames().len(), poses.len());
        assert_eq!(sequence.color_camera(), &camera);
        assert!(sequence.depth_calibration().unwrap().registered);
        assert!(sequence.warnings().is_empty(), "{:?}", sequence.warnings());
        let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);
        for (index, pose) in poses.iter().enumerate() {
            let read = sequence.frames()[index].world_from_camera;
            assert!((read.translation.vector - pose.translation.vector).norm() < 1e-8);
            assert!(read.rotation.angle_to(&pose.rotation) < 1e-8);
            let photo = photographer.render(pose);
            let depth = sequence.load_depth(index).unwrap().unwrap();
            for (position, exact) in photo.depth.iter().enumerate() {
                let found = f64::from(*depth.get(position % 96, position / 96).unwrap());
                match exact {
                    Some(exact) => {
                        let half_step = 0.5 / layout.depth_scale();
                        assert!(
                            (found - exact).abs() <= half_step * 1.001,
                            "{found} {exact}"
                        );
                    }
                    None => assert!(found.is_nan() || found <= 0.0, "{found}"),
                }
            }
            let color = sequence.load_color(index).unwrap();
            assert_eq!(
                color,
                photo.color_image(1.0, 0.0, options.seed, index as u64)
            );
        }
    }
}

#[test]
fn threads_and_runs_do_not_change_a_byte_but_the_seed_does() {
    let options = SynthOptions {
        noise: DepthNoise::Kinect { strength: 1.0 },
        color_noise: 2.0,
        exposure_change: 0.2,
        ..small(SceneKind::Boxes)
    };
    let with_threads = |threads: usize, options: &SynthOptions| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| write(options, folder.path()));
        contents(folder.path())
    };
    let one = with_threads(1, &options);
    assert_eq!(one, with_threads(2, &options));
    let other = SynthOptions { seed: 2, ..options };
    let two = with_threads(2, &other);
    assert_ne!(one["depth/1.000000.png"], two["depth/1.000000.png"]);
    assert_ne!(one["groundtruth.txt"], two["groundtruth.txt"]);
    assert_eq!(one["ground-truth.ply"], two["ground-truth.ply"]);
}

#[test]
fn what_frames_observe_lies_on_the_surface_and_is_part_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let options = SynthOptions {
        frames: 12,
        ..small(SceneKind::Boxes)
    };
    let summary = write(&options, folder.path());
    // Undersides, backs and what others hide are not seen; tops and fronts are.
    assert!((0.3..0.8).contains(&summary.observed_share), "{summary:?}");
    let scene = Scene::boxes();
    let camera = Camera::pinhole(78.75, 78.75, 47.5, 35.5).unwrap();
    let rays = RayScene::new(&scene.mesh());
    let poses = scene.poses(12, 1);
    let observed = ground_truth::observed(&scene, &rays, &camera, (96, 72), &poses);
    assert_eq!(observed.share, summary.observed_share);
    for position in &observed.mesh.positions {
        assert!(rays.closest(position, 1e-9).is_some());
    }
    // Every exact depth lies near an observed piece: the two are decided apart from each other.
    let seen = RayScene::new(&observed.mesh);
    let photographer = FrameRenderer::new(&scene, &camera, 96, 72);
    let (mut near, mut all) = (0, 0);
    for pose in &poses {
        for (index, depth) in photographer.render(pose).depth.iter().enumerate() {
            let Some(depth) = depth else { continue };
            let pixel = Point2::new((index % 96) as f64, (index / 96) as f64);
            let direction = camera.unproject(&pixel).unwrap();
            let point = pose * Point3::from(direction * (depth / direction.z));
            all += 1;
            near += usize::from(seen.closest(&point, 0.05).is_some());
        }
    }
    assert!(near as f64 > 0.995 * f64::from(all), "{near} of {all}");
}

#[test]
fn bad_options_and_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |options: &SynthOptions| {
        write_sequence(options, folder.path(), &|_, _| {})
            .unwrap_err()
            .to_string()
    };
    let good = small(SceneKind::Corner);
    let with_frames = |frames| SynthOptions {
        frames,
        ..good.clone()
    };
    assert!(refused(&with_frames(0)).contains("frames = 0"));
    let focal = SynthOptions {
        focal_px: Some(f64::NAN),
        ..good.clone()
    };
    assert!(refused(&focal).contains("focal"));
    let noise = SynthOptions {
        noise: DepthNoise::Kinect { strength: f64::NAN },
        ..good.clone()
    };
    assert!(refused(&noise).contains("noise strength"));
    let quality = SynthOptions {
        color: ColorFormat::Jpeg { quality: 0 },
        ..good.clone()
    };
    assert!(refused(&quality).contains("quality"));
    let blur = SynthOptions {
        blur: 1.5,
        ..good.clone()
    };
    assert!(refused(&blur).contains("blur = 1.5"));
    let stereo = SynthOptions {
        stereo_baseline: Some(0.0),
        ..good.clone()
    };
    assert!(refused(&stereo).contains("stereo baseline = 0"));
    assert!(
        contents(folder.path()).is_empty(),
        "nothing is written before the options are checked"
    );
    std::fs::write(folder.path().join("mine.txt"), "keep").unwrap();
    assert!(refused(&good).contains("not empty"));
    assert_eq!(contents(folder.path()).len(), 1);
    let file = folder.path().join("mine.txt");
    let error = write_sequence(&good, &file, &|_, _| {}).unwrap_err();
    assert!(error.to_string().contains("mine.txt"));
}

#[test]
fn the_command_line_names_what_differs_from_the_defaults() {
    assert_eq!(
        SynthOptions::default().command_line(),
        "linecarve synth room --frames 36 --seed 1 --out DIR"
    );
    let options = SynthOptions {
        noise: DepthNoise::Kinect { strength: 2.0 },
        layout: SequenceLayout::SevenScenes,
        ..small(SceneKind::Boxes)
    };
    assert_eq!(
        options.command_line(),
        "linecarve synth boxes --frames 3 --seed 1 --size 96x72 --layout 7-scenes --noise kinect \
         --noise-strength 2.0 --out DIR"
    );
    let options = SynthOptions {
        blur: 0.5,
        rolling_shutter: 0.25,
        stereo_baseline: Some(0.1),
        ..small(SceneKind::Room)
    };
    assert_eq!(
        options.command_line(),
        "linecarve synth room --frames 3 --seed 1 --size 96x72 --blur 0.5 --rolling-shutter 0.25 --stereo 0.1 --out DIR"
    );
}

/// The sample that the README reconstructs is what its command renders: all lists and meshes, and two of its frames.
#[test]
fn the_sample_is_what_its_command_renders() {
    let sample = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/room"));
    if !sample.exists() {
        println!("skipped: a packaged crate has no sample");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let selected = [7, 23];
    let is_selected = |frame: usize| selected.contains(&frame);
    let options = SynthOptions {
        color: ColorFormat::Jpeg { quality: 85 },
        ..SynthOptions::default()
    };
    write_selected(&options, folder.path(), &is_selected, &|_, _| {}).unwrap();
    let (expected, rendered) = (contents(sample), contents(folder.path()));
    for (name, bytes) in &rendered {
        assert!(expected.get(name) == Some(bytes), "{name} differs");
    }
    let is_image = |name: &&String| name.ends_with(".jpg") || name.ends_with(".png");
    assert_eq!(rendered.keys().filter(is_image).count(), 2 * selected.len());
    let lists =
        |files: &BTreeMap<String, Vec<u8>>| files.keys().filter(|name| !is_image(name)).count();
    assert_eq!(lists(&rendered), lists(&expected));
    assert_eq!(expected.keys().filter(is_image).count(), 2 * 36);
    let size: usize = expected.values().map(Vec::len).sum();
    assert!(size < 6_000_000, "{size} bytes");
}
