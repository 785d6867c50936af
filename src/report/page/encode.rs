//! Compact encoding of numbers and positions; decoded by `assets/report/viewer/decode.js`.

use base64::display::Base64Display;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Point3, Vector3};
use serde::{Serialize, Serializer};

/// Largest stored coordinate: three of 21 bits fit into eight bytes.
const COORDINATE_STEPS: f64 = ((1u32 << 21) - 1) as f64;

/// Bytes that are written as base64.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Base64(pub(crate) Vec<u8>);

impl Serialize for Base64 {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&Base64Display::new(&self.0, &STANDARD))
    }
}

/// Appends a number as LEB128.
pub(super) fn push_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Positions quantised within their bounding box, to a two-millionth of its sides.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Positions {
    count: usize,
    low: [f64; 3],
    step: [f64; 3],
    data: Base64,
}

impl Positions {
    /// Encodes positions. Non-finite ones become the low corner of the box.
    pub(crate) fn new(points: impl Iterator<Item = Point3<f64>> + Clone) -> Self {
        let finite = || points.clone().filter(|p| p.iter().all(|v| v.is_finite()));
        let first = finite().next().unwrap_or_else(Point3::origin);
        let (low, high) =
            finite().fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let step: Vector3<f64> = (high - low) / COORDINATE_STEPS;
        let mut data = Vec::with_capacity(8 * points.size_hint().0);
        for point in points {
            let [x, y, z]: [u64; 3] = std::array::from_fn(|axis| {
                let increments = (point[axis] - low[axis]) / step[axis];
                // The cast saturates; NaN becomes 0.
                increments.round().clamp(0.0, COORDINATE_STEPS) as u64
            });
            data.extend_from_slice(&(x | y << 21 | z << 42).to_le_bytes());
        }
        Self {
            count: data.len() / 8,
            low: low.coords.into(),
            step: step.into(),
            data: Base64(data),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn positions_of(stored: &Positions) -> Vec<Point3<f64>> {
        let bytes = &stored.data.0;
        bytes
            .chunks_exact(8)
            .map(|chunk| {
                let packed = u64::from_le_bytes(chunk.try_into().unwrap());
                let at = |axis: usize| {
                    let increments = packed >> (21 * axis) & 0x1f_ffff;
                    stored.low[axis] + stored.step[axis] * increments as f64
                };
                Point3::new(at(0), at(1), at(2))
            })
            .collect()
    }

    #[test]
    fn positions_are_decoded_within_half_a_step() {
        let points: Vec<Point3<f64>> = (0..50)
            .map(|i| {
                let t = f64::from(i);
                Point3::new(t.sin() * 7.0, t * 1e3 - 4e4, 2.5)
            })
            .collect();
        let stored = Positions::new(points.iter().copied());
        for (point, back) in points.iter().zip(positions_of(&stored)) {
            for axis in 0..3 {
                let bound = 0.5001 * stored.step[axis] + 1e-9;
                assert!((point[axis] - back[axis]).abs() <= bound, "{point} {back}");
            }
        }
    }

    #[test]
    fn non_finite_and_empty_positions_are_encoded() {
        let points = [
            Point3::new(f64::NAN, 1.0, f64::INFINITY),
            Point3::new(1.0, 2.0, 3.0),
        ];
        let stored = Positions::new(points.into_iter());
        assert_eq!(stored.count, 2);
        assert!(stored.low.iter().all(|v| v.is_finite()));
        assert_eq!(Positions::new(std::iter::empty()).count, 0);
    }

    #[test]
    fn bytes_are_written_as_base64() {
        let text = serde_json::to_string(&Base64(vec![0, 1, 254, 255])).unwrap();
        assert_eq!(text, "\"AAH+/w==\"");
    }

    #[test]
    fn small_numbers_take_one_byte() {
        let mut bytes = Vec::new();
        for number in [0, 127, 128, u32::MAX] {
            push_number(&mut bytes, number);
        }
        assert_eq!(bytes, [0, 127, 0x80, 1, 0xff, 0xff, 0xff, 0xff, 0x0f]);
    }
}
