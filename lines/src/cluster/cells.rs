//! The cells of a grid that a segment crosses.

use nalgebra::Point3;

use super::representative::WorldSegment;

/// A cell of a grid of cubes.
pub(super) type Cell = [i32; 3];

/// Segments with more cells along their longest axis have none.
const MOST_CELLS: f64 = 512.0;
/// Largest coordinate of a cell; those beyond are in the last one.
const LARGEST: f64 = 1e9;
/// Margin against rounding, in sides.
const ROUNDING: f64 = 1e-6;

/// The cell of this side that a position is in.
pub(super) fn cell_of(position: &Point3<f64>, side: f64) -> Cell {
    [position.x, position.y, position.z]
        .map(|at| (at / side).floor().clamp(-LARGEST, LARGEST) as i32)
}

/// The cells of this side whose distance from a segment is at most `margin` along each axis, and a few others, each once. `None` for segments that are too long.
pub(super) fn cells_along(
    segment: &WorldSegment,
    side: f64,
    margin: f64,
) -> Option<impl Iterator<Item = Cell> + use<>> {
    let [mut from, mut to] = segment.ends.map(|end| end / side);
    // Slabs of cells across the longest axis, and in each the cells around what lies in it.
    let axis = (to - from).iamax();
    if from[axis] > to[axis] {
        std::mem::swap(&mut from, &mut to);
    }
    let along = to - from;
    if along[axis] > MOST_CELLS {
        return None;
    }
    let margin = margin / side + ROUNDING;
    let [first, last] = range(from[axis], to[axis], margin);
    let others = [(axis + 1) % 3, (axis + 2) % 3];
    let cells = (first..=last).flat_map(move |slab| {
        let share = |at: f64| ((at - from[axis]) / along[axis]).clamp(0.0, 1.0);
        let start = match slab == first {
            true => 0.0,
            false => share(f64::from(slab) - margin),
        };
        let end = match slab == last {
            true => 1.0,
            false => share(f64::from(slab) + 1.0 + margin),
        };
        let [u, v] = others.map(|other| {
            let at = |share: f64| from[other] + share * along[other];
            range(at(start), at(end), margin)
        });
        (u[0]..=u[1]).flat_map(move |u| {
            (v[0]..=v[1]).map(move |v| {
                let mut cell = [slab; 3];
                cell[others[0]] = u;
                cell[others[1]] = v;
                cell
            })
        })
    });
    Some(cells)
}

/// The cells between two places along an axis, extended by a margin.
fn range(a: f64, b: f64, margin: f64) -> [i32; 2] {
    [a.min(b) - margin, a.max(b) + margin].map(|at| at.floor().clamp(-LARGEST, LARGEST) as i32)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use nalgebra::{Point3, Vector3};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn places_near_a_segment_are_in_its_cells() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for round in 0..2000 {
            let mut vector =
                |size: f64| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0) * size);
            let (side, margin) = (0.5, [0.0, 0.05, 0.7][round % 3]);
            let from = Point3::from(vector(3.0));
            let mut along = vector([0.1, 1.0, 8.0][round / 3 % 3]);
            // Along an axis as well.
            if round % 4 == 0 {
                along.x = 0.0;
                along.y = 0.0;
            }
            let segment = WorldSegment::new([from, from + along]).unwrap();
            let cells: Vec<Cell> = cells_along(&segment, side, margin).unwrap().collect();
            let set: HashSet<&Cell> = cells.iter().collect();
            assert_eq!(set.len(), cells.len(), "a cell comes once");
            for step in 0..=50 {
                let at = from + along * (f64::from(step) / 50.0) + vector(margin);
                let cell = [at.x, at.y, at.z].map(|x| (x / side).floor() as i32);
                assert!(set.contains(&cell), "{segment:?} {at}");
            }
        }
    }

    #[test]
    fn few_cells_or_none() {
        let segment = |x: f64| WorldSegment::new([Point3::origin(), Point3::new(x, 1.0, 0.5)]);
        let count = |x| cells_along(&segment(x).unwrap(), 1.0, 0.0).map(Iterator::count);
        assert!(count(500.0).is_some_and(|count| count < 1600));
        assert_eq!(count(1e4), None);
        assert_eq!(count(1e150), None);
    }
}
