//! Three white walls that meet in a corner: all quantities can be computed by hand.

use nalgebra::{Point3, Vector3};

use super::super::scene::{Lamp, Scene};
use super::super::texture::Texture;
use super::super::trajectory::Path;

impl Scene {
    /// The planes x = 0, y = 0 and z = 0, two metres wide each, seen from inside; tiles on the floor.
    pub fn corner() -> Self {
        let mut scene = Self::empty(
            "Three walls that meet in a corner",
            Path {
                eye: |t| {
                    let angle = 0.45 + 0.67 * t;
                    [2.2 * angle.cos(), 2.2 * angle.sin(), 1.4 + 0.2 * t]
                },
                target: |_| [0.4, 0.4, 0.5],
                closed: false,
            },
        );
        let wall = |seed| Texture::plain([222, 220, 214], seed);
        scene.rectangle([0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0], wall(1));
        scene.rectangle([2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 2.0], wall(2));
        scene.surfaces[1] = scene.surfaces[1].clone().with_decal(
            (0.7, 0.6),
            (0.5, 0.7),
            Texture::poster(1, [178, 62, 52], [58, 92, 140], 4),
        );
        scene.rectangle(
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [0.0, 2.0, 0.0],
            Texture::tiles([196, 186, 170], [140, 128, 112], 0.25, 3),
        );
        scene.ambient = [0.32; 3];
        scene.lamps.push(Lamp {
            centre: Point3::new(1.3, 1.9, 2.6),
            half_u: Vector3::new(0.3, 0.0, 0.0),
            half_v: Vector3::new(0.0, -0.3, 0.0),
            power: [4.2, 4.1, 3.9],
        });
        scene
    }
}
