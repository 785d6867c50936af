use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::baselines::line_detection::LineSegment2d;
use linecarve_lines::camera::Camera;
use linecarve_lines::image::GrayImage;

fn poses(count: usize) -> Vec<Isometry3<f64>> {
    (0..count)
        .map(|i| {
            let t = i as f64 / (count - 1).max(1) as f64 - 0.5;
            let eye = Point3::new(1.6 * t, 0.3 * (7.0 * t).sin(), -0.2 * t);
            let view = Isometry3::look_at_rh(&eye, &Point3::new(0.1, 0.0, 3.0), &-Vector3::y());
            // look_at_rh looks along -z with y up.
            let flip =
                nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
            view.inverse() * flip
        })
        .collect()
}

/// Views of the given lines, their ends off by noise, in random order; `matched` is ready to finish.
fn views_of(lines: &[[Point3<f64>; 2]], count: usize, noise_px: f64, scale: f64) -> Matched {
    let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
    let image = GrayImage::new(640, 480, vec![0; 640 * 480]).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut matched = Matched::new(
        EdgeOptions::default(),
        LineDetectorOptions::default(),
        MatchedOptions::default(),
    )
    .unwrap();
    for (number, pose) in poses(count).into_iter().enumerate() {
        let mut segments = Vec::new();
        for line in lines {
            let mut pixel = |end: usize| {
                let p = camera.project(&pose.inverse_transform_point(&line[end]))?;
                let off = Point2::new(
                    rng.random_range(-noise_px..=noise_px),
                    rng.random_range(-noise_px..=noise_px),
                );
                Some(p + off.coords)
            };
            let (Some(a), Some(b)) = (pixel(0), pixel(1)) else {
                continue;
            };
            let ends_px = if rng.random_bool(0.5) { [a, b] } else { [b, a] };
            segments.push(LineSegment2d {
                ends_px,
                pixels: 0..0,
                chain: 0,
            });
        }
        let mut world_from_camera = pose;
        world_from_camera.translation.vector *= scale;
        let keyframe = PosedKeyframe {
            number: number as u32,
            image: &image,
            rgb: None,
            depth: None,
            camera: &camera,
            world_from_camera,
        };
        matched
            .views
            .push(View::new(&keyframe, &segments, &matched.options));
    }
    matched
}

fn lines(count: usize) -> Vec<[Point3<f64>; 2]> {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut random = |low: f64, high: f64| Vector3::from_fn(|_, _| rng.random_range(low..high));
    (0..count)
        .map(|_| {
            let center = Vector3::new(0.0, 0.0, 3.0) + random(-0.8, 0.8);
            let half = random(-0.4, 0.4);
            [center - half, center + half].map(Point3::from)
        })
        .collect()
}

fn finish(mut matched: Matched) -> Vec<[Point3<f64>; 2]> {
    let mut findings = Findings::default();
    matched.finish(&mut findings);
    findings.segments.iter().map(|s| s.ends_in_world).collect()
}

/// The nearest of the true lines to a found one, and the larger distance of its ends from it.
fn nearest(found: &[Point3<f64>; 2], lines: &[[Point3<f64>; 2]]) -> (usize, f64) {
    lines
        .iter()
        .map(|line| {
            let direction = (line[1] - line[0]).normalize();
            found
                .iter()
                .map(|end| (end - line[0]).cross(&direction).norm())
                .fold(0.0, f64::max)
        })
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap()
}

#[test]
fn lines_of_several_views_are_found_where_they_are() {
    let lines = lines(40);
    let found = finish(views_of(&lines, 8, 0.5, 1.0));
    let mut seen = vec![false; lines.len()];
    let mut wrong = 0;
    for ends in &found {
        let (line, distance) = nearest(ends, &lines);
        if distance < 0.01 {
            seen[line] = true;
        } else {
            wrong += 1;
        }
    }
    // Lines in the plane of the camera path cannot be triangulated: their match is not told by epipolar lines.
    let seen = seen.iter().filter(|&&s| s).count();
    assert!(seen >= 28, "{seen} of {}", lines.len());
    // Half a pixel of noise, and views that differ little from each other, leave some further off than a centimetre.
    assert!(wrong * 6 <= found.len(), "{wrong} of {}", found.len());
}

#[test]
fn the_unit_of_the_poses_does_not_matter() {
    let lines = lines(15);
    let plain = finish(views_of(&lines, 6, 0.0, 1.0));
    let scaled = finish(views_of(&lines, 6, 0.0, 1000.0));
    assert!(plain.len() > 8);
    assert_eq!(plain.len(), scaled.len());
    for (a, b) in plain.iter().flatten().zip(scaled.iter().flatten()) {
        assert!((a.coords * 1000.0 - b.coords).norm() < 0.1, "{a} {b}");
    }
}

#[test]
fn two_views_are_not_enough() {
    assert!(finish(views_of(&lines(20), 2, 0.0, 1.0)).is_empty());
    assert!(finish(views_of(&[], 8, 0.0, 1.0)).is_empty());
}

#[test]
fn refinement_moves_a_line_onto_its_images() {
    let lines = lines(12);
    let matched = views_of(&lines, 8, 0.0, 1.0);
    let members: Vec<grouping::Member> = (0..8)
        .map(|view| {
            // Segments are sorted by length in each view: find that of the first line.
            let [a, b] = lines[0].map(|end| {
                let view: &View = &matched.views[view];
                view.camera
                    .project(&(view.camera_from_world * end))
                    .unwrap()
            });
            let segment = matched.views[view]
                .segments
                .iter()
                .position(|s| {
                    let [p, q] = s.ends_px;
                    (p - a).norm().min((p - b).norm()) + (q - a).norm().min((q - b).norm()) < 1e-6
                })
                .unwrap();
            grouping::Member {
                view: view as u32,
                segment: segment as u32,
            }
        })
        .collect();
    let off = Vector3::new(0.02, -0.03, 0.05);
    let start = line::Line {
        points: [lines[0][0] + off, lines[0][1] - off * 0.5],
    };
    let refined = line::refine(&matched.views, &members, start, &matched.options);
    let (_, distance) = nearest(&refined.points, &lines[..1]);
    assert!(distance < 1e-6, "{distance}");
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let lines = lines(25);
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| finish(views_of(&lines, 7, 0.4, 1.0)))
    };
    assert_eq!(on(1), on(3));
}
