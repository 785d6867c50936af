//! How far the depth of a keyframe may be off when other keyframes look at it.
//!
//! Within a keyframe depth has the noise of its source. Between keyframes the errors of the poses, of the calibration and of the
//! sensor's slowly varying bias add to it, and close to the camera they are larger than the noise. They are not known beforehand, but each
//! keyframe tells: where surfaces of earlier keyframes lie on its own, both would agree within the noise if nothing else were wrong.
//! What exceeds it is taken as a share of the depth.

use std::f64::consts::FRAC_1_SQRT_2;

use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;

use super::surface_points::KeyframeSurface;

/// Largest deviation that is looked at, as a share of the depth. What lies further away is another surface.
const LARGEST_DEVIATION: f64 = 0.05;
/// Resolution of the deviations.
const BINS: usize = 500;
/// Deviations needed for an estimate.
const LEAST_COUNT: u64 = 200;
/// Standard deviation of a normal distribution over the lower quartile of its absolute value.
const SIGMA_OVER_QUARTILE: f64 = 3.138;
/// Standard deviation over that of the lower quartile. Deviations have longer tails than a normal distribution, as keyframes differ in how far they
/// are off. Tuned on the kitchen of 7-Scenes.
const MARGIN: f64 = 1.5;

/// Samples of a keyframe that are compared lie this many apart, along columns and rows.
const STRIDE: usize = 4;

/// The surface of an earlier keyframe compared with that which a keyframe measured along the same ray.
#[derive(Debug, Clone, Copy)]
struct Deviation {
    /// Difference of the inverse depths over the inverse depth.
    relative: f64,
    /// Mean standard deviation of both inverse depths by the noise of their source, over the inverse depth.
    relative_noise: f64,
}

/// The noise of a depth source, and what keyframes disagree about beyond it.
#[derive(Debug, Clone)]
pub(super) struct DepthNoise {
    source: SensorNoise,
    /// Histogram of absolute deviations.
    bins: Vec<u64>,
    count: u64,
    /// Sum of the variances by the noise of the source.
    variances: f64,
    disagreement: f64,
}

impl DepthNoise {
    /// The noise of a source, before any two keyframes were compared.
    pub(super) fn new(source: SensorNoise) -> Self {
        Self {
            source,
            bins: vec![0; BINS],
            count: 0,
            variances: 0.0,
            disagreement: 0.0,
        }
    }

    /// Standard deviation of an inverse depth, seen from another keyframe.
    pub(super) fn sigma(&self, rho: f64) -> f64 {
        self.source.sigma(rho).hypot(self.disagreement * rho)
    }

    /// Standard deviation of depth beyond the noise of its source, as a share of the depth.
    pub(super) fn disagreement(&self) -> f64 {
        self.disagreement
    }

    /// Compares the surface of a keyframe with those of earlier ones.
    ///
    /// # Complexity
    /// The samples of the earlier ones.
    pub(super) fn observe<'a>(
        &mut self,
        surface: &KeyframeSurface<'_>,
        earlier: impl Iterator<Item = KeyframeSurface<'a>>,
    ) {
        for earlier in earlier {
            let points = earlier.points(STRIDE);
            let head_on = points.filter(|(_, sample)| earlier.is_head_on(sample));
            self.add(head_on.filter_map(|(point, sample)| {
                deviation(surface, &point, f64::from(sample.sigma / sample.rho))
            }));
        }
    }

    /// Takes deviations into account.
    ///
    /// A deviation has the variance of two keyframes. The lower quartile of all deviations so far, which other surfaces hardly change,
    /// gives it; the noise of the source is subtracted.
    fn add(&mut self, deviations: impl Iterator<Item = Deviation>) {
        for deviation in deviations {
            let size = deviation.relative.abs() * FRAC_1_SQRT_2;
            // False also for NaN.
            if size < LARGEST_DEVIATION && deviation.relative_noise < LARGEST_DEVIATION {
                self.bins[(size / LARGEST_DEVIATION * BINS as f64) as usize] += 1;
                self.count += 1;
                self.variances += deviation.relative_noise.powi(2);
            }
        }
        if self.count >= LEAST_COUNT {
            let total = SIGMA_OVER_QUARTILE * self.quartile();
            let noise = self.variances / self.count as f64;
            self.disagreement = MARGIN * (total * total - noise).max(0.0).sqrt();
        }
    }

    /// The lower quartile of the deviations, linear within its bin.
    fn quartile(&self) -> f64 {
        let quarter = self.count as f64 / 4.0;
        let mut below = 0.0;
        for (bin, count) in self.bins.iter().enumerate() {
            let count = *count as f64;
            if below + count >= quarter {
                let within = (quarter - below) / count;
                return (bin as f64 + within) / BINS as f64 * LARGEST_DEVIATION;
            }
            below += count;
        }
        LARGEST_DEVIATION
    }
}

/// How far a point that another keyframe measured is from a surface that faces the camera; `noise` is its standard deviation over its
/// depth.
fn deviation(surface: &KeyframeSurface<'_>, point: &Point3<f64>, noise: f64) -> Option<Deviation> {
    let (vertex, sample) = surface.look_up(point)?;
    let rho = f64::from(sample.rho);
    surface.is_head_on(&sample).then(|| Deviation {
        relative: (vertex.rho - rho) / rho,
        relative_noise: noise.hypot(f64::from(sample.sigma) / rho) * FRAC_1_SQRT_2,
    })
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
    use linecarve_lines::triangulation::{SampleOptions, SurfaceSamples};
    use nalgebra::Isometry3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::options::SurfacePointOptions;

    fn source() -> SensorNoise {
        SensorNoise {
            inverse_depth_sigma: 0.001,
            depth_step: 0.0,
        }
    }

    /// Normally distributed deviations of two keyframes, and every tenth from another surface.
    fn deviations(sigma: f64, noise: f64) -> impl Iterator<Item = Deviation> {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        (0..5000).map(move |index| {
            let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let relative = match index % 10 {
                0 => 0.1 * (random.random::<f64>() - 0.5),
                _ => 2.0_f64.sqrt() * sigma * normal,
            };
            Deviation {
                relative,
                relative_noise: noise,
            }
        })
    }

    #[test]
    fn the_disagreement_is_what_exceeds_the_noise() {
        let mut noise = DepthNoise::new(source());
        noise.add(deviations(0.005, 0.003));
        let disagreement = noise.disagreement();
        // 0.004, and a little more by other surfaces.
        assert!(
            (0.0038..0.0048).contains(&(disagreement / MARGIN)),
            "{disagreement}"
        );
        let expected = 0.001_f64.hypot(disagreement * 0.5);
        assert!((noise.sigma(0.5) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_pose_that_is_off_shows_in_the_disagreement() {
        let mut map = InverseDepthMap::unknown(160, 120).unwrap();
        for (x, y) in (0..160).flat_map(|x| (0..120).map(move |y| (x, y))) {
            map.set(x, y, InverseDepth::new(0.5, 1e-5));
        }
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5).unwrap();
        let options = SurfacePointOptions::default();
        let pose = Isometry3::translation(0.3, 0.0, 0.0);
        // Two centimetres along the ray at two metres.
        let off = Isometry3::translation(0.0, 0.0, 0.02);
        let surface = |pose| KeyframeSurface::new(&samples, &camera, pose, &options, 0.0);
        let mut noise = DepthNoise::new(source());
        noise.observe(&surface(&off), [surface(&pose), surface(&pose)].into_iter());
        // All deviations are the same, so their lower quartile is as large as any.
        let expected = MARGIN * SIGMA_OVER_QUARTILE * 0.01 * FRAC_1_SQRT_2;
        assert!((noise.disagreement() - expected).abs() < 0.02 * expected);
        let mut noise = DepthNoise::new(source());
        noise.observe(&surface(&off), [surface(&off), surface(&off)].into_iter());
        assert!(noise.disagreement() < 2e-4);
    }

    #[test]
    fn exact_keyframes_do_not_disagree() {
        let mut noise = DepthNoise::new(source());
        noise.add(deviations(0.0, 0.003));
        assert_eq!(noise.disagreement(), 0.0);
        assert_eq!(noise.sigma(0.5), 0.001);
    }

    #[test]
    fn few_and_unusable_deviations_say_nothing() {
        let mut noise = DepthNoise::new(source());
        noise.add(deviations(0.02, 0.0).take(100));
        assert_eq!(noise.disagreement(), 0.0);
        let unusable = [f64::NAN, f64::INFINITY, 1.0].map(|relative| Deviation {
            relative,
            relative_noise: 0.0,
        });
        for _ in 0..1000 {
            noise.add(unusable.into_iter());
        }
        assert_eq!(noise.disagreement(), 0.0);
    }
}
