//! What rays say about the cells of a tile.
//!
//! What one ray adds to one cell is an integer that depends on these two alone, so a sum may be split among tiles in any way. Small
//! cells are summed by the tile that they belong to, from the rays to its own points and from all others that may meet the cells. Some cells are giants, wider than an eighth of a tile, and crossed by a good part of all rays; each tile adds up what the
//! rays to its own points say about them, and the stage `giants` adds these sums.
//!
//! A ray walks through the tetrahedra of the tile even where these are not those of the whole scene: what it adds there is not
//! looked at.

use linecarve_carving::internals::{RayTracer, TracedRay};
use linecarve_carving::{CellId, Changes, Location};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::blocks::write_blocks;
use crate::bounds::{Bounds, BoxTree, Node};
use crate::error::TilesError;
use crate::file::{Kind, Reader, Writer};
use crate::giants::{self, Giants};
use crate::record::RayRecord;
use crate::stage::{Counts, Item, counts};
use crate::tile::{CellKey, TileCells, Vertex, global, tile_of, traced};
use crate::work::Work;

/// A cell without a sum.
const NO_SUM: u32 = u32::MAX;
/// Own vertices whose cells share a box.
const GROUP: usize = 64;

/// The cells of a tile and their sums.
struct Sums {
    cells: TileCells,
    /// For each cell the number of its sums: small cells, then giants.
    numbers: Vec<u32>,
    small: Vec<CellId>,
    /// Sums of a cell follow each other.
    sums: Vec<u64>,
    width: usize,
    tracer: RayTracer,
    centers: Vec<[f64; 3]>,
    locations: Vec<Option<Location>>,
    /// The latest vertex of another tile, and where it lies.
    latest: Option<(u64, Location)>,
    rays: usize,
}

impl Sums {
    fn new(
        work: &Work,
        tile: usize,
        cells: TileCells,
        giants: &Giants,
    ) -> Result<Self, TilesError> {
        let tetrahedra = &cells.tetrahedra;
        let mut numbers = vec![NO_SUM; tetrahedra.cell_capacity()];
        let mut small = Vec::new();
        let mut large = Vec::new();
        for cell in tetrahedra
            .cells()
            .filter(|&cell| !tetrahedra.is_ghost(cell))
        {
            if work.plan().is_giant(cells.extent(cell)) {
                let giant = cells.key(cell).and_then(|key| giants.number(&key));
                large.extend(giant.map(|giant| (cell, giant)));
            } else if (cells.key(cell)).is_some_and(|key| tile_of(key[0]) == tile) {
                numbers[cell.index()] = small.len() as u32;
                small.push(cell);
            }
        }
        for (cell, giant) in large {
            numbers[cell.index()] = (small.len() + giant) as u32;
        }
        let width = work.plan().sums();
        let centers: Vec<[f64; 3]> = work.open_plan_file("views", Kind::Views)?.records(0)?;
        Ok(Self {
            sums: vec![0; (small.len() + giants.keys.len()) * width],
            tracer: work.plan().carver.labels.tracer(),
            locations: vec![None; centers.len()],
            latest: None,
            rays: 0,
            cells,
            numbers,
            small,
            width,
            centers,
        })
    }

    /// Boxes of the small cells, in the order of the tile's points: of those around a group of points, and of each cell that is wider
    /// than its group.
    fn tree(&self) -> BoxTree {
        let mut groups: Vec<(Bounds, Bounds)> = Vec::new();
        let mut cells: Vec<(usize, Bounds)> = Vec::new();
        let tetrahedra = &self.cells.tetrahedra;
        for &cell in &self.small {
            let own = (tetrahedra.cell_vertices(cell).into_iter())
                .filter(|&vertex| self.cells.is_own(vertex))
                .map(|vertex| (crate::tile::local_of(self.cells.id(vertex)), vertex))
                .min();
            let (Some((local, vertex)), Some(bounds)) = (own, self.cells.bounds(cell)) else {
                continue;
            };
            let group = local / GROUP;
            if groups.len() <= group {
                groups.resize(group + 1, (Bounds::EMPTY, Bounds::EMPTY));
            }
            groups[group].0.add(tetrahedra.coordinates(vertex));
            cells.push((group, bounds));
        }
        let mut wide: Vec<(usize, Bounds)> = Vec::new();
        for (group, bounds) in cells {
            let (points, joined) = &mut groups[group];
            match bounds.extent() <= points.extent() {
                true => *joined = joined.join(&bounds),
                false => wide.push((group, bounds)),
            }
        }
        wide.sort_by_key(|(group, _)| *group);
        let boxes = groups.into_iter().map(|(_, joined)| joined);
        let boxes: Vec<Bounds> = boxes.chain(wide.into_iter().map(|(_, b)| b)).collect();
        BoxTree::new(&boxes)
    }

    /// Adds a ray to small cells, and to giants if it is to a point of the tile.
    fn add(&mut self, ray: &TracedRay, view: u32, target: Location, is_own: bool) {
        let center = self.locate_view(view, &ray.center);
        let Self {
            cells,
            numbers,
            sums,
            ..
        } = self;
        let small = self.small.len();
        let width = self.width;
        let tetrahedra = &cells.tetrahedra;
        self.tracer
            .trace(tetrahedra, ray, [target, center], |cell, sum, amount| {
                let number = numbers[cell.index()];
                if number != NO_SUM && (is_own || (number as usize) < small) {
                    sums[number as usize * width + sum] += amount;
                }
            });
        self.rays += 1;
    }

    fn locate_view(&mut self, view: u32, center: &[f64; 3]) -> Location {
        let slot = &mut self.locations[view as usize];
        *slot.get_or_insert_with(|| {
            let located = self.cells.tetrahedra.locate(&Point3::from(*center), None);
            // Centres were accepted by the carver.
            located.unwrap_or(Location::NoCells)
        })
    }

    /// Where a vertex of another tile lies; it is inserted if it is outside the hull of those that are here.
    fn locate_foreign(
        &mut self,
        vertex: Vertex,
    ) -> Result<Location, linecarve_carving::BatchError> {
        let (id, position) = vertex;
        if let Some((latest, location)) = self.latest
            && latest == id
        {
            return Ok(location);
        }
        let hint = match self.latest {
            Some((_, Location::InCell(cell))) => Some(cell),
            _ => None,
        };
        let tetrahedra = &self.cells.tetrahedra;
        let mut location = match self.cells.vertex(id) {
            Some(vertex) => Location::OnVertex(vertex),
            None => (tetrahedra.locate(&Point3::from(position), hint)).unwrap_or(Location::NoCells),
        };
        if let Location::Outside(_) | Location::NoCells = location {
            let mut changes = Changes::new();
            self.cells.insert(&[vertex], &mut changes)?;
            let capacity = self.cells.tetrahedra.cell_capacity();
            self.numbers.resize(capacity, NO_SUM);
            debug_assert!(
                (changes.destroyed.iter()).all(|cell| self.numbers[cell.index()] == NO_SUM),
                "no point destroys a cell of the whole scene"
            );
            for cell in changes.created {
                self.numbers[cell.index()] = NO_SUM;
            }
            self.locations.fill(None);
            location = self
                .cells
                .vertex(id)
                .map_or(Location::NoCells, Location::OnVertex);
        }
        self.latest = Some((id, location));
        Ok(location)
    }

    /// The sums of a cell, those of facets in the order of the opposite vertices in its key.
    fn of(&self, cell: CellId) -> Vec<u64> {
        let number = self.numbers[cell.index()] as usize;
        let own = &self.sums[number * self.width..(number + 1) * self.width];
        let mut sums = own.to_vec();
        if self.width > 1 {
            for (k, place) in self.cells.places(cell).into_iter().enumerate() {
                sums[k] = own[place];
            }
        }
        sums
    }
}

/// Adds the rays of a block of a file.
fn add_block(
    sums: &mut Sums,
    (reader, section, other): (&Reader, usize, usize),
    tile: usize,
    (tree, stack): (&BoxTree, &mut Vec<Node>),
) -> Result<(), TilesError> {
    let rays: Vec<RayRecord> = reader.records(section)?;
    for ray in rays {
        if ray.view as usize >= sums.centers.len() {
            return Err(TilesError::damaged(reader.path(), "a ray without a view"));
        }
        let id = global(other, ray.vertex as usize);
        let traced = traced(&ray, &sums.centers);
        if other == tile {
            let Some(vertex) = sums.cells.vertex(id) else {
                return Err(TilesError::damaged(reader.path(), "a ray without a point"));
            };
            sums.add(&traced, ray.view, Location::OnVertex(vertex), true);
            continue;
        }
        let end = sums.tracer.anchor(&traced).unwrap_or(traced.target);
        if tree.may_meet([&traced.center, &end], stack) {
            let target = (sums.locate_foreign((id, ray.target)))
                .map_err(|error| TilesError::damaged(reader.path(), error.to_string()))?;
            sums.add(&traced, ray.view, target, false);
        }
    }
    Ok(())
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let tile = item.number;
    let giants = giants::list(work, item)?;
    let is_empty = work.plan().tiles[tile].points == 0;
    let vertices = if is_empty {
        Vec::new()
    } else {
        giants.vertices.clone()
    };
    let cells = TileCells::framed_with(work, item, vertices)?;
    let mut sums = Sums::new(work, tile, cells, &giants)?;
    let tree = sums.tree();
    let mut stack = Vec::new();
    let root = tree.root().map(|root| *tree.bounds(root));
    let mut foreign = 0;
    for other in 0..work.plan().tiles.len() {
        let reader = work.open_tile("rays", other, Kind::Rays)?;
        let boxes: Vec<Bounds> = reader.records(0)?;
        for (block, bounds) in boxes.iter().enumerate() {
            if other == tile || root.is_some_and(|root| root.meets(bounds)) {
                let before = sums.rays;
                let place = (&reader, block + 1, other);
                add_block(&mut sums, place, tile, (&tree, &mut stack))?;
                foreign += if other == tile { 0 } else { sums.rays - before };
            }
        }
    }
    let mut small: Vec<(CellKey, CellId)> = (sums.small.iter())
        .filter_map(|&cell| Some((sums.cells.key(cell)?, cell)))
        .collect();
    small.sort_unstable();
    let keys: Vec<CellKey> = small.iter().map(|(key, _)| *key).collect();
    let mut writer = work.create_result(item)?;
    writer.section(&partial_sums(&sums, &giants))?;
    write_blocks(&mut writer, &keys, |writer, block| {
        writer.section(&keys[block.clone()])?;
        let values = small[block].iter().flat_map(|(_, cell)| sums.of(*cell));
        writer.section(&values.collect::<Vec<u64>>())
    })?;
    let counted = [
        ("cells", small.len()),
        ("rays", sums.rays - foreign),
        ("foreign_rays", foreign),
    ];
    Ok((writer, counts(counted)))
}

/// What the rays to the tile's own points say about giants: for each giant its number and its sums.
fn partial_sums(sums: &Sums, giants: &Giants) -> Vec<u64> {
    let mut found: FxHashMap<u32, CellId> = FxHashMap::default();
    for cell in sums.cells.tetrahedra.cells() {
        let number = sums.numbers[cell.index()];
        if number != NO_SUM && number as usize >= sums.small.len() {
            found.insert(number - sums.small.len() as u32, cell);
        }
    }
    let mut partial = Vec::new();
    for giant in 0..giants.keys.len() as u32 {
        let own = found.get(&giant).map(|&cell| sums.of(cell));
        if let Some(own) = own.filter(|own| own.iter().any(|&sum| sum > 0)) {
            partial.push(u64::from(giant));
            partial.extend(own);
        }
    }
    partial
}
