//! Lists of entries under any change.

use super::*;

#[test]
fn lists_keep_what_is_added_and_forget_what_is_removed() {
    let mut crossings = Crossings::new(true);
    crossings.grow(2);
    let [one, two] = [0, 1].map(CellId::from_index);
    for id in 0..100 {
        crossings.add(one, ObservationId(id), Entrance::Unknown);
        crossings.add(two, ObservationId(id + 1000), Entrance::Unknown);
    }
    assert_eq!(crossings.of(one).count(), 100);
    crossings.retain_entries(one, |_, id| id.0 % 3 != 0);
    let mut rest: Vec<u32> = crossings.of(one).map(|id| id.0).collect();
    rest.sort_unstable();
    assert_eq!(rest, (0..100).filter(|r| r % 3 != 0).collect::<Vec<_>>());
    let mut taken = vec![];
    crossings.take(two, &mut taken);
    assert_eq!((taken.len(), crossings.of(two).count()), (100, 0));
    for id in rest {
        assert!(crossings.contains(one, ObservationId(id)));
    }
    assert!(!crossings.contains(one, ObservationId(3)));
    assert_eq!(crossings.total(), 66);
    crossings.retain_entries(one, |_, _| false);
    assert_eq!((crossings.total(), crossings.of(one).count()), (0, 0));
}

#[test]
fn any_choice_of_entries_can_be_dropped() {
    let mut crossings = Crossings::new(true);
    crossings.grow(1);
    let cell = CellId::from_index(0);
    for count in 0..64u32 {
        // Multiplicative hashing makes the choices irregular.
        for choice in 0..40u32 {
            let keep = |r: u32| (r + 1).wrapping_mul(choice * 0x9e37 + 1) >> 3 & 3 < choice % 5;
            for id in 0..count {
                crossings.add(cell, ObservationId(id), Entrance::Unknown);
            }
            crossings.retain_entries(cell, |_, id| keep(id.0));
            let mut rest: Vec<u32> = crossings.of(cell).map(|id| id.0).collect();
            rest.sort_unstable();
            let expected: Vec<u32> = (0..count).filter(|&r| keep(r)).collect();
            assert_eq!(rest, expected, "{count} {choice}");
            assert_eq!(crossings.total(), expected.len() as u64);
            crossings.add(cell, ObservationId(1000), Entrance::Unknown);
            assert_eq!(crossings.of(cell).count(), expected.len() + 1);
            crossings.clear(&mut vec![]);
        }
    }
}

#[test]
fn withdrawn_numbers_are_unlisted_at_once_and_given_out_again_later() {
    let mut crossings = Crossings::new(true);
    crossings.grow(40);
    for id in 0..200 {
        for cell in (0..40).map(CellId::from_index) {
            crossings.add(cell, ObservationId(id), Entrance::Facet(3));
        }
    }
    let mut unlisted = vec![];
    for id in 0..200 {
        crossings.withdraw(ObservationId(id), 40);
        let expected = 40 * (199 - u64::from(id));
        assert_eq!(crossings.total(), expected);
        let listed: usize = (0..40)
            .map(|cell| crossings.of(CellId::from_index(cell)).count())
            .sum();
        assert_eq!(listed as u64, expected);
        crossings.sweep(40, &mut unlisted);
        for &id in &unlisted {
            let holds = |list: &List| crossings.stored(list).any(|entry| entry.id().0 == id);
            assert!(!crossings.lists.iter().any(holds));
        }
    }
    assert!(unlisted.len() > 150, "{}", unlisted.len());
    crossings.clear(&mut unlisted);
    unlisted.sort_unstable();
    assert_eq!(unlisted, (0..200).collect::<Vec<_>>());
}

#[test]
fn an_entry_says_where_the_observation_enters() {
    let mut crossings = Crossings::new(true);
    crossings.grow(1);
    let cell = CellId::from_index(0);
    let entrances = [
        Entrance::Facet(0),
        Entrance::Facet(3),
        Entrance::Start,
        Entrance::Unknown,
    ];
    for (id, entrance) in (7..).zip(entrances) {
        crossings.add(cell, ObservationId(id), entrance);
    }
    let mut entries = vec![];
    crossings.take(cell, &mut entries);
    let taken: Vec<Entrance> = entries.iter().map(|entry| entry.entrance()).collect();
    assert_eq!(taken, entrances);
    assert_eq!(entries[1].id(), ObservationId(8));
}

#[test]
fn freed_memory_is_used_again() {
    let mut crossings = Crossings::new(true);
    crossings.grow(1);
    let cell = CellId::from_index(0);
    let mut ids = vec![];
    for round in 0..50 {
        for id in 0..40 {
            crossings.add(cell, ObservationId(round * 40 + id), Entrance::Unknown);
        }
        crossings.take(cell, &mut ids);
    }
    // 40 entries, of which the first eight were a short list for a while.
    assert_eq!((crossings.chunks.len(), crossings.shorts.len()), (3, 1));
}
