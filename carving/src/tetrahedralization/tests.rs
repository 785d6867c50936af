use nalgebra::Point3;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Finite cells by sorted positions: comparable between triangulations that number vertices differently.
pub(super) fn canonical(t: &Tetrahedralization) -> Vec<[[u64; 3]; 4]> {
    let mut cells: Vec<_> = t
        .cells()
        .filter(|&c| !t.is_ghost(c))
        .map(|c| {
            let mut corners = t
                .cell_vertices(c)
                .map(|v| t.coordinates(v).map(|x| (x + 0.0).to_bits()));
            corners.sort_unstable();
            corners
        })
        .collect();
    cells.sort_unstable();
    cells
}

fn build(points: &[Point3<f64>]) -> Tetrahedralization {
    let mut t = Tetrahedralization::new();
    let mut changes = Changes::new();
    for p in points {
        t.insert(*p, None, &mut changes).unwrap();
    }
    t
}

pub(super) fn grid(n: i32) -> Vec<Point3<f64>> {
    (0..n * n * n)
        .map(|i| Point3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64))
        .collect()
}

#[test]
fn random_points_are_delaunay() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let points: Vec<_> = (0..300)
        .map(|_| Point3::new(rng.random(), rng.random(), rng.random::<f64>()))
        .collect();
    let t = build(&points);
    t.check_exhaustively().unwrap();
    assert_eq!(t.vertex_count(), 300);
}

#[test]
fn a_grid_has_one_triangulation_whatever_the_order() {
    let mut points = grid(4);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let reference = build(&points);
    reference.check_exhaustively().unwrap();
    for _ in 0..20 {
        points.shuffle(&mut rng);
        let t = build(&points);
        t.check().unwrap();
        assert_eq!(canonical(&t), canonical(&reference));
    }
}

#[test]
fn removal_restores_the_cells_of_a_grid() {
    let points = grid(4);
    let mut t = build(&points);
    let mut changes = Changes::new();
    let reference = canonical(&t);
    for p in &points {
        let v = match t.locate(p, None).unwrap() {
            Location::OnVertex(v) => v,
            other => panic!("{p} found at {other:?}"),
        };
        t.remove(v, &mut changes).unwrap();
        t.check().unwrap();
        t.insert(*p, None, &mut changes).unwrap();
        t.check().unwrap();
        assert_eq!(canonical(&t), reference);
    }
    // Down to nothing, through every dimension.
    let mut dimensions = vec![];
    for v in t.vertices().collect::<Vec<_>>() {
        t.remove(v, &mut changes).unwrap();
        t.check().unwrap();
        dimensions.push(t.dimension());
    }
    dimensions.dedup();
    assert_eq!(dimensions, [3, 2, 1, 0, -1]);
}

/// On small grids a move by (1, e, e²) times 1e-4 with e = 1e-4 is as good as an infinitely small one.
#[test]
fn ties_of_a_position_are_broken_as_if_it_moved() {
    let t = build(&grid(4));
    let mut hint = None;
    for i in -1..=13 {
        for j in -1..=13 {
            for k in -1..=13 {
                let position = [i, j, k].map(|c| f64::from(c) / 4.0);
                let [x, y, z] = position;
                let moved = Point3::new(x + 1e-4, y + 1e-8, z + 1e-12);
                let cell = t.locate_perturbed(&position, hint).unwrap();
                hint = Some(cell);
                match t.locate(&moved, None).unwrap() {
                    Location::InCell(expected) => {
                        assert_eq!(cell, expected);
                        // No other cell holds it.
                        let holders = t.cells().filter(|&c| t.holds_perturbed(c, &position));
                        assert_eq!(holders.collect::<Vec<_>>(), [cell]);
                    }
                    Location::Outside(_) => assert!(t.is_ghost(cell), "{position:?}"),
                    other => panic!("{moved} is at {other:?}"),
                }
                assert!(t.holds_perturbed(cell, &position));
            }
        }
    }
    assert_eq!(
        Tetrahedralization::new().locate_perturbed(&[0.0; 3], None),
        None
    );
}
