//! Matching of map points with the features of an image.

use linecarve_points::Descriptor;
use multiversion::multiversion;
use nalgebra::{Isometry3, Point2};

use crate::camera::Pinhole;
use crate::frame::{FrameFeatures, LEVELS, SCALE_FACTOR, level_scale};
use crate::map::{Map, PointId};

/// Largest descriptor distance of matches whose position is predicted, in bits.
pub(crate) const FAR_DESCRIPTOR: u32 = 100;

/// Largest descriptor distance of matches that are not predicted well.
pub(crate) const NEAR_DESCRIPTOR: u32 = 50;

/// Bins of the histogram of rotations, and how many of them are kept.
const ROTATION_BINS: usize = 30;
const ROTATION_BINS_KEPT: usize = 3;

/// Where a point is expected in an image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    pub(crate) point: PointId,
    pub(crate) pixel: Point2<f64>,
    pub(crate) radius_px: f64,
    /// Admissible pyramid levels.
    pub(crate) octaves: [u8; 2],
    pub(crate) descriptor: Descriptor,
    /// Orientation where it was seen before; `None` when unknown.
    pub(crate) angle_rad: Option<f32>,
}

/// How candidates of a point are judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rules {
    pub(crate) max_distance: u32,
    /// Largest ratio of the best to the second-best distance, when both are of one pyramid level.
    pub(crate) ratio: f64,
}

/// Rules for matches without an expected position.
pub(crate) const UNGUIDED: Rules = Rules {
    max_distance: NEAR_DESCRIPTOR + 14,
    ratio: 0.8,
};

/// Matches expected points with features that have none; each feature and each point has at most one. Returns pairs
/// (feature, index of the expected point), sorted by feature.
pub(crate) fn match_expected(
    view: &FrameFeatures,
    is_taken: impl Fn(u32) -> bool,
    expected: &[Expected],
    rules: &Rules,
) -> Vec<(u32, usize)> {
    let mut best_of: Vec<Option<(u32, usize)>> = vec![None; view.len()];
    for (index, one) in expected.iter().enumerate() {
        let Some((distance, feature)) = best_feature(view, &is_taken, one, rules) else {
            continue;
        };
        let slot = &mut best_of[feature as usize];
        if slot.is_none_or(|(other, _)| distance < other) {
            *slot = Some((distance, index));
        }
    }
    let mut matches: Vec<(u32, usize)> = best_of
        .into_iter()
        .enumerate()
        .filter_map(|(feature, slot)| slot.map(|(_, index)| (feature as u32, index)))
        .collect();
    keep_common_rotation(&mut matches, |(feature, index)| {
        let before = expected[*index].angle_rad?;
        Some(view.features.angles_rad[*feature as usize] - before)
    });
    matches
}

/// The feature with the nearest descriptor near the expected pixel.
fn best_feature(
    view: &FrameFeatures,
    is_taken: &impl Fn(u32) -> bool,
    expected: &Expected,
    rules: &Rules,
) -> Option<(u32, u32)> {
    let [x, y] = [expected.pixel.x as f32, expected.pixel.y as f32];
    let radius = expected.radius_px as f32;
    let mut best: Option<(u32, u32)> = None;
    let mut second: Option<(u32, u32)> = None;
    view.grid.near_box(
        [x - radius, y - radius],
        [x + radius, y + radius],
        |feature| {
            let octave = view.octave(feature);
            let [at_x, at_y] = view.features.pixels[feature as usize];
            if octave < expected.octaves[0]
                || octave > expected.octaves[1]
                || (at_x - x).abs() > radius
                || (at_y - y).abs() > radius
                || is_taken(feature)
            {
                return;
            }
            let found = (
                expected.descriptor.distance(view.descriptor(feature)),
                feature,
            );
            if best.is_none_or(|other| found < other) {
                second = best;
                best = Some(found);
            } else if second.is_none_or(|other| found < other) {
                second = Some(found);
            }
        },
    );
    let (distance, feature) = best.filter(|(distance, _)| *distance <= rules.max_distance)?;
    if let Some((other, rival)) = second
        && view.octave(rival) == view.octave(feature)
        && f64::from(distance) > rules.ratio * f64::from(other)
    {
        return None;
    }
    Some((distance, feature))
}

/// Keeps matches whose rotation is among the most frequent ones; matches without rotation are kept.
fn keep_common_rotation<T>(matches: &mut Vec<T>, rotation: impl Fn(&T) -> Option<f32>) {
    let bin = |angle: f32| {
        let share = angle.rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
        (share * ROTATION_BINS as f32) as usize % ROTATION_BINS
    };
    let mut counts = [0_usize; ROTATION_BINS];
    for one in matches.iter() {
        if let Some(angle) = rotation(one) {
            counts[bin(angle)] += 1;
        }
    }
    let mut order: Vec<usize> = (0..ROTATION_BINS).collect();
    order.sort_by_key(|&at| (std::cmp::Reverse(counts[at]), at));
    let most = counts[order[0]];
    let mut is_kept = [false; ROTATION_BINS];
    for &at in order.iter().take(ROTATION_BINS_KEPT) {
        is_kept[at] = 10 * counts[at] >= most;
    }
    matches.retain(|one| rotation(one).is_none_or(|angle| is_kept[bin(angle)]));
}

/// Matches two sets of descriptors by the nearest one both ways; pairs of positions in the lists.
pub(crate) fn match_descriptors(
    first: &[Descriptor],
    second: &[Descriptor],
    rules: &Rules,
) -> Vec<(usize, usize)> {
    // Best and second-best distance of each of the second, and the best of the first.
    let mut best_of: Vec<Option<(u32, usize)>> = vec![None; second.len()];
    for (index, descriptor) in first.iter().enumerate() {
        let (at, [best, rival]) = nearest(descriptor, second);
        let is_clear = rival == u32::MAX || f64::from(best) < rules.ratio * f64::from(rival);
        if best <= rules.max_distance && is_clear && best_of[at].is_none_or(|(d, _)| best < d) {
            best_of[at] = Some((best, index));
        }
    }
    let mut pairs: Vec<(usize, usize)> = best_of
        .into_iter()
        .enumerate()
        .filter_map(|(other, slot)| slot.map(|(_, index)| (index, other)))
        .collect();
    pairs.sort_unstable();
    pairs
}

/// The position of the nearest descriptor, the first of equals, and the distances of the nearest two; `u32::MAX` where there are none.
/// A first map spends most of its time here, so it uses the instruction that counts bits where the processor has it.
#[multiversion(targets("x86_64+popcnt"))]
fn nearest(descriptor: &Descriptor, candidates: &[Descriptor]) -> (usize, [u32; 2]) {
    let (mut at, mut best, mut rival) = (0, u32::MAX, u32::MAX);
    for (other, candidate) in candidates.iter().enumerate() {
        let distance = descriptor.distance(candidate);
        if distance < best {
            (at, best, rival) = (other, distance, best);
        } else if distance < rival {
            rival = distance;
        }
    }
    (at, [best, rival])
}

/// Where a point of the map is expected, by its distance and direction; `None` when it cannot be seen from there.
pub(crate) fn expect_point(
    map: &Map,
    camera: &Pinhole,
    camera_from_world: &Isometry3<f64>,
    center: &nalgebra::Point3<f64>,
    id: PointId,
    radius_factor: f64,
) -> Option<Expected> {
    let point = map.point(id);
    let pixel = camera.project_inside(&(camera_from_world * point.position))?;
    let towards = center - point.position;
    let distance = towards.norm();
    if distance < 0.8 * point.near || distance > 1.2 * point.far {
        return None;
    }
    let cosine = towards.dot(&point.normal) / distance;
    if cosine < 0.5 {
        return None;
    }
    let level = ((point.far / distance).ln() / SCALE_FACTOR.ln()).ceil();
    let level = level.clamp(0.0, f64::from(LEVELS - 1)) as u8;
    let radius = if cosine > 0.998 { 2.5 } else { 4.0 };
    Some(Expected {
        point: id,
        pixel,
        radius_px: radius_factor * radius * level_scale(level),
        octaves: [level.saturating_sub(1), level],
        descriptor: point.descriptor,
        angle_rad: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descriptors_find_their_partners() {
        let of = |bits: u64| Descriptor([bits, 0, 0, 0]);
        let first = [of(0), of(0xffff_0000), of(0xff)];
        let second = [of(0xfffe_0000), of(0xff01), of(1)];
        let rules = Rules {
            max_distance: 10,
            ratio: 0.7,
        };
        assert_eq!(match_descriptors(&first, &second, &rules), [(0, 2), (1, 0)]);
    }

    #[test]
    fn rare_rotations_are_dropped() {
        let mut matches: Vec<f32> = vec![0.1; 40];
        matches.extend([2.0, 4.0]);
        keep_common_rotation(&mut matches, |angle| Some(*angle));
        assert_eq!(matches.len(), 40);
    }
}
