//! Settings of labels by minimum cut.

use thiserror::Error;

use crate::visibility::{Softness, UNIT};

/// Labels by minimum cut: of all surfaces between free cells and matter the one is taken that contradicts rays and shapes
/// least. No setting has a unit of length: the result does not depend on the scale of the map.
///
/// With `w` the weight of an observation, `d` the distance from its point and `s` the point's standard deviation along
/// the ray:
///
/// * a surface that a ray pierces in front of its point costs `w (1 - exp(-d^2 / 2 s^2))`, if matter is on the far side;
/// * matter where the view's centre is costs `w`, or `w` times the number of its rays;
/// * free space `behind_sigmas` deviations behind the point, seen along the ray, costs `matter_weight w`;
/// * every facet of the surface costs `quality_weight (1 - min(cos phi, cos psi))`, `phi` and `psi` being the angles
///   between the facet and the circumspheres of its two cells: facets between large empty spheres cost nothing.
///
/// Outside the hull nothing is free and nothing costs; rays enter the hull as if from free space. Of several cheapest
/// surfaces the one with the least free space is taken.
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
pub struct CutOptions {
    /// Standard deviation of points without one of their own, as a share of the ray's length.
    pub relative_sigma: f64,
    /// How many deviations behind a point there is matter; at least a millionth of the ray's length in any case.
    pub behind_sigmas: f64,
    /// Weight of the matter behind a point, as a share of the observation's weight; 16 at most.
    pub matter_weight: f64,
    /// Weight of the facets' shape; 256 at most.
    pub quality_weight: f64,
}

impl Default for CutOptions {
    /// Robust to wrong points: two in a hundred at 0.3 to 1.7 times their distance, each seen by all its views, raise the mean
    /// error of a room's surface 1.7-fold. With a shape of 0.35 it is 4-fold. Ties further behind the points (three deviations)
    /// fill the space behind thin things and take a seventh of the recall on measured depth.
    fn default() -> Self {
        Self {
            relative_sigma: 0.01,
            behind_sigmas: 0.5,
            matter_weight: 0.75,
            quality_weight: 0.5,
        }
    }
}

/// Why settings are refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("{name} = {value}: a number from {least} to {most} is needed")]
pub struct CutOptionsError {
    /// The setting.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// The least value that will do.
    pub least: f64,
    /// The greatest value that will do.
    pub most: f64,
}

impl CutOptions {
    const MAX_MATTER: f64 = 16.0;
    const MAX_QUALITY: f64 = 256.0;

    /// Checks the ranges. Values out of range do no harm but are taken as the nearest within, and NaN as 0.
    ///
    /// # Errors
    ///
    /// The first setting out of range.
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

    /// Weight of the facets' shape in units.
    pub(super) fn quality_units(&self) -> i64 {
        (self.quality_weight.clamp(0.0, Self::MAX_QUALITY) * UNIT as f64).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_named() {
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
