//! The plane of a pixel, and pseudo-random variations of it.

use crate::camera::Camera;

/// Least cosine between the normal of a plane and the direction to the camera.
const LEAST_COSINE: f32 = 0.2;

/// A surface plane seen at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PixelPlane {
    /// Inverse depth at the pixel.
    pub(super) rho: f32,
    /// Gradient of the inverse depth per pixel along x and y.
    pub(super) slope: [f32; 2],
}

impl PixelPlane {
    /// The plane with its inverse depth at a pixel `away` from its own.
    #[inline]
    pub(super) fn shifted(&self, away: [f32; 2]) -> Self {
        Self {
            rho: self.rho + away[0] * self.slope[0] + away[1] * self.slope[1],
            slope: self.slope,
        }
    }
}

/// Which planes are possible.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneBounds {
    /// Range of inverse depths.
    pub(super) range: [f32; 2],
    focal: [f32; 2],
    center: [f32; 2],
}

impl PlaneBounds {
    pub(super) fn new(range: [f32; 2], camera: &Camera) -> Self {
        Self {
            range,
            focal: [camera.fx() as f32, camera.fy() as f32],
            center: [camera.cx() as f32, camera.cy() as f32],
        }
    }

    /// Whether the inverse depth is in range and the plane is not seen at a grazing angle.
    #[inline]
    pub(super) fn contains(&self, pixel: [f32; 2], plane: &PixelPlane) -> bool {
        let [x, y] = [pixel[0] - self.center[0], pixel[1] - self.center[1]];
        // With rho = normal * ray along a plane.
        let normal = [
            plane.slope[0] * self.focal[0],
            plane.slope[1] * self.focal[1],
            plane.rho - plane.slope[0] * x - plane.slope[1] * y,
        ];
        let (u, v) = (x / self.focal[0], y / self.focal[1]);
        let lengths = (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
            * (u * u + v * v + 1.0);
        plane.rho >= self.range[0]
            && plane.rho <= self.range[1]
            && plane.rho * plane.rho >= LEAST_COSINE * LEAST_COSINE * lengths
    }

    /// A plane anywhere in the range.
    pub(super) fn random(&self, noise: &mut Noise) -> PixelPlane {
        let [low, high] = self.range;
        let rho = low + 0.5 * (1.0 + noise.next()) * (high - low);
        PixelPlane {
            rho,
            slope: self.focal.map(|focal| rho / focal * noise.next()),
        }
    }

    /// A plane whose inverse depth differs by up to the share `depth` and whose slopes by up to `tilt`.
    pub(super) fn varied(
        &self,
        plane: &PixelPlane,
        depth: f32,
        tilt: f32,
        noise: &mut Noise,
    ) -> PixelPlane {
        let rho = plane.rho * (1.0 + depth * noise.next());
        PixelPlane {
            rho,
            slope: std::array::from_fn(|axis| {
                plane.slope[axis] + tilt * noise.next() * rho / self.focal[axis]
            }),
        }
    }
}

/// Pseudo-random numbers that depend on a key alone (splitmix64).
pub(super) struct Noise(u64);

impl Noise {
    pub(super) fn new(pixel: usize, round: usize) -> Self {
        Self((pixel as u64) << 20 ^ round as u64)
    }

    /// The next number from -1 to 1.
    pub(super) fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    }
}
