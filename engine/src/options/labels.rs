//! Labelling of tetrahedra: the configuration and its translation for the carver.

use std::num::NonZeroU64;

use linecarve_carving::{CutOptions, Labels, Votes};
use serde::{Deserialize, Serialize};

use super::CarvingOptions;

/// How tetrahedra are labelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LabelKind {
    /// Free when enough rays cross the tetrahedron, as in the literature on carving.
    Votes,
    /// Minimum cut with soft visibility, which tolerates outliers.
    #[default]
    Cut,
}

/// Settings of the minimum cut; see `CutOptions` of the carving library.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CutSettings {
    /// Factor on the measured standard deviation of a point.
    pub sigma_factor: f64,
    /// Distance behind a point that is assumed occupied, in standard deviations.
    pub behind_sigmas: f64,
    /// Weight of the occupied space behind a point.
    pub matter_weight: f64,
    /// Weight of the facet quality.
    pub quality_weight: f64,
}

impl Default for CutSettings {
    /// The weights of the library with a lower facet quality: landmarks are observed repeatedly and validated with depth, so
    /// that outliers are few. Tuned on two indoor sequences with sensor depth.
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
    /// The options of the carver.
    pub fn options(&self) -> CutOptions {
        let mut options = CutOptions::default();
        options.behind_sigmas = self.behind_sigmas;
        options.matter_weight = self.matter_weight;
        options.quality_weight = self.quality_weight;
        options
    }
}

impl CarvingOptions {
    /// The labelling of the carver.
    pub fn labels(&self) -> Labels {
        match self.labels {
            LabelKind::Votes => Labels::Votes(Votes {
                threshold: NonZeroU64::new(self.free_threshold.into()).unwrap_or(NonZeroU64::MIN),
            }),
            LabelKind::Cut => Labels::Cut(self.cut.options()),
        }
    }
}
