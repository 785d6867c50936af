//! Packing of rectangles into an atlas.

/// Largest side of an atlas: what browsers draw everywhere.
pub(super) const MAX_SIDE: u32 = 8192;

/// Left upper corners of rectangles, and the size of the atlas that holds all of them without overlap; `None` when they need
/// an atlas with a longer side than [`MAX_SIDE`].
///
/// # Reference
/// E. Coffman, M. Garey, D. Johnson, R. Tarjan, "Performance Bounds for Level-Oriented Two-Dimensional Packing Algorithms",
/// SIAM Journal on Computing 1980: next-fit decreasing height.
pub(super) fn pack(sizes: &[[u32; 2]]) -> Option<(Vec<[u32; 2]>, [u32; 2])> {
    let area: u64 = sizes
        .iter()
        .map(|[w, h]| u64::from(*w) * u64::from(*h))
        .sum();
    let widest = sizes.iter().map(|size| size[0]).max().unwrap_or(1);
    // Levels waste about a tenth.
    let width = ((1.1 * area as f64).sqrt().ceil() as u32)
        .clamp(1, MAX_SIDE)
        .max(widest);
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&at| {
        (
            std::cmp::Reverse(sizes[at][1]),
            std::cmp::Reverse(sizes[at][0]),
            at,
        )
    });
    let mut corners = vec![[0, 0]; sizes.len()];
    let (mut x, mut y, mut level) = (0, 0, 0);
    for at in order {
        let [w, h] = sizes[at];
        if x + w > width {
            (x, y) = (0, y + level);
            level = 0;
        }
        if y + h > MAX_SIDE || w > MAX_SIDE {
            return None;
        }
        corners[at] = [x, y];
        level = level.max(h);
        x += w;
    }
    Some((corners, [width, (y + level).max(1)]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn rectangles_lie_inside_and_never_overlap(
            sizes in proptest::collection::vec([1_u32..80, 1_u32..80], 0..80),
        ) {
            let (corners, [width, height]) = pack(&sizes).unwrap();
            let mut owners = vec![false; width as usize * height as usize];
            for ([x, y], [w, h]) in corners.iter().zip(&sizes) {
                prop_assert!(x + w <= width && y + h <= height);
                for row in *y..y + h {
                    for column in *x..x + w {
                        let owner = &mut owners[(row * width + column) as usize];
                        prop_assert!(!*owner);
                        *owner = true;
                    }
                }
            }
        }
    }

    #[test]
    fn too_much_is_refused() {
        assert_eq!(pack(&[[MAX_SIDE + 1, 1]]), None);
        assert_eq!(pack(&[[5000, 5000]; 4]), None);
    }
}
