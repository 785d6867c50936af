//! The part of a 3D segment that keyframes can show.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};

/// Images reach this many of their sizes beyond their borders: their size is only known from the principal point.
const MARGIN: f64 = 1.0;

/// A part of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShownPart {
    /// Where it begins and ends, as shares of the length of the segment.
    pub(super) shares: [f64; 2],
    /// Its largest length in the images, in pixels.
    pub(super) length_px: f64,
}

impl ShownPart {
    /// A segment of which no length in an image is known.
    pub(super) const WHOLE: Self = Self {
        shares: [0.0, 1.0],
        length_px: 0.0,
    };

    /// The smallest part of a segment that holds what each of the keyframes can show of it. The whole when none shows anything.
    pub(super) fn new<'a>(
        ends: &[Point3<f64>; 2],
        camera: &Camera,
        world_from_cameras: impl Iterator<Item = &'a Isometry3<f64>>,
    ) -> Self {
        let views = world_from_cameras.filter_map(|pose| {
            let ends = ends.map(|end| pose.inverse_transform_point(&end));
            Some((ends, clipped(&ends, camera)?))
        });
        let views: Vec<([Point3<f64>; 2], [f64; 2])> = views.collect();
        let shares = views
            .iter()
            .fold([1.0, 0.0], |[low, high]: [f64; 2], (_, part)| {
                [low.min(part[0]), high.max(part[1])]
            });
        if views.is_empty() {
            return Self::WHOLE;
        }
        let lengths = views.iter().filter_map(|(ends, part)| {
            let pixel = |share: f64| camera.project(&(ends[0] + share * (ends[1] - ends[0])));
            Some((pixel(part[1])? - pixel(part[0])?).norm())
        });
        Self {
            shares,
            length_px: lengths.fold(0.0, f64::max),
        }
    }
}

/// The shares of a segment, in the frame of a camera, between which it can be in the image.
fn clipped(ends: &[Point3<f64>; 2], camera: &Camera) -> Option<[f64; 2]> {
    // On the image plane at depth 1, a side reaches from its margin to the other.
    let reach = |center: f64, focal: f64| {
        let side = 2.0 * center.abs().max(1.0);
        [
            (-MARGIN * side - center) / focal,
            ((1.0 + MARGIN) * side - center) / focal,
        ]
    };
    let [left, right] = reach(camera.cx(), camera.fx());
    let [top, bottom] = reach(camera.cy(), camera.fy());
    // Positive inside. Where all four are, so is depth.
    let inside = |point: &Point3<f64>| {
        [
            point.x - left * point.z,
            right * point.z - point.x,
            point.y - top * point.z,
            bottom * point.z - point.y,
        ]
    };
    let [from, to] = [0, 1].map(|end| inside(&ends[end]));
    let [mut low, mut high] = [0.0_f64, 1.0_f64];
    for (from, to) in from.into_iter().zip(to) {
        match (from >= 0.0, to >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (true, false) => high = high.min(from / (from - to)),
            (false, true) => low = low.max(from / (from - to)),
        }
    }
    (low < high).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(ends: [[f64; 3]; 2], shifts: &[f64]) -> ShownPart {
        let camera = Camera::pinhole(100.0, 100.0, 100.0, 50.0).unwrap();
        let poses: Vec<_> = shifts
            .iter()
            .map(|x| Isometry3::translation(*x, 0.0, 0.0))
            .collect();
        ShownPart::new(&ends.map(Point3::from), &camera, poses.iter())
    }

    #[test]
    fn a_line_in_the_image_is_shown_whole() {
        let shown = part([[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0]], &[0.0, 0.5]);
        assert_eq!(shown.shares, [0.0, 1.0]);
        assert!((shown.length_px - 100.0).abs() < 1e-9, "{shown:?}");
    }

    #[test]
    fn a_long_line_is_shown_as_far_as_images_reach() {
        // 600 pixels from -200 to 400 are 12 units at depth 2: from -6 to 6, and half a unit further for the second camera.
        let expected = [-6.0, 6.5];
        for half in [100.0, 1e6, 1e9] {
            let shown = part([[-half, 0.0, 2.0], [half, 0.0, 2.0]], &[0.0, 0.5]);
            for (share, expected) in shown.shares.iter().zip(expected) {
                let at = half * (2.0 * share - 1.0);
                assert!((at - expected).abs() < 1e-6, "{half}: {shown:?}");
            }
            assert!((shown.length_px - 600.0).abs() < 1e-3, "{shown:?}");
        }
    }

    #[test]
    fn a_line_behind_or_beside_all_cameras_is_shown_by_none() {
        for ends in [
            [[-1.0, 0.0, -2.0], [1.0, 0.0, -2.0]],
            [[100.0, 0.0, 2.0], [200.0, 0.0, 2.0]],
        ] {
            assert_eq!(part(ends, &[0.0, 0.5]), ShownPart::WHOLE);
        }
        // Only the part before the camera.
        let through = part([[0.1, 0.0, -10.0], [0.1, 0.0, 10.0]], &[0.0]);
        assert!(
            through.shares[0] > 0.5 && through.shares[1] == 1.0,
            "{through:?}"
        );
        assert!(through.length_px <= 600.0, "{through:?}");
    }
}
