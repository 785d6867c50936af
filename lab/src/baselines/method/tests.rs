use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::*;
use linecarve_lines::depth::{InverseDepth, InverseDepthMap};

const METHODS: [Method; 4] = [
    Method::EdgeAided,
    Method::Decoupled,
    Method::Matched,
    Method::Points,
];

fn camera() -> Camera {
    Camera::pinhole(140.0, 140.0, 79.5, 59.5).unwrap()
}

/// A dark panel on a bright wall; inverse depth is that of a slanted plane.
fn slanted_panel() -> (GrayImage, InverseDepthMap) {
    let (width, height) = (160, 120);
    let is_panel = |x: usize, y: usize| (40..120).contains(&x) && (30..90).contains(&y);
    let samples = (0..width * height).map(|i| {
        if is_panel(i % width, i / width) {
            60
        } else {
            190
        }
    });
    let image = GrayImage::new(width, height, samples.collect()).unwrap();
    let mut map = InverseDepthMap::unknown(width, height).unwrap();
    for y in 0..height {
        for x in 0..width {
            map.set(x, y, InverseDepth::new(plane_rho(x as f64, y as f64), 1e-3));
        }
    }
    (image, map)
}

fn plane_rho(x: f64, y: f64) -> f32 {
    (0.4 + 0.001 * x - 0.0005 * y) as f32
}

fn keyframe<'a>(
    image: &'a GrayImage,
    depth: Option<&'a InverseDepthMap>,
    camera: &'a Camera,
    number: u32,
) -> PosedKeyframe<'a> {
    PosedKeyframe {
        number,
        image,
        rgb: None,
        depth,
        camera,
        world_from_camera: Isometry3::from_parts(
            Translation3::new(5.0, -2.0, 1.0),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.4, 0.1)),
        ),
    }
}

#[test]
fn segments_and_points_lie_on_the_plane_whose_depth_they_were_given() {
    let (image, map) = slanted_panel();
    let camera = camera();
    let keyframe = keyframe(&image, Some(&map), &camera, 3);
    for method in [Method::EdgeAided, Method::Decoupled, Method::Points] {
        let mut findings = Findings::default();
        let mut run = method.build(&MethodOptions::default()).unwrap();
        run.add(&keyframe, &mut findings).unwrap();
        run.finish(&mut findings);
        let ends = findings.segments.iter().flat_map(|s| s.ends_in_world);
        let all: Vec<_> = ends
            .chain(findings.points.iter().map(|p| p.point_in_world))
            .collect();
        for point in &all {
            let in_camera = keyframe.world_from_camera.inverse_transform_point(point);
            let pixel = camera.project(&in_camera).unwrap();
            let rho = f64::from(plane_rho(pixel.x, pixel.y));
            // Depth is that of a whole pixel, the edge runs up to half a pixel beside its centre.
            let slack = 0.5 * (0.001 + 0.0005) + 1e-6;
            assert!((1.0 / in_camera.z - rho).abs() < slack, "{method} {pixel}");
        }
        if method == Method::Points {
            assert!(findings.segments.is_empty() && all.len() > 250);
            assert!(
                findings
                    .points
                    .iter()
                    .all(|p| p.gray == 60 || p.gray == 190)
            );
        } else {
            assert_eq!(findings.segments.len(), 4, "{method}");
            assert!(findings.segments.iter().all(|s| s.keyframe == Some(3)));
        }
        assert!(!findings.stages.is_empty());
    }
}

#[test]
fn a_step_in_depth_under_a_straight_edge_does_not_bend_the_segment() {
    let (image, mut map) = slanted_panel();
    // A quarter of the depths along the upper side belong to something far behind.
    for y in 20..40 {
        for x in 40..60 {
            map.set(x, y, InverseDepth::new(0.1, 1e-3));
        }
    }
    let camera = camera();
    let keyframe = keyframe(&image, Some(&map), &camera, 0);
    let mut findings = Findings::default();
    let mut run = Method::Decoupled.build(&MethodOptions::default()).unwrap();
    run.add(&keyframe, &mut findings).unwrap();
    assert_eq!(findings.segments.len(), 4);
    for point in findings.segments.iter().flat_map(|s| s.ends_in_world) {
        let in_camera = keyframe.world_from_camera.inverse_transform_point(&point);
        let pixel = camera.project(&in_camera).unwrap();
        let rho = f64::from(plane_rho(pixel.x, pixel.y));
        assert!((1.0 / in_camera.z - rho).abs() < 0.01 * rho, "{pixel}");
    }
}

#[test]
fn nothing_to_see_is_no_error_and_yields_nothing() {
    let camera = camera();
    for (width, height) in [(0, 0), (2, 2), (160, 120)] {
        for value in [0, 255] {
            let image = GrayImage::new(width, height, vec![value; width * height]).unwrap();
            let map = InverseDepthMap::unknown(width, height).unwrap();
            for method in METHODS {
                let mut findings = Findings::default();
                let mut run = method.build(&MethodOptions::default()).unwrap();
                for number in 0..4 {
                    let keyframe = keyframe(&image, Some(&map), &camera, number);
                    run.add(&keyframe, &mut findings).unwrap();
                }
                run.finish(&mut findings);
                assert!(findings.segments.is_empty() && findings.points.is_empty());
            }
        }
    }
}

#[test]
fn one_keyframe_has_nothing_to_be_matched_with() {
    let (image, map) = slanted_panel();
    let camera = camera();
    let mut run = Method::Matched.build(&MethodOptions::default()).unwrap();
    let mut findings = Findings::default();
    run.finish(&mut findings);
    run.add(&keyframe(&image, Some(&map), &camera, 0), &mut findings)
        .unwrap();
    run.finish(&mut findings);
    // The same place over and over has no baseline.
    for number in 0..5 {
        run.add(&keyframe(&image, None, &camera, number), &mut findings)
            .unwrap();
    }
    run.finish(&mut findings);
    assert!(findings.segments.is_empty());
}

#[test]
fn what_is_lacking_is_named() {
    let (image, map) = slanted_panel();
    let camera = camera();
    let fisheye = camera_with_distortion();
    let small = InverseDepthMap::unknown(10, 10).unwrap();
    let mut findings = Findings::default();
    for method in METHODS {
        let mut run = method.build(&MethodOptions::default()).unwrap();
        let without = run.add(&keyframe(&image, None, &camera, 7), &mut findings);
        if method.needs_depth() {
            let message = without.unwrap_err().to_string();
            assert!(
                message.contains("keyframe 7") && message.contains(&method.to_string()),
                "{message}"
            );
            let other = run.add(&keyframe(&image, Some(&small), &camera, 8), &mut findings);
            assert!(matches!(other, Err(MethodError::Size { keyframe: 8, .. })));
        } else {
            without.unwrap();
        }
        let distorted = run.add(&keyframe(&image, Some(&map), &fisheye, 9), &mut findings);
        assert!(distorted.unwrap_err().to_string().contains("undistort"));
        let mut lost = keyframe(&image, Some(&map), &camera, 2);
        lost.world_from_camera.translation.vector.x = f64::NAN;
        assert_eq!(
            run.add(&lost, &mut findings),
            Err(MethodError::Pose { keyframe: 2 })
        );
    }
}

fn camera_with_distortion() -> Camera {
    use linecarve_lines::camera::Distortion;
    let distortion = Distortion::RadialTangential {
        k1: -0.2,
        k2: 0.05,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };
    Camera::with_distortion(140.0, 140.0, 79.5, 59.5, distortion).unwrap()
}

#[test]
fn options_out_of_range_are_named_with_their_method() {
    let mut options = MethodOptions::default();
    options.matched.minimum_views = 2;
    options.decoupled.depth_tolerance = f64::NAN;
    options.points.minimum_gradient = -1.0;
    for (method, name) in [
        (Method::Matched, "minimum_views"),
        (Method::Decoupled, "depth_tolerance"),
        (Method::Points, "minimum_gradient"),
    ] {
        let message = method.build(&options).err().unwrap().to_string();
        assert!(
            message.contains(name) && message.contains(&method.to_string()),
            "{message}"
        );
    }
}
