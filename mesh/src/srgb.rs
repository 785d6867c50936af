//! The sRGB transfer curve.

use std::sync::LazyLock;

/// Linear intensity, 0 to 1, of an sRGB byte.
pub fn linear(byte: u8) -> f64 {
    linear_value(f64::from(byte) / 255.0)
}

/// Linear intensity, 0 to 1, of an sRGB value, 0 to 1.
pub fn linear_value(value: f64) -> f64 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// sRGB value, 0 to 255 and not rounded, of a linear intensity; intensities beyond 0 to 1 are clipped.
pub fn encoded(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    let curve = if value <= 0.003_130_8 {
        12.92 * value
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    };
    curve * 255.0
}

/// Linear intensities of the bytes.
static LINEAR: LazyLock<[f64; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear(i as u8)));

/// The least intensity, positive, that each byte from 1 on stands for.
static LEAST: LazyLock<[f64; 255]> = LazyLock::new(|| {
    std::array::from_fn(|index| {
        let is_reached = |bits: u64| encoded(f64::from_bits(bits)).round() as usize > index;
        let (mut below, mut above) = (0.0_f64.to_bits(), 1.0_f64.to_bits());
        while above - below > 1 {
            let middle = below + (above - below) / 2;
            match is_reached(middle) {
                true => above = middle,
                false => below = middle,
            }
        }
        f64::from_bits(above)
    })
});

/// Linear colour of an sRGB colour.
pub fn linear_color(color: [u8; 3]) -> [f64; 3] {
    color.map(|byte| LINEAR[usize::from(byte)])
}

/// The byte of the smallest intensity in each of 4096 equal intervals. Within an interval it grows by at most one.
static FIRST: LazyLock<[u8; 4096]> = LazyLock::new(|| {
    std::array::from_fn(|i| LEAST.partition_point(|least| *least <= i as f64 / 4096.0) as u8)
});

/// sRGB colour of a linear colour; its intensities are rounded.
pub fn encoded_color(color: [f64; 3]) -> [u8; 3] {
    let (first, least) = (&*FIRST, &*LEAST);
    color.map(|value| {
        let mut byte = first[((value * 4096.0) as usize).min(4095)];
        while byte < 255 && least[usize::from(byte)] <= value {
            byte += 1;
        }
        byte
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_round_trip() {
        for byte in 0..=255 {
            assert_eq!(encoded_color([linear(byte); 3]), [byte; 3]);
        }
        assert_eq!(encoded_color([-1.0, 2.0, f64::NAN]), [0, 255, 0]);
        for value in (0..=10_000).map(|i| f64::from(i) / 10_000.0) {
            assert_eq!(encoded_color([value; 3])[0], encoded(value).round() as u8);
        }
    }
}
