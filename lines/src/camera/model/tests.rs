use super::*;
use proptest::prelude::*;

fn cameras() -> Vec<Camera> {
    vec![
        Camera::pinhole(525.8, 524.0, 322.2, 235.6).unwrap(),
        Camera::with_distortion(
            458.654,
            457.296,
            367.215,
            248.375,
            Distortion::RadialTangential {
                k1: -0.28340811,
                k2: 0.07395907,
                p1: 1.9359e-4,
                p2: 1.76187e-5,
                k3: 0.0,
            },
        )
        .unwrap(),
        Camera::with_distortion(
            517.3,
            516.5,
            318.6,
            255.3,
            Distortion::RadialTangential {
                k1: 0.2624,
                k2: -0.9531,
                p1: -0.0054,
                p2: 0.0026,
                k3: 1.1633,
            },
        )
        .unwrap(),
        Camera::with_distortion(
            190.97,
            190.97,
            254.93,
            256.9,
            Distortion::KannalaBrandt {
                k1: 0.00348,
                k2: 0.000715,
                k3: -0.00205,
                k4: 0.000202,
            },
        )
        .unwrap(),
    ]
}

proptest! {
    #[test]
    fn unproject_inverts_project(x in 0.0..640.0_f64, y in 0.0..480.0_f64, depth in 0.01..1e4_f64) {
        for camera in cameras() {
            let pixel = Point2::new(x, y);
            let Ok(direction) = camera.unproject(&pixel) else {
                prop_assert!(!camera.is_pinhole());
                continue;
            };
            prop_assert!((direction.norm() - 1.0).abs() < 1e-12);
            let back = camera.project(&Point3::from(direction * depth)).unwrap();
            prop_assert!((back - pixel).norm() < 1e-6, "{camera:?} {pixel} {back}");
        }
    }

    #[test]
    fn jacobian_is_the_derivative(x in -0.5..0.5_f64, y in -0.4..0.4_f64, z in 0.8..5.0_f64) {
        let p = Point3::new(x * z, y * z, z);
        for camera in cameras() {
            let Some((pixel, jacobian)) = camera.project_with_jacobian(&p) else { continue };
            prop_assert!((camera.project(&p).unwrap() - pixel).norm() < 1e-9);
            for axis in 0..3 {
                let step = 1e-6;
                let mut ahead = p;
                ahead[axis] += step;
                let mut behind = p;
                behind[axis] -= step;
                let (Some(a), Some(b)) = (camera.project(&ahead), camera.project(&behind)) else { continue };
                let numeric = (a - b) / (2.0 * step);
                prop_assert!((numeric - jacobian.column(axis)).norm() < 1e-3 * (1.0 + numeric.norm()));
            }
        }
    }
}

#[test]
fn fisheye_sees_behind_the_image_plane() {
    let camera = &cameras()[3];
    let sideways = Point3::new(1.0, 0.2, -0.1);
    let pixel = camera.project(&sideways).unwrap();
    let direction = camera.unproject(&pixel).unwrap();
    assert!((direction - sideways.coords.normalize()).norm() < 1e-9);
    assert!(matches!(
        camera.point_at_depth(&pixel, 1.0),
        Err(UnprojectError::NoDepth { .. })
    ));
}

#[test]
fn distortion_that_folds_back_is_cut_off() {
    // 1 + 3 k1 r^2 = 0 at r = 1: beyond it two points share a pixel.
    let distortion = Distortion::RadialTangential {
        k1: -1.0 / 3.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };
    let camera = Camera::with_distortion(100.0, 100.0, 0.0, 0.0, distortion).unwrap();
    assert!(camera.project(&Point3::new(0.99, 0.0, 1.0)).is_some());
    assert!(camera.project(&Point3::new(1.01, 0.0, 1.0)).is_none());
    assert!(camera.unproject(&Point2::new(66.0, 0.0)).is_ok());
    assert!(matches!(
        camera.unproject(&Point2::new(70.0, 0.0)),
        Err(UnprojectError::OutsideModel { .. })
    ));
}

#[test]
fn bad_input_is_refused_or_none() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Camera::pinhole(bad, 500.0, 0.0, 0.0).is_err());
        assert!(Camera::pinhole(500.0, bad, 0.0, 0.0).is_err());
    }
    assert!(Camera::pinhole(500.0, 500.0, f64::NAN, 0.0).is_err());
    let distortion = Distortion::KannalaBrandt {
        k1: 0.0,
        k2: f64::NAN,
        k3: 0.0,
        k4: 0.0,
    };
    assert_eq!(
        Camera::with_distortion(1.0, 1.0, 0.0, 0.0, distortion)
            .unwrap_err()
            .to_string(),
        "distortion coefficient 2 = NaN must be finite"
    );
    for camera in cameras() {
        assert!(camera.unproject(&Point2::new(f64::NAN, 0.0)).is_err());
        assert!(camera.project(&Point3::new(f64::NAN, 0.0, 1.0)).is_none());
        assert!(camera.project(&Point3::new(0.0, 0.0, f64::NAN)).is_none());
        assert!(camera.project(&Point3::new(0.0, 0.0, 0.0)).is_none());
        assert!(camera.project(&Point3::new(0.0, 0.0, -1.0)).is_none());
    }
}

#[test]
fn scaled_camera_sees_the_same_corner() {
    let camera = Camera::pinhole(500.0, 500.0, 319.5, 239.5)
        .unwrap()
        .scaled(0.5)
        .unwrap();
    assert_eq!(
        (camera.fx(), camera.cx(), camera.cy()),
        (250.0, 159.5, 119.5)
    );
}
