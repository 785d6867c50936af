//! Which labels the carver gives, as the configuration says it.

use std::num::NonZeroU64;

use linecarve_carving::{CutOptions, Labels, Votes};
use serde::{Deserialize, Serialize};

use crate::options::CarvingOptions;

/// How tetrahedra are labelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LabelKind {
    /// Free when enough rays cross it, as in the literature on carving.
    Votes,
    /// By a minimum cut with soft visibility, which weighs wrong points against right ones.
    #[default]
    Cut,
}

/// Settings of the labels by minimum cut; see `CutOptions` of the carving library.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutSettings {
    /// The standard deviation of a point is taken as this many times the one measured.
    pub sigma_factor: f64,
    /// How many deviations behind a point there is matter.
    pub behind_sigmas: f64,
    /// Weight of the matter behind a point.
    pub matter_weight: f64,
    /// Weight of the facets' shape.
    pub quality_weight: f64,
}

impl Default for CutSettings {
    /// The weights of the library, but for a lighter shape: the program's points are seen several times and held against
    /// depth, where there is any, so that few are far off. On two indoor sequences with sensor depth a shape of 0.5, which withstands
    /// wrong points by itself, costs up to 0.035 of recall at 5 cm.
    fn default() -> Self {
        let options = CutOptions::default();
        Self {
            sigma_factor: 1.0,
            behind_sigmas: options.behind_sigmas,
            matter_weight: options.matter_weight,
            quality_weight: 0.05,
        }
    }
}

impl CutSettings {
    /// As the carver takes them.
    pub fn options(&self) -> CutOptions {
        CutOptions {
            behind_sigmas: self.behind_sigmas,
            matter_weight: self.matter_weight,
            quality_weight: self.quality_weight,
            ..CutOptions::default()
        }
    }
}

impl CarvingOptions {
    /// The labels as the carver takes them.
    pub fn labels(&self) -> Labels {
        match self.labels {
            LabelKind::Votes => Labels::Votes(Votes {
                threshold: NonZeroU64::new(self.free_threshold.into()).unwrap_or(NonZeroU64::MIN),
            }),
            LabelKind::Cut => Labels::Cut(self.cut.options()),
        }
    }
}
