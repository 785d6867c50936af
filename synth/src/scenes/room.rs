//! A furnished room with a doorway to a corridor.

use nalgebra::{Point3, Vector3};

use super::super::scene::{BoxTextures, Face, Lamp, Scene, at};
use super::super::surface::Surface;
use super::super::texture::Texture;
use super::super::trajectory::Path;

/// Extent of the room along x (west to east), y (south to north) and z.
const WIDTH: f64 = 4.6;
const DEPTH: f64 = 3.8;
const HEIGHT: f64 = 2.5;
/// The doorway in the west wall.
const DOOR: (f64, f64, f64) = (0.5, 1.4, 2.05);
/// Thickness of that wall.
const WALL: f64 = 0.14;
/// The window in the north wall: along x and z.
const WINDOW: ([f64; 2], [f64; 2]) = ([0.75, 2.05], [0.95, 2.05]);

impl Scene {
    /// A living room of 4.6 m by 3.8 m: a sofa, a bookcase, a desk with a screen, a cabinet, a coffee table on a rug,
    /// cartons, posters, a window, and a doorway through which a corridor is seen.
    pub fn room() -> Self {
        let mut scene = Self::bare_room();
        scene.title = "A room";
        scene.things();
        scene
    }

    /// The same room without its furniture: planes, posters, a picture in its frame, skirting boards, window and doorway.
    pub fn bare_room() -> Self {
        let mut scene = Self::empty(
            "A bare room",
            Path {
                // Around the coffee table, looking across it.
                eye: |t| {
                    let angle = std::f64::consts::TAU * t;
                    [
                        2.35 + 1.2 * angle.cos(),
                        1.9 + 0.85 * angle.sin(),
                        1.42 + 0.12 * (3.0 * angle).sin(),
                    ]
                },
                target: |t| {
                    let angle = std::f64::consts::TAU * t;
                    [
                        2.35 - 1.3 * angle.cos(),
                        1.9 - 1.1 * angle.sin(),
                        1.0 + 0.5 * (5.0 * angle).sin(),
                    ]
                },
                closed: true,
            },
        );
        scene.shell();
        scene.corridor();
        scene.window();
        scene.walls_with_pictures();
        scene.ambient = [0.45, 0.45, 0.46];
        scene.lamps = vec![
            Lamp {
                centre: Point3::new(2.5, 1.9, HEIGHT - 0.06),
                half_u: Vector3::new(0.5, 0.0, 0.0),
                half_v: Vector3::new(0.0, -0.5, 0.0),
                power: [3.0, 2.88, 2.65],
            },
            Lamp {
                centre: Point3::new(1.4, DEPTH - 0.05, 1.5),
                half_u: Vector3::new(0.0, 0.0, 0.5),
                half_v: Vector3::new(-0.6, 0.0, 0.0),
                power: [2.2, 2.35, 2.6],
            },
            Lamp {
                centre: Point3::new(-0.9, 1.5, HEIGHT - 0.06),
                half_u: Vector3::new(0.3, 0.0, 0.0),
                half_v: Vector3::new(0.0, -0.3, 0.0),
                power: [1.5, 1.42, 1.27],
            },
        ];
        scene
    }

    /// Floor, ceiling, and the south and east walls, which have no opening.
    fn shell(&mut self) {
        let floor = Surface::new(
            Point3::origin(),
            Vector3::new(WIDTH, 0.0, 0.0),
            Vector3::new(0.0, DEPTH, 0.0),
            Texture::planks([176, 136, 96], 0.14, 1.25, 11),
        )
        .with_decal(
            (1.4, 1.2),
            (1.95, 1.4),
            Texture::rug([142, 52, 48], [42, 66, 98], 12),
        );
        self.surfaces.push(floor);
        self.rectangle(
            [0.0, DEPTH, HEIGHT],
            [WIDTH, 0.0, 0.0],
            [0.0, -DEPTH, 0.0],
            Texture::grid([236, 234, 228], [176, 174, 168], (0.6, 0.015), 13).from(0.1, 0.2),
        );
    }

    /// What lies behind the doorway, and the opening in the wall.
    fn corridor(&mut self) {
        let (south, north, top) = DOOR;
        let wall = |seed| Texture::wall([212, 216, 206], [178, 160, 136], seed);
        let far = -1.5;
        let (low, high) = (-0.4, 3.2);
        let (length, reach) = (high - low, -WALL - far);
        self.rectangle(
            [far, low, 0.0],
            [reach + WALL, 0.0, 0.0],
            [0.0, length, 0.0],
            Texture::tiles([204, 198, 186], [150, 146, 138], 0.3, 21),
        );
        let poster = Texture::poster(2, [88, 128, 150], [222, 170, 84], 23);
        self.surfaces.push(
            Surface::new(
                Point3::new(far, low, 0.0),
                Vector3::new(0.0, length, 0.0),
                Vector3::new(0.0, 0.0, HEIGHT),
                wall(22),
            )
            .with_decal((1.25, 1.15), (0.6, 0.8), poster),
        );
        self.rectangle(
            [-WALL, low, 0.0],
            [-reach, 0.0, 0.0],
            [0.0, 0.0, HEIGHT],
            wall(24),
        );
        self.rectangle(
            [far, high, 0.0],
            [reach, 0.0, 0.0],
            [0.0, 0.0, HEIGHT],
            wall(25),
        );
        self.rectangle(
            [far, high, HEIGHT],
            [reach, 0.0, 0.0],
            [0.0, -length, 0.0],
            wall(26),
        );

        // The wall on both sides: towards the corridor it faces west, towards the room east.
        let room = |y: f64, z: f64| Texture::wall([226, 216, 196], [150, 164, 150], 28).from(y, z);
        for (y0, y1, z0) in [(low, south, 0.0), (south, north, top), (north, high, 0.0)] {
            self.rectangle(
                [-WALL, y1, z0],
                [0.0, y0 - y1, 0.0],
                [0.0, 0.0, HEIGHT - z0],
                wall(27),
            );
        }
        for (y0, y1, z0) in [(0.0, south, 0.0), (south, north, top), (north, DEPTH, 0.0)] {
            self.rectangle(
                [0.0, y0, z0],
                [0.0, y1 - y0, 0.0],
                [0.0, 0.0, HEIGHT - z0],
                room(y0, z0),
            );
        }
        // The sides and the top of the opening.
        let white = |seed| Texture::plain([240, 240, 236], seed);
        self.rectangle(
            [0.0, south, 0.0],
            [-WALL, 0.0, 0.0],
            [0.0, 0.0, top],
            white(29),
        );
        self.rectangle(
            [-WALL, north, 0.0],
            [WALL, 0.0, 0.0],
            [0.0, 0.0, top],
            white(30),
        );
        self.rectangle(
            [-WALL, north, top],
            [WALL, 0.0, 0.0],
            [0.0, south - north, 0.0],
            white(31),
        );
        // Its frame, towards the room.
        let frame = BoxTextures::standing(white(32)).without(Face::West);
        self.block([0.0, south - 0.08, 0.0], [0.025, south, top + 0.08], &frame);
        self.block([0.0, north, 0.0], [0.025, north + 0.08, top + 0.08], &frame);
        let lintel = BoxTextures::all_sides(white(33)).without(Face::West);
        self.block([0.0, south, top], [0.025, north, top + 0.08], &lintel);
    }

    /// The north wall with its window.
    fn window(&mut self) {
        let ([left, right], [low, high]) = WINDOW;
        let wall = |x: f64, z: f64| Texture::wall([226, 226, 220], [150, 164, 150], 41).from(x, z);
        // Seen from the room, right is west to east for a wall that faces south.
        let mut piece = |x0: f64, x1: f64, z0: f64, z1: f64| {
            self.rectangle(
                [x0, DEPTH, z0],
                [x1 - x0, 0.0, 0.0],
                [0.0, 0.0, z1 - z0],
                wall(x0, z0),
            );
        };
        piece(0.0, left, 0.0, HEIGHT);
        piece(right, WIDTH, 0.0, HEIGHT);
        piece(left, right, 0.0, low);
        piece(left, right, high, HEIGHT);
        let white = |seed| Texture::plain([242, 242, 240], seed);
        let deep = 0.12;
        let (w, h) = (right - left, high - low);
        self.rectangle(
            [left, DEPTH + deep, low],
            [w, 0.0, 0.0],
            [0.0, 0.0, h],
            Texture::sky(45),
        );
        self.rectangle(
            [left, DEPTH, low],
            [0.0, deep, 0.0],
            [0.0, 0.0, h],
            white(46),
        );
        self.rectangle(
            [right, DEPTH + deep, low],
            [0.0, -deep, 0.0],
            [0.0, 0.0, h],
            white(47),
        );
        self.rectangle(
            [left, DEPTH, low],
            [w, 0.0, 0.0],
            [0.0, deep, 0.0],
            white(48),
        );
        self.rectangle(
            [left, DEPTH + deep, high],
            [w, 0.0, 0.0],
            [0.0, -deep, 0.0],
            white(49),
        );
        // Bars before the pane, a frame before the wall, a sill.
        let bar = BoxTextures::all_sides(white(50)).without(Face::North);
        let middle = 0.5 * (left + right);
        let front = DEPTH + deep - 0.04;
        self.block(
            [middle - 0.03, front, low],
            [middle + 0.03, DEPTH + deep, high],
            &bar,
        );
        for x in [left, right - 0.05] {
            self.block([x, front, low], [x + 0.05, DEPTH + deep, high], &bar);
        }
        for (x0, x1) in [(left + 0.05, middle - 0.03), (middle + 0.03, right - 0.05)] {
            self.block([x0, front, low], [x1, DEPTH + deep, low + 0.05], &bar);
            self.block([x0, front, high - 0.05], [x1, DEPTH + deep, high], &bar);
        }
        let frame = BoxTextures::all_sides(white(51)).without(Face::North);
        let out = DEPTH - 0.02;
        for (x0, x1, z0, z1) in [
            (left - 0.07, left, low, high + 0.07),
            (right, right + 0.07, low, high + 0.07),
            (left, right, high, high + 0.07),
        ] {
            self.block([x0, out, z0], [x1, DEPTH, z1], &frame);
        }
        self.block(
            [left - 0.1, DEPTH - 0.12, low - 0.035],
            [right + 0.1, DEPTH, low],
            &frame,
        );
    }

    /// South and east walls with posters, and baseboards.
    fn walls_with_pictures(&mut self) {
        let south = Surface::new(
            Point3::new(WIDTH, 0.0, 0.0),
            Vector3::new(-WIDTH, 0.0, 0.0),
            Vector3::new(0.0, 0.0, HEIGHT),
            Texture::wall([206, 216, 224], [150, 164, 150], 61),
        )
        .with_decal(
            (1.75, 1.2),
            (0.6, 0.85),
            Texture::poster(0, [232, 206, 170], [150, 84, 70], 62),
        )
        .with_decal(
            (2.55, 1.3),
            (0.5, 0.65),
            Texture::poster(3, [228, 222, 206], [196, 96, 60], 63),
        );
        self.surfaces.push(south);
        let east = Surface::new(
            Point3::new(WIDTH, DEPTH, 0.0),
            Vector3::new(0.0, -DEPTH, 0.0),
            Vector3::new(0.0, 0.0, HEIGHT),
            Texture::wall([228, 218, 204], [150, 164, 150], 64),
        )
        .with_decal(
            (1.15, 1.25),
            (0.9, 0.7),
            Texture::poster(1, [186, 52, 46], [44, 86, 148], 65),
        );
        self.surfaces.push(east);
        // A picture in a frame, which stands out from the wall.
        let frame = BoxTextures::all_sides(Texture::wood([84, 62, 44], 66)).without(Face::East);
        let (y0, y1, z0, z1) = (0.75, 1.3, 1.35, 2.0);
        for (a, b, c, d) in [
            (y0, y1, z0, z0 + 0.04),
            (y0, y1, z1 - 0.04, z1),
            (y0, y0 + 0.04, z0 + 0.04, z1 - 0.04),
            (y1 - 0.04, y1, z0 + 0.04, z1 - 0.04),
        ] {
            self.block([WIDTH - 0.03, a, c], [WIDTH, b, d], &frame);
        }
        self.rectangle(
            [WIDTH - 0.012, y1 - 0.04, z0 + 0.04],
            [0.0, y0 - y1 + 0.08, 0.0],
            [0.0, 0.0, z1 - z0 - 0.08],
            Texture::poster(0, [176, 204, 214], [70, 110, 88], 67),
        );
        let board = BoxTextures::standing(Texture::plain([240, 240, 236], 68));
        let (deep, high) = (0.016, 0.09);
        let (door_south, door_north, _) = DOOR;
        self.block(
            [deep, 0.0, 0.0],
            [WIDTH - deep, deep, high],
            &board.clone().without(Face::South),
        );
        self.block(
            [deep, DEPTH - deep, 0.0],
            [WIDTH - deep, DEPTH, high],
            &board.clone().without(Face::North),
        );
        self.block(
            [WIDTH - deep, 0.0, 0.0],
            [WIDTH, DEPTH, high],
            &board.clone().without(Face::East),
        );
        for (a, b) in [(0.0, door_south - 0.08), (door_north + 0.08, DEPTH)] {
            self.block(
                [0.0, a, 0.0],
                [deep, b, high],
                &board.clone().without(Face::West),
            );
        }
    }

    /// Furniture and what lies about.
    fn things(&mut self) {
        use std::f64::consts::{FRAC_PI_2, PI};
        // Its front looks east, into the room.
        self.bookcase(&at(0.2, 2.6, 0.0, FRAC_PI_2), [1.5, 0.3, 1.95], 100);
        self.sofa(&at(2.2, 0.5, 0.0, PI), 1.9, 200);

        self.table(
            &at(3.35, 3.4, 0.0, 0.0),
            [1.5, 0.7, 0.74],
            [200, 164, 118],
            300,
        );
        self.monitor(&at(3.5, 3.52, 0.74, 0.0), 310);
        self.chair(
            &at(3.3, 2.72, 0.0, PI + 0.35),
            [150, 106, 70],
            [70, 110, 104],
            320,
        );
        let keyboard = BoxTextures::standing(Texture::plain([58, 60, 64], 330)).with(
            Face::Top,
            Texture::tiles([58, 60, 64], [96, 98, 104], 0.02, 331),
        );
        self.cuboid(&at(3.48, 3.22, 0.74, 0.03), [0.44, 0.14, 0.02], &keyboard);
        let stack = [
            ([0.26, 0.19, 0.035], [150, 60, 52]),
            ([0.24, 0.18, 0.028], [52, 88, 120]),
            ([0.2, 0.15, 0.04], [222, 196, 140]),
        ];
        let mut z = 0.74;
        for (index, (size, color)) in stack.into_iter().enumerate() {
            let look = BoxTextures::standing(Texture::plain(color, 340 + index as u64));
            self.cuboid(&at(2.86, 3.4, z, 0.2 - 0.25 * index as f64), size, &look);
            z += size[2];
        }

        self.cabinet(
            &at(WIDTH - 0.24, 1.75, 0.0, -FRAC_PI_2),
            [1.5, 0.42, 0.72],
            400,
        );
        self.table_lamp(&at(WIDTH - 0.26, 1.18, 0.72, 0.3), 420);
        let radio = BoxTextures::standing(Texture::plain([178, 92, 60], 430)).with(
            Face::South,
            Texture::stripes([178, 92, 60], [60, 44, 40], 0.024, 431),
        );
        self.cuboid(
            &at(WIDTH - 0.24, 1.72, 0.72, -FRAC_PI_2 + 0.15),
            [0.34, 0.16, 0.2],
            &radio,
        );
        self.cuboid(
            &at(WIDTH - 0.25, 2.25, 0.72, -FRAC_PI_2 - 0.25),
            [0.22, 0.2, 0.28],
            &BoxTextures::standing(Texture::poster(3, [72, 118, 138], [240, 226, 190], 432)),
        );

        // Cartons in the corner, one of them on another.
        self.cuboid(
            &at(4.12, 0.42, 0.0, 0.12),
            [0.6, 0.5, 0.42],
            &BoxTextures::standing(Texture::carton(500)),
        );
        self.cuboid(
            &at(4.1, 0.42, 0.42, -0.18),
            [0.42, 0.36, 0.3],
            &BoxTextures::standing(Texture::carton(501)),
        );
        self.cuboid(
            &at(3.55, 0.36, 0.0, -0.35),
            [0.34, 0.3, 0.28],
            &BoxTextures::standing(Texture::carton(502)),
        );

        self.table(
            &at(2.35, 1.88, 0.0, 0.06),
            [0.95, 0.55, 0.42],
            [120, 80, 54],
            600,
        );
        let book = BoxTextures::standing(Texture::plain([58, 96, 110], 610)).with(
            Face::Top,
            Texture::poster(0, [226, 208, 170], [58, 96, 110], 611),
        );
        self.cuboid(&at(2.12, 1.84, 0.42, 0.4), [0.28, 0.21, 0.03], &book);
        let tin = BoxTextures::standing(Texture::stripes([214, 174, 88], [120, 60, 52], 0.06, 612))
            .with(Face::Top, Texture::plain([214, 174, 88], 613));
        self.cuboid(&at(2.6, 1.95, 0.42, -0.3), [0.2, 0.15, 0.14], &tin);
        self.cuboid(
            &at(2.42, 1.74, 0.42, 0.7),
            [0.09, 0.09, 0.1],
            &BoxTextures::standing(Texture::plain([236, 234, 226], 614)),
        );

        // A chest beneath the window.
        let chest = BoxTextures::standing(Texture::wood([92, 116, 112], 620)).with(
            Face::South,
            Texture::stripes([92, 116, 112], [74, 96, 92], 0.3, 621),
        );
        self.cuboid(&at(1.4, DEPTH - 0.26, 0.0, 0.0), [1.0, 0.42, 0.46], &chest);
        self.cuboid(
            &at(1.2, DEPTH - 0.26, 0.46, 0.3),
            [0.3, 0.24, 0.16],
            &BoxTextures::standing(Texture::plain([196, 88, 70], 622)),
        );
    }
}
