//! A reader of changes of the surface, apart from those in `clients` and in the page.

use std::collections::{BTreeMap, BTreeSet};

/// A triangle by the bits of the positions of its corners.
pub(crate) type Corners = [[u32; 3]; 3];

/// The surface that the changes so far add up to.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct DeltaReader {
    vertices: BTreeMap<u32, [u32; 3]>,
    faces: BTreeSet<[u32; 3]>,
}

impl DeltaReader {
    /// Applies the bytes of a `.delta` file.
    pub(crate) fn apply(&mut self, bytes: &[u8]) {
        assert_eq!(&bytes[..8], b"LCDELTA1");
        let mut words = bytes[32..]
            .chunks_exact(4)
            .map(|word| u32::from_le_bytes(word.try_into().expect("four bytes")));
        let mut next = || words.next().expect("another number");
        let counts: [u32; 7] = std::array::from_fn(|_| next());
        let [
            vertices,
            triangles,
            removed,
            freed,
            placed,
            recolored,
            added,
        ] = counts;
        for _ in 0..removed {
            let face = [(); 3].map(|()| next());
            assert!(self.faces.remove(&face), "{face:?} was there");
        }
        for _ in 0..freed {
            let number = next();
            assert!(self.vertices.remove(&number).is_some());
        }
        for _ in 0..placed {
            let number = next();
            // -0 and 0 are the same position.
            let position = [(); 3].map(|()| (f32::from_bits(next()) + 0.0).to_bits());
            self.vertices.insert(number, position);
            next();
        }
        for _ in 0..recolored {
            assert!(self.vertices.contains_key(&next()));
            next();
        }
        for _ in 0..added {
            let face = [(); 3].map(|()| next());
            assert!(self.faces.insert(face), "{face:?} is new");
        }
        assert_eq!(self.vertices.len() as u32, vertices);
        assert_eq!(self.faces.len() as u32, triangles);
    }

    /// The triangles by positions, sorted.
    pub(crate) fn triangles(&self) -> Vec<Corners> {
        let faces = self.faces.iter();
        sorted(faces.map(|face| face.map(|number| self.vertices[&number])))
    }
}

/// Triangles with the smallest corner first, sorted.
pub(crate) fn sorted(triangles: impl Iterator<Item = Corners>) -> Vec<Corners> {
    let first = |[a, b, c]: Corners| [a, b, c].min([b, c, a]).min([c, a, b]);
    let mut all: Vec<Corners> = triangles.map(first).collect();
    all.sort_unstable();
    all
}
