//! Depth sensor: geometry, noise model and conversion of depth images to inverse depth maps.

use nalgebra::Isometry3;
use thiserror::Error;

use super::registration::{DepthDeviations, Registration, register};
use crate::camera::Camera;
use crate::image::{ImageError, Plane};
use crate::inverse_depth::{InverseDepth, InverseDepthMap, UNKNOWN};

/// Noise of a disparity sensor (stereo, structured light): constant standard deviation of inverse depth, plus the rounding of stored
/// depths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Standard deviation of the inverse depth, in 1 / unit of the poses.
    pub inverse_depth_sigma: f64,
    /// Quantisation step of stored depths in units of the poses; 0 for continuous depths. Adds a standard deviation of `step / sqrt(12)`.
    pub depth_step: f64,
}

impl SensorNoise {
    /// Relative standard deviation of a structured-light sensor at a median indoor depth of 2 m: 5.7 mm, or 0.29 %, for a first-generation
    /// Kinect.
    ///
    /// # Reference
    /// K. Khoshelham, S. O. Elberink, Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications,
    /// Sensors, 2012: sigma_z = 1.425e-3 z^2 (metres).
    pub const STRUCTURED_LIGHT_RELATIVE: f64 = 0.003;

    /// From disparity noise (pixels), focal length (pixels) and baseline (units of the poses).
    pub fn from_disparity(noise_px: f64, focal_px: f64, baseline: f64, depth_step: f64) -> Self {
        Self {
            inverse_depth_sigma: noise_px / (focal_px * baseline),
            depth_step,
        }
    }

    /// From the relative standard deviation of depth at the median scene depth; independent of scale.
    pub fn relative_at(relative: f64, median_depth: f64, depth_step: f64) -> Self {
        Self {
            inverse_depth_sigma: relative / median_depth,
            depth_step,
        }
    }

    /// [`SensorNoise::sigma`] in single precision, for loops over pixels.
    pub(super) fn in_single_precision(&self) -> impl Fn(f32) -> f32 + Copy + use<> {
        let base = (self.inverse_depth_sigma * self.inverse_depth_sigma) as f32;
        let rounding = (self.depth_step * UNIFORM_SIGMA) as f32;
        move |rho| {
            let rounding = rounding * rho * rho;
            (base + rounding * rounding).sqrt()
        }
    }

    /// Whether a depth can be measured: it is positive and finite, and its inverse is larger than the standard deviation, so that it differs
    /// from infinity.
    pub fn can_measure(&self, depth: f32) -> bool {
        let rho = 1.0 / f64::from(depth);
        depth > 0.0 && depth.is_normal() && rho > self.inverse_depth_sigma
    }

    /// Standard deviation of an inverse depth.
    pub fn sigma(&self, rho: f64) -> f64 {
        // d rho = rho^2 d z
        let rounding = self.depth_step * UNIFORM_SIGMA * rho * rho;
        (self.inverse_depth_sigma * self.inverse_depth_sigma + rounding * rounding).sqrt()
    }
}

/// Standard deviation of a uniform distribution of width 1: 1 / sqrt(12).
const UNIFORM_SIGMA: f64 = 0.288_675_134_594_812_9;

/// A depth camera with its pose relative to the colour camera.
#[derive(Debug, Clone)]
pub struct DepthSensor {
    /// The depth camera, a pinhole.
    pub camera: Camera,
    /// `point_in_color = color_from_depth * point_in_depth`.
    pub color_from_depth: Isometry3<f64>,
    /// Depth pixels coincide with colour pixels; camera and pose are then unused.
    pub is_registered: bool,
    /// Measurement noise.
    pub noise: SensorNoise,
}

/// Error of converting a depth image.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SensorError {
    /// Registered depth and colour images differ in size.
    #[error(
        "the depth image is {depth_width} x {depth_height}, the colour image {color_width} x {color_height}; \
         a registered depth image must have the same size (or give the depth camera's calibration)"
    )]
    Size {
        /// Width of the depth image.
        depth_width: usize,
        /// Height of the depth image.
        depth_height: usize,
        /// Width of the colour image.
        color_width: usize,
        /// Height of the colour image.
        color_height: usize,
    },
    /// Depth and its standard deviations differ in size.
    #[error(
        "the depth image is {depth_width} x {depth_height}, its standard deviations {sigma_width} x {sigma_height}: \
         both must have the same size"
    )]
    SigmaSize {
        /// Width of the depth image.
        depth_width: usize,
        /// Height of the depth image.
        depth_height: usize,
        /// Width of the standard deviations.
        sigma_width: usize,
        /// Height of the standard deviations.
        sigma_height: usize,
    },
    /// A camera has lens distortion.
    #[error("the {which} camera has lens distortion; undistort its images first")]
    Distorted {
        /// `depth` or `color`.
        which: &'static str,
    },
    /// A noise parameter is negative or not finite, or both are zero.
    #[error(
        "sensor noise needs a positive inverse depth sigma or depth step (sigma {inverse_depth_sigma}, step {depth_step})"
    )]
    Noise {
        /// The inverse depth sigma.
        inverse_depth_sigma: f64,
        /// The depth step.
        depth_step: f64,
    },
    /// The image size is invalid.
    #[error(transparent)]
    Image(#[from] ImageError),
}

impl DepthSensor {
    /// A sensor whose depth image is already registered to the colour image.
    pub fn registered(color: &Camera, noise: SensorNoise) -> Self {
        Self {
            camera: color.clone(),
            color_from_depth: Isometry3::identity(),
            is_registered: true,
            noise,
        }
    }

    /// Inverse depth of each pixel of the colour image, from a depth image in units of the poses. Depths that the sensor [cannot
    /// measure](SensorNoise::can_measure) are unknown.
    ///
    /// An unregistered depth image is projected forward as a surface: cells of 2 x 2 depth pixels on one surface are filled with linear
    /// inverse depth, and the nearest surface wins. A finer colour image therefore shows no holes.
    ///
    /// # Errors
    /// When sizes do not match, a camera has distortion, or the noise is not positive.
    ///
    /// # Complexity
    /// Linear in the number of depth and colour pixels.
    pub fn inverse_depth(
        &self,
        depth: &Plane<f32>,
        color: &Camera,
        width: usize,
        height: usize,
    ) -> Result<InverseDepthMap, SensorError> {
        self.check(depth, color, width, height)?;
        let samples = if self.is_registered {
            depth
                .samples()
                .iter()
                .map(|z| self.measurement(*z))
                .collect()
        } else {
            let registration = Registration {
                depth_camera: &self.camera,
                color_camera: color,
                color_from_depth: &self.color_from_depth,
                noise: &self.noise,
            };
            register(depth, &registration, width, height)
        };
        Ok(InverseDepthMap::new(width, height, samples)?)
    }

    /// [`inverse_depth`](Self::inverse_depth) of a depth image with the standard deviation of each depth, in units of the
    /// poses, in place of that of the sensor. Where it is 0, negative, not finite or as large as the depth, the depth is
    /// unknown.
    ///
    /// Depth that is not registered is projected as a surface; a colour pixel has the largest relative deviation of the four depth pixels
    /// around it.
    ///
    /// # Errors
    /// As [`inverse_depth`](Self::inverse_depth), and when the two images differ in size.
    pub fn inverse_depth_with_sigma(
        &self,
        depth: &Plane<f32>,
        sigma: &Plane<f32>,
        color: &Camera,
        width: usize,
        height: usize,
    ) -> Result<InverseDepthMap, SensorError> {
        self.check(depth, color, width, height)?;
        if (depth.width(), depth.height()) != (sigma.width(), sigma.height()) {
            return Err(SensorError::SigmaSize {
                depth_width: depth.width(),
                depth_height: depth.height(),
                sigma_width: sigma.width(),
                sigma_height: sigma.height(),
            });
        }
        if !self.is_registered {
            return self.registered_with_sigma(depth, sigma, color, width, height);
        }
        let pairs = depth.samples().iter().zip(sigma.samples());
        let samples = pairs
            .map(|(&z, &sigma)| {
                // d rho = rho^2 d z
                let rho = 1.0 / z;
                let measurement = InverseDepth::new(rho, sigma * rho * rho);
                measurement
                    .filter(|it| it.sigma < it.rho)
                    .unwrap_or(UNKNOWN)
            })
            .collect();
        Ok(InverseDepthMap::new(width, height, samples)?)
    }

    /// [`inverse_depth_with_sigma`](Self::inverse_depth_with_sigma) of depth that is not registered.
    fn registered_with_sigma(
        &self,
        depth: &Plane<f32>,
        sigma: &Plane<f32>,
        color: &Camera,
        width: usize,
        height: usize,
    ) -> Result<InverseDepthMap, SensorError> {
        let is_known = |z: f32, sigma: f32| z > 0.0 && sigma > 0.0 && sigma < z;
        let pairs = depth.samples().iter().zip(sigma.samples());
        let known = pairs.map(|(&z, &sigma)| if is_known(z, sigma) { z } else { 0.0 });
        let known = Plane::new(depth.width(), depth.height(), known.collect())?;
        let registration = Registration {
            depth_camera: &self.camera,
            color_camera: color,
            color_from_depth: &self.color_from_depth,
            noise: &self.noise,
        };
        let mut samples = register(&known, &registration, width, height);
        let deviations = DepthDeviations::new(&registration, &known, sigma);
        for (index, sample) in samples.iter_mut().enumerate() {
            if sample.rho > 0.0 {
                let relative = deviations.relative(index % width, index / width, sample.rho);
                let measured = relative
                    .and_then(|relative| InverseDepth::new(sample.rho, relative * sample.rho));
                *sample = measured.unwrap_or(UNKNOWN);
            }
        }
        Ok(InverseDepthMap::new(width, height, samples)?)
    }

    fn check(
        &self,
        depth: &Plane<f32>,
        color: &Camera,
        width: usize,
        height: usize,
    ) -> Result<(), SensorError> {
        let SensorNoise {
            inverse_depth_sigma,
            depth_step,
        } = self.noise;
        let is_range = |value: f64| value.is_finite() && value >= 0.0;
        if !(is_range(inverse_depth_sigma) && is_range(depth_step))
            || inverse_depth_sigma + depth_step <= 0.0
        {
            return Err(SensorError::Noise {
                inverse_depth_sigma,
                depth_step,
            });
        }
        if self.is_registered {
            if (depth.width(), depth.height()) != (width, height) {
                return Err(SensorError::Size {
                    depth_width: depth.width(),
                    depth_height: depth.height(),
                    color_width: width,
                    color_height: height,
                });
            }
            return Ok(());
        }
        for (which, camera) in [("depth", &self.camera), ("color", color)] {
            if !camera.is_pinhole() {
                return Err(SensorError::Distorted { which });
            }
        }
        Ok(())
    }

    /// The measurement of a depth, or [`UNKNOWN`].
    #[inline]
    fn measurement(&self, depth: f32) -> InverseDepth {
        if !self.noise.can_measure(depth) {
            return UNKNOWN;
        }
        let rho = 1.0 / f64::from(depth);
        let (rho, sigma) = (rho as f32, self.noise.sigma(rho) as f32);
        InverseDepth::new(rho, sigma).unwrap_or(UNKNOWN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::pinhole(50.0, 50.0, 19.5, 14.5).unwrap()
    }

    #[test]
    fn registered_depth_is_inverted() {
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.001);
        let sensor = DepthSensor::registered(&camera(), noise);
        let mut samples = vec![2.0_f32; 1200];
        samples[..5].copy_from_slice(&[0.0, -1.0, f32::NAN, f32::INFINITY, 4.0]);
        let depth = Plane::new(40, 30, samples).unwrap();
        let map = sensor.inverse_depth(&depth, &camera(), 40, 30).unwrap();
        for x in 0..4 {
            assert_eq!(map.get(x, 0), None, "pixel {x}");
        }
        let far = map.get(4, 0).unwrap();
        assert_eq!(far.rho, 0.25);
        // Depth noise grows with the square of depth: 0.003 * 2 at 2, four times that at 4.
        let sigma_depth = f64::from(far.sigma) * 16.0;
        assert!((sigma_depth - 0.024).abs() < 1e-4);
        assert_eq!(map.median_depth(), Some(2.0));
    }

    #[test]
    fn depths_like_infinity_are_unknown() {
        // The standard deviation is as large as the depth at 2 / 0.003.
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.0);
        assert!(noise.can_measure(600.0) && noise.can_measure(1e-3));
        for depth in [700.0, 1e10, f32::MAX, 1e-40, f32::NAN] {
            assert!(!noise.can_measure(depth), "{depth}");
        }
        for is_registered in [true, false] {
            let mut sensor = DepthSensor::registered(&camera(), noise);
            sensor.is_registered = is_registered;
            let depth = Plane::new(40, 30, vec![1e10_f32; 1200]).unwrap();
            let map = sensor.inverse_depth(&depth, &camera(), 40, 30).unwrap();
            assert_eq!(map.known_count(), 0);
        }
    }

    #[test]
    fn each_depth_can_have_its_own_deviation() {
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.0);
        let mut sensor = DepthSensor::registered(&camera(), noise);
        let depth = Plane::new(40, 30, vec![2.0; 1200]).unwrap();
        let mut sigmas = vec![0.04; 1200];
        sigmas[..4].copy_from_slice(&[0.0, -1.0, f32::NAN, f32::INFINITY]);
        let sigma = Plane::new(40, 30, sigmas).unwrap();
        let measure = |sensor: &DepthSensor, sigma| {
            sensor.inverse_depth_with_sigma(&depth, sigma, &camera(), 40, 30)
        };
        let map = measure(&sensor, &sigma).unwrap();
        assert!((0..4).all(|x| map.get(x, 0).is_none()));
        let known = map.get(4, 0).unwrap();
        assert_eq!(known.rho, 0.5);
        assert!((known.sigma - 0.01).abs() < 1e-7);
        let small = Plane::new(20, 30, vec![0.04; 600]).unwrap();
        assert!(matches!(
            measure(&sensor, &small),
            Err(SensorError::SigmaSize { .. })
        ));
        // Registered by its geometry, the deviations follow.
        sensor.is_registered = false;
        let map = measure(&sensor, &sigma).unwrap();
        assert!((0..3).all(|x| map.get(x, 0).is_none()));
        let known = map.get(20, 10).unwrap();
        assert!((known.rho - 0.5).abs() < 1e-6 && (known.sigma - 0.01).abs() < 1e-6);
    }

    #[test]
    fn deviations_are_seen_from_the_colour_camera() {
        // Depth of half the size, 10 cm to the left; its right half is ten times less certain.
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.0);
        let color = Camera::pinhole(100.0, 100.0, 39.5, 29.5).unwrap();
        let sensor = DepthSensor {
            camera: camera(),
            color_from_depth: Isometry3::translation(-0.1, 0.0, 0.0),
            is_registered: false,
            noise,
        };
        let depth = Plane::new(40, 30, vec![2.0; 1200]).unwrap();
        let sigma = (0..1200).map(|at| if at % 40 < 20 { 0.01 } else { 0.1 });
        let sigma = Plane::new(40, 30, sigma.collect()).unwrap();
        let map = sensor
            .inverse_depth_with_sigma(&depth, &sigma, &color, 80, 60)
            .unwrap();
        let plain = sensor.inverse_depth(&depth, &color, 80, 60).unwrap();
        assert_eq!(map.known_count(), plain.known_count());
        // The border between columns 19 and 20 of depth, 39 of colour, is seen 0.1 * 100 / 2 = 5 pixels to the left.
        for (x, relative) in [(5, 0.005), (30, 0.005), (34, 0.05), (36, 0.05), (60, 0.05)] {
            let sample = map.get(x, 30).unwrap();
            assert_eq!(Some(sample.rho), plain.get(x, 30).map(|it| it.rho));
            assert!(
                (sample.sigma / sample.rho - relative).abs() < 1e-6,
                "{x}: {sample:?}"
            );
        }
    }

    #[test]
    fn disparity_noise_is_the_kinect_figure() {
        // Half a pixel over 7.5 cm at 585 px would be 11 mm at 1 m; an eighth of a pixel gives 2.8 mm.
        let noise = SensorNoise::from_disparity(0.125, 585.0, 0.075, 0.0);
        assert!((noise.sigma(1.0) - 0.00285).abs() < 1e-5);
    }

    #[test]
    fn refusals_say_what_is_wrong() {
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.0);
        let mut sensor = DepthSensor::registered(&camera(), noise);
        let depth = Plane::new(40, 30, vec![1.0; 1200]).unwrap();
        let error = sensor.inverse_depth(&depth, &camera(), 41, 30).unwrap_err();
        assert!(error.to_string().contains("40 x 30"));
        sensor.noise.inverse_depth_sigma = f64::NAN;
        assert!(matches!(
            sensor.inverse_depth(&depth, &camera(), 40, 30),
            Err(SensorError::Noise { .. })
        ));
    }
}
