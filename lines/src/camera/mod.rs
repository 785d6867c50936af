//! Camera models.

/// A calibrated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point x; the centre of the top-left pixel is (0, 0).
    pub cx: f64,
    /// Principal point y.
    pub cy: f64,
}
