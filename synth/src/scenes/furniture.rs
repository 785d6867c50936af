//! Furniture, made of boxes.

use nalgebra::Isometry3;

use super::super::scene::{BoxTextures, Face, Scene, at};
use super::super::texture::{Texture, unit_hash};

/// A box of a piece of furniture: low corner and size in the frame of the piece, x across its front, y towards its back.
type Part = ([f64; 3], [f64; 3]);

impl Scene {
    /// Adds a box given in the frame of a piece of furniture.
    fn part(&mut self, pose: &Isometry3<f64>, (low, size): Part, textures: &BoxTextures) {
        let middle = at(low[0] + 0.5 * size[0], low[1] + 0.5 * size[1], low[2], 0.0);
        self.cuboid(&(pose * middle), size, textures);
    }

    /// A table with four legs; `pose` is the middle of its outline on the floor.
    pub(super) fn table(
        &mut self,
        pose: &Isometry3<f64>,
        [width, depth, height]: [f64; 3],
        color: [u8; 3],
        seed: u64,
    ) {
        let top = BoxTextures::all_sides(Texture::wood(color, seed))
            .with(Face::Top, Texture::planks(color, 0.11, 2.0, seed));
        let (x, y) = (-0.5 * width, -0.5 * depth);
        self.part(pose, ([x, y, height - 0.035], [width, depth, 0.035]), &top);
        let leg = BoxTextures::standing(Texture::wood(color, seed + 1)).without(Face::Top);
        let thick = 0.055;
        for along in [0.02, width - 0.02 - thick] {
            for across in [0.02, depth - 0.02 - thick] {
                let low = [x + along, y + across, 0.0];
                self.part(pose, (low, [thick, thick, height - 0.035]), &leg);
            }
        }
    }

    /// A chair; its back is at the +y side of `pose`.
    pub(super) fn chair(
        &mut self,
        pose: &Isometry3<f64>,
        wood: [u8; 3],
        cloth: [u8; 3],
        seed: u64,
    ) {
        let frame = BoxTextures::all_sides(Texture::wood(wood, seed));
        let leg = BoxTextures::standing(Texture::wood(wood, seed + 1)).without(Face::Top);
        for x in [-0.21, 0.17] {
            self.part(pose, ([x, -0.21, 0.0], [0.04, 0.04, 0.42]), &leg);
            self.part(
                pose,
                ([x, 0.17, 0.0], [0.04, 0.04, 0.92]),
                &BoxTextures::standing(Texture::wood(wood, seed + 1)),
            );
        }
        self.part(pose, ([-0.22, -0.22, 0.42], [0.44, 0.44, 0.03]), &frame);
        let cushion = BoxTextures::standing(Texture::plain(cloth, seed + 2));
        self.part(pose, ([-0.2, -0.21, 0.45], [0.4, 0.37, 0.035]), &cushion);
        for z in [0.6, 0.78] {
            self.part(pose, ([-0.17, 0.18, z], [0.34, 0.02, 0.1]), &frame);
        }
    }

    /// A bookcase; `pose` is the middle of its outline on the floor, its open front is the -y side.
    pub(super) fn bookcase(
        &mut self,
        pose: &Isometry3<f64>,
        [width, depth, height]: [f64; 3],
        seed: u64,
    ) {
        let wood = [214, 196, 168];
        let board = 0.025;
        let look = |s: u64| BoxTextures::standing(Texture::wood(wood, seed + s));
        let (x, y) = (-0.5 * width, -0.5 * depth);
        self.part(pose, ([x, y, 0.0], [board, depth, height]), &look(0));
        self.part(
            pose,
            ([-x - board, y, 0.0], [board, depth, height]),
            &look(1),
        );
        let inner = width - 2.0 * board;
        let back = BoxTextures::standing(Texture::plain([188, 170, 142], seed + 2));
        self.part(
            pose,
            ([x + board, -y - 0.01, 0.0], [inner, 0.01, height]),
            &back,
        );
        let levels = 5_u32;
        let pitch = (height - board - 0.06) / f64::from(levels);
        for level in 0..=levels {
            let z = 0.06 + pitch * f64::from(level);
            let shelf = BoxTextures::all_sides(Texture::wood(wood, seed + 3 + u64::from(level)))
                .without(Face::East)
                .without(Face::West)
                .without(Face::North);
            self.part(
                pose,
                ([x + board, y, z], [inner, depth - 0.01, board]),
                &shelf,
            );
            if level < levels {
                let low = [x + board + 0.01, y, z + board];
                self.books(
                    pose,
                    low,
                    inner - 0.02,
                    pitch - board,
                    seed + 31 * u64::from(level),
                );
            }
        }
    }

    /// A row of books from `low` to the right: of different sizes, with a gap or a box here and there.
    fn books(&mut self, pose: &Isometry3<f64>, low: [f64; 3], width: f64, room: f64, seed: u64) {
        const COLORS: [[u8; 3]; 8] = [
            [150, 48, 44],
            [40, 78, 120],
            [58, 104, 74],
            [212, 168, 84],
            [92, 60, 96],
            [226, 220, 204],
            [44, 48, 56],
            [190, 104, 58],
        ];
        let pick = |index: i64, what: i64| unit_hash(index, what, seed);
        let mut x = 0.0;
        let mut index = 0;
        loop {
            index += 1;
            if pick(index, 0) < 0.09 {
                // A box lies on the shelf, or nothing does.
                let size = [0.16 + 0.08 * pick(index, 1), 0.16, room * 0.45];
                if x + size[0] + 0.04 < width {
                    if pick(index, 2) < 0.6 {
                        let color = COLORS[(pick(index, 3) * 8.0) as usize];
                        let look =
                            BoxTextures::standing(Texture::plain(color, seed + index as u64)).with(
                                Face::South,
                                Texture::poster(3, color, [236, 230, 214], seed + index as u64),
                            );
                        self.part(
                            pose,
                            ([low[0] + x + 0.02, low[1] + 0.03, low[2]], size),
                            &look,
                        );
                    }
                    x += size[0] + 0.04;
                }
                continue;
            }
            let thickness = 0.022 + 0.032 * pick(index, 4);
            if x + thickness > width || index > 60 {
                break;
            }
            let size = [
                thickness,
                0.15 + 0.05 * pick(index, 5),
                room * (0.62 + 0.28 * pick(index, 6)),
            ];
            let color = COLORS[(pick(index, 7) * 8.0) as usize];
            let other = if color[0] > 180 {
                [70, 60, 56]
            } else {
                [228, 208, 160]
            };
            let inset = 0.012 + 0.02 * pick(index, 8);
            let look = BoxTextures::standing(Texture::plain(color, seed + index as u64))
                .with(
                    Face::South,
                    Texture::spine(color, other, seed + index as u64),
                )
                .with(
                    Face::Top,
                    Texture::plain([236, 230, 216], seed + index as u64),
                );
            self.part(pose, ([low[0] + x, low[1] + inset, low[2]], size), &look);
            x += thickness + 0.0015;
        }
    }

    /// A sofa; its back is at the +y side of `pose`.
    pub(super) fn sofa(&mut self, pose: &Isometry3<f64>, width: f64, seed: u64) {
        let weave = |s: u64| {
            Texture::grid([96, 112, 122], [136, 150, 156], (0.12, 0.012), seed + s).from(0.05, 0.05)
        };
        let cloth = |s: u64| BoxTextures::standing(weave(s));
        let half = 0.5 * width;
        self.part(
            pose,
            ([-half, -0.42, 0.05], [width, 0.84, 0.22]),
            &BoxTextures::all_sides(Texture::plain([84, 98, 108], seed)),
        );
        self.part(pose, ([-half, 0.2, 0.27], [width, 0.22, 0.55]), &cloth(1));
        for x in [-half, half - 0.18] {
            self.part(pose, ([x, -0.42, 0.27], [0.18, 0.62, 0.33]), &cloth(2));
        }
        let seat = (width - 0.36) / 2.0;
        for index in 0..2 {
            let x = -half + 0.18 + seat * f64::from(index);
            let low = [x + 0.006, -0.43, 0.27];
            self.part(
                pose,
                (low, [seat - 0.012, 0.62, 0.15]),
                &cloth(3 + u64::from(index as u32)),
            );
        }
        let cushion =
            |color, other, s| BoxTextures::standing(Texture::stripes(color, other, 0.09, seed + s));
        let turned = |x: f64, yaw: f64| pose * at(x, 0.06, 0.42, yaw);
        let size = [0.38, 0.13, 0.36];
        self.cuboid(
            &turned(-half + 0.48, 0.25),
            size,
            &cushion([204, 120, 66], [236, 222, 196], 7),
        );
        self.cuboid(
            &turned(half - 0.5, -0.2),
            size,
            &cushion([60, 116, 124], [226, 226, 214], 8),
        );
    }

    /// A low cabinet with doors; its front is the -y side.
    pub(super) fn cabinet(
        &mut self,
        pose: &Isometry3<f64>,
        [width, depth, height]: [f64; 3],
        seed: u64,
    ) {
        let body = BoxTextures::standing(Texture::wood([122, 84, 58], seed))
            .with(Face::Top, Texture::planks([122, 84, 58], 0.105, 2.0, seed))
            .with(Face::South, Texture::plain([66, 46, 34], seed + 1));
        let (x, y) = (-0.5 * width, -0.5 * depth);
        self.part(pose, ([x, y, 0.08], [width, depth, height - 0.08]), &body);
        let foot = BoxTextures::standing(Texture::plain([50, 42, 38], seed + 2)).without(Face::Top);
        for along in [0.05, width - 0.11] {
            for across in [0.04, depth - 0.1] {
                self.part(
                    pose,
                    ([x + along, y + across, 0.0], [0.06, 0.06, 0.08]),
                    &foot,
                );
            }
        }
        let doors = 3;
        let pitch = width / f64::from(doors);
        for door in 0..doors {
            let low = [x + pitch * f64::from(door) + 0.012, y - 0.018, 0.1];
            let look = BoxTextures::all_sides(Texture::wood(
                [226, 218, 202],
                seed + 3 + u64::from(door as u32),
            ))
            .without(Face::North);
            self.part(pose, (low, [pitch - 0.024, 0.018, height - 0.14]), &look);
            let handle =
                BoxTextures::all_sides(Texture::plain([60, 60, 64], seed + 9)).without(Face::North);
            let at_handle = [low[0] + pitch - 0.09, y - 0.04, 0.5 * height];
            self.part(pose, (at_handle, [0.025, 0.022, 0.14]), &handle);
        }
    }

    /// A screen on a foot; it looks towards the -y side.
    pub(super) fn monitor(&mut self, pose: &Isometry3<f64>, seed: u64) {
        let black = |s: u64| Texture::plain([44, 45, 49], seed + s);
        self.part(
            pose,
            ([-0.13, -0.09, 0.0], [0.26, 0.18, 0.015]),
            &BoxTextures::standing(black(0)),
        );
        self.part(
            pose,
            ([-0.03, 0.02, 0.015], [0.06, 0.03, 0.18]),
            &BoxTextures::standing(black(1)).without(Face::Top),
        );
        self.part(
            pose,
            ([-0.31, -0.02, 0.12], [0.62, 0.04, 0.38]),
            &BoxTextures::all_sides(black(2)).without(Face::South),
        );
        // The picture lies a centimetre within its frame.
        let (width, bottom, top) = (0.62, 0.12, 0.5);
        let frame = 0.018;
        for (x, z, w, h) in [
            (-0.31, bottom, width, frame),
            (-0.31, top - frame, width, frame),
            (-0.31, bottom + frame, frame, top - bottom - 2.0 * frame),
            (
                0.31 - frame,
                bottom + frame,
                frame,
                top - bottom - 2.0 * frame,
            ),
        ] {
            self.part(
                pose,
                ([x, -0.03, z], [w, 0.01, h]),
                &BoxTextures::all_sides(black(3)).without(Face::North),
            );
        }
        let screen = BoxTextures::standing(Texture::screen(seed + 4))
            .without(Face::Top)
            .without(Face::North)
            .without(Face::East)
            .without(Face::West);
        self.part(
            pose,
            (
                [-0.31 + frame, -0.02, bottom + frame],
                [width - 2.0 * frame, 0.001, top - bottom - 2.0 * frame],
            ),
            &screen,
        );
    }

    /// A lamp on a foot with a shade.
    pub(super) fn table_lamp(&mut self, pose: &Isometry3<f64>, seed: u64) {
        let metal = |s: u64| Texture::plain([74, 72, 70], seed + s);
        self.part(
            pose,
            ([-0.08, -0.08, 0.0], [0.16, 0.16, 0.02]),
            &BoxTextures::standing(metal(0)),
        );
        self.part(
            pose,
            ([-0.012, -0.012, 0.02], [0.024, 0.024, 0.26]),
            &BoxTextures::standing(metal(1)).without(Face::Top),
        );
        self.part(
            pose,
            ([-0.12, -0.12, 0.26], [0.24, 0.24, 0.2]),
            &BoxTextures::all_sides(Texture::plain([240, 226, 188], seed + 2)),
        );
    }
}
