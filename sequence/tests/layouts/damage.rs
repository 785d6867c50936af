//! Property tests: arbitrarily damaged files are read or refused, without a panic.

use linecarve_sequence::{InspectOptions, inspect};
use proptest::prelude::*;

use super::support::write_seven_scenes;
use super::{LAYOUTS, folder_with, open};

/// Small text files of a sequence, one of which is damaged.
fn text_files(layout: usize) -> &'static [&'static str] {
    [
        &["frame-000001.pose.txt", "camera-intrinsics.txt"][..],
        &["rgb.txt", "depth.txt", "groundtruth.txt", "linecarve.toml"],
        &["trajectory.log", "camera_primesense.json"],
    ][layout]
}

fn damage(bytes: &mut Vec<u8>, kind: u8, at: &prop::sample::Index, with: &[u8]) {
    let at = at.index(bytes.len().max(1)).min(bytes.len());
    match kind {
        0 => bytes.truncate(at),
        1 => bytes.splice(at..at, with.iter().copied()).for_each(drop),
        2 => {
            for (slot, value) in bytes[at..].iter_mut().zip(with) {
                *slot = *value;
            }
        }
        3 => {
            // Inserts an invalid or far too large number.
            let number = [
                &b"nan"[..],
                b"-inf",
                b"1e999",
                b"99999999999999999999",
                b"-0",
            ][with.len() % 5];
            bytes.splice(at..at, number.iter().copied()).for_each(drop);
        }
        _ => {
            let copy = bytes.clone();
            bytes.extend(copy);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_damage_to_text_files_is_read_or_refused(
        layout in 0_usize..3,
        file in any::<prop::sample::Index>(),
        hits in prop::collection::vec(
            (0_u8..5, any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 0..12)),
            1..4,
        ),
    ) {
        let folder = folder_with(LAYOUTS[layout].1);
        let path = folder.path().join(file.get(text_files(layout)));
        let mut bytes = std::fs::read(&path).unwrap();
        for (kind, at, with) in &hits {
            damage(&mut bytes, *kind, at, with);
        }
        std::fs::write(&path, bytes).unwrap();
        match open(folder.path()) {
            Ok(sequence) => {
                prop_assert!(!sequence.frames().is_empty());
                for frame in sequence.frames() {
                    let finite = frame.world_from_camera.to_homogeneous().iter().all(|v| v.is_finite());
                    prop_assert!(finite);
                }
                let _ = sequence.load_gray(0);
                let _ = sequence.load_depth(0);
            }
            // The message names the file.
            Err(message) => prop_assert!(message.contains(&*folder.path().to_string_lossy()), "{message}"),
        }
    }

    #[test]
    fn any_damage_to_images_is_decoded_or_refused(
        kind in 0_u8..3,
        at in any::<prop::sample::Index>(),
        with in prop::collection::vec(any::<u8>(), 1..12),
        is_depth in any::<bool>(),
    ) {
        let folder = folder_with(|folder| write_seven_scenes(folder, 1));
        let name = if is_depth { "frame-000000.depth.png" } else { "frame-000000.color.png" };
        let path = folder.path().join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        damage(&mut bytes, kind, &at, &with);
        std::fs::write(&path, bytes).unwrap();
        if let Ok(sequence) = open(folder.path()) {
            let _ = sequence.load_gray(0);
            let _ = sequence.load_color(0);
            let _ = sequence.load_depth(0);
            let _ = inspect(&sequence, &InspectOptions::default());
        }
    }
}
