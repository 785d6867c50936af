use linecarve_mesh::LineSet;
use nalgebra::Point3;
use proptest::prelude::*;

use super::state::{LiveState, LiveUpdate};
use crate::report::growth_delta::NumberedSurface;
use crate::report::page::Elements;
use delta_reader::sorted;
use linecarve_engine::testing::TestSurface;
use live_client::LiveClient;

#[path = "../../tests/program/delta_reader.rs"]
mod delta_reader;
#[path = "../../tests/program/live_client.rs"]
#[allow(dead_code, reason = "the tests of the commands use the rest")]
mod live_client;

impl NumberedSurface for TestSurface {
    fn vertex_count(&self) -> usize {
        let mut corners: Vec<u32> = self.faces().flatten().collect();
        corners.sort_unstable();
        corners.dedup();
        corners.len()
    }

    fn triangle_count(&self) -> usize {
        self.faces().count()
    }

    fn position(&self, number: u32) -> Point3<f64> {
        self.position(number)
    }

    fn color(&self, number: u32) -> Option<[u8; 3]> {
        number.is_multiple_of(2).then_some([number as u8; 3])
    }
}

fn positions(shift: u8) -> Vec<Point3<f64>> {
    let shifted = |i: u8| if i > 5 { f64::from(shift) } else { 0.0 };
    (0..8)
        .map(|i| Point3::new(f64::from(i), 0.0, shifted(i)))
        .collect()
}

fn face() -> impl Strategy<Value = [u32; 3]> {
    let three = prop::sample::subsequence((0..8).collect::<Vec<u32>>(), 3).prop_shuffle();
    three.prop_map(|corners| [corners[0], corners[1], corners[2]])
}

fn read(client: &mut LiveClient, message: Option<String>) {
    let message = message.expect("there is a message");
    client.apply(&serde_json::from_str(&message).expect("a message is JSON"));
}

proptest! {
    /// A client from the beginning, one that comes late, and one that joins at the end see the same, which is the surface.
    #[test]
    fn whole_states_and_changes_agree(
        steps in prop::collection::vec(
            (prop::collection::vec(face(), 0..12), 0_u8..3, 0_u8..4), 1..8),
        late in 0_usize..8,
    ) {
        let mut state = LiveState::default();
        let mut surface = TestSurface::default();
        let mut first = LiveClient::default();
        let mut second = None;
        let mut segments = Vec::new();
        for (step, (faces, shift, anew)) in steps.iter().enumerate() {
            if *anew == 0 {
                surface = TestSurface::default();
                segments.clear();
            }
            segments.push([Point3::origin(), Point3::new(step as f64, 1.0, 0.0)]);
            let change = surface.change_to(faces, &positions(*shift));
            let update = LiveUpdate {
                surface: Some((&surface, &change)),
                elements: Some(Elements { segments: &segments, clusters: Some(&LineSet::default()), points: &[] }),
                are_segments_anew: change.is_anew,
                ..LiveUpdate::default()
            };
            let message = state.update(&update, true);
            if let Some(second) = &mut second {
                read(second, message.clone());
            }
            read(&mut first, message);
            if step == late {
                let mut client = LiveClient::default();
                read(&mut client, state.snapshot().message());
                second = Some(client);
            }
            let position = |number: u32| surface.position(number).coords.map(|c| (c as f32).to_bits());
            let expected = sorted(surface.faces().map(|face| face.map(|v| position(v).into())));
            prop_assert_eq!(first.surface(), expected);
            prop_assert_eq!(first.segments, segments.len() as u64);
        }
        let mut last = LiveClient::default();
        read(&mut last, state.snapshot().message());
        prop_assert_eq!(&last, &first);
        if let Some(second) = second {
            prop_assert_eq!(&second, &first);
        }
    }
}

#[test]
fn nothing_is_made_for_nobody() {
    let mut state = LiveState::default();
    assert_eq!(state.update(&LiveUpdate::default(), false), None);
    assert!(state.update(&LiveUpdate::default(), true).is_some());
}
