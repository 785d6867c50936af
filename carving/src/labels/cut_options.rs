//! Options of labels by minimum cut.

use thiserror::Error;

use crate::visibility::{Softness, UNIT};

/// Labels by minimum cut: the surface between free and occupied cells that has the least cost. No option has a unit of length:
/// the result does not depend on the scale of the map.
///
/// With `w` the weight of an observation, `d` the distance from its point and `s` the point's standard deviation along
/// the ray:
///
/// * a surface that a ray pierces before its point costs `w (1 - exp(-d^2 / 2 s^2))`, if the far side is the occupied one;
/// * a label occupied at the centre of the view costs `w` for each of its rays;
/// * a label free `behind_sigmas` deviations behind the point, along the ray, costs `matter_weight w n / 3`, `n` being the total weight of
///   the observations of the point, from 3 to 8: what is behind a point is as certain as the point;
/// * every facet of the surface costs `quality_weight (1 - min(cos phi, cos psi))`, `phi` and `psi` being the angles
///   between the facet and the circumspheres of its two cells: facets between large empty spheres cost nothing.
///
/// Space outside the hull is not free and has no cost; rays enter the hull as if from free space. Of several surfaces of least
/// cost the one with the least free space is chosen.
///
/// # Reference
///
/// P. Labatut, J.-P. Pons, R. Keriven, "Robust and efficient surface reconstruction from range data", Computer Graphics Forum
/// 28(8), 2009, sections 4.1 and 4.2. *Differs from the paper:* each point has its own deviation; costs are integers, in
/// 256ths of a ray; a facet that a ray meets at its edge or corner costs nothing for this ray.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
#[non_exhaustive]
pub struct CutOptions {
    /// Standard deviation of points without one of their own, as a share of the ray's length.
    pub relative_sigma: f64,
    /// Distance behind a point, in deviations, at which space is expected to be occupied; at least a millionth of the length of
    /// the ray.
    pub behind_sigmas: f64,
    /// Weight of the occupied space behind a point of up to 3 observations, as a share of the weight of the observation; 16 at most.
    pub matter_weight: f64,
    /// Weight of the shape of facets; 256 at most.
    pub quality_weight: f64,
}

impl Default for CutOptions {
    /// Tuned on generated rooms with 2 % wrong points and on sequences with measured depth. A smaller `quality_weight` is less
    /// robust to wrong points; a larger `behind_sigmas` fills the space behind thin objects.
    fn default() -> Self {
        Self {
            relative_sigma: 0.01,
            behind_sigmas: 0.5,
            matter_weight: 0.75,
            quality_weight: 0.5,
        }
    }
}

/// Why options are refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("{name} = {value}: a number from {least} to {most} is needed")]
pub struct CutOptionsError {
    /// Name of the option.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// The least valid value.
    pub least: f64,
    /// The greatest valid value.
    pub most: f64,
}

impl CutOptions {
    const MAX_MATTER: f64 = 16.0;
    const MAX_QUALITY: f64 = 256.0;

    /// Checks the ranges. A carver clamps values out of range, and takes NaN as 0.
    ///
    /// # Errors
    ///
    /// The first option out of range.
    pub fn validate(&self) -> Result<(), CutOptionsError> {
        let ranges = [
            ("relative_sigma", self.relative_sigma, 0.0, 1.0),
            ("behind_sigmas", self.behind_sigmas, 0.0, 100.0),
            ("matter_weight", self.matter_weight, 0.0, Self::MAX_MATTER),
            (
                "quality_weight",
                self.quality_weight,
                0.0,
                Self::MAX_QUALITY,
            ),
        ];
        for (name, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Err(CutOptionsError {
                    name,
                    value,
                    least,
                    most,
                });
            }
        }
        Ok(())
    }

    pub(crate) fn softness(&self) -> Softness {
        // NaN stays what it is, and becomes 0 where it is made an integer.
        let within = |value: f64, most: f64| value.clamp(0.0, most);
        Softness {
            relative_sigma: within(self.relative_sigma, 1.0),
            behind_sigmas: within(self.behind_sigmas, 100.0),
            anchor_weight: (within(self.matter_weight, Self::MAX_MATTER) * UNIT as f64).round()
                as u64,
        }
    }

    /// Weight of the shape of facets in units.
    pub(super) fn quality_units(&self) -> i64 {
        (self.quality_weight.clamp(0.0, Self::MAX_QUALITY) * UNIT as f64).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_range_are_named() {
        assert_eq!(CutOptions::default().validate(), Ok(()));
        for value in [-1.0, 1e9, f64::NAN, f64::INFINITY] {
            let options = CutOptions {
                quality_weight: value,
                ..CutOptions::default()
            };
            let error = options.validate().unwrap_err();
            assert!(error.to_string().contains("quality_weight"), "{error}");
            assert!((0..=65536).contains(&options.quality_units()));
        }
    }
}
