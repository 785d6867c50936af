//! Depth as evidence for free and occupied cells, beside the rays.
//!
//! Rays end at points that lie pixels apart. Along an outline, rays that pass closely behind it free the cells before it, and what is
//! thinner than the points lie apart is carved away. Depth images know better there: in front of a measured surface space is free, behind it
//! occupied. Positions on either side of it go into the carver as samples, whose weights a cell sums up.
//!
//! Samples in one cube of a grid are joined: the cube keeps the position of its first sample, and the weights of all. So the number of samples follows
//! the size of the scene, not the number of keyframes.

use linecarve_carving::{SampleId, Transaction, TransactionError};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::surface_points::KeyframeSurface;

/// Distance of a sample from the measured surface along the ray, in standard deviations: beyond most of the noise, and before what lies
/// behind thin things.
const DISTANCE_SIGMAS: f64 = 2.0;
/// Weight of a sample behind the surface, in 256ths of a ray. Tuned on the kitchen of 7-Scenes, a living room and a noisy rendered room; with half
/// of both weights F of the kitchen is 0.002 lower.
const OCCUPIED_WEIGHT: i32 = -26;
/// Weight of a sample in front of the surface. It is larger: wrong depth lies between surfaces, where it would make matter of free space.
const FREE_WEIGHT: i32 = 102;

/// A cube on one side of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Cube {
    corner: [i32; 3],
    is_free: bool,
}

/// The sample of a cube.
#[derive(Debug, Clone, Copy)]
struct CubeSample {
    id: SampleId,
    /// Number of depth samples in it.
    count: u32,
}

/// The samples of the keyframes so far.
#[derive(Debug, Clone)]
pub(super) struct DepthEvidence {
    /// Side of the cubes.
    side: f64,
    cubes: FxHashMap<Cube, CubeSample>,
}

/// Whether what a view measured is added or taken back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    Add,
    Remove,
}

impl DepthEvidence {
    /// No samples yet; those in a cube with this side are joined.
    pub(super) fn new(side: f64) -> Self {
        Self {
            side,
            cubes: FxHashMap::default(),
        }
    }

    /// Adds what a keyframe measured near outlines, or takes it back.
    ///
    /// # Errors
    /// When the carver rejects a position.
    ///
    /// # Complexity
    /// Linear in the samples of the keyframe.
    pub(super) fn change(
        &mut self,
        transaction: &mut Transaction<'_>,
        surface: &KeyframeSurface<'_>,
        change: Change,
    ) -> Result<(), TransactionError> {
        for (point, sample) in surface.points_at_outlines() {
            let sigma = surface.relative_sigma(&sample);
            for (sigmas, weight) in [
                (DISTANCE_SIGMAS, OCCUPIED_WEIGHT),
                (-DISTANCE_SIGMAS, FREE_WEIGHT),
            ] {
                let position = point + sigmas * sigma * (point - surface.center());
                self.change_sample(transaction, position, weight, change)?;
            }
        }
        Ok(())
    }

    fn change_sample(
        &mut self,
        transaction: &mut Transaction<'_>,
        position: Point3<f64>,
        weight: i32,
        change: Change,
    ) -> Result<(), TransactionError> {
        let corner = position.coords.map(|along| (along / self.side).floor());
        if corner
            .iter()
            .any(|along| along.abs() >= f64::from(i32::MAX))
        {
            return Ok(());
        }
        let cube = Cube {
            corner: corner.map(|along| along as i32).into(),
            is_free: weight > 0,
        };
        match (self.cubes.get_mut(&cube), change) {
            (Some(sample), Change::Add) => {
                sample.count += 1;
                transaction.change_sample(sample.id, weight)
            }
            (None, Change::Add) => {
                let id = transaction.add_sample(position, weight)?;
                self.cubes.insert(cube, CubeSample { id, count: 1 });
                Ok(())
            }
            (Some(sample), Change::Remove) if sample.count > 1 => {
                sample.count -= 1;
                transaction.change_sample(sample.id, -weight)
            }
            (Some(sample), Change::Remove) => {
                let id = sample.id;
                self.cubes.remove(&cube);
                transaction.remove_sample(id)
            }
            (None, Change::Remove) => Ok(()),
        }
    }
}
