//! What a map has carved, and how it lets go of it.

use linecarve_carving::Carver;

use super::{Contents, Map, MapError, carver_options};

/// Numbers of what is carved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CarvedCounts {
    /// Points in the tetrahedralisation.
    pub points: usize,
    /// Rays from keyframes to points.
    pub rays: usize,
    /// Tetrahedra, without those that reach to infinity.
    pub cells: usize,
}

impl Map {
    /// Numbers of what is carved, or was before memory was freed for the final surface.
    pub fn carved_counts(&self) -> CarvedCounts {
        self.released.unwrap_or_else(|| CarvedCounts {
            points: self.carver.point_count(),
            rays: self.carver.ray_count(),
            cells: self.carver.tetrahedra().finite_cell_count(),
        })
    }

    /// Checks that keyframes can still be added.
    ///
    /// # Errors
    /// After [`release_carving`](Self::release_carving).
    pub(super) fn check_growing(&self) -> Result<(), MapError> {
        match self.released {
            Some(_) => Err(MapError::Released),
            None => Ok(()),
        }
    }

    /// Frees points and cells of a finished map whose [final surface](Self::final_surface) is fused from depth images, which needs memory of
    /// its own. That surface, segments and counts stay, and the [followed](Self::followed_surface) surface if asked for. Other maps stay as
    /// they are.
    pub(crate) fn release_carving(&mut self, is_surface_kept: bool) {
        let counts = self.carved_counts();
        let is_fused = self.is_fused();
        if let Contents::Lines(lines) = &mut self.contents
            && is_fused
        {
            lines.release_landmarks(&self.options);
            self.carver = Carver::new(carver_options(&self.options));
            if !is_surface_kept {
                self.surface = None;
            }
            lines.compact();
            self.released = Some(counts);
        }
    }
}
