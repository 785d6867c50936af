//! Bundle adjustment of disturbed cameras with ground truth.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::{KnownPoint, correct_pose};
use super::*;

fn camera() -> Camera {
    Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap()
}

/// A camera that walks to the right, points two to four in front of it.
fn truth(step: u32) -> Isometry3<f64> {
    let t = f64::from(step);
    Isometry3::from_parts(
        Translation3::new(0.15 * t, 0.03 * (t * 1.7).sin(), 0.04 * t),
        UnitQuaternion::from_euler_angles(0.01 * t, -0.02 * t, 0.02 * t),
    )
}

struct Scene {
    poses: Vec<CorrectedPose>,
    tracks: Vec<Track>,
    truths: Vec<Isometry3<f64>>,
    points: Vec<Point3<f64>>,
}

/// Pose errors of `pose_px`, pixel errors of `pixel`, points that start off by 2 % of their distance. One observation in `wrong` is
/// at a random pixel.
fn scene(cameras: u32, pose_px: f64, pixel: f64, wrong: Option<usize>) -> Scene {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let truths: Vec<Isometry3<f64>> = (0..cameras).map(truth).collect();
    let prior = PosePrior::in_pixels(pose_px, 525.0, 3.0);
    let poses = truths
        .iter()
        .map(|truth| {
            let mut shake =
                |size: f64| Vector3::from([(); 3].map(|()| random.random_range(-size..=size)));
            let error = Isometry3::from_parts(
                Translation3::from(shake(prior.translation)),
                UnitQuaternion::from_scaled_axis(shake(prior.rotation_rad)),
            );
            CorrectedPose::new(truth * error)
        })
        .collect();
    let mut tracks = Vec::new();
    let mut points = Vec::new();
    let mut made = 0;
    for _ in 0..400 {
        let mut at = |low: f64, high: f64| random.random_range(low..high);
        let point = Point3::new(at(-1.0, 2.0), at(-0.8, 0.8), at(2.0, 4.0));
        let start = point + Vector3::new(at(-0.04, 0.04), at(-0.04, 0.04), at(-0.08, 0.08));
        let mut observations = Vec::new();
        for (index, truth) in truths.iter().enumerate() {
            let seen = camera().project(&(truth.inverse() * point)).unwrap();
            if !(seen.x > 0.0 && seen.y > 0.0 && seen.x < 639.0 && seen.y < 479.0) {
                continue;
            }
            made += 1;
            let is_wrong = wrong.is_some_and(|every| made % every == 0);
            let pixel = if is_wrong {
                Point2::new(at(0.0, 639.0), at(0.0, 479.0))
            } else {
                seen + nalgebra::Vector2::new(at(-1.0, 1.0), at(-1.0, 1.0)) * pixel
            };
            observations.push(TrackObservation {
                camera: index as u32,
                pixel,
                sigma_px: 1.0,
            });
        }
        if observations.len() >= 2 {
            tracks.push(Track {
                point_in_world: start,
                observations,
            });
            points.push(point);
        }
    }
    Scene {
        poses,
        tracks,
        truths,
        points,
    }
}

/// Largest distance between projections of points under two poses.
fn difference_px(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    [
        (-0.8, -0.6, 2.0),
        (0.8, 0.6, 2.5),
        (0.8, -0.6, 4.0),
        (0.0, 0.0, 3.0),
    ]
    .iter()
    .map(|&(x, y, z)| {
        let point = a * Point3::new(x, y, z);
        let seen = |pose: &Isometry3<f64>| camera().project(&(pose.inverse() * point)).unwrap();
        (seen(a) - seen(b)).norm()
    })
    .fold(0.0, f64::max)
}

/// An adjustment with a fixed lens.
fn adjust_poses(
    poses: &mut [CorrectedPose],
    free: &[u32],
    prior: &PosePrior,
    tracks: &mut [Track],
) -> AdjustmentSummary {
    let mut lens = CorrectedLens::new(camera());
    let done = adjust_bundle(&mut lens, FreeLens::Fixed, poses, free, prior, tracks);
    assert_eq!(lens, CorrectedLens::new(camera()));
    done
}

fn all(count: u32) -> Vec<u32> {
    (0..count).collect()
}

#[test]
fn disturbed_cameras_find_back_and_the_whole_stays_in_place() {
    for wrong in [None, Some(12)] {
        let mut s = scene(10, 4.0, 0.5, wrong);
        let prior = PosePrior::in_pixels(4.0, 525.0, 3.0);
        let before: Vec<f64> = (s.poses.iter().zip(&s.truths))
            .map(|(pose, truth)| difference_px(pose.world_from_camera(), truth))
            .collect();
        let done = adjust_poses(&mut s.poses, &all(10), &prior, &mut s.tracks);
        assert!(done.cost_after < 0.3 * done.cost_before, "{done:?}");
        // What all cameras have in common is only held by the given poses, and as good as their mean.
        let relative = |poses: &[CorrectedPose]| -> f64 {
            poses
                .windows(2)
                .zip(s.truths.windows(2))
                .map(|(now, truth)| {
                    let moved = now[0].world_from_camera().inverse() * now[1].world_from_camera();
                    difference_px(&moved, &(truth[0].inverse() * truth[1]))
                })
                .fold(0.0, f64::max)
        };
        let given: Vec<CorrectedPose> = scene(10, 4.0, 0.5, wrong).poses;
        assert!(relative(&given) > 5.0);
        assert!(
            relative(&s.poses) < 1.0,
            "{wrong:?}: {}",
            relative(&s.poses)
        );
        let mean_before = before.iter().sum::<f64>() / 10.0;
        for (pose, truth) in s.poses.iter().zip(&s.truths) {
            assert!(difference_px(pose.world_from_camera(), truth) < mean_before);
        }
        let mut errors: Vec<f64> = (s.tracks.iter().zip(&s.points))
            .map(|(track, point)| (track.point_in_world - point).norm())
            .collect();
        errors.sort_by(f64::total_cmp);
        assert!(
            errors[errors.len() / 2] < 0.03,
            "{}",
            errors[errors.len() / 2]
        );
    }
}

#[test]
fn cameras_that_are_not_free_stay_to_the_bit() {
    let mut s = scene(6, 3.0, 0.3, None);
    let given = s.poses.clone();
    let prior = PosePrior::in_pixels(3.0, 525.0, 3.0);
    adjust_poses(&mut s.poses, &[1, 4], &prior, &mut s.tracks);
    for index in [0, 2, 3, 5] {
        assert_eq!(s.poses[index], given[index]);
    }
    assert!(s.poses[1] != given[1] && s.poses[4] != given[4]);
}

#[test]
fn right_poses_stay_where_they_are() {
    let mut s = scene(8, 0.0, 0.3, None);
    let prior = PosePrior::in_pixels(3.0, 525.0, 3.0);
    adjust_poses(&mut s.poses, &all(8), &prior, &mut s.tracks);
    for (pose, truth) in s.poses.iter().zip(&s.truths) {
        let moved = difference_px(pose.world_from_camera(), truth);
        assert!(moved < 0.6, "{moved}");
    }
}

#[test]
fn the_lens_is_found_along_with_disturbed_poses() {
    for k1 in [-0.08, 0.0, 0.05] {
        let distorting = CorrectedLens::new(camera())
            .moved(&LensVector::ith(0, k1))
            .unwrap();
        let mut s = scene(10, 4.0, 0.0, None);
        for (track, point) in s.tracks.iter_mut().zip(&s.points) {
            for observation in &mut track.observations {
                let in_camera = s.truths[observation.camera as usize].inverse() * point;
                let straight = camera().project(&in_camera).unwrap();
                let bent = distorting.camera().project(&in_camera).unwrap();
                observation.pixel += bent - straight;
            }
        }
        let prior = PosePrior::in_pixels(4.0, 525.0, 3.0);
        let mut fixed = s.poses.clone();
        let without = adjust_poses(&mut fixed, &all(10), &prior, &mut s.tracks.clone());
        let mut lens = CorrectedLens::new(camera());
        let tracks = &mut s.tracks;
        let with = adjust_bundle(
            &mut lens,
            FreeLens::Distortion,
            &mut s.poses,
            &all(10),
            &prior,
            tracks,
        );
        let found = lens.correction().unwrap().k1;
        assert!((found - k1).abs() < 0.005, "{k1}: {found}");
        assert!(
            with.cost_after <= 1.001 * without.cost_after,
            "{without:?} {with:?}"
        );
        if k1 != 0.0 {
            assert!(
                with.cost_after < 0.5 * without.cost_after,
                "{without:?} {with:?}"
            );
        }
    }
}

#[test]
fn nothing_to_go_by_changes_nothing_and_is_no_fault() {
    let prior = PosePrior::in_pixels(3.0, 525.0, 3.0);
    let s = scene(3, 1.0, 0.5, None);
    let mut poses = s.poses.clone();
    adjust_poses(&mut poses, &[], &prior, &mut s.tracks.clone());
    assert_eq!(poses, s.poses);
    adjust_poses(&mut poses, &all(3), &prior, &mut []);
    for (pose, given) in poses.iter().zip(&s.poses) {
        assert!(difference_px(pose.world_from_camera(), given.world_from_camera()) < 1e-6);
    }
    // Points behind the cameras, at a camera, without parallax, and not a number.
    let at = *s.poses[0].world_from_camera();
    let mut odd: Vec<Track> = [
        at * Point3::new(0.0, 0.0, -2.0),
        at * Point3::origin(),
        at * Point3::new(0.0, 0.0, 1e12),
        Point3::new(f64::NAN, 0.0, 0.0),
    ]
    .into_iter()
    .map(|point_in_world| Track {
        point_in_world,
        observations: s.tracks[0].observations.clone(),
    })
    .collect();
    for count in 1..=odd.len() {
        let mut poses = s.poses.clone();
        adjust_poses(&mut poses, &all(3), &prior, &mut odd[..count]);
        let is_finite = poses.iter().all(|pose| {
            pose.world_from_camera()
                .to_homogeneous()
                .iter()
                .all(|x| x.is_finite())
        });
        assert!(is_finite, "{count}");
    }
}

#[test]
fn one_camera_finds_its_place_among_known_points() {
    let s = scene(6, 4.0, 0.5, Some(5));
    let prior = PosePrior::in_pixels(6.0, 525.0, 3.0);
    for index in 0..6_u32 {
        let known: Vec<KnownPoint> = s
            .tracks
            .iter()
            .zip(&s.points)
            .filter_map(|(track, point)| {
                let observation = track
                    .observations
                    .iter()
                    .find(|observation| observation.camera == index)?;
                Some(KnownPoint {
                    point_in_world: *point,
                    covariance: Matrix3::identity() * 1e-6,
                    pixel: observation.pixel,
                    sigma_px: 0.7,
                })
            })
            .collect();
        let mut pose = s.poses[index as usize];
        let agreeing = correct_pose(&camera(), &mut pose, &prior, &known);
        assert!(
            10 * agreeing > 7 * known.len(),
            "{agreeing} of {}",
            known.len()
        );
        let off = difference_px(pose.world_from_camera(), &s.truths[index as usize]);
        assert!(off < 0.5, "{off}");
        assert!(pose.change().rotation_rad < 0.03 && pose.change().translation < 0.06);
        let mut alone = s.poses[index as usize];
        assert_eq!(correct_pose(&camera(), &mut alone, &prior, &[]), 0);
    }
}
