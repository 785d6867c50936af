//! The plan: which tile owns which points, the options, and the files that all tasks read.

use std::path::Path;

use linecarve_carving::{Carver, CarverOptions, ExportOptions, Labels};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::bounds::Bounds;
use crate::error::TilesError;
use crate::file::Kind;
use crate::record::{RayRecord, Record};
use crate::split::{self, Tile};
use crate::work::{Work, program, write_whole};

/// How a plan is made; nothing of it changes the mesh.
#[derive(Clone, Copy, Debug)]
pub struct PlanOptions {
    /// Number of tiles.
    pub tiles: usize,
    /// Another number splits the points in another way.
    pub seed: u64,
    /// How many cells beyond its own a tile looks at for a cut, counted across facets.
    pub halo: u32,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            tiles: 1,
            seed: 0,
            halo: 8,
        }
    }
}

/// A tile of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileSummary {
    /// Number of its vertices: distinct positions.
    pub vertices: usize,
    /// Number of rays to them.
    pub rays: usize,
}

/// What all tasks know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the program that made it.
    program: String,
    /// Digest of points, views, observations and split.
    input: String,
    /// How the carver labels.
    pub(crate) carver: CarverOptions,
    /// How the mesh is exported.
    pub(crate) export: ExportOptions,
    pub(crate) halo: u32,
    /// Cells with a longer side of their bounding box are giants; without it none are.
    giant_extent: Option<f64>,
    /// The tiles.
    pub tiles: Vec<TileSummary>,
    /// What the caller wants to know again when the mesh is there.
    pub caller: String,
    /// Digest of all the rest.
    pub(crate) sealed: String,
}

impl Plan {
    /// Whether labels are those of a minimum cut.
    pub fn is_cut(&self) -> bool {
        matches!(self.carver.labels, Labels::Cut(_))
    }

    /// Whether a cell with this longest side of its bounding box is a giant.
    pub(crate) fn is_giant(&self, extent: f64) -> bool {
        self.giant_extent.is_some_and(|giant| extent > giant)
    }

    /// Number of sums that a cell has.
    pub(crate) fn sums(&self) -> usize {
        if self.is_cut() { 6 } else { 1 }
    }

    pub(crate) fn seal(&self) -> String {
        let unsealed = Self {
            sealed: String::new(),
            ..self.clone()
        };
        let text = serde_json::to_vec(&unsealed).unwrap_or_default();
        format!("{:016x}", xxh3_64(&text))
    }
}

/// Points, views and rays of a carver, as they go to files.
struct Scene {
    centers: Vec<[f64; 3]>,
    /// Distinct positions.
    positions: Vec<[f64; 3]>,
    /// The rays; `vertex` is the number of a position.
    rays: Vec<RayRecord>,
}

/// Plans what a [deferred](Carver::deferred) carver holds: splits the points into tiles and writes their files to `folder`. The plan
/// itself, `plan.json`, is written last. `caller` is kept with the plan.
///
/// The mesh will be that of [`Carver::mesh`] with these options after [`Carver::carve`].
///
/// # Errors
/// When there are no cells, the carver has segments, the folder holds another plan or a file cannot be written.
pub fn plan(
    folder: &Path,
    carver: &Carver,
    export: &ExportOptions,
    options: &PlanOptions,
    caller: String,
) -> Result<Work, TilesError> {
    if carver.segment_count() > 0 {
        let segments = carver.segment_count();
        return Err(TilesError::Segments { segments });
    }
    let scene = scene(carver)?;
    let basis = split::basis(&scene.positions).ok_or(TilesError::Flat {
        points: scene.positions.len(),
    })?;
    let tiles = split::tiles(&scene.positions, options.tiles.max(1), options.seed);
    let rays = rays_of_tiles(&scene, &tiles);
    let mut plan = Plan {
        program: program(),
        input: digest(&scene, &tiles),
        carver: carver.options(),
        export: *export,
        halo: options.halo,
        giant_extent: giant_extent(&scene, &tiles),
        tiles: (tiles.iter().zip(&rays))
            .map(|(tile, rays)| TileSummary {
                vertices: tile.vertices.len(),
                rays: rays.len(),
            })
            .collect(),
        caller,
        sealed: String::new(),
    };
    plan.sealed = plan.seal();
    let text = serde_json::to_vec_pretty(&plan).unwrap_or_default();
    let path = folder.join("plan.json");
    if let Ok(found) = std::fs::read(&path) {
        return match found == text {
            true => Work::open(folder),
            false => Err(TilesError::Planned {
                path: folder.to_owned(),
            }),
        };
    }
    let work = Work::new(folder, plan, xxh3_64(&text));
    write_scene(&work, &scene, &tiles, &rays, &basis)?;
    write_whole(&path, &text)?;
    Ok(work)
}

fn scene(carver: &Carver) -> Result<Scene, TilesError> {
    let too_many = |what, count: usize| match u32::try_from(count) {
        Ok(u32::MAX) | Err(_) => Err(TilesError::TooMany { what, count }),
        Ok(_) => Ok(()),
    };
    too_many("points", carver.point_count())?;
    too_many("views", carver.view_count())?;
    let points = carver.points();
    let mut located: Vec<([f64; 3], u32)> = points
        .filter_map(|id| Some((carver.point(id)?.into(), id.0)))
        .collect();
    located.sort_unstable_by(|(a, _), (b, _)| split::by_position(a, b));
    let mut positions: Vec<[f64; 3]> = Vec::new();
    let mut vertex_of: FxHashMap<u32, u32> = FxHashMap::default();
    for (position, id) in located {
        if positions.last() != Some(&position) {
            positions.push(position);
        }
        vertex_of.insert(id, positions.len() as u32 - 1);
    }
    let mut view_of: FxHashMap<u32, u32> = FxHashMap::default();
    let mut centers = Vec::new();
    for view in carver.views() {
        view_of.insert(view.0, centers.len() as u32);
        centers.extend(carver.view(view).map(<[f64; 3]>::from));
    }
    let ray =
        |(view, point, weight): (linecarve_carving::ViewId, linecarve_carving::PointId, u32)| {
            let vertex = vertex_of[&point.0];
            RayRecord {
                view: view_of[&view.0],
                vertex,
                weight,
                sigma: carver.sigma(point).unwrap_or(f64::NAN),
                target: positions[vertex as usize],
            }
        };
    let mut rays: Vec<RayRecord> = carver.observations().map(ray).collect();
    // No order of the carver gets into files.
    rays.sort_unstable_by_key(|ray| (ray.vertex, ray.view, ray.weight, ray.sigma.to_bits()));
    Ok(Scene {
        centers,
        positions,
        rays,
    })
}

/// The rays to the vertices of each tile, by increasing vertex.
fn rays_of_tiles(scene: &Scene, tiles: &[Tile]) -> Vec<Vec<RayRecord>> {
    let mut owner = vec![(0u32, 0u32); scene.positions.len()];
    for (number, tile) in (0u32..).zip(tiles) {
        for (local, &vertex) in (0u32..).zip(&tile.vertices) {
            owner[vertex as usize] = (number, local);
        }
    }
    let mut rays = vec![Vec::new(); tiles.len()];
    for ray in &scene.rays {
        let (tile, vertex) = owner[ray.vertex as usize];
        rays[tile as usize].push(RayRecord { vertex, ..*ray });
    }
    for rays in &mut rays {
        rays.sort_by_key(|ray| ray.vertex);
    }
    rays
}

/// Wider cells are giants, as a share of the median of the tiles' longest sides. A larger share has tiles walk more rays of others, a
/// smaller one gives every tile more vertices of giants. Chosen on a generated city in 8 tiles.
const GIANT_SHARE: f64 = 0.125;

/// From which extent on cells are giants; none are in a single tile.
fn giant_extent(scene: &Scene, tiles: &[Tile]) -> Option<f64> {
    if tiles.len() == 1 {
        return None;
    }
    let extent = |tile: &Tile| {
        let positions = tile.vertices.iter().map(|&v| &scene.positions[v as usize]);
        Bounds::of(positions).extent()
    };
    let filled = tiles.iter().filter(|tile| !tile.vertices.is_empty());
    let mut extents: Vec<f64> = filled.map(extent).collect();
    extents.sort_unstable_by(f64::total_cmp);
    let middle = extents.get(extents.len() / 2).copied();
    Some(GIANT_SHARE * middle.unwrap_or(0.0))
}

fn digest(scene: &Scene, tiles: &[Tile]) -> String {
    let mut hash = Xxh3::new();
    let mut bytes = Vec::new();
    scene
        .centers
        .iter()
        .for_each(|center| center.put(&mut bytes));
    scene.rays.iter().for_each(|ray| ray.put(&mut bytes));
    hash.update(&bytes);
    for tile in tiles {
        bytes.clear();
        (tile.vertices.len() as u64).put(&mut bytes);
        for &vertex in &tile.vertices {
            scene.positions[vertex as usize].put(&mut bytes);
        }
        hash.update(&bytes);
    }
    format!("{:016x}", hash.digest())
}

/// Number of rays in a block.
const RAY_BLOCK: usize = 2048;
/// Every so many vertices belong to the sample that each tile begins with.
const SAMPLE_STRIDE: usize = 512;

fn write_scene(
    work: &Work,
    scene: &Scene,
    tiles: &[Tile],
    rays: &[Vec<RayRecord>],
    basis: &[u32; 4],
) -> Result<(), TilesError> {
    let mut views = work.create_plan_file("views", Kind::Views)?;
    views.section(&scene.centers)?;
    views.finish()?;
    let tracer = linecarve_carving::internals::RayTracer::new(&work.plan().carver.labels);
    let mut sample: Vec<(u64, [f64; 3])> = Vec::new();
    for (number, (tile, rays)) in tiles.iter().zip(rays).enumerate() {
        let position = |&vertex: &u32| scene.positions[vertex as usize];
        let mut points =
            work.create_plan_file(&format!("points/{number:06}.tile"), Kind::Points)?;
        let blocks = tile.blocks.iter().map(|block| {
            let vertices = &tile.vertices[block.clone()];
            vertices.iter().map(position).collect::<Vec<_>>()
        });
        let blocks: Vec<Vec<[f64; 3]>> = blocks.collect();
        points.section(&blocks.iter().map(Bounds::of).collect::<Vec<_>>())?;
        blocks.iter().try_for_each(|block| points.section(block))?;
        points.finish()?;
        let mut file = work.create_plan_file(&format!("rays/{number:06}.tile"), Kind::Rays)?;
        let boxes = rays.chunks(RAY_BLOCK).map(|block| {
            let mut bounds = Bounds::EMPTY;
            for ray in block {
                let ray = crate::tile::traced(ray, &scene.centers);
                bounds.add(&ray.center);
                bounds.add(&ray.target);
                bounds.add(&tracer.anchor(&ray).unwrap_or(ray.target));
            }
            bounds
        });
        file.section(&boxes.collect::<Vec<Bounds>>())?;
        (rays.chunks(RAY_BLOCK)).try_for_each(|block| file.section(block))?;
        file.finish()?;
        let chosen = (0..tile.vertices.len()).filter(|&local| {
            local % SAMPLE_STRIDE == 0
                || tile.extremes.contains(&local)
                || basis.contains(&tile.vertices[local])
        });
        sample.extend(chosen.map(|local| {
            let id = crate::tile::global(number, local);
            (id, position(&tile.vertices[local]))
        }));
    }
    let mut file = work.create_plan_file("sample", Kind::Sample)?;
    let (ids, positions): (Vec<u64>, Vec<[f64; 3]>) = sample.into_iter().unzip();
    file.section(&ids)?;
    file.section(&positions)?;
    file.finish().map(drop)
}
