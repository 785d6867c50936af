//! Cells of tiles against those of all points.

use std::collections::BTreeSet;

use linecarve_carving::{
    Carver, CarverOptions, CellId, ExportOptions, Labels, Tetrahedralization, Votes,
};
use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::plan::PlanOptions;
use crate::plan_carver::plan;
use crate::run_item::run_item;
use crate::stage::Stage;

const TILES: usize = 10;

/// A cell by the bits of its corners, in order; a cell outside the hull has three.
type Corners = Vec<[u64; 3]>;

fn corners(tetrahedra: &Tetrahedralization, cell: CellId) -> Corners {
    let finite = (tetrahedra.cell_vertices(cell).into_iter()).filter(|vertex| !vertex.is_ghost());
    let mut corners: Corners = finite
        .map(|vertex| tetrahedra.coordinates(vertex).map(f64::to_bits))
        .collect();
    corners.sort_unstable();
    corners
}

/// Cells that satisfy a condition.
fn cells_where(
    tetrahedra: &Tetrahedralization,
    condition: impl Fn(CellId) -> bool,
) -> BTreeSet<Corners> {
    let cells = tetrahedra.cells().filter(|&cell| condition(cell));
    cells.map(|cell| corners(tetrahedra, cell)).collect()
}

/// Plans tiles of these points, finds their cells, and compares those around each tile's own points with the cells of the whole.
fn assert_cells_are_those_of_the_whole(points: &[[f64; 3]], seed: u64) {
    let votes = Labels::Votes(Votes::default());
    let mut carver = Carver::deferred(CarverOptions::with_labels(votes));
    let mut change = carver.transaction();
    for point in points {
        change.add_point(Point3::from(*point)).unwrap();
    }
    change.commit().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let options = PlanOptions {
        tiles: TILES,
        seed,
        sample: 64,
        ..PlanOptions::default()
    };
    let export = ExportOptions::default();
    let work = plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
    let all: Vec<Point3<f64>> = points.iter().copied().map(Point3::from).collect();
    let (whole, _) = Tetrahedralization::from_points(&all).unwrap();
    for item in work.items(Stage::Frame) {
        run_item(&work, item, || None).unwrap();
        let own: BTreeSet<[u64; 3]> = (own_vertices(&work, item.number).unwrap().iter())
            .map(|(_, position)| position.map(f64::to_bits))
            .collect();
        let is_of_tile = |cell: CellId| {
            let own_corners = corners(&whole, cell);
            own_corners.iter().any(|corner| own.contains(corner))
        };
        // The cells across a facet count too: the cost of a facet depends on both circumspheres.
        let is_near =
            |cell: CellId| is_of_tile(cell) || whole.neighbors(cell).into_iter().any(is_of_tile);
        let expected = cells_where(&whole, is_near);
        let tile = TileCells::framed(&work, item).unwrap();
        let found = cells_where(&tile.tetrahedra, |cell| tile.is_near(cell));
        assert_eq!(found, expected, "{item}, seed {seed}");
    }
}

/// A wall to the last bit, and a few points beside it.
#[test]
fn thousands_of_points_on_a_plane() {
    let wall = (0..70).flat_map(|x| (0..70).map(move |y| [f64::from(x), f64::from(y), 0.0]));
    let beside = (0..8).map(|k| {
        [
            f64::from(9 * k),
            f64::from(61 - 7 * k),
            1.0 + f64::from(k % 3),
        ]
    });
    assert_cells_are_those_of_the_whole(&wall.chain(beside).collect::<Vec<_>>(), 1);
}

/// Points with whole coordinates that lie on one sphere to the last bit.
#[test]
fn thousands_of_points_on_a_sphere() {
    const SQUARED: i64 = 999_994;
    let mut points = Vec::new();
    for x in -1000_i64..=1000 {
        for y in -1000_i64..=1000 {
            let rest = SQUARED - x * x - y * y;
            let z = rest.max(0).isqrt();
            if rest >= 0 && z * z == rest {
                points.push([x as f64, y as f64, z as f64]);
                if z > 0 {
                    points.push([x as f64, y as f64, -z as f64]);
                }
            }
        }
    }
    assert_eq!(points.len(), 6048);
    assert_cells_are_those_of_the_whole(&points, 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    // Fine positions are in general position, coarse ones are cospherical by the hundred; some lie far away.
    #[test]
    fn cells_of_tiles_are_those_of_the_whole(
        fine in prop::collection::vec(prop::array::uniform3(-100_000i32..=100_000), 60..240),
        coarse in prop::collection::vec(prop::array::uniform3(-4i32..=4), 60..240),
        far in prop::collection::vec(prop::array::uniform3(-1_000_000_000i32..=1_000_000_000), 0..4),
        seed in 0u64..100,
    ) {
        let fine = fine.iter().map(|p| p.map(|x| f64::from(x) / 25_000.0));
        let coarse = coarse.iter().map(|p| p.map(f64::from));
        let far = far.iter().map(|p| p.map(f64::from));
        let points: Vec<[f64; 3]> = fine.chain(coarse).chain(far).collect();
        assert_cells_are_those_of_the_whole(&points, seed);
    }
}
