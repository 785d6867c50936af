//! FAST-9 corners of a grey image.
//!
//! # Reference
//! Rosten, Drummond, "Machine learning for high-speed corner detection", ECCV 2006. Scores, their order and the thinning of
//! wide images are those of `kornia-imgproc` 0.2 on a processor with AVX2, bit for bit, on every processor.

use linecarve_lines::image::GrayImage;

/// Pixels that are scored together.
const LANES: usize = 16;

/// One value for each of [`LANES`] neighbouring pixels of a row.
type Lanes = [u8; LANES];

/// Column and row offsets of the circle of radius 3 around a corner, in order.
const RING: [[isize; 2]; 16] = [
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
];

/// Radius of the ring.
const RADIUS_PX: usize = 3;

/// Smallest border: a group of pixels that starts inside the border may end outside, but its ring stays in the image.
pub(super) const MIN_BORDER_PX: usize = RADIUS_PX + LANES;

/// Images of this width and more yield only corners whose score exceeds both horizontal neighbours of their group.
const THINNED_WIDTH_PX: usize = 800;

/// A pixel that passed the segment test.
///
/// Of equal responses the order is that of `sort_unstable_by`, which depends on the size of this type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FastCorner {
    pub(super) row: usize,
    pub(super) column: usize,
    /// Largest threshold at which the pixel is still a corner, divided by 255.
    pub(super) response: f32,
}

/// Corners at least `border` pixels from the edge of the image, row by row: nine successive pixels of the ring are all
/// brighter, or all darker, than the centre by more than `threshold`.
///
/// # Panics
/// When `border` is below [`MIN_BORDER_PX`].
pub(super) fn fast_corners(image: &GrayImage, threshold: u8, border: usize) -> Vec<FastCorner> {
    assert!(border >= MIN_BORDER_PX, "the ring of a group must fit");
    let (width, height) = (image.width(), image.height());
    let ring = RING.map(|[column, row]| row * width as isize + column);
    let right = width.saturating_sub(border);
    let mut corners = Vec::new();
    for row in border..height.saturating_sub(border) {
        for column in (border..right).step_by(LANES) {
            let start = row * width + column;
            let Some(scores) = segment_scores(image.samples(), start, &ring, threshold) else {
                continue;
            };
            let is_complete = column + LANES <= right;
            let is_thinned = is_complete && width >= THINNED_WIDTH_PX;
            for lane in 0..LANES.min(right - column) {
                let score = scores[lane];
                let is_beaten = is_thinned && {
                    let before = lane.checked_sub(1).map_or(0, |lane| scores[lane]);
                    let after = scores.get(lane + 1).copied().unwrap_or(0);
                    score <= before.max(after)
                };
                if score <= threshold || is_beaten {
                    continue;
                }
                let score = f32::from(score);
                corners.push(FastCorner {
                    row,
                    column: column + lane,
                    // The two roundings differ, and with them the order of corners.
                    response: if is_complete {
                        score * (1.0 / 255.0)
                    } else {
                        score / 255.0
                    },
                });
            }
        }
    }
    corners
}

/// The corners whose response no neighbour exceeds; of equal neighbours, the first. `corners` must be sorted by rows, then by
/// columns, and keep one pixel from the edge of an image of this width.
pub(super) fn local_maxima(corners: Vec<FastCorner>, width: usize) -> Vec<FastCorner> {
    let Some(last) = corners.last() else {
        return corners;
    };
    let mut responses = vec![0.0_f32; (last.row + 2) * width];
    for corner in &corners {
        responses[corner.row * width + corner.column] = corner.response;
    }
    corners
        .into_iter()
        .filter(|corner| {
            let at = corner.row * width + corner.column;
            let before = [at - width - 1, at - width, at - width + 1, at - 1];
            let after = [at + 1, at + width - 1, at + width, at + width + 1];
            before
                .iter()
                .all(|&other| responses[other] < corner.response)
                && after
                    .iter()
                    .all(|&other| responses[other] <= corner.response)
        })
        .collect()
}

/// The `most` corners with the largest responses, in descending order.
pub(super) fn strongest(mut corners: Vec<FastCorner>, most: usize) -> Vec<FastCorner> {
    let descending = |a: &FastCorner, b: &FastCorner| b.response.total_cmp(&a.response);
    if most < corners.len() {
        corners.select_nth_unstable_by(most, descending);
        corners.truncate(most);
    }
    corners.sort_unstable_by(descending);
    corners
}

/// Scores of the pixels that start at an index: the largest threshold at which each is a corner. `None` when none exceeds
/// `threshold`.
fn segment_scores(
    samples: &[u8],
    start: usize,
    ring: &[isize; 16],
    threshold: u8,
) -> Option<Lanes> {
    let lanes = |offset: isize| -> &Lanes {
        samples[start.wrapping_add_signed(offset)..]
            .first_chunk()
            .expect("the border leaves room for the ring")
    };
    let center = lanes(0);
    // Nine of sixteen successive pixels contain two successive ones of these four.
    let quarters = [0, 4, 8, 12].map(|k| lanes(ring[k]));
    let mut bound = [0; LANES];
    for k in 0..4 {
        let (a, b) = (quarters[k], quarters[(k + 1) % 4]);
        for lane in 0..LANES {
            let (low, high) = (a[lane].min(b[lane]), a[lane].max(b[lane]));
            let brighter = low.saturating_sub(center[lane]);
            let darker = center[lane].saturating_sub(high);
            bound[lane] = bound[lane].max(brighter).max(darker);
        }
    }
    if bound.iter().all(|bound| *bound <= threshold) {
        return None;
    }
    let mut brighter = [[0; LANES]; 16];
    let mut darker = [[0; LANES]; 16];
    for k in 0..16 {
        let pixel = lanes(ring[k]);
        for lane in 0..LANES {
            brighter[k][lane] = pixel[lane].saturating_sub(center[lane]);
            darker[k][lane] = center[lane].saturating_sub(pixel[lane]);
        }
    }
    let (brighter, darker) = (best_arc(&brighter), best_arc(&darker));
    Some(largest(brighter, &darker))
}

/// The largest, over all arcs of nine successive differences of the ring, of the smallest difference in the arc.
fn best_arc(differences: &[Lanes; 16]) -> Lanes {
    // Smallest of two, four and eight differences from each on.
    let twos = with_later(differences, differences, 1);
    let fours = with_later(&twos, &twos, 2);
    let eights = with_later(&fours, &fours, 4);
    let nines = with_later(&eights, differences, 8);
    nines.iter().fold([0; LANES], largest)
}

/// The smaller of each value and the one of `later` that is `step` further along the ring.
fn with_later(values: &[Lanes; 16], later: &[Lanes; 16], step: usize) -> [Lanes; 16] {
    let mut smaller = *values;
    for (k, smaller) in smaller.iter_mut().enumerate() {
        for (value, later) in smaller.iter_mut().zip(&later[(k + step) % 16]) {
            *value = (*value).min(*later);
        }
    }
    smaller
}

fn largest(mut a: Lanes, b: &Lanes) -> Lanes {
    for (a, b) in a.iter_mut().zip(b) {
        *a = (*a).max(*b);
    }
    a
}

#[cfg(test)]
mod tests {
    use kornia_image::{Image, ImageSize};
    use kornia_imgproc::features::{fast_detect_rows_u8_serial, suppress_direct_standalone};

    use super::*;
    use crate::tests::{room_images, squares};

    #[test]
    fn corners_and_their_order_are_those_of_kornia() {
        let mut images = room_images();
        for (width, height) in [
            (640, 480),
            (799, 60),
            (800, 60),
            (1501, 700),
            (39, 39),
            (54, 41),
        ] {
            images.push(squares(width, height));
        }
        for image in images {
            let (width, height) = (image.width(), image.height());
            let size = ImageSize { width, height };
            let input = Image::<u8, 1>::from_size_slice(size, image.samples()).unwrap();
            for (threshold, border, most) in
                [(1, 19, 100), (5, 19, 10_000), (12, 19, 600), (60, 23, 60)]
            {
                let fraction = f32::from(threshold) / 255.0;
                let expected = fast_detect_rows_u8_serial(&input, fraction, 9, border, 0..height);
                let expected = suppress_direct_standalone(expected, most, width, height, 1);
                let found = strongest(fast_corners(&image, threshold, border), most);
                let found: Vec<_> = found
                    .iter()
                    .map(|corner| ([corner.row, corner.column], corner.response))
                    .collect();
                // Without AVX2 the other implementation thins nothing and rounds otherwise.
                if std::arch::is_x86_feature_detected!("avx2") {
                    assert!(found == expected, "{width}x{height}, {threshold}");
                }
            }
        }
    }

    #[test]
    fn a_score_is_the_largest_threshold() {
        let image = squares(120, 90);
        let corners = |threshold| fast_corners(&image, threshold, MIN_BORDER_PX);
        for corner in corners(10) {
            let score = (corner.response * 255.0).round() as u8;
            let is_at =
                |other: &FastCorner| (other.row, other.column) == (corner.row, corner.column);
            assert!(corners(score - 1).iter().any(is_at) && !corners(score).iter().any(is_at));
        }
    }

    #[test]
    fn images_within_the_border_have_no_corners() {
        for (width, height) in [(1, 1), (38, 200), (200, 38), (18, 18)] {
            assert!(fast_corners(&squares(width, height), 5, MIN_BORDER_PX).is_empty());
        }
    }

    #[test]
    fn of_neighbouring_corners_the_strongest_stays() {
        let corner = |row, column, response| FastCorner {
            row,
            column,
            response,
        };
        let corners = vec![
            corner(3, 4, 0.2),
            corner(3, 5, 0.3),
            corner(3, 9, 0.3),
            corner(3, 10, 0.3),
            corner(4, 4, 0.1),
            corner(5, 9, 0.1),
        ];
        let left = [corners[1], corners[2], corners[5]];
        assert_eq!(local_maxima(corners, 12), left);
        assert_eq!(local_maxima(Vec::new(), 12), []);
    }
}
