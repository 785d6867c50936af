//! The labels that no tile could prove, found with all others fixed.
//!
//! With the proved cells fixed, the smallest minimum cut of the others is the smallest minimum cut of all, restricted to them. Components
//! of these cells do not know each other, so they are solved a few at a time: memory holds some 20 bytes for each undecided
//! cell, and the network of the largest component or of [`BATCH`] cells.

use linecarve_carving::internals::flow::{Network, NodeId};

use crate::error::TilesError;
use crate::file::Writer;
use crate::label::{FREE, OCCUPIED, UNDECIDED, proved};
use crate::network::{Cells, ELSEWHERE, across};
use crate::stage::{Counts, Item, counts};
use crate::tile::CellKey;
use crate::work::Work;

/// Most cells that are solved together, unless a component has more.
const BATCH: usize = 1 << 20;

/// All undecided cells, tile after tile.
struct Undecided {
    /// Where those of each tile begin, and the end.
    first: Vec<usize>,
    /// Numbers in the tile, increasing in each.
    numbers: Vec<u32>,
}

impl Undecided {
    fn read(work: &Work, item: Item) -> Result<Self, TilesError> {
        let mut found = Self {
            first: vec![0],
            numbers: Vec::new(),
        };
        for tile in 0..work.plan().tiles.len() {
            let labels = proved(work, tile, item)?;
            let labels = (0u32..).zip(labels);
            let undecided = labels.filter(|(_, label)| *label == UNDECIDED);
            found.numbers.extend(undecided.map(|(number, _)| number));
            found.first.push(found.numbers.len());
        }
        Ok(found)
    }

    fn tiles(&self) -> usize {
        self.first.len() - 1
    }

    fn of_tile(&self, tile: usize) -> &[u32] {
        &self.numbers[self.first[tile]..self.first[tile + 1]]
    }

    /// The cell with a number in a tile, if it is undecided.
    fn cell(&self, tile: usize, number: u32) -> Option<u32> {
        let found = self.of_tile(tile).binary_search(&number).ok()?;
        Some((self.first[tile] + found) as u32)
    }

    /// Passes the undecided cells of a tile that are `wanted` to `take`: the cell, the network around it, and its number there.
    fn visit(
        &self,
        work: &Work,
        (tile, item): (usize, Item),
        wanted: impl Fn(usize) -> bool,
        mut take: impl FnMut(usize, &Cells, usize),
    ) -> Result<(), TilesError> {
        let numbers = self.of_tile(tile);
        let first = self.first[tile];
        let cells = |range: std::ops::Range<usize>| {
            let from = numbers.partition_point(|&number| (number as usize) < range.start);
            let to = numbers.partition_point(|&number| (number as usize) < range.end);
            (from..to).filter(|&at| wanted(first + at))
        };
        Cells::visit(
            work,
            (tile, item),
            |range| cells(range).next().is_some(),
            |start, network| {
                for at in cells(start..start + network.keys.len()) {
                    take(first + at, network, numbers[at] as usize - start);
                }
            },
        )
    }
}

/// What is across a facet that leads to another tile.
#[derive(Clone, Copy)]
enum Beyond {
    /// An undecided cell, and its facet back.
    Cell(u32, u8),
    /// A cell with a proved label.
    Proved(bool),
}

/// Facets of undecided cells that lead to other tiles; sorted.
struct Borders(Vec<((u32, u8), Beyond)>);

impl Borders {
    /// `facets` are cells across, and the cells and facets that lead there.
    fn resolve(
        work: &Work,
        item: Item,
        undecided: &Undecided,
        mut facets: Vec<(CellKey, u32, u8, u8)>,
    ) -> Result<Self, TilesError> {
        facets.sort_unstable();
        let mut keys: Vec<CellKey> = facets.iter().map(|facet| facet.0).collect();
        keys.dedup();
        let count = facets.len();
        let mut found = Vec::with_capacity(count);
        let mut facets = facets.into_iter().peekable();
        let mut of_tile: (usize, Vec<u8>) = (usize::MAX, Vec::new());
        for (key, tile, number) in Cells::numbers(work, item, &keys)? {
            if of_tile.0 != tile {
                of_tile = (tile, proved(work, tile, item)?);
            }
            let cell = undecided.cell(tile, number as u32);
            let is_free = of_tile.1.get(number) == Some(&FREE);
            while facets.next_if(|facet| facet.0 < key).is_some() {}
            while let Some((_, own, facet, back)) = facets.next_if(|facet| facet.0 == key) {
                let beyond = match cell {
                    Some(cell) => Beyond::Cell(cell, back),
                    None => Beyond::Proved(is_free),
                };
                found.push(((own, facet), beyond));
            }
        }
        if found.len() < count {
            let what = "a cell beside an undecided one is in no network";
            return Err(TilesError::damaged(work.folder(), what));
        }
        found.sort_unstable_by_key(|(facet, _)| *facet);
        Ok(Self(found))
    }

    fn get(&self, cell: u32, facet: u8) -> Option<Beyond> {
        let found = self.0.binary_search_by_key(&(cell, facet), |(at, _)| *at);
        found.ok().map(|found| self.0[found].1)
    }
}

/// The component of each undecided cell, by its smallest cell.
struct Components(Vec<u32>);

impl Components {
    fn find(&mut self, mut cell: u32) -> u32 {
        while self.0[cell as usize] != cell {
            let parent = self.0[cell as usize];
            self.0[cell as usize] = self.0[parent as usize];
            cell = parent;
        }
        cell
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// For each cell the number of its batch; the number of batches, of components, and the size of the largest.
    fn batches(mut self, most: usize) -> (Vec<u32>, [usize; 3]) {
        let cells = 0..self.0.len() as u32;
        let roots: Vec<u32> = cells.map(|cell| self.find(cell)).collect();
        let mut sizes = self.0;
        sizes.fill(0);
        for &root in &roots {
            sizes[root as usize] += 1;
        }
        let largest = sizes.iter().copied().max().unwrap_or(0) as usize;
        let components = sizes.iter().filter(|&&size| size > 0).count();
        let (mut batch, mut filled) = (0u32, 0usize);
        for size in sizes.iter_mut().filter(|size| **size > 0) {
            if filled > 0 && filled + *size as usize > most {
                (batch, filled) = (batch + 1, 0);
            }
            filled += *size as usize;
            *size = batch;
        }
        let batches = if filled > 0 { batch as usize + 1 } else { 0 };
        let of = roots.iter().map(|&root| sizes[root as usize]).collect();
        (of, [batches, components, largest])
    }
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let (undecided, labels, [batches, components, largest]) = settle(work, item, BATCH)?;
    let mut writer = work.create_result(item)?;
    for ends in undecided.first.windows(2) {
        writer.section(&labels[ends[0]..ends[1]])?;
    }
    let free = labels.iter().filter(|&&label| label == FREE).count();
    let counted = [
        ("settled", labels.len()),
        ("free", free),
        ("components", components),
        ("largest", largest),
        ("batches", batches),
    ];
    Ok((writer, counts(counted)))
}

/// The labels of all undecided cells; the numbers of batches and components, and the size of the largest component.
fn settle(
    work: &Work,
    item: Item,
    most: usize,
) -> Result<(Undecided, Vec<u8>, [usize; 3]), TilesError> {
    let undecided = Undecided::read(work, item)?;
    let count = undecided.numbers.len();
    let mut components = Components((0..count as u32).collect());
    let mut facets = Vec::new();
    for tile in 0..undecided.tiles() {
        let take = |cell: usize, network: &Cells, at: usize| {
            for facet in 0..4 {
                let inside = network.inside[at][facet];
                if inside == ELSEWHERE {
                    let other = across(&network.keys[at], facet, network.apexes[at][facet]);
                    let other =
                        other.map(|(key, back)| (key, cell as u32, facet as u8, back as u8));
                    facets.extend(other);
                } else if let Some(other) = undecided.cell(tile, inside / 4) {
                    components.unite(cell as u32, other);
                }
            }
        };
        undecided.visit(work, (tile, item), |_| true, take)?;
    }
    let borders = Borders::resolve(work, item, &undecided, facets)?;
    for &((cell, _), beyond) in &borders.0 {
        if let Beyond::Cell(other, _) = beyond {
            components.unite(cell, other);
        }
    }
    let (batch_of, numbers) = components.batches(most);
    let mut labels = vec![OCCUPIED; count];
    // The number of each cell in its batch.
    let mut nodes = vec![0u32; count];
    let mut sizes = vec![0u32; numbers[0]];
    for (node, &batch) in nodes.iter_mut().zip(&batch_of) {
        *node = sizes[batch as usize];
        sizes[batch as usize] += 1;
    }
    for (batch, &size) in (0u32..).zip(&sizes) {
        let network = network(work, item, &undecided, &borders, (&nodes, size), |cell| {
            batch_of[cell] == batch
        })?;
        for (cell, label) in labels.iter_mut().enumerate() {
            if batch_of[cell] == batch && network.is_source_side(NodeId(nodes[cell])) {
                *label = FREE;
            }
        }
    }
    Ok((undecided, labels, numbers))
}

/// The solved network of some cells.
fn network(
    work: &Work,
    item: Item,
    undecided: &Undecided,
    borders: &Borders,
    (nodes, size): (&[u32], u32),
    is_wanted: impl Fn(usize) -> bool,
) -> Result<Network, TilesError> {
    let mut network = Network::new();
    network.grow(size as usize);
    // Capacities follow once all nodes are joined.
    let mut arcs: Vec<(i64, [i64; 4])> = vec![(0, [0; 4]); size as usize];
    for tile in 0..undecided.tiles() {
        let own = undecided.first[tile]..undecided.first[tile + 1];
        if !own.into_iter().any(&is_wanted) {
            continue;
        }
        let proved = proved(work, tile, item)?;
        let take = |cell: usize, cells: &Cells, at: usize| {
            let node = NodeId(nodes[cell]);
            let mut terminal = cells.terminals[at];
            for facet in 0..4 {
                let inside = cells.inside[at][facet];
                let beyond = if inside == ELSEWHERE {
                    borders.get(cell as u32, facet as u8)
                } else {
                    let number = inside / 4;
                    Some(match undecided.cell(tile, number) {
                        Some(other) => Beyond::Cell(other, (inside % 4) as u8),
                        None => Beyond::Proved(proved.get(number as usize) == Some(&FREE)),
                    })
                };
                match beyond {
                    None => (),
                    Some(Beyond::Cell(other, back)) => {
                        let other = NodeId(nodes[other as usize]);
                        network.join(node, facet, other, back.into());
                    }
                    Some(Beyond::Proved(true)) => terminal += cells.into[at][facet],
                    Some(Beyond::Proved(false)) => terminal -= cells.out[at][facet],
                }
            }
            arcs[node.0 as usize] = (terminal, cells.out[at]);
        };
        undecided.visit(work, (tile, item), &is_wanted, take)?;
    }
    for (node, (terminal, out)) in (0u32..).zip(arcs) {
        for (facet, capacity) in out.into_iter().enumerate() {
            network.set_capacity(NodeId(node), facet, capacity);
        }
        network.set_terminal(NodeId(node), terminal);
    }
    network.maximize();
    Ok(network)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test ends where anything fails")]
    use super::*;
    use crate::plan::PlanOptions;
    use crate::plan_carver::plan;
    use crate::run::run;
    use crate::run_item::run_item;
    use crate::stage::Stage;
    use linecarve_carving::{Carver, CarverOptions, CutOptions, Hull, Labels};
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn components_may_be_solved_one_by_one() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut carver = Carver::deferred(CarverOptions::new(
            Labels::Cut(CutOptions::default()),
            Hull::Drop,
        ));
        let mut transaction = carver.transaction();
        // A rough terrain seen from above, with holes in what is seen.
        let mut random = |side: f64| random.random_range(0.0..side);
        let views: Vec<_> = (0..10)
            .map(|_| transaction.add_view(Point3::new(random(40.0), random(40.0), 25.0)))
            .map(Result::unwrap)
            .collect();
        for number in 0..2000 {
            let (x, y) = (random(40.0), random(40.0));
            let z = (0.4 * x).sin() * (0.3 * y).cos() - random(0.5);
            let point = transaction.add_point(Point3::new(x, y, z)).unwrap();
            if number % 3 > 0 {
                let view = views[number % views.len()];
                transaction.add_observation(view, point, 1).unwrap();
            }
        }
        transaction.commit().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let options = PlanOptions {
            tiles: 3,
            halo: 60,
            ..PlanOptions::default()
        };
        let export = Default::default();
        let work = plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
        run(&work, 1, |item| run_item(&work, item, || None)).unwrap();
        let item = work.items(Stage::Settle).next().unwrap();
        // Some of the proved labels are forgotten, so that there are many components.
        let mut before: Vec<u8> = Vec::new();
        for tile in work.items(Stage::Label) {
            let mut labels = proved(&work, tile.number, item).unwrap();
            for label in labels.iter_mut().step_by(4) {
                if *label != UNDECIDED {
                    before.push(*label);
                    *label = UNDECIDED + 1;
                }
            }
            let mut forgotten = Vec::new();
            for label in &mut labels {
                if *label >= UNDECIDED {
                    forgotten.push(*label > UNDECIDED);
                    *label = UNDECIDED;
                }
            }
            // A mark for each undecided cell: whether its label was forgotten.
            before.extend(forgotten.iter().map(|&is| 10 + u8::from(is)));
            let mut writer = work.create_result(tile).unwrap();
            writer.section(&labels).unwrap();
            work.finish(tile, writer, (Vec::new(), 0.0, None)).unwrap();
        }
        let (labels_before, marks): (Vec<u8>, Vec<u8>) = before.into_iter().partition(|&l| l < 10);
        let (_, whole, [one, components, largest]) = settle(&work, item, usize::MAX).unwrap();
        let shape = (one, components, largest, labels_before.len());
        assert!(one == 1 && components > 10 && largest > 1, "{shape:?}");
        let found_again = whole.iter().zip(&marks).filter(|(_, mark)| **mark == 11);
        assert!(found_again.map(|(label, _)| *label).eq(labels_before));
        for most in [1, 50, 1000] {
            let (_, labels, [batches, ..]) = settle(&work, item, most).unwrap();
            assert!(batches > 1 && (most > 1 || batches == components));
            assert!(labels == whole, "at most {most}");
        }
    }
}
