//! Colour map for distances.

/// Ten colours from dark violet over green to yellow, equally spaced in lightness, after *viridis* (S. van der Walt
/// and N. Smith, CC0).
const COLORS: [[f64; 3]; 10] = [
    [68.0, 1.0, 84.0],
    [72.0, 40.0, 120.0],
    [62.0, 74.0, 137.0],
    [49.0, 104.0, 142.0],
    [38.0, 130.0, 142.0],
    [31.0, 158.0, 137.0],
    [53.0, 183.0, 121.0],
    [109.0, 205.0, 89.0],
    [180.0, 222.0, 44.0],
    [253.0, 231.0, 37.0],
];

/// The sRGB colour of a value from 0 (dark) to 1 (bright), clamped to this range. NaN is grey.
pub fn heat_color(share: f64) -> [u8; 3] {
    if share.is_nan() {
        return [128; 3];
    }
    let rank = share.clamp(0.0, 1.0) * (COLORS.len() - 1) as f64;
    let (low, high) = (COLORS[rank.floor() as usize], COLORS[rank.ceil() as usize]);
    let fraction = rank.fract();
    std::array::from_fn(|channel| {
        (low[channel] + (high[channel] - low[channel]) * fraction).round() as u8
    })
}

/// A colour for each distance: dark at 0, bright from `largest` on.
pub fn heat_colors(distances: &[f64], largest: f64) -> Vec<[u8; 3]> {
    let share = |distance: &f64| {
        if *distance <= 0.0 {
            0.0
        } else {
            distance / largest
        }
    };
    distances.iter().map(|d| heat_color(share(d))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_hold_beyond_their_range() {
        assert_eq!(heat_color(-1.0), [68, 1, 84]);
        assert_eq!(heat_color(f64::INFINITY), [253, 231, 37]);
        assert_eq!(heat_color(f64::NAN), [128; 3]);
        assert_eq!(
            heat_colors(&[0.0, 2.0, f64::INFINITY], 2.0),
            [[68, 1, 84], [253, 231, 37], [253, 231, 37]]
        );
        assert_eq!(heat_colors(&[0.0, 1.0], 0.0), [[68, 1, 84], [253, 231, 37]]);
    }

    #[test]
    fn lightness_rises() {
        let lightness = |c: [u8; 3]| {
            0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
        };
        let scale: Vec<f64> = (0..=100)
            .map(|i| lightness(heat_color(f64::from(i) / 100.0)))
            .collect();
        assert!(scale.is_sorted());
    }
}
