//! Points into the files of a plan, in memory that does not grow with their number.
//!
//! Points are first written to a file as they come, with a sample of positions and a digest kept. The sample decides which tile owns which
//! part of space. A second pass writes each point to a file of its tile, and a third, tile by tile, sorts these into the files of
//! the plan.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use linecarve_carving::internals::RayTracer;
use linecarve_carving::{CarverOptions, ExportOptions, accept_position};
use nalgebra::Point3;
use tempfile::TempDir;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::bounds::Bounds;
use crate::error::TilesError;
use crate::file::{Kind, UNFINISHED, write_whole};
use crate::plan::{Plan, PlanOptions, TileSummary};
use crate::record::{RayRecord, Record};
use crate::split::{self, Basis, Numbering, Territory};
use crate::tile::{Vertex, global, traced};
use crate::work::Work;

/// A point and the views that see it.
#[derive(Clone, Copy, Debug)]
pub struct SeenPoint<'a> {
    /// Where it is.
    pub position: [f64; 3],
    /// Standard deviation along the rays, if known, as [`Transaction::set_sigma`](linecarve_carving::Transaction::set_sigma).
    pub sigma: Option<f64>,
    /// Numbers of views, each with the weight of the ray.
    pub rays: &'a [[u32; 2]],
}

/// Position, standard deviation and number of rays of a point in a file; the rays follow.
const POINT_BYTES: usize = 36;
const RAY_BYTES: usize = 8;
/// Bytes that all tiles together hold back before they write them to their files.
const BUFFERED: usize = 64 << 20;

/// Takes the points of a plan one by one.
///
/// # Complexity
/// Memory holds the views, a sample of at most [`PlanOptions::sample`] positions, and the points of one tile.
pub struct Planner {
    folder: PathBuf,
    scratch: TempDir,
    /// Dropped after `scratch`.
    _made: MadeFolder,
    spill: BufWriter<File>,
    centers: Vec<[f64; 3]>,
    options: PlanOptions,
    sample: Sample,
    basis: Basis,
    points: u64,
    /// Sum of the digests of all points, so their order is of no influence.
    digest: u64,
    record: Vec<u8>,
}

/// A folder that did not exist before; removed again if nothing was left in it.
struct MadeFolder(Option<PathBuf>);

impl Drop for MadeFolder {
    fn drop(&mut self) {
        // Fails where a plan is.
        let _ = self.0.take().map(std::fs::remove_dir);
    }
}

/// Distinct positions chosen by their digests.
struct Sample {
    positions: Vec<[f64; 3]>,
    most: usize,
    /// Digests of chosen positions end in so many zeros.
    zeros: u32,
}

impl Sample {
    fn takes(&self, position: &[f64; 3]) -> bool {
        let mut bytes = Vec::with_capacity(24);
        position.put(&mut bytes);
        xxh3_64(&bytes).trailing_zeros() >= self.zeros
    }

    fn add(&mut self, position: &[f64; 3]) {
        if self.takes(position) {
            self.positions.push(*position);
            if self.positions.len() > self.most {
                self.settle();
            }
        }
    }

    /// Sorts, and makes room.
    fn settle(&mut self) {
        loop {
            let positions = &mut self.positions;
            positions.sort_unstable_by(split::by_position);
            positions.dedup();
            if positions.len() <= self.most / 2 {
                return;
            }
            self.zeros += 1;
            let mut positions = std::mem::take(&mut self.positions);
            positions.retain(|position| self.takes(position));
            self.positions = positions;
        }
    }
}

impl Planner {
    /// Begins a plan in a folder, which is made when missing, for points that these views see.
    ///
    /// # Errors
    /// When a centre is not finite or out of range, or the folder cannot be written.
    pub fn new(
        folder: &Path,
        centers: &[[f64; 3]],
        options: PlanOptions,
    ) -> Result<Self, TilesError> {
        let mut accepted = Vec::with_capacity(centers.len());
        for (view, center) in centers.iter().enumerate() {
            let center = accept_position(&Point3::from(*center));
            accepted.push(center.map_err(|source| TilesError::View { view, source })?);
        }
        too_many("views", accepted.len())?;
        let made = MadeFolder((!folder.exists()).then(|| folder.to_owned()));
        std::fs::create_dir_all(folder).map_err(TilesError::io(folder))?;
        let scratch = tempfile::Builder::new()
            .prefix(UNFINISHED)
            .tempdir_in(folder)
            .map_err(TilesError::io(folder))?;
        let path = scratch.path().join("points");
        let spill = File::create(&path).map_err(TilesError::io(&path))?;
        Ok(Self {
            folder: folder.to_owned(),
            spill: BufWriter::with_capacity(1 << 20, spill),
            scratch,
            _made: made,
            centers: accepted,
            sample: Sample {
                positions: Vec::new(),
                most: options.sample.max(16),
                zeros: 0,
            },
            options,
            basis: Basis::default(),
            points: 0,
            digest: 0,
            record: Vec::new(),
        })
    }

    /// Number of points so far.
    pub fn point_count(&self) -> u64 {
        self.points
    }

    /// The number of tiles, in place of that of the options.
    pub fn set_tiles(&mut self, tiles: usize) {
        self.options.tiles = tiles;
    }

    /// Keeps what [`merged_surface`](crate::merged_surface) needs.
    pub fn keep_neighbors(&mut self) {
        self.options.keeps_neighbors = true;
    }

    /// Adds a point.
    ///
    /// # Errors
    /// When the position is not finite or out of range, a view is unknown, or the disk is full.
    pub fn add(&mut self, point: SeenPoint<'_>) -> Result<(), TilesError> {
        let number = self.points;
        let position =
            accept_position(&Point3::from(point.position)).map_err(|source| TilesError::Point {
                point: number,
                source,
            })?;
        let unknown = |[view, _]: &&[u32; 2]| *view as usize >= self.centers.len();
        if let Some([view, _]) = point.rays.iter().find(unknown) {
            return Err(TilesError::UnknownView {
                point: number,
                view: *view,
                views: self.centers.len(),
            });
        }
        self.record.clear();
        position.put(&mut self.record);
        point.sigma.unwrap_or(f64::NAN).put(&mut self.record);
        (point.rays.len() as u32).put(&mut self.record);
        point.rays.iter().for_each(|ray| ray.put(&mut self.record));
        let path = self.scratch.path().join("points");
        (self.spill.write_all(&self.record)).map_err(TilesError::io(&path))?;
        self.digest = self.digest.wrapping_add(xxh3_64(&self.record));
        self.sample.add(&position);
        self.basis.add(&position);
        self.points += 1;
        Ok(())
    }

    /// Splits the points into tiles and writes their files; the plan itself, `plan.json`, is written last. `caller` is kept with the
    /// plan.
    ///
    /// The mesh will be that of [`Carver::mesh`](linecarve_carving::Carver::mesh) with these options for these points and views.
    ///
    /// # Errors
    /// When there are no cells, the folder holds another plan or a file cannot be written.
    pub fn finish(
        mut self,
        carver: CarverOptions,
        export: ExportOptions,
        caller: String,
    ) -> Result<Work, TilesError> {
        let path = self.scratch.path().join("points");
        self.spill.flush().map_err(TilesError::io(&path))?;
        self.sample.positions.sort_unstable_by(split::by_position);
        self.sample.positions.dedup();
        if !self.basis.is_complete() {
            let points = self.sample.positions.len();
            return Err(TilesError::Flat { points });
        }
        let options = self.options;
        let count = options.tiles.max(1);
        let territory = Territory::new(&self.sample.positions, count, options.seed);
        self.sample.positions = Vec::new();
        let scattered = self.scatter(&territory, count)?;
        for tile in &scattered {
            too_many("points of a tile", tile.summary.points)?;
        }
        let extents = scattered.iter().filter(|tile| !tile.bounds.is_empty());
        let extents = extents.map(|tile| tile.bounds.extent()).collect();
        let tiles: Vec<TileSummary> = scattered.into_iter().map(|tile| tile.summary).collect();
        let input = self.input(&territory);
        let how = (options.halo, options.keeps_neighbors);
        let plan = Plan::new(input, carver, export, how, extents, tiles, caller);
        let text = serde_json::to_vec_pretty(&plan).unwrap_or_default();
        let path = self.folder.join("plan.json");
        match Work::open(&self.folder) {
            // What is damaged is made anew.
            Err(TilesError::NoPlan { .. } | TilesError::DamagedPlan { .. }) => {}
            Ok(work) if work.is(&text) => match work.verify_plan() {
                Err(TilesError::DamagedPlan { .. } | TilesError::OtherPlan { .. }) => {}
                verified => return verified.map(|()| work),
            },
            _ => return Err(TilesError::Planned { path: self.folder }),
        }
        let work = Work::new(&self.folder, plan, xxh3_64(&text));
        self.gather(&work)?;
        write_whole(&path, &text)?;
        Ok(work)
    }

    /// Digest of points, views, observations and split.
    fn input(&self, territory: &Territory) -> String {
        let mut bytes = Vec::new();
        [self.points, self.digest].put(&mut bytes);
        (self.centers.iter()).for_each(|center| center.put(&mut bytes));
        territory.put(&mut bytes);
        let mut hash = Xxh3::new();
        hash.update(&bytes);
        format!("{:016x}", hash.digest())
    }

    fn tile_path(&self, tile: usize) -> PathBuf {
        self.scratch.path().join(format!("{tile:06}"))
    }

    /// Writes each point to the file of its tile.
    fn scatter(&self, territory: &Territory, count: usize) -> Result<Vec<Scattered>, TilesError> {
        let path = self.scratch.path().join("points");
        let file = File::open(&path).map_err(TilesError::io(&path))?;
        let mut reader = BufReader::with_capacity(1 << 20, file);
        let mut tiles: Vec<Scattered> = (0..count).map(|_| Scattered::default()).collect();
        let most = (BUFFERED / count).clamp(1 << 10, 1 << 20);
        let mut head = [0; POINT_BYTES];
        for _ in 0..self.points {
            reader
                .read_exact(&mut head)
                .map_err(TilesError::io(&path))?;
            let position = <[f64; 3]>::get(&head);
            let rays = u32::get(&head[32..]) as usize;
            let number = territory.tile(&position);
            let tile = &mut tiles[number];
            tile.buffer.extend_from_slice(&head);
            let start = tile.buffer.len();
            tile.buffer.resize(start + rays * RAY_BYTES, 0);
            (reader.read_exact(&mut tile.buffer[start..])).map_err(TilesError::io(&path))?;
            tile.bounds.add(&position);
            tile.summary.points += 1;
            tile.summary.rays += rays;
            if tile.buffer.len() >= most {
                self.flush(number, tile)?;
            }
        }
        for (number, tile) in tiles.iter_mut().enumerate() {
            self.flush(number, tile)?;
        }
        // All is in the files of the tiles now.
        std::fs::remove_file(&path).map_err(TilesError::io(&path))?;
        Ok(tiles)
    }

    /// Files are opened for each part: a plan may have more tiles than a process may have files open.
    fn flush(&self, number: usize, tile: &mut Scattered) -> Result<(), TilesError> {
        let path = self.tile_path(number);
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let written = file.and_then(|mut file| file.write_all(&tile.buffer));
        written.map_err(TilesError::io(&path))?;
        tile.buffer.clear();
        Ok(())
    }

    /// Writes the files of the plan from those of the tiles.
    fn gather(&self, work: &Work) -> Result<(), TilesError> {
        let mut views = work.create_plan_file("views", Kind::Views)?;
        views.section(&self.centers)?;
        views.finish()?;
        let tracer = work.plan().carver.labels.tracer();
        let mut sample: Vec<Vertex> = Vec::new();
        for tile in 0..work.plan().tiles.len() {
            let path = self.tile_path(tile);
            let bytes = std::fs::read(&path).map_err(TilesError::io(&path))?;
            let (positions, rays) = sorted(&bytes);
            drop(bytes);
            let numbering = split::number(&positions);
            let points = (&positions[..], &numbering);
            write_tile(work, tile, points, rays, (&self.centers, &tracer))?;
            std::fs::remove_file(&path).map_err(TilesError::io(&path))?;
            let chosen = numbering
                .order
                .iter()
                .enumerate()
                .filter(|(local, vertex)| {
                    local % SAMPLE_STRIDE == 0
                        || numbering.extremes.contains(local)
                        || self.basis.contains(&positions[**vertex as usize])
                });
            sample.extend(
                chosen.map(|(local, vertex)| (global(tile, local), positions[*vertex as usize])),
            );
        }
        let mut file = work.create_plan_file("sample", Kind::Sample)?;
        let (ids, positions): (Vec<u64>, Vec<[f64; 3]>) = sample.into_iter().unzip();
        file.section(&ids)?;
        file.section(&positions)?;
        file.finish().map(drop)
    }
}

/// What the second pass finds of a tile.
struct Scattered {
    summary: TileSummary,
    bounds: Bounds,
    buffer: Vec<u8>,
}

impl Default for Scattered {
    fn default() -> Self {
        Self {
            summary: TileSummary { points: 0, rays: 0 },
            bounds: Bounds::EMPTY,
            buffer: Vec::new(),
        }
    }
}

fn too_many(what: &'static str, count: usize) -> Result<(), TilesError> {
    match u32::try_from(count) {
        Ok(u32::MAX) | Err(_) => Err(TilesError::TooMany { what, count }),
        Ok(_) => Ok(()),
    }
}

/// The distinct positions of a tile in order, and its rays; `vertex` of these is the number of a position.
fn sorted(bytes: &[u8]) -> (Vec<[f64; 3]>, Vec<RayRecord>) {
    let mut points: Vec<([f64; 3], usize)> = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        points.push((<[f64; 3]>::get(&bytes[at..]), at));
        at += POINT_BYTES + u32::get(&bytes[at + 32..]) as usize * RAY_BYTES;
    }
    points.sort_unstable_by(|(a, _), (b, _)| split::by_position(a, b));
    let mut positions: Vec<[f64; 3]> = Vec::new();
    let mut rays = Vec::new();
    for (position, at) in points {
        if positions.last() != Some(&position) {
            positions.push(position);
        }
        let sigma = f64::get(&bytes[at + 24..]);
        let count = u32::get(&bytes[at + 32..]) as usize;
        let first = at + POINT_BYTES;
        let own = bytes[first..first + count * RAY_BYTES].chunks_exact(RAY_BYTES);
        let weights = own.clone().map(|ray| <[u32; 2]>::get(ray)[1]);
        let support = weights.fold(0, u32::saturating_add);
        for ray in own {
            let [view, weight] = <[u32; 2]>::get(ray);
            rays.push(RayRecord {
                view,
                vertex: positions.len() as u32 - 1,
                weight,
                support,
                sigma,
                target: position,
            });
        }
    }
    (positions, rays)
}

/// Number of rays in a block.
const RAY_BLOCK: usize = 2048;
/// Every so many vertices belong to the sample that each tile begins with.
const SAMPLE_STRIDE: usize = 512;

fn write_tile(
    work: &Work,
    tile: usize,
    (positions, numbering): (&[[f64; 3]], &Numbering),
    mut rays: Vec<RayRecord>,
    (centers, tracer): (&[[f64; 3]], &RayTracer),
) -> Result<(), TilesError> {
    let mut points = work.create_plan_file(&format!("points/{tile:06}.tile"), Kind::Points)?;
    let block = |block: &std::ops::Range<usize>| {
        let vertices = numbering.order[block.clone()].iter();
        vertices.map(|&v| positions[v as usize]).collect()
    };
    let blocks: Vec<Vec<[f64; 3]>> = numbering.blocks.iter().map(block).collect();
    points.section(&blocks.iter().map(Bounds::of).collect::<Vec<_>>())?;
    blocks.iter().try_for_each(|block| points.section(block))?;
    points.finish()?;
    let mut local = vec![0u32; positions.len()];
    for (number, &vertex) in (0u32..).zip(&numbering.order) {
        local[vertex as usize] = number;
    }
    for ray in &mut rays {
        ray.vertex = local[ray.vertex as usize];
    }
    // No order of the input gets into files.
    rays.sort_unstable_by_key(|ray| (ray.vertex, ray.view, ray.weight, ray.sigma.to_bits()));
    let mut file = work.create_plan_file(&format!("rays/{tile:06}.tile"), Kind::Rays)?;
    let boxes = rays.chunks(RAY_BLOCK).map(|block| {
        let mut bounds = Bounds::EMPTY;
        for ray in block {
            let ray = traced(ray, centers);
            bounds.add(&ray.center);
            bounds.add(&ray.target);
            bounds.add(&tracer.anchor(&ray).unwrap_or(ray.target));
        }
        bounds
    });
    file.section(&boxes.collect::<Vec<Bounds>>())?;
    (rays.chunks(RAY_BLOCK)).try_for_each(|block| file.section(block))?;
    file.finish().map(drop)
}
