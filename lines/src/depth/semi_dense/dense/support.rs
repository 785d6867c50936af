//! A plane that most of the samples around a place without samples lie on.

use nalgebra::{Matrix3, Vector3};

use super::plane::Noise;

/// Sectors of directions.
pub(super) const SECTORS: usize = 8;
/// Most neighbouring sectors without a sample on a plane that samples surround.
const LARGEST_GAP: usize = 3;

/// A sample that may support a plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Support {
    /// Place, in grid steps.
    pub(super) column: f64,
    pub(super) row: f64,
    pub(super) rho: f64,
    pub(super) sigma: f64,
    /// Its direction, below [`SECTORS`].
    pub(super) sector: usize,
}

/// What a plane has to have to be taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Demand {
    /// Fewest samples on the plane.
    pub(super) samples: usize,
    /// Least share of all samples.
    pub(super) share: f64,
    /// Fewest sectors with a sample on the plane.
    pub(super) sectors: usize,
    /// Largest distance from the origin, in grid steps, of the nearest sample on a plane that samples do not surround.
    pub(super) extension: f64,
    /// Largest distance of a sample from the plane, in its standard deviations.
    pub(super) gate_sigmas: f64,
    /// Planes tried.
    pub(super) trials: usize,
}

/// A plane of inverse depth over columns and rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct SupportedPlane {
    /// Value at the origin, and changes by column and row.
    pub(super) plane: Vector3<f64>,
    /// Standard deviation of the samples from it, their own included.
    pub(super) sigma: f64,
}

impl SupportedPlane {
    /// The plane that meets the demand; the same for the same `noise`.
    ///
    /// # Complexity
    /// O(samples x trials).
    pub(super) fn of(samples: &[Support], demand: &Demand, noise: Noise) -> Option<Self> {
        if samples.len() < demand.samples {
            return None;
        }
        let is_near = |plane: &Vector3<f64>, it: &&Support| {
            residual(plane, it) <= demand.gate_sigmas * it.sigma
        };
        let mut plane = consensus(samples, demand, noise)?;
        for _ in 0..2 {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for sample in samples.iter().filter(|sample| is_near(&plane, sample)) {
                let row = Vector3::new(1.0, sample.column, sample.row);
                let weight = sample.sigma.powi(-2);
                normal += weight * row * row.transpose();
                right += weight * sample.rho * row;
            }
            plane = normal.try_inverse()? * right;
        }
        let mut has_sample = [false; SECTORS];
        let (mut count, mut squares, mut nearest) = (0, 0.0, f64::INFINITY);
        for sample in samples.iter().filter(|sample| is_near(&plane, sample)) {
            has_sample[sample.sector] = true;
            count += 1;
            nearest = nearest.min(sample.column.hypot(sample.row));
            squares += residual(&plane, sample).powi(2) + sample.sigma.powi(2);
        }
        let sectors = has_sample.iter().filter(|has_sample| **has_sample).count();
        let is_supported = count >= demand.samples
            && count as f64 >= demand.share * samples.len() as f64
            && sectors >= demand.sectors
            && (nearest <= demand.extension || !has_gap(&has_sample));
        is_supported.then_some(Self {
            plane,
            sigma: (squares / count as f64).sqrt(),
        })
    }

    /// Inverse depth at a place.
    pub(super) fn at(&self, column: f64, row: f64) -> f64 {
        self.plane.dot(&Vector3::new(1.0, column, row))
    }
}

/// Whether there are more neighbouring sectors without a sample than [`LARGEST_GAP`].
fn has_gap(has_sample: &[bool; SECTORS]) -> bool {
    (0..SECTORS)
        .any(|first| (first..=first + LARGEST_GAP).all(|sector| !has_sample[sector % SECTORS]))
}

/// Distance of a sample from a plane.
fn residual(plane: &Vector3<f64>, sample: &Support) -> f64 {
    (plane.x + plane.y * sample.column + plane.z * sample.row - sample.rho).abs()
}

/// The plane through three samples that most others are near.
fn consensus(samples: &[Support], demand: &Demand, mut noise: Noise) -> Option<Vector3<f64>> {
    let mut best: Option<(usize, Vector3<f64>)> = None;
    for _ in 0..demand.trials {
        let mut pick = || {
            let share = 0.5 * (1.0 + noise.next());
            samples[((share * samples.len() as f32) as usize).min(samples.len() - 1)]
        };
        let picked = [pick(), pick(), pick()];
        let rows = Matrix3::from_fn(|i, j| [1.0, picked[i].column, picked[i].row][j]);
        let Some(inverse) = rows.try_inverse() else {
            continue;
        };
        let plane = inverse * Vector3::from_fn(|i, _| picked[i].rho);
        let near = samples
            .iter()
            .filter(|it| residual(&plane, it) <= demand.gate_sigmas * it.sigma);
        let count = near.count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, plane));
        }
    }
    best.map(|(_, plane)| plane)
}
