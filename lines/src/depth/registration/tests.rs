use nalgebra::{Point2, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::depth::InverseDepthMap;

const WIDTH: usize = 80;
const HEIGHT: usize = 60;

fn noise() -> SensorNoise {
    SensorNoise::relative_at(0.003, 2.0, 0.0)
}

fn map_of(depth: &Plane<f32>, registration: &Registration<'_>) -> InverseDepthMap {
    let samples = register(depth, registration, WIDTH, HEIGHT);
    InverseDepthMap::new(WIDTH, HEIGHT, samples).unwrap()
}

/// Renders a scene given as depth along a ray (direction with z = 1 and origin, both in the depth frame).
fn registered(
    color_focal: f64,
    color_from_depth: Isometry3<f64>,
    surface: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>,
) -> (InverseDepthMap, InverseDepthMap) {
    let depth_camera = Camera::pinhole(60.0, 60.0, 39.5, 29.5).unwrap();
    let color_camera = Camera::pinhole(color_focal, color_focal, 39.2, 30.1).unwrap();
    let direction = |camera: &Camera, x: usize, y: usize| {
        let point = camera
            .point_at_depth(&Point2::new(x as f64, y as f64), 1.0)
            .unwrap();
        point.coords
    };
    let mut depth = Plane::new(WIDTH, HEIGHT, vec![0.0_f32; WIDTH * HEIGHT]).unwrap();
    let mut truth = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
    let depth_from_color = color_from_depth.inverse();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let ray = direction(&depth_camera, x, y);
            if let Some(z) = surface(&Point3::origin(), &ray) {
                depth.samples_mut()[y * WIDTH + x] = z as f32;
            }
            let ray = depth_from_color * direction(&color_camera, x, y);
            let origin = depth_from_color * Point3::origin();
            if let Some(z) = surface(&origin, &ray) {
                truth.set(x, y, InverseDepth::new((1.0 / z) as f32, 1.0));
            }
        }
    }
    let registration = Registration {
        depth_camera: &depth_camera,
        color_camera: &color_camera,
        color_from_depth: &color_from_depth,
        noise: &noise(),
    };
    (map_of(&depth, &registration), truth)
}

/// Ray parameter at which a ray meets the plane `normal . x = offset`; with z = 1 directions it is the depth.
fn plane(
    origin: &Point3<f64>,
    ray: &Vector3<f64>,
    normal: Vector3<f64>,
    offset: f64,
) -> Option<f64> {
    let t = (offset - normal.dot(&origin.coords)) / normal.dot(ray);
    (t > 0.0).then_some(t)
}

fn beside() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(-0.05, 0.012, 0.004),
        UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015),
    )
}

#[test]
fn slanted_plane_is_exact() {
    let normal = Vector3::new(0.3, -0.5, -1.0);
    for color_focal in [40.0, 60.0, 110.0] {
        let (map, truth) = registered(color_focal, beside(), |o, r| plane(o, r, normal, -1.8));
        let (mut compared, mut rounded) = (0, 0);
        for (x, y, sample) in map.known() {
            let expected = truth.get(x, y).unwrap().rho;
            let error = (sample.rho / expected - 1.0).abs();
            // Border pixels of the depth image have no cell; they go to the nearest pixel, half a pixel off.
            assert!(error < 0.02, "focal {color_focal} at {x}, {y}: {error}");
            rounded += usize::from(error > 1e-4);
            compared += 1;
        }
        assert!(rounded < compared / 20, "{rounded} of {compared}");
        assert!(compared > WIDTH * HEIGHT / 3);
    }
}

#[test]
fn finer_image_has_no_pinholes_and_no_bleeding() {
    // A near panel before a far wall, seen by a colour camera of nearly twice the focal length.
    let scene = |o: &Point3<f64>, r: &Vector3<f64>| {
        let near = plane(o, r, Vector3::z(), 1.0).filter(|t| {
            let hit = o + r * *t;
            hit.x.abs() < 0.25 && hit.y.abs() < 0.2
        });
        near.or_else(|| plane(o, r, Vector3::z(), 3.0))
    };
    let (map, truth) = registered(110.0, beside(), scene);
    let (mut holes, mut wrong, mut inside) = (0, 0, 0);
    for y in 3..HEIGHT - 3 {
        for x in 3..WIDTH - 3 {
            let near = |x: usize, y: usize| truth.get(x, y).is_some_and(|s| s.rho > 0.8);
            // Away from the panel's border by 2 pixels the answer is unambiguous.
            let is_inside = (x - 2..=x + 2).all(|x| (y - 2..=y + 2).all(|y| near(x, y)));
            if is_inside {
                inside += 1;
                match map.get(x, y) {
                    None => holes += 1,
                    Some(sample) if sample.rho < 0.8 => wrong += 1,
                    Some(_) => {}
                }
            }
        }
    }
    assert!(inside > 500);
    assert_eq!((holes, wrong), (0, 0));
}

#[test]
fn nothing_stretches_across_a_jump() {
    let scene = |o: &Point3<f64>, r: &Vector3<f64>| {
        let near = plane(o, r, Vector3::z(), 1.0).filter(|t| (o + r * *t).x < 0.0);
        near.or_else(|| plane(o, r, Vector3::z(), 2.0))
    };
    let (map, _) = registered(60.0, beside(), scene);
    for (x, y, sample) in map.known() {
        let is_surface = (sample.rho - 1.0).abs() < 0.05 || (sample.rho - 0.5).abs() < 0.03;
        assert!(is_surface, "{} at {x}, {y}", sample.rho);
    }
}

#[test]
fn hostile_depth_is_unknown() {
    let depth_camera = Camera::pinhole(60.0, 60.0, 39.5, 29.5).unwrap();
    let turned = Isometry3::rotation(Vector3::y() * std::f64::consts::PI);
    let registration = Registration {
        depth_camera: &depth_camera,
        color_camera: &depth_camera,
        color_from_depth: &turned,
        noise: &noise(),
    };
    // Rows of good depth between hostile ones, so that cells mix both.
    let hostile: Vec<f32> = (0..WIDTH * HEIGHT)
        .map(|i| match i / WIDTH % 3 {
            0 => 1.0,
            _ => [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e-38, f32::MAX, 1.0][i % 7],
        })
        .collect();
    let depth = Plane::new(WIDTH, HEIGHT, hostile).unwrap();
    // Everything lies behind a camera that looks the other way.
    let map = map_of(&depth, &registration);
    assert_eq!(map.known_count(), 0);
    // A depth camera far beside and just behind: huge pixel coordinates.
    let aside = Isometry3::translation(1e30, -1e30, -1.0 + 1e-7);
    let far = Registration {
        color_from_depth: &aside,
        ..registration
    };
    let map = map_of(&depth, &far);
    assert_eq!(map.known_count(), 0);
    let straight = Registration {
        color_from_depth: &Isometry3::identity(),
        ..registration
    };
    let map = map_of(&depth, &straight);
    assert!(
        map.known()
            .all(|(_, _, s)| s.rho.is_finite() && s.sigma > 0.0 && s.sigma.is_finite())
    );
}
