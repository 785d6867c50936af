//! A landmark: the mean of measurements of a point, weighted by their inverse variances.

use nalgebra::{Point3, Unit, Vector3};

/// A point measured by a keyframe.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measurement {
    /// Measured position.
    pub point_in_world: Point3<f64>,
    /// Direction from the camera to the point.
    pub direction: Unit<Vector3<f64>>,
    /// Size of one pixel at its depth.
    pub pixel: f64,
    /// Standard deviation along the view ray.
    pub sigma: f64,
}

/// A point fused from measurements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Landmark {
    /// Current position.
    pub position: Point3<f64>,
    /// Sum of the measurements weighted by inverse variance.
    pub weighted: Vector3<f64>,
    /// Sum of the inverse variances.
    pub weight: f64,
    /// Number of measurements.
    pub measurements: u32,
    /// Number of keyframes that measured it.
    pub keyframes: u32,
    /// The last of them.
    pub last_keyframe: u32,
    /// How many had measured it when it was last settled.
    pub settled_at: u32,
    /// Number of keyframes that measured a surface behind it.
    pub contradictions: u32,
    /// Sum of its observed sRGB colours, and their number.
    pub colors: [u32; 4],
    pub is_removed: bool,
}

impl Landmark {
    /// The landmark of a first measurement.
    pub(super) fn new(measurement: &Measurement, keyframe: u32) -> Self {
        let mut landmark = Self {
            position: measurement.point_in_world,
            weighted: Vector3::zeros(),
            weight: 0.0,
            measurements: 0,
            keyframes: 0,
            last_keyframe: 0,
            settled_at: 0,
            contradictions: 0,
            colors: [0; 4],
            is_removed: false,
        };
        landmark.add(measurement, keyframe);
        landmark
    }

    /// Adds a measurement by a keyframe.
    pub(super) fn add(&mut self, measurement: &Measurement, keyframe: u32) {
        let weight = 1.0 / (measurement.sigma * measurement.sigma);
        self.weighted += weight * measurement.point_in_world.coords;
        self.weight += weight;
        self.measurements += 1;
        if self.keyframes == 0 || self.last_keyframe != keyframe {
            self.keyframes += 1;
            self.last_keyframe = keyframe;
        }
    }

    /// Standard deviation of one measurement.
    pub(super) fn sigma(&self) -> f64 {
        (f64::from(self.measurements) / self.weight).sqrt()
    }
}
