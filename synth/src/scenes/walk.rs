//! Furnished rooms in a row, joined by doorways.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::super::scene::{BoxTextures, Face, Lamp, Scene, at};
use super::super::surface::Surface;
use super::super::texture::{Texture, unit_hash};
use super::super::trajectory::Path;

/// Number of rooms.
const ROOMS: u32 = 5;
/// Extent of a room along x and y, and of all along z.
const WIDTH: f64 = 4.0;
const DEPTH: f64 = 3.8;
const HEIGHT: f64 = 2.5;
/// Thickness of the walls between rooms.
const WALL: f64 = 0.12;
/// From the west wall of a room to that of the next.
const PITCH: f64 = WIDTH + WALL;
/// The doorways: along y, and their height.
const DOOR: [f64; 2] = [1.4, 2.4];
const DOOR_HEIGHT: f64 = 2.05;
/// Length of all rooms.
const LENGTH: f64 = ROOMS as f64 * PITCH - WALL;
/// Distance of the ends of the path from the outermost walls.
const END: f64 = 1.2;
/// Share of the path on which the camera turns around in the last room.
const TURNING: f64 = 0.06;

/// Where the path is along x, and the share of the turn that was made.
fn progress(t: f64) -> (f64, f64) {
    let walking = 0.5 * (1.0 - TURNING);
    let way = LENGTH - 2.0 * END;
    let smooth = |share: f64| share * share * (3.0 - 2.0 * share);
    if t <= walking {
        (END + way * t / walking, 0.0)
    } else if t <= walking + TURNING {
        (END + way, smooth((t - walking) / TURNING))
    } else {
        (END + way * (1.0 - t) / walking, 1.0)
    }
}

/// To and fro across each room; in the middle of the doorways.
fn eye(t: f64) -> [f64; 3] {
    let (x, _) = progress(t);
    let phase = TAU * (x + 0.5 * WALL) / PITCH;
    [
        x,
        1.9 + 0.45 * phase.sin(),
        1.45 + 0.08 * (2.0 * phase).sin(),
    ]
}

/// Ahead, and in turn to the left and to the right.
fn target(t: f64) -> [f64; 3] {
    let (x, turned) = progress(t);
    let [_, y, z] = eye(t);
    let phase = TAU * (x + 0.5 * WALL) / PITCH;
    let heading = PI * turned + 1.1 * phase.sin();
    [
        x + heading.cos(),
        y + heading.sin(),
        z - 0.22 + 0.25 * (3.0 * phase).sin(),
    ]
}

impl Scene {
    /// Five furnished rooms in a row, joined by doorways. The path leads through all of them and back.
    pub fn walk() -> Self {
        let path = Path {
            eye,
            target,
            closed: false,
        };
        let mut scene = Self::empty("A walk through rooms", path);
        scene.ambient = [0.45, 0.45, 0.46];
        scene.floor_and_ceiling();
        for room in 0..ROOMS {
            let x = f64::from(room) * PITCH;
            let seed = 1000 * u64::from(room + 1);
            scene.outer_walls(x, seed);
            if room + 1 < ROOMS {
                scene.wall_with_doorway(x + WIDTH, seed + 50);
            }
            scene.furnish(x, room, seed + 100);
            scene.lamps.push(Lamp {
                centre: Point3::new(x + 0.5 * WIDTH, 0.5 * DEPTH, HEIGHT - 0.06),
                half_u: Vector3::new(0.5, 0.0, 0.0),
                half_v: Vector3::new(0.0, -0.5, 0.0),
                power: [3.4, 3.3, 3.1],
            });
        }
        scene
    }

    /// One floor and one ceiling for all rooms, and the walls at both ends.
    fn floor_and_ceiling(&mut self) {
        self.rectangle(
            [0.0; 3],
            [LENGTH, 0.0, 0.0],
            [0.0, DEPTH, 0.0],
            Texture::planks([176, 136, 96], 0.14, 1.25, 11),
        );
        self.rectangle(
            [0.0, DEPTH, HEIGHT],
            [LENGTH, 0.0, 0.0],
            [0.0, -DEPTH, 0.0],
            Texture::grid([236, 234, 228], [176, 174, 168], (0.6, 0.015), 13).from(0.1, 0.2),
        );
        let wall = |seed| Texture::wall([226, 216, 196], [150, 164, 150], seed);
        let poster = |kind| Texture::poster(kind, [186, 92, 46], [44, 86, 148], 15);
        let up = Vector3::new(0.0, 0.0, HEIGHT);
        for (x, y, along, kind) in [(0.0, 0.0, DEPTH, 0), (LENGTH, DEPTH, -DEPTH, 1)] {
            let right = Vector3::new(0.0, along, 0.0);
            let wall = Surface::new(Point3::new(x, y, 0.0), right, up, wall(14));
            let wall = wall.with_decal((1.4, 1.1), (0.9, 0.8), poster(kind));
            self.surfaces.push(wall);
        }
    }

    /// The south and north walls of the room that begins at `x`, with posters.
    fn outer_walls(&mut self, x: f64, seed: u64) {
        let tint = |index: i64| (200.0 + 40.0 * unit_hash(index, 0, seed)) as u8;
        let color = [tint(0), tint(1), tint(2)];
        let pale = |seed| Texture::wall(color, [150, 164, 150], seed);
        let poster = |index: i64| {
            let shade = |channel: i64| (60.0 + 170.0 * unit_hash(index, channel, seed + 1)) as u8;
            let colors = [
                [shade(0), shade(1), shade(2)],
                [shade(3), shade(4), shade(5)],
            ];
            Texture::poster(
                index as u32 % 4,
                colors[0],
                colors[1],
                seed + 2 + index as u64,
            )
        };
        let place = |index: i64| 0.5 + 1.5 * unit_hash(index, 7, seed);
        let up = Vector3::new(0.0, 0.0, HEIGHT);
        let walls = [
            (Point3::new(x + WIDTH, 0.0, 0.0), -WIDTH, 0),
            (Point3::new(x, DEPTH, 0.0), WIDTH, 2),
        ];
        for (corner, along, index) in walls {
            let right = Vector3::new(along, 0.0, 0.0);
            let wall = Surface::new(corner, right, up, pale(seed + 10 + index as u64))
                .with_decal((place(index), 1.25), (0.6, 0.85), poster(index))
                .with_decal(
                    (place(index + 1) + 1.4, 1.3),
                    (0.5, 0.65),
                    poster(index + 1),
                );
            self.surfaces.push(wall);
        }
    }

    /// The wall from `x` on, with its doorway.
    fn wall_with_doorway(&mut self, x: f64, seed: u64) {
        let [south, north] = DOOR;
        let texture =
            |y: f64, z: f64, seed| Texture::wall([214, 220, 214], [178, 160, 136], seed).from(y, z);
        for (y0, y1, z0) in [
            (0.0, south, 0.0),
            (south, north, DOOR_HEIGHT),
            (north, DEPTH, 0.0),
        ] {
            let up = [0.0, 0.0, HEIGHT - z0];
            self.rectangle([x, y1, z0], [0.0, y0 - y1, 0.0], up, texture(y0, z0, seed));
            let other = texture(y0, z0, seed + 1);
            self.rectangle([x + WALL, y0, z0], [0.0, y1 - y0, 0.0], up, other);
        }
        let white = |seed| Texture::plain([240, 240, 236], seed);
        let up = [0.0, 0.0, DOOR_HEIGHT];
        self.rectangle(
            [x + WALL, south, 0.0],
            [-WALL, 0.0, 0.0],
            up,
            white(seed + 2),
        );
        self.rectangle([x, north, 0.0], [WALL, 0.0, 0.0], up, white(seed + 3));
        self.rectangle(
            [x, north, DOOR_HEIGHT],
            [WALL, 0.0, 0.0],
            [0.0, south - north, 0.0],
            white(seed + 4),
        );
    }

    /// What stands along the walls of the room that begins at `x`: one of two arrangements, in colours of its own.
    fn furnish(&mut self, x: f64, room: u32, seed: u64) {
        let shade = |channel: i64| (70.0 + 150.0 * unit_hash(i64::from(room), channel, 5)) as u8;
        let wood = [shade(0), shade(1), shade(2)];
        let cloth = [shade(3), shade(4), shade(5)];
        if room.is_multiple_of(2) {
            self.bookcase(&at(x + 1.1, DEPTH - 0.2, 0.0, 0.0), [1.5, 0.3, 1.95], seed);
            self.sofa(&at(x + 1.8, 0.5, 0.0, PI), 1.9, seed + 200);
            self.table(
                &at(x + 3.0, 3.4, 0.0, 0.0),
                [1.3, 0.7, 0.74],
                wood,
                seed + 300,
            );
            self.monitor(&at(x + 3.1, 3.52, 0.74, 0.0), seed + 310);
        } else {
            let low = [1.5, 0.42, 0.72];
            self.cabinet(&at(x + 1.2, 0.24, 0.0, PI), low, seed + 400);
            self.table_lamp(&at(x + 0.8, 0.26, 0.72, 0.3), seed + 420);
            self.table(
                &at(x + 1.2, 3.4, 0.0, 0.0),
                [1.5, 0.7, 0.74],
                wood,
                seed + 300,
            );
            self.chair(&at(x + 2.4, 3.4, 0.0, 0.4), wood, cloth, seed + 320);
            let box_look = BoxTextures::standing(Texture::plain(cloth, seed + 500))
                .with(Face::Top, Texture::poster(0, wood, cloth, seed + 501));
            self.cuboid(&at(x + 1.0, 3.4, 0.74, 0.4), [0.3, 0.22, 0.12], &box_look);
        }
        let carton = |index: u64| BoxTextures::standing(Texture::carton(seed + 510 + index));
        self.cuboid(&at(x + 3.4, 0.42, 0.0, 0.12), [0.6, 0.5, 0.42], &carton(0));
        self.cuboid(
            &at(x + 3.4, 0.42, 0.42, -0.18),
            [0.42, 0.36, 0.3],
            &carton(1),
        );
    }
}
