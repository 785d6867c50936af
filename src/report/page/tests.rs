//! Tests of surface histories.

use nalgebra::Point3;
use proptest::prelude::*;

use super::{Elements, HistoryLimits, SurfaceHistory};
use linecarve_engine::testing::TestSurface;

const NOTHING: Elements<'static> = Elements {
    segments: &[],
    clusters: None,
    points: &[],
};

/// Points on a line, one of them elsewhere.
fn positions(turn: usize) -> Vec<Point3<f64>> {
    let height = |name: usize| if name == 4 { (turn % 3) as f64 } else { 0.0 };
    (0..9)
        .map(|name| Point3::new(name as f64, height(name), -0.0))
        .collect()
}

/// Notes the change to these triangles.
fn note(history: &mut SurfaceHistory, surface: &mut TestSurface, faces: &[[u8; 3]], turn: usize) {
    let faces: Vec<[u32; 3]> = faces.iter().map(|face| face.map(u32::from)).collect();
    history.note(&surface.change_to(&faces, &positions(turn)));
}

/// The triangles of a history at a state, by names and heights of their corners, the smallest first.
fn at(history: &SurfaceHistory, state: u16) -> Vec<[(u8, u64); 3]> {
    let name = |corner: u32| {
        let position = history.position(corner);
        (position.x as u8, position.y.to_bits())
    };
    let records = history.triangles.records().iter();
    let mut current: Vec<[(u8, u64); 3]> = records
        .filter(|(_, lifetime)| lifetime.holds(state))
        .map(|(corners, _)| smallest_first(corners.map(name)))
        .collect();
    current.sort_unstable();
    current
}

fn smallest_first<T: Ord + Copy>(mut corners: [T; 3]) -> [T; 3] {
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
        anew in 0usize..24,
    ) {
        let limits = HistoryLimits { states: most, memory: 1 << 20 };
        let mut history = SurfaceHistory::new(limits);
        let mut surface = TestSurface::default();
        for (number, triangles) in states.iter().enumerate() {
            if number == anew {
                surface = TestSurface::default();
            }
            note(&mut history, &mut surface, triangles, number);
            if history.advance() {
                history.record(number, |v| surface.position(v), number, NOTHING);
            }
        }
        let last = states.len() - 1;
        history.finish(last, |v| surface.position(v), last, NOTHING);
        prop_assert_eq!(history.keyframes().last(), Some(&(last as u32)));
        prop_assert!(history.keyframes().len() <= most as usize);
        prop_assert!(history.keyframes().is_sorted());
        prop_assert_eq!(history.vertex_counts(), history.keyframes());
        for (state, keyframe) in (0..).zip(history.keyframes()) {
            let height = |name: u8| if name == 4 { f64::from(keyframe % 3) } else { 0.0 };
            let mut expected: Vec<[(u8, u64); 3]> = states[*keyframe as usize]
                .iter()
                .map(|face| smallest_first(face.map(|name| (name, height(name).to_bits()))))
                .collect();
            expected.sort_unstable();
            expected.dedup();
            prop_assert_eq!(at(&history, state), expected);
        }
        let records = history.triangles.records();
        prop_assert!(records.is_sorted_by_key(|(ids, lifetime)| (lifetime.first_state, *ids)));
        prop_assert!(records.iter().all(|(ids, _)| ids[0] < ids[1] && ids[0] < ids[2]));
    }
}

#[test]
fn vertices_of_dropped_states_go_with_them() {
    let limits = HistoryLimits {
        states: 4,
        memory: usize::MAX,
    };
    let mut history = SurfaceHistory::new(limits);
    let mut surface = TestSurface::default();
    for number in 0..64 {
        // Vertex 4 is elsewhere each time.
        note(&mut history, &mut surface, &[[0, 1, 4]], number);
        if history.advance() {
            history.record(number, |v| surface.position(v), 3, NOTHING);
        }
    }
    assert!(history.keyframes().len() <= 4);
    // The two that stay, and one for each state.
    assert!(
        history.positions().len() <= 6,
        "{}",
        history.positions().len()
    );
}

#[test]
fn an_unchanged_surface_needs_no_memory() {
    let mut history = SurfaceHistory::new(HistoryLimits::default());
    let mut surface = TestSurface::default();
    for number in 0..100 {
        note(&mut history, &mut surface, &[[0, 1, 2], [2, 1, 3]], 0);
        assert!(history.advance());
        history.record(number, |v| surface.position(v), 4, NOTHING);
    }
    assert_eq!(
        (history.triangles().len(), history.positions().len()),
        (2, 4)
    );
}
