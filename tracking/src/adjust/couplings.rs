//! What eliminated points leave between poses.

use nalgebra::{Matrix3, Matrix6x3};
use rayon::prelude::*;

use super::skyline::{BlockRow, Skyline};

/// Observations whose products are computed together: enough for all threads, few enough for the cache.
const MANY: usize = 8192;

/// Observations of eliminated points. The product of each pair of observations of a point is subtracted from the system of the poses, for many
/// points together: one thread does all of a row of the system, in the order of the points.
#[derive(Default)]
pub(super) struct Couplings {
    observations: Vec<Coupling>,
    /// The observations of each pose: by slot, then in order.
    by_slot: Vec<(usize, usize)>,
}

/// An observation of a point.
struct Coupling {
    slot: usize,
    /// The block between the pose and the point.
    block: Matrix6x3<f64>,
    /// The block times the inverse of that of the point.
    through: Matrix6x3<f64>,
    /// The observations of its point.
    range: [usize; 2],
}

impl Couplings {
    /// Adds the observations of a point, given by the slots of the poses and the blocks between poses and point, and the inverse of the block of
    /// the point. Returns for each observation the slot and its block times that inverse.
    pub(super) fn add(
        &mut self,
        blocks: &[(usize, Matrix6x3<f64>)],
        inverse: &Matrix3<f64>,
    ) -> impl Iterator<Item = (usize, &Matrix6x3<f64>)> {
        let begin = self.observations.len();
        let range = [begin, begin + blocks.len()];
        let added = blocks.iter().map(|&(slot, block)| Coupling {
            slot,
            block,
            through: block * inverse,
            range,
        });
        self.observations.extend(added);
        let added = self.observations[begin..].iter();
        added.map(|one| (one.slot, &one.through))
    }

    /// Whether there are enough observations to subtract them.
    pub(super) fn are_many(&self) -> bool {
        self.observations.len() >= MANY
    }

    /// Subtracts the products of all pairs of observations of a point from the system, and forgets the observations.
    ///
    /// # Complexity
    /// Quadratic in the observations of each point.
    pub(super) fn subtract_from(&mut self, system: &mut Skyline) {
        self.by_slot.clear();
        let slots = self.observations.iter().enumerate();
        self.by_slot.extend(slots.map(|(at, one)| (one.slot, at)));
        self.by_slot.sort_unstable();
        let observations = &self.observations;
        let mut rest = &self.by_slot[..];
        let rows = system.rows_mut().iter_mut().enumerate();
        let rows = rows.filter_map(|(slot, row)| {
            let own = rest.partition_point(|(other, _)| *other <= slot);
            let (of_row, others) = rest.split_at(own);
            rest = others;
            (!of_row.is_empty()).then_some((slot, row, of_row))
        });
        let subtract = |(slot, row, of_row): (usize, &mut BlockRow, &[(usize, usize)])| {
            for &(_, at) in of_row {
                let one = &observations[at];
                let [begin, end] = one.range;
                for other in &observations[begin..end] {
                    if other.slot <= slot {
                        row.subtract_product(other.slot, &one.through, &other.block);
                    }
                }
            }
        };
        match self.are_many() {
            true => rows.collect::<Vec<_>>().into_par_iter().for_each(subtract),
            false => rows.for_each(subtract),
        }
        self.observations.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DVector, Matrix6};
    use rand::{RngExt, SeedableRng};

    #[test]
    fn products_of_pairs_are_subtracted_on_any_number_of_threads() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut number = || random.random_range(-1.0..1.0);
        let inverse = Matrix3::new(2.0, 0.1, 0.0, 0.1, 3.0, 0.2, 0.0, 0.2, 1.0);
        let poses = 12;
        // Two thirds of the points are subtracted together, the others are few.
        let points: Vec<Vec<(usize, Matrix6x3<f64>)>> = (0..3 * MANY / 16)
            .map(|point| {
                let views = (0..8).map(|view| (point + view * view) % poses);
                views
                    .map(|slot| (slot, Matrix6x3::from_fn(|_, _| number())))
                    .collect()
            })
            .collect();
        let diagonal = Matrix6::identity() * 1e6;
        let mut expected = Skyline::new(&vec![0; poses]);
        for slot in 0..poses {
            expected.add(slot, slot, &diagonal);
        }
        for blocks in &points {
            for (slot, block) in blocks {
                for (other, other_block) in blocks {
                    let product = block * inverse * other_block.transpose();
                    expected.add(*slot, *other, &-product);
                }
            }
        }
        let right = DVector::from_fn(6 * poses, |row, _| row as f64);
        let expected = expected.solve(&right).unwrap();
        let found = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build().unwrap().install(|| {
                let mut system = Skyline::new(&vec![0; poses]);
                for slot in 0..poses {
                    system.add(slot, slot, &diagonal);
                }
                let mut couplings = Couplings::default();
                let mut batches = 0;
                for blocks in &points {
                    let added = couplings.add(blocks, &inverse);
                    assert_eq!(added.count(), blocks.len());
                    if couplings.are_many() {
                        couplings.subtract_from(&mut system);
                        batches += 1;
                    }
                }
                couplings.subtract_from(&mut system);
                assert_eq!(batches, 1);
                system.solve(&right).unwrap()
            })
        });
        assert_eq!(found[0], found[1]);
        let error = (&found[0] - &expected).norm() / expected.norm();
        assert!(error < 1e-9, "{error}");
    }
}
