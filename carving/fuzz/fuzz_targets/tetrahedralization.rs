//! Random operations on the tetrahedralisation: every invariant holds after each, reports mirror the cells, and the
//! final state equals that of building anew.
//!
//! `cargo +nightly fuzz run tetrahedralization` in the folder above.

#![no_main]

use std::collections::BTreeSet;

use arbitrary::{Arbitrary, Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use linecarve_carving::{
    CellId, Changes, IncidentCells, Insertion, Location, Move, Tetrahedralization, VertexId,
};
use nalgebra::Point3;

/// A coordinate from sets in which ties are common, or from anywhere.
#[derive(Arbitrary, Debug)]
enum Coordinate {
    Small(u8),
    Eighth(i8),
    /// A small integer some units in the last place off.
    Near(u8, i8),
    /// Millimetres at ten million.
    Far(i8),
    Scaled(i8, u8),
    Any(f64),
}

impl Coordinate {
    fn value(&self) -> f64 {
        match *self {
            Coordinate::Small(i) => f64::from(i % 4),
            Coordinate::Eighth(i) => f64::from(i) / 8.0,
            Coordinate::Near(i, ulps) => {
                let base = f64::from(i % 3 + 1);
                f64::from_bits(base.to_bits().wrapping_add_signed(i64::from(ulps)))
            }
            Coordinate::Far(i) => 1e7 + f64::from(i) * 1e-3,
            Coordinate::Scaled(i, exponent) => f64::from(i) * 2f64.powi(i32::from(exponent) - 130),
            Coordinate::Any(x) => x,
        }
    }
}

#[derive(Arbitrary, Debug)]
enum Operation {
    Insert([Coordinate; 3]),
    Remove(u8),
    Move(u8, [Coordinate; 3]),
    /// A move by a fraction of the way, often possible in place.
    Nudge(u8, [Coordinate; 3], u8),
    Locate([Coordinate; 3]),
    /// The following operations, up to this many, are reported as one.
    Edit(u8),
}

fn point(coordinates: &[Coordinate; 3]) -> Point3<f64> {
    let [x, y, z] = coordinates;
    Point3::new(x.value(), y.value(), z.value())
}

struct State {
    tetrahedra: Tetrahedralization,
    changes: Changes,
    live: Vec<VertexId>,
    mirror: BTreeSet<CellId>,
    scratch: IncidentCells,
}

impl State {
    fn pick(&self, index: u8) -> Option<VertexId> {
        let count = self.live.len().max(1);
        self.live.get(usize::from(index) % count).copied()
    }

    fn perform(&mut self, operations: &[Operation]) {
        let State {
            tetrahedra,
            changes,
            live,
            ..
        } = self;
        let mut edit = tetrahedra.edit(changes);
        for operation in operations {
            let pick = |live: &[VertexId], index: u8| {
                live.get(usize::from(index) % live.len().max(1)).copied()
            };
            match operation {
                Operation::Insert(p) => {
                    if let Ok(Insertion::Inserted(vertex)) = edit.insert(point(p), None) {
                        live.push(vertex);
                    }
                }
                Operation::Remove(index) => {
                    if let Some(vertex) = pick(live, *index) {
                        edit.remove(vertex).expect("vertex is alive");
                        live.retain(|&v| v != vertex);
                    }
                }
                Operation::Move(index, p) => {
                    if let Some(vertex) = pick(live, *index) {
                        let _ = edit.move_vertex(vertex, point(p));
                    }
                }
                Operation::Nudge(index, p, shift) => {
                    if let Some(vertex) = pick(live, *index) {
                        let from = edit.tetrahedra().position(vertex);
                        let to = from + (point(p) - from) / 2f64.powi(i32::from(shift % 60));
                        if let Ok(Move::Duplicate(other)) = edit.move_vertex(vertex, to) {
                            assert_ne!(other, vertex);
                        }
                    }
                }
                Operation::Locate(_) | Operation::Edit(_) => {}
            }
        }
        edit.finish();
    }

    fn verify(&mut self) {
        for cell in &self.changes.destroyed {
            assert!(self.mirror.remove(cell));
        }
        for cell in &self.changes.created {
            assert!(self.mirror.insert(*cell));
        }
        assert!(self.mirror.iter().copied().eq(self.tetrahedra.cells()));
        assert!(
            self.changes
                .reshaped
                .iter()
                .all(|cell| self.mirror.contains(cell))
        );
        assert_eq!(self.tetrahedra.vertex_count(), self.live.len());
        if let Err(violation) = self.tetrahedra.check() {
            panic!("{violation}");
        }
    }

    fn locate(&mut self, p: Point3<f64>) {
        let hint = self.pick(7).and_then(|v| self.tetrahedra.cell_of(v));
        let Ok(location) = self.tetrahedra.locate(&p, hint) else {
            return;
        };
        if let Location::OnVertex(v) = location {
            assert_eq!(self.tetrahedra.position(v), p);
        }
        let nearest = self.tetrahedra.nearest_vertex(&p, hint, &mut self.scratch);
        let nearest = nearest.expect("the point was located");
        assert_eq!(nearest.is_none(), self.live.is_empty());
    }
}

/// Cells by positions of their corners.
fn canonical(tetrahedra: &Tetrahedralization) -> Vec<[Option<[u64; 3]>; 4]> {
    let corners = |cell| {
        let mut corners = tetrahedra
            .cell_vertices(cell)
            .map(|v| (!v.is_ghost()).then(|| tetrahedra.coordinates(v).map(f64::to_bits)));
        corners.sort_unstable();
        corners
    };
    let mut cells: Vec<_> = tetrahedra.cells().map(corners).collect();
    cells.sort_unstable();
    cells
}

fn operations(data: &[u8]) -> Result<Vec<Operation>> {
    let mut data = Unstructured::new(data);
    let mut operations = vec![];
    while !data.is_empty() && operations.len() < 80 {
        operations.push(data.arbitrary()?);
    }
    Ok(operations)
}

fuzz_target!(|data: &[u8]| {
    let Ok(operations) = operations(data) else {
        return;
    };
    let mut state = State {
        tetrahedra: Tetrahedralization::new(),
        changes: Changes::new(),
        live: vec![],
        mirror: BTreeSet::new(),
        scratch: IncidentCells::new(),
    };
    let mut rest = operations.as_slice();
    while let Some(first) = rest.first() {
        let length = match first {
            Operation::Edit(length) => usize::from(*length % 16) + 1,
            _ => 1,
        };
        if let Operation::Locate(p) = first {
            state.locate(point(p));
        }
        let (now, later) = rest.split_at(length.min(rest.len()));
        state.perform(now);
        state.verify();
        rest = later;
    }
    let points: Vec<_> = state
        .live
        .iter()
        .map(|&v| state.tetrahedra.position(v))
        .collect();
    let (anew, _) =
        Tetrahedralization::from_points(&points).expect("positions were accepted before");
    assert!(canonical(&anew) == canonical(&state.tetrahedra));
});
