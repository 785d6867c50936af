//! The sRGB transfer curve.

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

/// Linear colour of an sRGB colour.
pub fn linear_color(color: [u8; 3]) -> [f64; 3] {
    color.map(linear)
}

/// sRGB colour of a linear colour.
pub fn encoded_color(color: [f64; 3]) -> [u8; 3] {
    color.map(|value| encoded(value).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_the_round_trip() {
        for byte in 0..=255 {
            assert_eq!(encoded_color([linear(byte); 3]), [byte; 3]);
        }
        assert_eq!(encoded_color([-1.0, 2.0, f64::NAN])[..2], [0, 255]);
    }
}
