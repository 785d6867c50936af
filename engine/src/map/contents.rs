//! What a map is made of.

use super::MapError;
use super::lines::LineMap;
use super::model::ModelMap;
use super::observed::ObservedMap;
use super::points::FeatureMap;
use super::segment_map::SegmentMap;

/// Source of the carved points.
pub(super) enum Contents {
    /// Segments alone; nothing is carved.
    Segments(Box<SegmentMap>),
    Lines(Box<LineMap>),
    Features(Box<FeatureMap>),
    Model(Box<ModelMap>),
    Observed(Box<ObservedMap>),
}

impl Contents {
    pub(super) fn lines(&self) -> Option<&LineMap> {
        match self {
            Self::Lines(lines) => Some(lines),
            _ => None,
        }
    }

    pub(super) fn lines_mut(&mut self) -> Option<&mut LineMap> {
        match self {
            Self::Lines(lines) => Some(lines),
            _ => None,
        }
    }

    /// The lines, for what only maps of lines do.
    ///
    /// # Errors
    /// When the map is made of something else.
    pub(super) fn expect_lines(&mut self) -> Result<&mut LineMap, MapError> {
        self.lines_mut().ok_or(MapError::WrongKeyframe)
    }

    pub(super) fn features(&self) -> Option<&FeatureMap> {
        match self {
            Self::Features(features) => Some(features),
            _ => None,
        }
    }

    pub(super) fn model(&self) -> Option<&ModelMap> {
        match self {
            Self::Model(model) => Some(model),
            _ => None,
        }
    }
}
