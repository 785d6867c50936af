//! One rectangle of a scene.

use nalgebra::{Point3, Vector3};

use super::texture::{Rgb, Texture};

/// A rectangle visible from its front, to which its normal, u cross v, points.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    /// The lower left corner as seen from the front.
    pub(super) origin: Point3<f64>,
    /// Unit direction to the right.
    pub(super) u: Vector3<f64>,
    /// Unit direction up.
    pub(super) v: Vector3<f64>,
    /// Extent along u and v in metres.
    pub(super) size: (f64, f64),
    texture: Texture,
    decals: Vec<Decal>,
}

/// A picture on a surface: a texture edge without a geometric edge.
#[derive(Debug, Clone)]
struct Decal {
    low: (f64, f64),
    size: (f64, f64),
    texture: Texture,
}

impl Surface {
    /// A rectangle with the edges `right` and `up` from `origin`, which must be perpendicular.
    pub(super) fn new(
        origin: Point3<f64>,
        right: Vector3<f64>,
        up: Vector3<f64>,
        texture: Texture,
    ) -> Self {
        debug_assert!(right.dot(&up).abs() < 1e-9 * right.norm() * up.norm());
        Self {
            origin,
            u: right.normalize(),
            v: up.normalize(),
            size: (right.norm(), up.norm()),
            texture,
            decals: Vec::new(),
        }
    }

    /// Adds a picture with its lower left corner at `low`.
    pub(super) fn with_decal(
        mut self,
        low: (f64, f64),
        size: (f64, f64),
        texture: Texture,
    ) -> Self {
        self.decals.push(Decal { low, size, texture });
        self
    }

    pub(super) fn normal(&self) -> Vector3<f64> {
        self.u.cross(&self.v)
    }

    pub(super) fn point(&self, u: f64, v: f64) -> Point3<f64> {
        self.origin + self.u * u + self.v * v
    }

    /// Surface coordinates of the projection of a point.
    pub(super) fn coordinates(&self, point: &Point3<f64>) -> (f64, f64) {
        let offset = point - self.origin;
        (offset.dot(&self.u), offset.dot(&self.v))
    }

    /// Colour and emission at a position of the surface.
    pub(super) fn color_at(&self, u: f64, v: f64) -> (Rgb, f64) {
        // Later pictures cover earlier ones.
        for decal in self.decals.iter().rev() {
            let (x, y) = (u - decal.low.0, v - decal.low.1);
            if x >= 0.0 && y >= 0.0 && x <= decal.size.0 && y <= decal.size.1 {
                return (decal.texture.color_at(x, y, decal.size), decal.texture.glow);
            }
        }
        (self.texture.color_at(u, v, self.size), self.texture.glow)
    }
}
