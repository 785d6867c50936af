//! Tests of surface histories.

use nalgebra::Point3;
use proptest::prelude::*;

use super::{Elements, HistoryLimits, SurfaceHistory};
use linecarve_mesh::TriangleMesh;

const NOTHING: Elements<'static> = Elements::Points(&[]);

/// A mesh of triangles between points on a line, its vertices rotated by `turn`.
fn mesh(triangles: &[[u8; 3]], turn: usize) -> TriangleMesh {
    let mut names: Vec<u8> = triangles.iter().flatten().copied().collect();
    names.sort_unstable();
    names.dedup();
    let shift = turn % names.len().max(1);
    names.rotate_left(shift);
    TriangleMesh {
        positions: names
            .iter()
            .map(|name| Point3::new(f64::from(*name), 0.0, -0.0))
            .collect(),
        triangles: triangles
            .iter()
            .map(|corners| {
                corners.map(|name| names.iter().position(|other| *other == name).unwrap() as u32)
            })
            .collect(),
        colors: None,
    }
}

/// The triangles of a history at a state, by the names of their corners, the smallest first.
fn at(history: &SurfaceHistory, state: u32) -> Vec<[u8; 3]> {
    let name = |corner: u32| history.positions()[corner as usize].x as u8;
    let records = history.triangles.records().iter();
    let mut current: Vec<[u8; 3]> = records
        .filter(|(_, lifetime)| {
            lifetime.first_state <= state
                && lifetime.end_state.is_none_or(|end_state| state < end_state)
        })
        .map(|(corners, _)| smallest_first(corners.map(name)))
        .collect();
    current.sort_unstable();
    current
}

fn smallest_first(mut corners: [u8; 3]) -> [u8; 3] {
    while corners[0] > corners[1] || corners[0] > corners[2] {
        corners.rotate_left(1);
    }
    corners
}

fn triangle() -> impl Strategy<Value = [u8; 3]> {
    let corners: Vec<u8> = (0..9).collect();
    let three = prop::sample::subsequence(corners, 3).prop_shuffle();
    three.prop_map(|corners| [corners[0], corners[1], corners[2]])
}

proptest! {
    #[test]
    fn a_history_holds_the_surface_of_every_state(
        states in prop::collection::vec(prop::collection::vec(triangle(), 0..7), 1..24),
        most in 2u32..9,
    ) {
        let limits = HistoryLimits { states: most, triangles: 1000 };
        let mut history = SurfaceHistory::new(limits);
        for (number, triangles) in states.iter().enumerate() {
            if history.advance() {
                history.record(number, &mesh(triangles, number), NOTHING);
            }
        }
        let last = states.len() - 1;
        history.finish(last, &mesh(&states[last], 0), NOTHING);
        prop_assert_eq!(history.keyframes().last(), Some(&(last as u32)));
        prop_assert!(history.keyframes().len() <= most as usize);
        prop_assert!(history.keyframes().is_sorted());
        for (state, keyframe) in (0..).zip(history.keyframes()) {
            let mut expected: Vec<[u8; 3]> =
                states[*keyframe as usize].iter().map(|corners| smallest_first(*corners)).collect();
            expected.sort_unstable();
            expected.dedup();
            prop_assert_eq!(at(&history, state), expected);
        }
    }
}

#[test]
fn an_unchanged_surface_needs_no_memory() {
    let mut history = SurfaceHistory::new(HistoryLimits::default());
    for number in 0..100 {
        assert!(history.advance());
        history.record(number, &mesh(&[[0, 1, 2], [2, 1, 3]], number), NOTHING);
    }
    assert_eq!(
        (history.triangles().len(), history.positions().len()),
        (2, 4)
    );
}

#[test]
fn invalid_triangles_are_skipped() {
    let mut broken = mesh(&[[0, 1, 2]], 0);
    broken.triangles.push([0, 1, 99]);
    broken.positions[1].y = f64::NAN;
    let mut history = SurfaceHistory::new(HistoryLimits::default());
    history.record(0, &broken, NOTHING);
    assert_eq!(history.triangles().len(), 1);
}
