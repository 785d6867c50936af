//! A city as a model of points with the views that see them, for tests of scale: rolling ground, blocks of houses on a grid,
//! views from the air and from the streets, points with noise, and a share of wrong ones.
//!
//! It is written as a dense workspace of COLMAP: cameras and images as text, `fused.ply` and `fused.ply.vis`. There are no images.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::write_atomically;
use linecarve_mesh::{TriangleMesh, write_mesh_ply};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::error::SynthError;
use super::files::make_folder;
use super::options::SynthOptionsError;

/// Metres from one block to the next, a street included.
const PERIOD: f64 = 30.0;
/// Width of a block.
const BLOCK: f64 = 20.0;
/// Points on a square metre of the ground plan.
const DENSITY: f64 = 10.0;
/// Height and spacing of the views from the air.
const AIR: [f64; 2] = [80.0, 20.0];
/// Spacing of the views along a street, 2 m above it, and how far they see.
const STREET: [f64; 2] = [10.0, 25.0];
/// Standard deviation of a point.
const NOISE: f64 = 0.03;
/// Share of wrong points.
const WRONG: f64 = 0.02;

/// Largest number of points of a city whose surface is written.
const MOST_POINTS_OF_TRUTH: usize = 20_000_000;

/// What a city is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CityOptions {
    /// Number of points; the city grows with it.
    pub points: usize,
    /// Seed of noise and wrong points.
    pub seed: u64,
    /// Standard deviation of each coordinate of a point.
    pub noise: f64,
    /// Share of wrong points, which lie between a view and where they should be.
    pub wrong: f64,
}

impl CityOptions {
    /// So many points, drawn with this seed.
    pub fn new(points: usize, seed: u64) -> Self {
        Self {
            points,
            seed,
            noise: NOISE,
            wrong: WRONG,
        }
    }
}

/// A city of some side length.
struct City {
    blocks: i64,
    views: Vec<[f64; 3]>,
    /// Views from the air along an axis, and where views from the streets begin.
    air: i64,
}

impl City {
    fn new(points: usize) -> Self {
        let side = (points as f64 / DENSITY).sqrt();
        let blocks = (side / PERIOD).ceil().max(2.0) as i64;
        let side = blocks as f64 * PERIOD;
        let air = (side / AIR[1]).ceil() as i64 + 1;
        let mut views = Vec::new();
        for i in 0..air * air {
            let (x, y) = ((i % air) as f64 * AIR[1], (i / air) as f64 * AIR[1]);
            views.push([x, y, AIR[0]]);
        }
        let mut city = Self { blocks, views, air };
        for street in 0..blocks {
            let middle = street as f64 * PERIOD + 0.5 * (BLOCK + PERIOD);
            for step in 0..(side / STREET[0]) as i64 {
                let along = (step as f64 + 0.5) * STREET[0];
                for [x, y] in [[middle, along], [along, middle]] {
                    city.views.push([x, y, city.ground(x, y) + 2.0]);
                }
            }
        }
        city
    }

    fn ground(&self, x: f64, y: f64) -> f64 {
        3.0 * (0.011 * x).sin() * (0.017 * y).cos()
    }

    fn ground_normal(x: f64, y: f64) -> [f64; 3] {
        let east = 3.0 * 0.011 * (0.011 * x).cos() * (0.017 * y).cos();
        let north = -3.0 * 0.017 * (0.011 * x).sin() * (0.017 * y).sin();
        let length = (1.0 + east * east + north * north).sqrt();
        [-east / length, -north / length, 1.0 / length]
    }

    /// Height of what stands at a place.
    fn height(&self, x: f64, y: f64) -> f64 {
        let (i, j) = ((x / PERIOD).floor(), (y / PERIOD).floor());
        let is_inside = |t: f64| (0.0..self.blocks as f64 * PERIOD).contains(&t);
        let is_block = x - i * PERIOD < BLOCK && y - j * PERIOD < BLOCK;
        match is_block && is_inside(x) && is_inside(y) {
            true => self.roof(i as i64, j as i64),
            false => self.ground(x, y),
        }
    }

    fn roof(&self, i: i64, j: i64) -> f64 {
        let (x, y) = (i as f64 * PERIOD, j as f64 * PERIOD);
        self.ground(x, y) + 8.0 + ((7 * i + 13 * j).rem_euclid(11)) as f64
    }

    /// The surface without noise: ground between the blocks, walls and roofs.
    fn surface(&self) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let mut add = |corners: [[f64; 3]; 4]| {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(corners.map(Point3::from));
            mesh.triangles.push([first, first + 1, first + 2]);
            mesh.triangles.push([first, first + 2, first + 3]);
        };
        let side = (self.blocks as f64 * PERIOD) as i64;
        let is_street = |t: i64| t as f64 % PERIOD >= BLOCK;
        for (x, y) in (0..side).flat_map(|x| (0..side).map(move |y| (x, y))) {
            if is_street(x) || is_street(y) {
                let corner = |dx: i64, dy: i64| {
                    let (x, y) = ((x + dx) as f64, (y + dy) as f64);
                    [x, y, self.ground(x, y)]
                };
                add([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
            }
        }
        for (i, j) in (0..self.blocks).flat_map(|i| (0..self.blocks).map(move |j| (i, j))) {
            let (x, y, roof) = (i as f64 * PERIOD, j as f64 * PERIOD, self.roof(i, j));
            let (right, top) = (x + BLOCK, y + BLOCK);
            add([
                [x, y, roof],
                [right, y, roof],
                [right, top, roof],
                [x, top, roof],
            ]);
            for step in 0..BLOCK as i64 {
                let (near, far) = (step as f64, (step + 1) as f64);
                for [[ax, ay], [bx, by]] in [
                    [[x + near, y], [x + far, y]],
                    [[x + far, top], [x + near, top]],
                    [[x, y + far], [x, y + near]],
                    [[right, y + near], [right, y + far]],
                ] {
                    let (a, b) = (self.ground(ax, ay), self.ground(bx, by));
                    add([[ax, ay, a], [bx, by, b], [bx, by, roof], [ax, ay, roof]]);
                }
            }
        }
        mesh
    }

    /// A point on the surface, and its normal: ground and roofs by their plan, walls by as much again.
    fn surface_point(&self, random: &mut ChaCha8Rng) -> [[f64; 3]; 2] {
        let side = self.blocks as f64 * PERIOD;
        if random.random_range(0.0..1.0) < 0.5 {
            let (x, y) = (
                random.random_range(0.0..side),
                random.random_range(0.0..side),
            );
            let height = self.height(x, y);
            let normal = match height == self.ground(x, y) {
                true => Self::ground_normal(x, y),
                false => [0.0, 0.0, 1.0],
            };
            return [[x, y, height], normal];
        }
        let i = random.random_range(0..self.blocks);
        let j = random.random_range(0..self.blocks);
        let along = random.random_range(0.0..BLOCK);
        let across = [0.0, BLOCK][random.random_range(0..2usize)];
        let outwards = if across == 0.0 { -1.0 } else { 1.0 };
        let (x, y, normal) = match random.random_range(0..2u32) {
            0 => (along, across, [0.0, outwards, 0.0]),
            _ => (across, along, [outwards, 0.0, 0.0]),
        };
        let (x, y) = (i as f64 * PERIOD + x, j as f64 * PERIOD + y);
        let ground = self.ground(x, y);
        [[x, y, random.random_range(ground..self.roof(i, j))], normal]
    }

    /// Whether nothing stands between a view and a point.
    fn is_visible(&self, view: &[f64; 3], point: &[f64; 3]) -> bool {
        /// Places that are looked at on the way.
        const STEPS: u32 = 40;
        (1..STEPS).all(|step| {
            let t = f64::from(step) / f64::from(STEPS);
            let [x, y, z] = std::array::from_fn(|k| point[k] + t * (view[k] - point[k]));
            let near = t * (view[2] - point[2]).abs() < 0.3 && t < 0.1;
            near || self.height(x, y) < z + 0.1
        })
    }

    /// Numbers of the images that see a point: up to four views from the air and up to four from the streets. Each view has five
    /// images: downwards and along the axes.
    fn images(&self, point: &[f64; 3], images: &mut Vec<u32>) {
        images.clear();
        let near = |t: f64| (t / AIR[1]).floor() as i64;
        let around = (-1..3).flat_map(|dy| (-1..3).map(move |dx| (dx, dy)));
        let air = around.filter_map(|(dx, dy)| {
            let (i, j) = (near(point[0]) + dx, near(point[1]) + dy);
            let is_there = (0..self.air).contains(&i) && (0..self.air).contains(&j);
            is_there.then(|| (j * self.air + i) as usize)
        });
        let seen = air.filter(|&view| self.is_visible(&self.views[view], point));
        images.extend(seen.take(4).map(|view| 5 * view as u32));
        let first = (self.air * self.air) as usize;
        let steps = (self.blocks as f64 * PERIOD / STREET[0]) as i64;
        let mut found = 0;
        for axis in 0..2 {
            let (across, along) = (point[axis], point[1 - axis]);
            let street = ((across - 0.5 * (BLOCK + PERIOD)) / PERIOD).round() as i64;
            let at = (along / STREET[0]) as i64;
            for step in at - 2..at + 3 {
                if found == 4 || !(0..self.blocks).contains(&street) || !(0..steps).contains(&step)
                {
                    continue;
                }
                let view = first + ((street * steps + step) * 2) as usize + axis;
                let center = self.views[view];
                let way: [f64; 3] = std::array::from_fn(|k| point[k] - center[k]);
                if way[0].hypot(way[1]) < STREET[1] && self.is_visible(&center, point) {
                    let axis = usize::from(way[1].abs() > way[0].abs());
                    let image = 1 + 2 * axis + usize::from(way[axis] < 0.0);
                    images.push((5 * view + image) as u32);
                    found += 1;
                }
            }
        }
    }
}

/// Rotations `camera from world` of the five images of a view, as `qw qx qy qz`: downwards, along +x, -x, +y, -y.
fn rotations() -> [[f64; 4]; 5] {
    use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
    let looks = [
        -Vector3::z(),
        Vector3::x(),
        -Vector3::x(),
        Vector3::y(),
        -Vector3::y(),
    ];
    looks.map(|forward| {
        let up = if forward.z == 0.0 {
            Vector3::z()
        } else {
            Vector3::y()
        };
        let right = forward.cross(&up);
        let rows = [right.transpose(), -up.transpose(), forward.transpose()];
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows));
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        [q.w, q.i, q.j, q.k]
    })
}

/// Writes the city into a folder, which must be empty or missing: `sparse/cameras.txt`, `sparse/images.txt`, `fused.ply`,
/// `fused.ply.vis`, an empty `sparse/points3D.txt` for COLMAP, and up to 20 million points the surface without noise, `ground-truth.ply`.
/// Returns the number of rays.
///
/// # Errors
/// When there are fewer than a thousand points or more than two billion, or the folder cannot be used.
pub fn write_city(options: &CityOptions, folder: &Path) -> Result<u64, SynthError> {
    if !(1000..=2_000_000_000).contains(&options.points) {
        return Err(SynthError::Options(SynthOptionsError::Range {
            name: "points",
            value: options.points as f64,
            range: "from 1000 to 2e9",
        }));
    }
    make_folder(folder)?;
    make_folder(&folder.join("sparse"))?;
    let city = City::new(options.points);
    write_atomically(&folder.join("sparse/cameras.txt"), |file| {
        writeln!(file, "1 PINHOLE 4000 3000 2500 2500 2000 1500")
    })?;
    write_atomically(&folder.join("sparse/images.txt"), |file| {
        let rotations = rotations();
        for (view, center) in city.views.iter().enumerate() {
            for (image, [w, x, y, z]) in rotations.iter().enumerate() {
                let rotation = nalgebra::Quaternion::new(*w, *x, *y, *z);
                let rotation = nalgebra::UnitQuaternion::new_normalize(rotation);
                let t = -(rotation * nalgebra::Vector3::from(*center));
                let id = 5 * view + image + 1;
                let name = format!("{id:08}.jpg");
                writeln!(
                    file,
                    "{id} {w} {x} {y} {z} {} {} {} 1 {name}\n",
                    t.x, t.y, t.z
                )?;
            }
        }
        Ok(())
    })?;
    write_atomically(&folder.join("sparse/points3D.txt"), |_| Ok(()))?;
    if options.points <= MOST_POINTS_OF_TRUTH {
        write_mesh_ply(&folder.join("ground-truth.ply"), &city.surface())?;
    }
    let mut rays = 0;
    write_atomically(&folder.join("fused.ply"), |points| {
        write!(
            points,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
             property uchar blue\nend_header\n",
            options.points
        )?;
        let seen = write_atomically(&folder.join("fused.ply.vis"), |views| {
            rays = write_points(&city, options, points, views)?;
            Ok(())
        });
        seen.map_err(std::io::Error::other)
    })?;
    Ok(rays)
}

fn write_points(
    city: &City,
    options: &CityOptions,
    points: &mut dyn Write,
    views: &mut dyn Write,
) -> std::io::Result<u64> {
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let mut images = Vec::new();
    let mut rays = 0;
    views.write_all(&(options.points as u64).to_le_bytes())?;
    let mut written = 0;
    while written < options.points {
        let [on_surface, normal] = city.surface_point(&mut random);
        let mut point = on_surface;
        for x in &mut point {
            // The sum of three is near enough to a normal distribution.
            let noise: f64 = (0..3).map(|_| random.random_range(-1.0..1.0)).sum();
            *x += options.noise * noise;
        }
        city.images(&on_surface, &mut images);
        let Some(&first) = images.first() else {
            continue;
        };
        if random.random_range(0.0..1.0) < options.wrong {
            let center = city.views[first as usize / 5];
            let share = random.random_range(0.3..1.0);
            point = std::array::from_fn(|k| center[k] + share * (point[k] - center[k]));
        }
        images.sort_unstable();
        for x in point.into_iter().chain(normal) {
            points.write_all(&(x as f32).to_le_bytes())?;
        }
        points.write_all(&[150, 140, 130])?;
        views.write_all(&(images.len() as u32).to_le_bytes())?;
        for image in &images {
            views.write_all(&image.to_le_bytes())?;
        }
        rays += images.len() as u64;
        written += 1;
    }
    Ok(rays)
}
