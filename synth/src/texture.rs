//! Procedural textures: patterns as functions of the position, at any scale.

use linecarve_mesh::srgb::linear_color;

/// A linear colour.
pub(super) type Rgb = [f64; 3];

/// A pattern over a rectangle. Coordinates are metres from its lower left corner, u to the right and v up as seen
/// from the front.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Texture {
    pattern: Pattern,
    /// The main colour.
    color: Rgb,
    /// The second colour.
    other: Rgb,
    /// Seed of the variation between textures of one kind.
    seed: u64,
    /// Position of the lower left corner in a larger pattern, so that neighbours fit together.
    offset: (f64, f64),
    /// Emitted share of its colour, 0 to 1: windows and screens.
    pub(super) glow: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Pattern {
    Plain,
    /// Grain along u.
    Wood,
    Planks {
        width: f64,
        length: f64,
    },
    Tiles {
        size: f64,
    },
    Stripes {
        period: f64,
    },
    /// Lines of the second colour around squares.
    Grid {
        period: f64,
        line: f64,
    },
    /// Boards below a rail, wallpaper above it, a border below the ceiling.
    Wall,
    Rug,
    Poster {
        kind: u32,
    },
    Spine,
    Carton,
    Screen,
    Sky,
}

impl Texture {
    fn new(pattern: Pattern, color: [u8; 3], other: [u8; 3], seed: u64) -> Self {
        Self {
            pattern,
            color: linear_color(color),
            other: linear_color(other),
            seed,
            offset: (0.0, 0.0),
            glow: 0.0,
        }
    }

    pub(super) fn plain(color: [u8; 3], seed: u64) -> Self {
        Self::new(Pattern::Plain, color, color, seed)
    }

    pub(super) fn wood(color: [u8; 3], seed: u64) -> Self {
        let dark = color.map(|c| (f64::from(c) * 0.72) as u8);
        Self::new(Pattern::Wood, color, dark, seed)
    }

    pub(super) fn planks(color: [u8; 3], width: f64, length: f64, seed: u64) -> Self {
        let seam = color.map(|c| (f64::from(c) * 0.5) as u8);
        Self::new(Pattern::Planks { width, length }, color, seam, seed)
    }

    pub(super) fn tiles(color: [u8; 3], other: [u8; 3], size: f64, seed: u64) -> Self {
        Self::new(Pattern::Tiles { size }, color, other, seed)
    }

    pub(super) fn stripes(color: [u8; 3], other: [u8; 3], period: f64, seed: u64) -> Self {
        Self::new(Pattern::Stripes { period }, color, other, seed)
    }

    pub(super) fn grid(
        color: [u8; 3],
        other: [u8; 3],
        (period, line): (f64, f64),
        seed: u64,
    ) -> Self {
        Self::new(Pattern::Grid { period, line }, color, other, seed)
    }

    /// `color` is that of the wallpaper, `other` that of the boards.
    pub(super) fn wall(color: [u8; 3], other: [u8; 3], seed: u64) -> Self {
        Self::new(Pattern::Wall, color, other, seed)
    }

    /// The part of the pattern whose lower left corner lies at (u, v).
    pub(super) fn from(self, u: f64, v: f64) -> Self {
        Self {
            offset: (u, v),
            ..self
        }
    }

    pub(super) fn rug(color: [u8; 3], other: [u8; 3], seed: u64) -> Self {
        Self::new(Pattern::Rug, color, other, seed)
    }

    pub(super) fn poster(kind: u32, color: [u8; 3], other: [u8; 3], seed: u64) -> Self {
        Self::new(Pattern::Poster { kind }, color, other, seed)
    }

    pub(super) fn spine(color: [u8; 3], other: [u8; 3], seed: u64) -> Self {
        Self::new(Pattern::Spine, color, other, seed)
    }

    pub(super) fn carton(seed: u64) -> Self {
        Self::new(Pattern::Carton, [188, 146, 98], [214, 186, 138], seed)
    }

    pub(super) fn screen(seed: u64) -> Self {
        Self {
            glow: 0.75,
            ..Self::new(Pattern::Screen, [34, 52, 84], [236, 238, 240], seed)
        }
    }

    pub(super) fn sky(seed: u64) -> Self {
        Self {
            glow: 0.9,
            ..Self::new(Pattern::Sky, [168, 200, 236], [112, 140, 96], seed)
        }
    }

    /// The colour of the surface at (u, v) of a rectangle of the given size.
    pub(super) fn color_at(&self, u: f64, v: f64, size: (f64, f64)) -> Rgb {
        let (u, v) = (u + self.offset.0, v + self.offset.1);
        let color = match self.pattern {
            Pattern::Plain => self.color,
            Pattern::Wood => self.wood_at(u, v, self.seed),
            Pattern::Planks { width, length } => self.planks_at(u, v, width, length),
            Pattern::Tiles { size } => self.tiles_at(u, v, size),
            Pattern::Stripes { period } => {
                if (u / period).rem_euclid(1.0) < 0.5 {
                    self.color
                } else {
                    self.other
                }
            }
            Pattern::Grid { period, line } => {
                let beside = |x: f64| (x / period).rem_euclid(1.0) * period < line;
                if beside(u) || beside(v) {
                    self.other
                } else {
                    self.color
                }
            }
            Pattern::Wall => self.wall_at(u, v),
            Pattern::Rug => self.rug_at(u, v, size),
            Pattern::Poster { kind } => self.poster_at(kind, u, v, size),
            Pattern::Spine => self.spine_at(u / size.0, v / size.1),
            Pattern::Carton => self.carton_at(u, v, size),
            Pattern::Screen => self.screen_at(u / size.0, v / size.1),
            Pattern::Sky => self.sky_at(u, v, size),
        };
        scale(color, 1.0 + 0.035 * mottling(u, v, self.seed))
    }

    fn wood_at(&self, u: f64, v: f64, seed: u64) -> Rgb {
        let bend = 0.02 * value_noise(u * 1.3, v * 4.0, seed ^ 0x51);
        let grain = value_noise(u * 1.5, (v + bend) * 55.0, seed ^ 0x52);
        mix(self.color, self.other, 0.18 + 0.16 * grain)
    }

    fn planks_at(&self, u: f64, v: f64, width: f64, length: f64) -> Rgb {
        let row = (v / width).floor();
        let shifted = u + length * unit_hash(row as i64, 7, self.seed);
        let board = (shifted / length).floor();
        let seam = 0.0022;
        let across = v - row * width;
        let along = shifted - board * length;
        if across < seam || across > width - seam || along < seam || along > length - seam {
            return self.other;
        }
        let tone = unit_hash(row as i64, board as i64, self.seed ^ 0x99);
        let grain = value_noise(shifted * 1.7, v * 45.0, self.seed ^ 0x9a);
        scale(
            mix(self.color, self.other, 0.1 * grain + 0.1),
            0.86 + 0.28 * tone,
        )
    }

    fn tiles_at(&self, u: f64, v: f64, size: f64) -> Rgb {
        let (i, j) = ((u / size).floor(), (v / size).floor());
        if (i + j).rem_euclid(2.0) < 1.0 {
            self.color
        } else {
            self.other
        }
    }

    fn wall_at(&self, u: f64, v: f64) -> Rgb {
        let white = linear_color([238, 236, 230]);
        match v {
            // Boards with grooves.
            v if v < 0.86 => {
                if u.rem_euclid(0.3) < 0.012 {
                    scale(self.other, 0.55)
                } else {
                    self.other
                }
            }
            v if v < 0.93 => white,
            v if v > 2.42 => white,
            v if v > 2.36 => self.other,
            // Stripes of wallpaper: broad ones, each with a narrow one in its middle.
            _ => {
                let phase = u.rem_euclid(0.44);
                if phase < 0.2 || (0.31..0.33).contains(&phase) {
                    scale(self.color, 0.8)
                } else {
                    self.color
                }
            }
        }
    }

    fn rug_at(&self, u: f64, v: f64, (width, height): (f64, f64)) -> Rgb {
        let from_edge = u.min(v).min(width - u).min(height - v);
        let cream = linear_color([232, 220, 196]);
        match from_edge {
            d if d < 0.05 => self.color,
            d if d < 0.075 => cream,
            d if d < 0.14 => self.other,
            d if d < 0.16 => cream,
            _ => {
                // Diamonds within diamonds.
                let cell = 0.3;
                let x = ((u - 0.5 * width) / cell + 0.5).rem_euclid(1.0) - 0.5;
                let y = ((v - 0.5 * height) / cell + 0.5).rem_euclid(1.0) - 0.5;
                match x.abs() + y.abs() {
                    d if d < 0.14 => cream,
                    d if d < 0.3 => self.other,
                    d if d < 0.36 => cream,
                    _ => self.color,
                }
            }
        }
    }

    fn poster_at(&self, kind: u32, u: f64, v: f64, (width, height): (f64, f64)) -> Rgb {
        let paper = linear_color([240, 236, 226]);
        let ink = linear_color([38, 40, 46]);
        let margin = 0.05 * width.min(height);
        if u < margin || v < margin || u > width - margin || v > height - margin {
            return paper;
        }
        let (x, y) = (u / width, v / height);
        match kind % 4 {
            // A sun over hills.
            0 => {
                let sun = (u - 0.62 * width).hypot(v - 0.68 * height) < 0.17 * width;
                let far = y < 0.42 + 0.08 * (x * 7.0).sin();
                let near = y < 0.24 + 0.07 * (x * 5.0 + 2.0).sin();
                match (near, far, sun) {
                    (true, _, _) => ink,
                    (_, true, _) => self.other,
                    (_, _, true) => linear_color([236, 184, 72]),
                    _ => self.color,
                }
            }
            // Blocks and bars, as a painter of rectangles would.
            1 => {
                let bars = [0.3, 0.72].iter().any(|b| (x - b).abs() < 0.018)
                    || [0.25, 0.66].iter().any(|b| (y - b).abs() < 0.014);
                match (bars, x < 0.3, y > 0.66, x > 0.72 && y < 0.25) {
                    (true, ..) => ink,
                    (_, true, true, _) => self.color,
                    (_, false, true, _) if x > 0.72 => linear_color([232, 196, 84]),
                    (_, _, _, true) => self.other,
                    _ => paper,
                }
            }
            // A title, a picture and lines of text.
            2 => {
                let text = |from: f64, to: f64, lines: f64| {
                    y > from && y < to && ((y - from) / (to - from) * lines).fract() < 0.5 && {
                        let line = ((y - from) / (to - from) * lines).floor();
                        x < 0.62 + 0.3 * unit_hash(line as i64, 3, self.seed)
                    }
                };
                if !(0.12..=0.9).contains(&x) {
                    paper
                } else if text(0.1, 0.36, 5.0) || (y > 0.84 && y < 0.91 && x < 0.7) {
                    ink
                } else if y > 0.42 && y < 0.78 {
                    let ring = (u - 0.5 * width).hypot(v - 0.6 * height) / width;
                    if (ring * 14.0).fract() < 0.5 && ring < 0.25 {
                        self.other
                    } else {
                        self.color
                    }
                } else {
                    paper
                }
            }
            // Circles in a grid.
            _ => {
                let cells = 4.0;
                let (i, j) = ((x * cells).floor(), (y * cells).floor());
                let (a, b) = ((x * cells).fract() - 0.5, (y * cells).fract() - 0.5);
                let within = (a * a + b * b).sqrt() < 0.36;
                match (within, unit_hash(i as i64, j as i64, self.seed) < 0.5) {
                    (true, true) => self.other,
                    (true, false) => ink,
                    _ => self.color,
                }
            }
        }
    }

    fn spine_at(&self, x: f64, y: f64) -> Rgb {
        let band = 0.12 + 0.1 * unit_hash(1, 1, self.seed);
        let title = (0.2..0.8).contains(&x) && (0.42..0.82).contains(&y);
        if (y - band).abs() < 0.03 || (y - 0.92).abs() < 0.015 || title && (x - 0.5).abs() < 0.16 {
            self.other
        } else {
            self.color
        }
    }

    fn carton_at(&self, u: f64, v: f64, (width, height): (f64, f64)) -> Rgb {
        let label = u > 0.12 * width && u < 0.46 * width && v > 0.18 * height && v < 0.5 * height;
        if label {
            let line = ((v / height - 0.18) / 0.32 * 6.0).fract() < 0.45;
            return if line && u > 0.16 * width && u < 0.42 * width {
                linear_color([70, 70, 74])
            } else {
                linear_color([236, 234, 228])
            };
        }
        if (u - 0.5 * width).abs() < 0.025 {
            self.other
        } else {
            self.color
        }
    }

    fn screen_at(&self, x: f64, y: f64) -> Rgb {
        let window = |x0: f64, y0: f64, x1: f64, y1: f64| x > x0 && x < x1 && y > y0 && y < y1;
        if y < 0.05 {
            return scale(self.color, 0.4);
        }
        if window(0.08, 0.2, 0.55, 0.88) {
            if y > 0.82 {
                return linear_color([74, 120, 188]);
            }
            let line = (y * 24.0).fract() < 0.45;
            let end = 0.2 + 0.3 * unit_hash((y * 24.0).floor() as i64, 5, self.seed);
            return if line && x > 0.12 && x < end {
                linear_color([88, 92, 100])
            } else {
                self.other
            };
        }
        if window(0.6, 0.45, 0.94, 0.8) {
            let bar = ((x - 0.6) / 0.34 * 7.0).floor();
            let height = 0.48 + 0.28 * unit_hash(bar as i64, 9, self.seed);
            return if y < height && ((x - 0.6) / 0.34 * 7.0).fract() < 0.7 {
                linear_color([226, 140, 66])
            } else {
                linear_color([248, 248, 248])
            };
        }
        self.color
    }

    fn sky_at(&self, u: f64, v: f64, (_, height): (f64, f64)) -> Rgb {
        let hill = 0.3 * height + 0.06 * (u * 4.0).sin() + 0.03 * (u * 11.0 + 1.0).sin();
        if v < hill {
            self.other
        } else {
            let t = ((v - hill) / (height - hill)).clamp(0.0, 1.0);
            mix(linear_color([226, 236, 244]), self.color, t)
        }
    }
}

/// Slow brightness variation with fine structure, about -1 to 1: painted surfaces are never uniform.
fn mottling(u: f64, v: f64, seed: u64) -> f64 {
    0.55 * value_noise(u * 1.9, v * 1.9, seed ^ 0xa1)
        + 0.3 * value_noise(u * 9.0, v * 9.0, seed ^ 0xa2)
        + 0.35 * value_noise(u * 130.0, v * 130.0, seed ^ 0xa3)
}

pub(super) fn scale(color: Rgb, factor: f64) -> Rgb {
    color.map(|c| c * factor)
}

fn mix(a: Rgb, b: Rgb, t: f64) -> Rgb {
    std::array::from_fn(|c| a[c] + t * (b[c] - a[c]))
}

/// A pseudo-random number from 0 to 1.
///
/// # Reference
/// G. Steele, D. Lea, C. Flood, *Fast Splittable Pseudorandom Number Generators*, OOPSLA 2014: the finaliser of SplitMix.
pub(super) fn unit_hash(x: i64, y: i64, seed: u64) -> f64 {
    let mut z = (x as u64)
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add((y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
        .wrapping_add(seed.wrapping_mul(0x1656_67b1_9e37_79f9));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Smooth noise from -1 to 1 with a period of about one.
fn value_noise(x: f64, y: f64, seed: u64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (s, t) = (smooth(x - i), smooth(y - j));
    let at = |di: i64, dj: i64| unit_hash(i as i64 + di, j as i64 + dj, seed);
    let low = at(0, 0) + s * (at(1, 0) - at(0, 0));
    let high = at(0, 1) + s * (at(1, 1) - at(0, 1));
    2.0 * (low + t * (high - low)) - 1.0
}
