//! Correction of depth whose scale or zero is a little off.

/// A depth for each depth: `corrected = scale / (1 / depth + inverse_shift) + shift`.
///
/// Models without a known scale are off by scale and shift of the inverse depth. Range cameras are off by scale and shift of the depth.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DepthCorrection {
    /// Factor of the depth.
    pub scale: f64,
    /// Added to the inverse depth, in 1 / unit of the poses.
    pub inverse_shift: f64,
    /// Added to the depth, in units of the poses.
    pub shift: f64,
}

impl Default for DepthCorrection {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl DepthCorrection {
    /// The correction that changes nothing.
    pub const IDENTITY: Self = Self {
        scale: 1.0,
        inverse_shift: 0.0,
        shift: 0.0,
    };

    /// The corrected depth; `None` where it is not positive and finite.
    pub fn depth(&self, depth: f64) -> Option<f64> {
        let corrected = self.scale / (1.0 / depth + self.inverse_shift) + self.shift;
        (corrected > 0.0 && corrected.is_finite()).then_some(corrected)
    }

    /// Derivative of the corrected depth by the depth.
    pub fn slope(&self, depth: f64) -> f64 {
        let bent = 1.0 + self.inverse_shift * depth;
        self.scale / (bent * bent)
    }

    /// Derivatives of the corrected depth by the logarithm of the scale, the inverse shift and the shift.
    pub fn derivatives(&self, depth: f64) -> [f64; 3] {
        let scaled = self.scale / (1.0 / depth + self.inverse_shift);
        [scaled, -scaled * scaled / self.scale, 1.0]
    }

    /// Corrects an image of depths; 0 is unknown, and so is what becomes no depth.
    pub fn apply(&self, depths: &mut [f32]) {
        for depth in depths.iter_mut().filter(|depth| **depth > 0.0) {
            *depth = self
                .depth(f64::from(*depth))
                .map_or(0.0, |depth| depth as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_differences() {
        let correction = DepthCorrection {
            scale: 1.07,
            inverse_shift: -0.02,
            shift: 0.05,
        };
        let step = 1e-6;
        let depth = |correction: DepthCorrection, z| correction.depth(z).unwrap();
        for z in [0.5, 1.0, 3.0] {
            let slope = (depth(correction, z + step) - depth(correction, z - step)) / (2.0 * step);
            assert!((slope - correction.slope(z)).abs() < 1e-7);
            let changed = |by: [f64; 3]| DepthCorrection {
                scale: correction.scale * by[0].exp(),
                inverse_shift: correction.inverse_shift + by[1],
                shift: correction.shift + by[2],
            };
            for (parameter, derivative) in correction.derivatives(z).into_iter().enumerate() {
                let mut by = [0.0; 3];
                by[parameter] = step;
                let ahead = depth(changed(by), z);
                let behind = depth(changed(by.map(|value| -value)), z);
                assert!(((ahead - behind) / (2.0 * step) - derivative).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_becomes_no_depth_is_unknown() {
        let correction = DepthCorrection {
            scale: 1.0,
            inverse_shift: -0.25,
            shift: -0.5,
        };
        let mut depths = [0.0, 0.4, 2.0, 4.0, 5.0];
        correction.apply(&mut depths);
        assert_eq!(depths, [0.0, 0.0, 3.5, 0.0, 0.0]);
        let mut same = [0.0, 1.5, 3.25];
        DepthCorrection::IDENTITY.apply(&mut same);
        assert_eq!(same, [0.0, 1.5, 3.25]);
    }
}
