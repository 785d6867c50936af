//! How many points views see.

use linecarve_sequence::{ModelPoint, ModelView};

use super::join::DENSE_PX;

/// Counts over the points of a model.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ViewStatistics {
    points: u64,
    /// Points with more than two views.
    well_seen: u64,
    observations: u64,
}

impl ViewStatistics {
    pub(crate) fn of<'a>(points: impl IntoIterator<Item = &'a ModelPoint>) -> Self {
        let mut statistics = Self::default();
        points.into_iter().for_each(|point| statistics.add(point));
        statistics
    }

    pub(crate) fn add(&mut self, point: &ModelPoint) {
        self.points += 1;
        self.well_seen += u64::from(point.observations.len() > 2);
        self.observations += point.observations.len() as u64;
    }

    /// The least number of views of a point that is carved, where the options do not say: points of dense clouds were checked pixel by
    /// pixel.
    pub(crate) fn least_views(&self, views: &[ModelView]) -> usize {
        let pixels = views.iter().filter_map(|view| view.size_px);
        let pixels: f64 = pixels.map(|[w, h]| f64::from(w) * f64::from(h)).sum();
        let is_dense = pixels > 0.0 && self.observations as f64 * DENSE_PX * DENSE_PX >= pixels;
        match is_dense || 2 * self.well_seen < self.points {
            true => 2,
            false => 3,
        }
    }
}
