//! A table with a few boxes, in the void.

use nalgebra::{Point3, Vector3};

use super::super::scene::{BoxTextures, Face, Lamp, Scene, at};
use super::super::texture::Texture;
use super::super::trajectory::Path;

impl Scene {
    /// A small scene in which large parts of the images show no surface.
    pub fn boxes() -> Self {
        let mut scene = Self::empty(
            "A table with a few boxes",
            Path {
                eye: |t| {
                    let angle = -2.5 + 1.9 * t;
                    [
                        1.45 * angle.cos(),
                        1.45 * angle.sin(),
                        1.45 + 0.15 * (5.0 * t).sin(),
                    ]
                },
                target: |t| [0.1 * (3.0 * t).sin(), 0.0, 0.72],
                closed: false,
            },
        );
        let top = BoxTextures::all_sides(Texture::wood([176, 128, 82], 1));
        scene.block([-0.7, -0.45, 0.68], [0.7, 0.45, 0.72], &top);
        for (x, y) in [(-0.64, -0.39), (0.64, -0.39), (-0.64, 0.39), (0.64, 0.39)] {
            let leg = BoxTextures::all_sides(Texture::wood([150, 104, 66], 2)).without(Face::Top);
            scene.cuboid(&at(x, y, 0.0, 0.0), [0.05, 0.05, 0.68], &leg);
        }
        let table = 0.72;
        scene.cuboid(
            &at(-0.32, 0.1, table, 0.35),
            [0.34, 0.26, 0.24],
            &BoxTextures::standing(Texture::carton(3)),
        );
        scene.cuboid(
            &at(-0.3, 0.1, table + 0.24, 0.8),
            [0.16, 0.16, 0.12],
            &BoxTextures::standing(Texture::plain([52, 110, 146], 4)).with(
                Face::Top,
                Texture::stripes([52, 110, 146], [226, 224, 214], 0.04, 5),
            ),
        );
        scene.cuboid(
            &at(0.3, 0.18, table, -0.4),
            [0.22, 0.14, 0.34],
            &BoxTextures::standing(Texture::poster(2, [196, 84, 62], [238, 188, 84], 6)),
        );
        scene.cuboid(
            &at(0.22, -0.2, table, 0.15),
            [0.3, 0.21, 0.05],
            &BoxTextures::standing(Texture::plain([140, 58, 62], 7)).with(
                Face::Top,
                Texture::poster(0, [96, 148, 168], [60, 96, 72], 8),
            ),
        );
        scene.cuboid(
            &at(-0.1, -0.26, table, -0.2),
            [0.12, 0.12, 0.12],
            &BoxTextures::standing(Texture::tiles([232, 230, 222], [64, 66, 72], 0.03, 9)),
        );
        scene.ambient = [0.34, 0.35, 0.37];
        scene.lamps.push(Lamp {
            centre: Point3::new(0.9, -1.4, 2.4),
            half_u: Vector3::new(0.3, 0.0, 0.0),
            half_v: Vector3::new(0.0, -0.3, 0.0),
            power: [3.6, 3.5, 3.3],
        });
        scene.lamps.push(Lamp {
            centre: Point3::new(-1.6, -0.2, 1.9),
            half_u: Vector3::new(0.0, 0.3, 0.0),
            half_v: Vector3::new(0.0, 0.0, 0.3),
            power: [1.1, 1.2, 1.35],
        });
        scene
    }
}
