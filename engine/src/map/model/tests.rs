use nalgebra::{Isometry3, Translation3};

use super::*;
use crate::front_end::Keyframe;
use crate::map::Map;
use crate::map::selection::sigma_along_rays;
use crate::options::Options;
use linecarve_mesh::TriangleMesh;
use linecarve_sequence::{ModelObservation, ModelPoint, ModelView};

/// A wall of points at z = 4 and a box of points before it, seen by a row of cameras at z = 0.
fn wall() -> SparseModel {
    let views: Vec<ModelView> = (0..5)
        .map(|i| ModelView {
            name: format!("{i}"),
            world_from_camera: Isometry3::from_parts(
                Translation3::new(0.45 * f64::from(i) - 0.9, 0.1, 0.0),
                nalgebra::UnitQuaternion::identity(),
            ),
            camera: None,
            size_px: None,
        })
        .collect();
    let all = |x: f64, y: f64, z: f64| ModelPoint {
        point_in_world: Point3::new(x, y, z),
        color: None,
        observations: (0..views.len() as u32)
            .map(|view| ModelObservation { view, pixel: None })
            .collect(),
    };
    let mut points = Vec::new();
    for row in 0..9 {
        for column in 0..13 {
            let (x, y) = (0.3 * f64::from(column) - 1.8, 0.3 * f64::from(row) - 1.2);
            points.push(all(x, y, 4.0 + 0.01 * (x * 7.0).sin()));
        }
    }
    // Something behind, so that the wall is not the hull.
    points.push(all(0.0, 0.0, 5.5));
    SparseModel { views, points }
}

fn triangles(mesh: &TriangleMesh) -> Vec<[[u64; 3]; 3]> {
    let mut all: Vec<[[u64; 3]; 3]> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|i| mesh.positions[i as usize].coords.map(f64::to_bits).into()))
        .collect();
    all.sort_unstable();
    all
}

fn map_of(model: &SparseModel) -> Map {
    Map::of_model(&Options::default(), model.clone()).unwrap()
}

#[test]
fn view_by_view_and_all_at_once_end_the_same() {
    let model = wall();
    let mut one = map_of(&model);
    let updates: Vec<MapUpdate> = (0..5)
        .map(|view| one.push(&Keyframe::Views(view..view + 1)).unwrap())
        .collect();
    assert_eq!(updates[0].new_points, model.points.len());
    assert_eq!(updates[4].observed_again, model.points.len());
    let mut other = map_of(&model);
    other.push(&Keyframe::Views(0..5)).unwrap();
    assert_eq!(triangles(&one.surface()), triangles(&other.surface()));
    assert_eq!(one.carved_points().unwrap().count(), model.points.len());
    assert_eq!(one.median_depth().map(|depth| depth.round()), Some(4.0));
}

#[test]
fn what_cannot_be_trusted_is_left_out_and_counted() {
    let mut model = wall();
    let camera = linecarve_lines::camera::Camera::pinhole(500.0, 500.0, 320.0, 240.0).unwrap();
    model.points[0].point_in_world.x = f64::NAN;
    model.points[1].observations.truncate(2);
    model.points[2].point_in_world = Point3::new(0.0, 0.1, 500.0);
    model.points[3].point_in_world.z = -4.0;
    model.views[1].camera = Some(camera);
    model.points[4].observations[1].pixel = Some([1e6, f64::NAN]);
    let map = map_of(&model);
    let (_, counts) = map.model().unwrap();
    assert_eq!(
        counts,
        ModelCounts {
            carved: model.points.len() - 4,
            not_finite: 1,
            without_normal: 0,
            too_few_views: 2,
            too_little_parallax: 1,
            wrong_observations: 6,
        }
    );
}

#[test]
fn a_view_that_there_is_not_is_named() {
    let mut model = wall();
    model.points[7].observations[0].view = 9;
    let error = Map::of_model(&Options::default(), model.clone())
        .err()
        .unwrap();
    assert_eq!(
        error.to_string(),
        "point 7 of the model is seen by view 9, but there are 5 views"
    );
    let mut model = wall();
    model.views[2].world_from_camera.translation.x = f64::NAN;
    let error = map_of(&model).push(&Keyframe::Views(0..5)).unwrap_err();
    assert!(error.to_string().contains("view 2"), "{error}");
}

#[test]
fn nothing_has_an_empty_surface() {
    let mut map = map_of(&SparseModel::default());
    map.push(&Keyframe::Views(0..0)).unwrap();
    assert!(map.surface().is_empty());
    assert_eq!(map.median_depth(), None);
}

#[test]
fn the_deviation_of_a_point_is_that_of_its_rays() {
    let view = |x: f64| ModelView {
        name: String::new(),
        world_from_camera: Isometry3::translation(x, 0.0, 0.0),
        camera: Some(linecarve_lines::camera::Camera::pinhole(500.0, 500.0, 320.0, 240.0).unwrap()),
        size_px: None,
    };
    let point = Point3::new(0.05, 0.0, 4.0);
    // z^2 / (f b) for the disparity of two pixels; the mean of four such pairs is half of it.
    let stereo = 16.0 / (500.0 * 0.1) * 2.0_f64.sqrt();
    for pairs in [1, 4] {
        let views: Vec<_> = (0..2 * pairs)
            .map(|i| view(0.1 * f64::from(i % 2)))
            .collect();
        let sigma = sigma_along_rays(&point, views.iter()).unwrap();
        let expected = stereo / f64::from(pairs).sqrt();
        assert!(
            (sigma / expected - 1.0).abs() < 0.02,
            "{sigma}, not {expected}"
        );
    }
    assert_eq!(
        sigma_along_rays(&point, [view(0.0), view(0.0)].iter()),
        None
    );
}
