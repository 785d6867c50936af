//! Which values of a depth image its camera can have measured.
//!
//! Renderers write a large number where they see nothing, and files hold a single wrong value now and then. One camera does not measure
//! both 2 m and 10 000 km: the standard deviation of a depth grows with its square, so depths much larger than the others would have one as
//! large as themselves.

use std::ops::RangeInclusive;

use super::SensorNoise;

/// Octaves of depth that a camera bridges without a value between: more than the ratio of the depth at which the standard deviation is as
/// large as the depth to that where it is [`SensorNoise::STRUCTURED_LIGHT_RELATIVE`] of it, 333.
const WIDEST_GAP: usize = 9;
const _: () = assert!(SensorNoise::STRUCTURED_LIGHT_RELATIVE * (1 << WIDEST_GAP) as f64 > 1.0);
/// One in so many depths makes a group that is more than a few wrong values.
const FEWEST: usize = 100;

/// Depths without gaps between them.
#[derive(Debug, Clone, Copy)]
struct Group {
    count: usize,
    nearest: f32,
    farthest: f32,
}

impl Group {
    /// Whether it is one number, as that which stands for the background.
    fn is_constant(&self) -> bool {
        self.nearest == self.farthest
    }
}

/// The range of depths that the camera of an image can have measured; `None` when no depth is known. 0, negative, subnormal and non-finite
/// values are unknown.
///
/// Depths are split where one is more than 512 times the one before it. Of these groups the nearest is measured that has one depth in 100 and
/// is not a single number, and if there is none, the nearest that has one in 100.
///
/// # Complexity
/// Linear in the number of depths.
pub fn measurable_range(depths: impl IntoIterator<Item = f32>) -> Option<RangeInclusive<f32>> {
    let mut octaves: [Option<Group>; 256] = [None; 256];
    let mut known = 0;
    for depth in depths {
        if !is_depth(depth) {
            continue;
        }
        known += 1;
        let group = octaves[(depth.to_bits() >> 23) as usize].get_or_insert(Group {
            count: 0,
            nearest: depth,
            farthest: depth,
        });
        group.count += 1;
        group.nearest = group.nearest.min(depth);
        group.farthest = group.farthest.max(depth);
    }
    let mut groups: Vec<(usize, Group)> = Vec::new();
    for (octave, next) in octaves.into_iter().enumerate() {
        let Some(next) = next else { continue };
        match groups.last_mut() {
            Some((last, group)) if octave - *last <= WIDEST_GAP => {
                *last = octave;
                group.count += next.count;
                group.farthest = next.farthest;
            }
            _ => groups.push((octave, next)),
        }
    }
    let large = || {
        let groups = groups.iter().map(|(_, group)| group);
        groups.filter(|group| group.count * FEWEST >= known)
    };
    let group = large()
        .find(|group| !group.is_constant())
        .or_else(|| large().next())?;
    Some(group.nearest..=group.farthest)
}

/// Whether a value is a depth at all: its inverse is finite, too.
fn is_depth(value: f32) -> bool {
    value > 0.0 && value.is_normal()
}

/// Sets values that are no depths to 0, and depths outside the [measurable range](measurable_range). Returns the number of the latter.
pub fn remove_unmeasurable(depths: &mut [f32]) -> usize {
    let range = measurable_range(depths.iter().copied());
    let mut removed = 0;
    for depth in depths {
        let is_known = is_depth(*depth);
        if !range.as_ref().is_some_and(|range| range.contains(depth)) {
            removed += usize::from(is_known);
            *depth = 0.0;
        }
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depths of a room with others in place of the first.
    fn room_with(others: &[f32]) -> Vec<f32> {
        let room = |i: usize| 1.0 + 0.001 * i as f32;
        let depths = (0..3000).map(|i| others.get(i).copied().unwrap_or(room(i)));
        depths.collect()
    }

    fn removed_of(others: &[f32]) -> (usize, usize) {
        let mut depths = room_with(others);
        let removed = remove_unmeasurable(&mut depths);
        (
            removed,
            depths.iter().filter(|depth| **depth == 0.0).count(),
        )
    }

    #[test]
    fn a_wrong_value_is_removed_and_counted() {
        for wrong in [1e10, f32::MAX, 5000.0, 1e-9, 1e-4, f32::MIN_POSITIVE] {
            assert_eq!(removed_of(&[wrong]), (1, 1), "{wrong}");
        }
        assert_eq!(removed_of(&[1e10, 1e-9, 2e15]), (3, 3));
    }

    #[test]
    fn unknown_values_are_not_counted() {
        let unknown = [0.0, -0.0, -1.0, f32::NAN, f32::INFINITY, -1e10, 1e-40];
        assert_eq!(removed_of(&unknown), (0, 7));
        assert_eq!(measurable_range([0.0, f32::NAN]), None);
        assert_eq!(remove_unmeasurable(&mut []), 0);
    }

    #[test]
    fn a_background_of_any_size_is_removed() {
        for share in [300, 1500, 2900] {
            assert_eq!(removed_of(&vec![1e10; share]), (share, share));
            // Distances along the ray become depths that differ.
            let oblique: Vec<f32> = (0..share).map(|i| 1e10 - 1e6 * i as f32).collect();
            assert_eq!(removed_of(&oblique), (share, share));
            assert_eq!(removed_of(&vec![1e-6; share]), (share, share));
        }
    }

    #[test]
    fn all_that_one_camera_sees_stays() {
        // From a hand to the horizon; one number in the whole image; nothing but the background.
        let scene: Vec<f32> = (0..3000).map(|i| 0.2 * 1.003_f32.powi(i)).collect();
        for mut depths in [scene, vec![2.0; 50], vec![1e10; 50]] {
            let before = depths.clone();
            assert_eq!(remove_unmeasurable(&mut depths), 0);
            assert_eq!(depths, before);
        }
        assert_eq!(removed_of(&[300.0]), (0, 0));
        let mut wall = [vec![2.0; 50], vec![1e10; 50]].concat();
        assert_eq!(remove_unmeasurable(&mut wall), 50);
    }
}
