//! Properties of the tetrahedralisation on hostile input: uniqueness, removal as the inverse of insertion, moves,
//! changes of dimension, reports of changes, refusals.
//!
//! `LINECARVE_LONG_TESTS=1` runs many more cases.

use std::collections::HashSet;

use linecarve_carving::{
    CellId, Changes, IncidentCells, Insertion, Location, Move, PointError, Tetrahedralization,
    VertexId,
};
use nalgebra::Point3;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::helpers::points::{self, Family, families, long_mode};

/// Cells, ghosts included, by positions of corners; equal for equal triangulations however numbered.
fn canonical(t: &Tetrahedralization) -> Vec<[Option<[u64; 3]>; 4]> {
    let mut cells: Vec<_> = t
        .cells()
        .map(|cell| {
            let mut corners = t
                .cell_vertices(cell)
                .map(|v| (!v.is_ghost()).then(|| t.coordinates(v).map(f64::to_bits)));
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

/// Replays reports on a set of cells and compares it with the cells there are.
struct Mirror(HashSet<CellId>);

impl Mirror {
    fn apply(&mut self, t: &Tetrahedralization, changes: &Changes) {
        for cell in &changes.destroyed {
            assert!(
                self.0.remove(cell),
                "{cell:?} destroyed without having been there"
            );
            assert!(!t.is_cell(*cell));
        }
        for cell in &changes.created {
            assert!(self.0.insert(*cell), "{cell:?} created twice");
        }
        for cell in &changes.reshaped {
            assert!(self.0.contains(cell) && !changes.created.contains(cell));
        }
        assert_eq!(self.0, t.cells().collect::<HashSet<_>>());
    }
}

#[test]
fn cells_do_not_depend_on_the_order_of_insertion() {
    for Family { name, points } in families(1) {
        let reference = canonical(&build(&points));
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for _ in 0..if long_mode() { 100 } else { 5 } {
            let mut shuffled = points.clone();
            shuffled.shuffle(&mut rng);
            let t = build(&shuffled);
            t.check()
                .unwrap_or_else(|violation| panic!("{name}: {violation}"));
            assert!(canonical(&t) == reference, "{name}: order matters");
        }
        let (t, outcomes) = Tetrahedralization::from_points(&points).unwrap();
        assert!(canonical(&t) == reference, "{name}: bulk differs");
        for (p, outcome) in points.iter().zip(outcomes) {
            assert_eq!(t.position(outcome.vertex()), *p, "{name}");
        }
    }
}

#[test]
fn every_sphere_is_empty() {
    for Family { name, points } in families(2) {
        let few = &points[..points.len().min(80)];
        build(few)
            .check_exhaustively()
            .unwrap_or_else(|violation| panic!("{name}: {violation}"));
    }
}

#[test]
fn removal_undoes_insertion() {
    for Family { name, points } in families(3) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (kept, extra) = points.split_at(points.len() / 2);
        let mut t = build(kept);
        let mut mirror = Mirror(t.cells().collect());
        let mut changes = Changes::new();
        let mut states = vec![];
        for p in extra {
            let before = canonical(&t);
            let outcome = t.insert(*p, None, &mut changes).unwrap();
            mirror.apply(&t, &changes);
            if let Insertion::Inserted(v) = outcome {
                states.push((v, before));
            }
        }
        // Backwards: each removal restores the state before.
        while let Some((v, before)) = states.pop() {
            t.remove(v, &mut changes).unwrap();
            mirror.apply(&t, &changes);
            t.check()
                .unwrap_or_else(|violation| panic!("{name}: {violation}"));
            assert!(canonical(&t) == before, "{name}: {v:?} left a trace");
        }
        // In any order: the same as never having inserted.
        let mut vertices: Vec<VertexId> = t.vertices().collect();
        vertices.shuffle(&mut rng);
        while let Some(v) = vertices.pop() {
            t.remove(v, &mut changes).unwrap();
            mirror.apply(&t, &changes);
            t.check()
                .unwrap_or_else(|violation| panic!("{name}: {violation}"));
            if vertices.len() % 16 == 3 {
                let rest: Vec<_> = vertices.iter().map(|&v| t.position(v)).collect();
                assert!(
                    canonical(&t) == canonical(&build(&rest)),
                    "{name}: order of removal matters"
                );
            }
        }
        assert_eq!((t.dimension(), t.vertex_count()), (-1, 0));
    }
}

#[test]
fn random_operations_equal_building_anew() {
    let sequences = if long_mode() { 4000 } else { 120 };
    for seed in 0..sequences {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let all = families(seed);
        let Family { name, points } = &all[seed as usize % all.len()];
        let mut t = Tetrahedralization::new();
        let mut mirror = Mirror(HashSet::new());
        let mut changes = Changes::new();
        let mut live: Vec<VertexId> = vec![];
        // Small sets change dimension often.
        let limit = if seed % 3 == 0 { 8 } else { 40 };
        for _ in 0..60 {
            let p = points[rng.random_range(0..points.len())];
            let choice = rng.random_range(0..10);
            if live.is_empty() || (choice < 5 && live.len() < limit) {
                if let Insertion::Inserted(v) = t.insert(p, None, &mut changes).unwrap() {
                    live.push(v);
                }
            } else if choice < 7 {
                let v = live.swap_remove(rng.random_range(0..live.len()));
                t.remove(v, &mut changes).unwrap();
            } else {
                let v = live[rng.random_range(0..live.len())];
                // Nudges are often possible in place.
                let target = match choice {
                    7 => t.position(v) + (p - t.position(v)) * 1e-3,
                    _ => p,
                };
                match t.move_vertex(v, target, &mut changes).unwrap() {
                    Move::Duplicate(other) => {
                        assert_eq!(t.position(other), target);
                        assert!(changes.is_empty() && other != v);
                    }
                    Move::InPlace | Move::Reinserted => assert_eq!(t.position(v), target),
                }
            }
            mirror.apply(&t, &changes);
            t.check()
                .unwrap_or_else(|violation| panic!("{name}, seed {seed}: {violation}"));
            assert_eq!(t.vertex_count(), live.len());
        }
        let rest: Vec<_> = live.iter().map(|&v| t.position(v)).collect();
        let anew = build(&rest);
        assert_eq!(t.dimension(), anew.dimension(), "{name}, seed {seed}");
        assert!(canonical(&t) == canonical(&anew), "{name}, seed {seed}");
    }
}

#[test]
fn an_edit_reports_its_net_effect() {
    for seed in 0..if long_mode() { 500 } else { 30 } {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let all = families(seed);
        let Family { name, points } = &all[seed as usize % all.len()];
        let mut t = build(&points[..points.len() / 2]);
        let mut mirror = Mirror(t.cells().collect());
        let mut changes = Changes::new();
        for _ in 0..4 {
            // What destroyed cells held before must remain readable after.
            let before: Vec<_> = t.cells().map(|c| (c, t.cell_vertices(c))).collect();
            let mut edit = t.edit(&mut changes);
            for _ in 0..12 {
                let p = points[rng.random_range(0..points.len())];
                let vertices: Vec<VertexId> = edit.tetrahedra().vertices().collect();
                let pick = vertices
                    .get(rng.random_range(0..vertices.len().max(1)))
                    .copied();
                match (rng.random_range(0..3), pick) {
                    (0, Some(v)) => edit.remove(v).unwrap(),
                    (1, Some(v)) => drop(edit.move_vertex(v, p).unwrap()),
                    _ => drop(edit.insert(p, None).unwrap()),
                }
            }
            edit.finish();
            mirror.apply(&t, &changes);
            t.check()
                .unwrap_or_else(|violation| panic!("{name}, seed {seed}: {violation}"));
            for (cell, vertices) in before {
                if changes.destroyed.contains(&cell) {
                    assert_eq!(t.cell_vertices(cell), vertices);
                }
            }
        }
    }
}

#[test]
fn batches_equal_single_insertions() {
    for Family { name, points } in families(7) {
        let mut t = Tetrahedralization::new();
        let mut mirror = Mirror(HashSet::new());
        let (mut changes, mut outcomes) = (Changes::new(), vec![]);
        for part in points.chunks(37) {
            t.insert_batch(part, &mut outcomes, &mut changes).unwrap();
            mirror.apply(&t, &changes);
            assert_eq!(outcomes.len(), part.len());
            for (p, outcome) in part.iter().zip(&outcomes) {
                assert_eq!(t.position(outcome.vertex()), *p, "{name}");
            }
        }
        t.check()
            .unwrap_or_else(|violation| panic!("{name}: {violation}"));
        assert!(canonical(&t) == canonical(&build(&points)), "{name}");
    }
}

#[test]
fn location_is_exact() {
    let corner = |i: i32| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
    let cube: Vec<_> = (0..8).map(corner).collect();
    let t = build(&cube);
    let at = |x, y, z| t.locate(&Point3::new(x, y, z), None).unwrap();
    for p in &cube {
        match t.locate(p, None).unwrap() {
            Location::OnVertex(v) => assert_eq!(t.position(v), *p),
            other => panic!("{p}: {other:?}"),
        }
    }
    assert!(matches!(at(0.5, 0.0, 0.0), Location::OnEdge { .. }));
    assert!(matches!(at(0.25, 0.625, 0.0), Location::OnFacet { .. }));
    assert!(matches!(at(0.25, 0.625, 0.031), Location::InCell(_)));
    for (x, y, z) in [
        (0.5, 0.5, -1e-45),
        (1.5, 0.5, 0.5),
        (2.0, 2.0, 2.0),
        (0.0, 0.0, -1e-40),
    ] {
        match at(x, y, z) {
            Location::Outside(cell) => assert!(t.is_ghost(cell)),
            other => panic!("{other:?}"),
        }
    }
    if let Location::OnEdge { cell, ends } = at(1.0, 1.0, 0.75) {
        assert!(ends.iter().all(|v| t.cell_vertices(cell).contains(v)));
        assert!(ends.iter().all(|&v| t.position(v).coords.xy().min() == 1.0));
    } else {
        panic!("on the edge");
    }
}

#[test]
fn location_agrees_with_a_scan_on_every_family() {
    for Family { name, points } in families(9) {
        let (inserted, queries) = points.split_at(points.len() * 2 / 3);
        let t = build(inserted);
        let mut scratch = IncidentCells::new();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let cells: Vec<CellId> = t.cells().collect();
        for q in queries {
            let hint = (!cells.is_empty()).then(|| cells[rng.random_range(0..cells.len())]);
            let exact = |p: &Point3<f64>| inserted.contains(p);
            let location = t.locate(q, hint).unwrap();
            assert_eq!(
                matches!(location, Location::OnVertex(_)),
                exact(q),
                "{name}"
            );
            let nearest = t.nearest_vertex(q, hint, &mut scratch).unwrap().unwrap();
            let found = (t.position(nearest) - q).norm();
            let best = inserted
                .iter()
                .map(|p| (p - q).norm())
                .fold(f64::INFINITY, f64::min);
            assert!(
                found <= best * (1.0 + 1e-9),
                "{name}: {found} instead of {best}"
            );
        }
    }
}

#[test]
fn incident_cells_are_exactly_those_with_the_vertex() {
    // A vertex joined to all others has more cells than the linear scan handles.
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut points: Vec<_> = (0..200)
        .map(|_| {
            let p = Point3::new(rng.random::<f64>(), rng.random(), rng.random()) * 2.0;
            let d = p.coords.add_scalar(-1.0);
            Point3::from(d / d.norm())
        })
        .collect();
    points.push(Point3::origin());
    let t = build(&points);
    let mut scratch = IncidentCells::new();
    for v in t.vertices() {
        let mut found = t.incident_cells(v, &mut scratch).to_vec();
        found.sort_unstable();
        let expected: Vec<_> = t
            .cells()
            .filter(|&c| t.cell_vertices(c).contains(&v))
            .collect();
        assert_eq!(found, expected);
        for other in t.vertices() {
            let shares_a_cell = expected
                .iter()
                .any(|&cell| t.cell_vertices(cell).contains(&other));
            let is_joined = t.are_joined(v, other, &mut scratch);
            assert_eq!(is_joined, other != v && shares_a_cell);
        }
    }
}

#[test]
fn a_vertex_joined_to_all_others_can_be_removed_and_moved() {
    // Large links take another path; points exactly on a sphere tie everywhere.
    for Family { name, points } in families(4)
        .into_iter()
        .filter(|f| f.name.contains("sphere"))
    {
        let reference = build(&points);
        let mut t = reference.clone();
        let mut changes = Changes::new();
        let Insertion::Inserted(centre) = t.insert(Point3::origin(), None, &mut changes).unwrap()
        else {
            panic!("{name}: the centre is free");
        };
        let with_centre = canonical(&t);
        t.remove(centre, &mut changes).unwrap();
        t.check().unwrap();
        assert!(canonical(&t) == canonical(&reference), "{name}");
        let centre = t
            .insert(Point3::new(100.0, 0.0, 0.0), None, &mut changes)
            .unwrap()
            .vertex();
        assert_eq!(
            t.move_vertex(centre, Point3::origin(), &mut changes)
                .unwrap(),
            Move::Reinserted
        );
        t.check().unwrap();
        assert!(canonical(&t) == with_centre, "{name}");
    }
}

#[test]
fn the_apex_of_a_pyramid_takes_the_dimension_with_it() {
    let mut t = build(&points::plane(5));
    assert_eq!((t.dimension(), t.cells().count()), (2, 0));
    let mut changes = Changes::new();
    let apex = t
        .insert(Point3::new(1.0, 1.0, 3.0), None, &mut changes)
        .unwrap()
        .vertex();
    assert_eq!(
        (t.dimension(), changes.created.len()),
        (3, t.cells().count())
    );
    let up = t
        .move_vertex(apex, Point3::new(7.0, 0.5, -2.0), &mut changes)
        .unwrap();
    assert_eq!(up, Move::Reinserted);
    t.check().unwrap();
    // Into the plane: all cells go, the vertex stays.
    t.move_vertex(apex, Point3::new(7.0, 0.5, 0.0), &mut changes)
        .unwrap();
    t.check().unwrap();
    assert_eq!(
        (t.dimension(), changes.created.len(), t.vertex_count()),
        (2, 0, 26)
    );
    assert!(t.cell_of(apex).is_none());
}

#[test]
fn refused_input_changes_nothing() {
    let mut t = build(&points::plane(3));
    let mut changes = Changes::new();
    t.insert(Point3::new(0.5, 0.5, 1.0), None, &mut changes)
        .unwrap();
    let (before, count) = (canonical(&t), t.vertex_count());
    let dead = t
        .insert(Point3::new(0.5, 0.25, 1.0), None, &mut changes)
        .unwrap()
        .vertex();
    t.remove(dead, &mut changes).unwrap();
    let alive = t.vertices().next().unwrap();
    for bad in [
        f64::NAN,
        f64::INFINITY,
        -f64::INFINITY,
        f64::MAX,
        -1e58,
        1e-300,
        f64::MIN_POSITIVE / 8.0,
    ] {
        for axis in 0..3 {
            let mut p = Point3::new(0.25, 0.25, 0.25);
            p[axis] = bad;
            assert!(t.insert(p, None, &mut changes).is_err() && changes.is_empty());
            assert!(t.locate(&p, None).is_err());
            assert!(t.move_vertex(alive, p, &mut changes).is_err() && changes.is_empty());
            let good = Point3::new(0.75, 0.75, 0.75);
            let mut outcomes = vec![Insertion::Duplicate(alive)];
            let refused = t
                .insert_batch(&[good, p], &mut outcomes, &mut changes)
                .unwrap_err();
            assert_eq!(refused.index, 1);
            assert!(outcomes.is_empty() && changes.is_empty());
            assert!(Tetrahedralization::from_points(&[good, p]).is_err());
        }
    }
    for vertex in [dead, VertexId::GHOST, VertexId::from_index(1_000_000)] {
        assert_eq!(t.remove(vertex, &mut changes).unwrap_err().vertex, vertex);
        assert!(
            t.move_vertex(vertex, Point3::origin(), &mut changes)
                .is_err()
        );
    }
    t.check().unwrap();
    assert!(canonical(&t) == before && t.vertex_count() == count);
    let text = t
        .insert(Point3::new(0.0, 1e60, 0.0), None, &mut changes)
        .unwrap_err();
    assert!(
        matches!(text, PointError::TooLarge { axis: 'y', .. }) && text.to_string().contains("1e60")
    );
}

#[test]
fn negative_zero_is_zero() {
    let mut t = Tetrahedralization::new();
    let mut changes = Changes::new();
    let first = t
        .insert(Point3::new(-0.0, 0.0, -0.0), None, &mut changes)
        .unwrap()
        .vertex();
    let again = t
        .insert(Point3::new(0.0, -0.0, 0.0), None, &mut changes)
        .unwrap();
    assert_eq!(again, Insertion::Duplicate(first));
    assert!(t.coordinates(first).iter().all(|c| c.to_bits() == 0));
}
