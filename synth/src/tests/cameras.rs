//! Shutters that take time, and right cameras.

use super::*;

/// A shutter that takes half of the time between frames to go from the first row to the last.
#[test]
fn each_row_of_a_rolling_shutter_has_its_own_pose() {
    let folder = tempfile::tempdir().unwrap();
    let options = SynthOptions {
        rolling_shutter: 0.5,
        color: ColorFormat::Png,
        ..small(SceneKind::Boxes)
    };
    write(&options, folder.path());
    let scene = Scene::new(SceneKind::Boxes);
    let camera = options.camera().unwrap();
    let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);
    let motion = scene.motion(options.frames, options.seed);
    let sequence = Sequence::open(folder.path(), &OpenOptions::default()).unwrap();
    let image = sequence.load_color(1).unwrap();
    let mut differ = 0;
    for row in [0, 20, 71] {
        let time = 1.0 + 0.5 * ((f64::from(row) + 0.5) / 72.0 - 0.5);
        let expected = photographer
            .render(&motion.at(time))
            .color_image(1.0, 0.0, 1, 1);
        let middle = photographer
            .render(&motion.at(1.0))
            .color_image(1.0, 0.0, 1, 1);
        for x in 0..96 {
            // Next to another surface a row is sampled with its neighbours, which have other poses.
            let steps = |a: &image::Rgb<u8>| {
                let pairs = a.0.iter().zip(image.get_pixel(x, row).0);
                pairs.map(|(a, b)| a.abs_diff(b)).max().unwrap()
            };
            assert!(steps(expected.get_pixel(x, row)) <= 1, "pixel {x} {row}");
            differ += usize::from(steps(middle.get_pixel(x, row)) > 4);
        }
    }
    assert!(differ > 20, "{differ} pixels are elsewhere");
}

#[test]
fn motion_blurs_images_and_keeps_depth_and_brightness() {
    let [sharp, blurred] = [0.0, 1.0].map(|blur| {
        let folder = tempfile::tempdir().unwrap();
        let options = SynthOptions {
            blur,
            frames: 8,
            color: ColorFormat::Png,
            ..small(SceneKind::Boxes)
        };
        write(&options, folder.path());
        let sequence = Sequence::open(folder.path(), &OpenOptions::default()).unwrap();
        let image = sequence.load_gray(3).unwrap();
        let (mut sum, mut steps) = (0.0, 0.0);
        for (y, x) in (0..72).flat_map(|y| (1..96).map(move |x| (y, x))) {
            let at = |x: usize| f64::from(image.samples()[y * 96 + x]);
            sum += at(x);
            steps += (at(x) - at(x - 1)).abs();
        }
        (sum, steps, contents(&folder.path().join("depth")))
    });
    assert_eq!(sharp.2, blurred.2);
    assert!((blurred.0 / sharp.0 - 1.0).abs() < 0.02);
    assert!(blurred.1 < 0.8 * sharp.1, "{} {}", blurred.1, sharp.1);
}

#[test]
fn stereo_pairs_open_as_kitti_with_their_baseline() {
    let folder = tempfile::tempdir().unwrap();
    let options = SynthOptions {
        stereo_baseline: Some(0.25),
        color: ColorFormat::Png,
        ..small(SceneKind::Boxes)
    };
    let summary = write(&options, folder.path());
    assert_eq!(summary.depth_share, 0.0);
    let sequence = Sequence::open(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(sequence.layout(), "kitti");
    let pair = sequence.stereo().unwrap();
    assert!((pair.baseline() - 0.25).abs() < 1e-12);
    let scene = Scene::new(SceneKind::Boxes);
    let poses = scene.poses(3, 1);
    for (frame, pose) in sequence.frames().iter().zip(&poses) {
        let error = pose.inverse() * frame.world_from_camera;
        assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9);
    }
    let camera = options.camera().unwrap();
    let photographer = FrameRenderer::new(&scene, &camera, 96, 72);
    let right = poses[2] * nalgebra::Isometry3::translation(0.25, 0.0, 0.0);
    let expected = photographer.render(&right).color_image(1.0, 0.0, 2, 2);
    let written = image::open(folder.path().join("image_1/000002.png")).unwrap();
    let pairs = expected.iter().zip(written.to_rgb8().into_raw());
    let most = pairs.map(|(a, b)| a.abs_diff(b)).max();
    assert!(most <= Some(1), "{most:?}");
}
