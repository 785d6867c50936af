//! Meshes of a part of the surface.

#![allow(clippy::unwrap_used)] // Helpers of tests fail like tests.

use linecarve_carving::carver::{Carver, CarverOptions};
use linecarve_carving::surface::{ExportOptions, Hull, Triangle};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random points, half of which a view in their middle sees.
fn carved(seed: u64) -> Carver {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut carver = Carver::new(CarverOptions {
        hull: Hull::Keep,
        ..CarverOptions::default()
    });
    let mut transaction = carver.transaction();
    let view = transaction.add_view(Point3::new(0.5, 0.5, 0.5)).unwrap();
    for index in 0..200 {
        let position = [(); 3].map(|()| random.random::<f64>());
        let point = transaction.add_point(Point3::from(position)).unwrap();
        if index % 2 == 0 {
            transaction.add_observation(view, point, 1).unwrap();
        }
    }
    transaction.commit().unwrap();
    carver
}

#[test]
fn the_unwanted_are_left_out_and_vertices_know_their_origin() {
    for seed in 0..10 {
        let carver = carved(seed);
        let is_wanted = |triangle: Triangle| !triangle[0].index().is_multiple_of(3);
        for manifold in [false, true] {
            let options = ExportOptions {
                manifold,
                ..ExportOptions::default()
            };
            let (mesh, origins) = carver.mesh_where(&options, is_wanted);
            let wanted = carver.triangles().filter(|t| is_wanted(*t)).count();
            assert!(wanted > 0 && wanted < carver.triangle_count());
            // Splitting an edge makes two triangles of one.
            assert!(mesh.triangles.len() >= wanted && (manifold || mesh.triangles.len() == wanted));
            assert_eq!(origins.len(), mesh.vertices.len());
            for (position, origin) in mesh.vertices.iter().zip(&origins) {
                match origin {
                    Some(vertex) => assert_eq!(*position, carver.tetrahedra().position(*vertex)),
                    None => assert!(manifold, "midpoints come from repair alone"),
                }
            }
            assert_eq!(
                carver.mesh_where(&options, |_| true).0,
                carver.mesh(&options)
            );
            assert_eq!(carver.mesh_where(&options, |_| false).0.vertices.len(), 0);
        }
    }
}

#[test]
fn what_is_left_of_a_large_component_may_be_small() {
    let carver = carved(0);
    let options = ExportOptions {
        minimum_component: 5,
        manifold: true,
        ..ExportOptions::default()
    };
    let whole = carver.mesh_where(&options, |_| true).0.triangles.len();
    let mut triangles: Vec<Triangle> = carver.triangles().collect();
    triangles.sort_unstable();
    let alone = triangles.iter().filter(|one| {
        let (mesh, _) = carver.mesh_where(&options, |triangle| triangle == **one);
        !mesh.triangles.is_empty()
    });
    // Every triangle of a component that is large enough is written when it is the only one wanted.
    assert!(whole > 0 && alone.count() >= whole / 2);
}
