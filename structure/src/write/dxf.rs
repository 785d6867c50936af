//! DXF R12 as text, which every CAD program reads: faces and edges in layers, upright.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use nalgebra::Point3;

use super::Decimals;
use crate::structure::Structure;

/// Layer of the borders of polygons.
const EDGES: &str = "EDGES";
/// Layer of triangles on no plane.
const REST: &str = "REST";
/// Colours of layers by kind of plane: numbers of the AutoCAD colour index.
const COLORS: [(&str, u8); 6] = [
    ("floor", 32),
    ("ceiling", 254),
    ("wall", 9),
    ("upright", 151),
    ("level", 83),
    ("other", 221),
];

/// Writes the triangles of each plane as `3DFACE` in a layer of its own, with inner edges invisible, each side of a polygon once as `LINE` in the
/// layer `EDGES`, and triangles on no plane in the layer `REST`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_dxf(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let upright = structure.upright_from_original();
    let points: Vec<Point3<f64>> = structure.positions.iter().map(|it| upright * it).collect();
    write_atomically(path, |out| {
        let mut file = File {
            out,
            decimals: Decimals::of(structure),
            points: &points,
        };
        file.pairs(&[
            ("0", "SECTION"),
            ("2", "HEADER"),
            ("9", "$ACADVER"),
            ("1", "AC1009"),
        ])?;
        file.pairs(&[("0", "ENDSEC"), ("0", "SECTION"), ("2", "TABLES")])?;
        let names: Vec<(String, u8)> = structure
            .by_plane()
            .map(|(plane, _)| {
                let kind = structure.planes[plane].kind.name();
                let color = COLORS.iter().find(|it| it.0 == kind).map_or(7, |it| it.1);
                (layer(structure, plane), color)
            })
            .chain([(EDGES.to_owned(), 7), (REST.to_owned(), 8)])
            .collect();
        let count = names.len().to_string();
        file.pairs(&[("0", "TABLE"), ("2", "LTYPE"), ("70", "1"), ("0", "LTYPE")])?;
        file.pairs(&[
            ("2", "CONTINUOUS"),
            ("70", "0"),
            ("3", "Solid line"),
            ("72", "65"),
        ])?;
        file.pairs(&[("73", "0"), ("40", "0.0"), ("0", "ENDTAB")])?;
        file.pairs(&[("0", "TABLE"), ("2", "LAYER"), ("70", &count)])?;
        for (name, color) in &names {
            file.pairs(&[("0", "LAYER"), ("2", name), ("70", "0")])?;
            file.pairs(&[("62", &color.to_string()), ("6", "CONTINUOUS")])?;
        }
        file.pairs(&[
            ("0", "ENDTAB"),
            ("0", "ENDSEC"),
            ("0", "SECTION"),
            ("2", "ENTITIES"),
        ])?;
        let mut sides: Vec<[u32; 2]> = Vec::new();
        for (plane, polygons) in structure.by_plane() {
            let name = layer(structure, plane);
            for polygon in polygons {
                let mut own = Vec::new();
                for ring in &polygon.rings {
                    let next = ring.iter().cycle().skip(1);
                    own.extend(ring.iter().zip(next).map(|(a, b)| [*a.min(b), *a.max(b)]));
                }
                own.sort_unstable();
                for triangle in &polygon.triangles {
                    file.face(&name, triangle, |a, b| {
                        own.binary_search(&[a.min(b), a.max(b)]).is_ok()
                    })?;
                }
                sides.extend(own);
            }
        }
        for triangle in &structure.rest {
            file.face(REST, triangle, |_, _| true)?;
        }
        sides.sort_unstable();
        sides.dedup();
        for side in &sides {
            file.pairs(&[("0", "LINE"), ("8", EDGES)])?;
            for (end, vertex) in side.iter().enumerate() {
                file.point(end, *vertex)?;
            }
        }
        file.pairs(&[("0", "ENDSEC"), ("0", "EOF")])
    })
}

/// The layer of a plane.
fn layer(structure: &Structure, plane: usize) -> String {
    structure.plane_name(plane).to_uppercase()
}

struct File<'a> {
    out: &'a mut dyn Write,
    decimals: Decimals,
    points: &'a [Point3<f64>],
}

impl File<'_> {
    fn pairs(&mut self, pairs: &[(&str, &str)]) -> std::io::Result<()> {
        pairs
            .iter()
            .try_for_each(|(code, value)| writeln!(self.out, "{code}\n{value}"))
    }

    /// The coordinates of the corner of an entity.
    fn point(&mut self, corner: usize, vertex: u32) -> std::io::Result<()> {
        let point = self.points[vertex as usize];
        for (axis, value) in [point.x, point.y, point.z].into_iter().enumerate() {
            let code = (10 * (axis + 1) + corner).to_string();
            let value = self.decimals.text(value);
            self.pairs(&[(&code, &value)])?;
        }
        Ok(())
    }

    /// A triangle; its last corner is repeated. Bits of group 70 hide edges.
    fn face(
        &mut self,
        layer: &str,
        triangle: &[u32; 3],
        is_visible: impl Fn(u32, u32) -> bool,
    ) -> std::io::Result<()> {
        self.pairs(&[("0", "3DFACE"), ("8", layer)])?;
        let [a, b, c] = *triangle;
        for (corner, vertex) in [a, b, c, c].into_iter().enumerate() {
            self.point(corner, vertex)?;
        }
        // The third edge is the repeated corner, the fourth leads back to the first.
        let edges = [(a, b, 1), (b, c, 2), (c, a, 8)];
        let hidden: u8 = edges
            .iter()
            .filter(|it| !is_visible(it.0, it.1))
            .map(|it| it.2)
            .sum();
        match hidden {
            0 => Ok(()),
            hidden => self.pairs(&[("70", &hidden.to_string())]),
        }
    }
}
