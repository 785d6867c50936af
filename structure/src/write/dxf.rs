//! DXF R12 as text, which every CAD program reads: faces and edges in layers, upright.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};

use super::{parts, texts};
use crate::structure::Structure;
use crate::surface::unique;

/// Layer of the borders of polygons.
const EDGES: &str = "EDGES";
/// Everything before the layers.
const START: &str = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\nENDSEC\n0\nSECTION\n2\nTABLES\n\
    0\nTABLE\n2\nLTYPE\n70\n1\n0\nLTYPE\n2\nCONTINUOUS\n70\n0\n3\nSolid line\n72\n65\n73\n0\n40\n0.0\n0\nENDTAB\n\
    0\nTABLE\n2\nLAYER\n";

/// Writes the triangles of each plane as `3DFACE` in a layer of its own, with inner edges invisible, each side of a polygon once as `LINE` in the
/// layer `EDGES`, and triangles on no plane in the layer `REST`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_dxf(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let points = texts(structure, &structure.upright_from_original());
    let parts = parts(structure);
    write_atomically(path, |out| {
        write!(out, "{START}70\n{}\n", parts.len() + 1)?;
        for part in &parts {
            if part.kind.is_none() {
                layer(out, EDGES, 7)?;
            }
            let color = part.kind.map_or(8, |it| it.autocad_color());
            layer(out, &part.name.to_uppercase(), color)?;
        }
        write!(out, "0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n")?;
        let mut sides: Vec<[u32; 2]> = Vec::new();
        for part in &parts {
            let layer = part.name.to_uppercase();
            for polygon in part.polygons.iter() {
                let own = unique(polygon.sides().map(|[a, b]| [a.min(b), a.max(b)]));
                for triangle in &polygon.triangles {
                    face(out, &points, &layer, triangle, &own)?;
                }
                sides.extend(own.iter().filter(|_| part.kind.is_some()));
            }
        }
        for side in unique(sides) {
            write!(out, "0\nLINE\n8\n{EDGES}\n")?;
            corners(out, &points, &side)?;
        }
        write!(out, "0\nENDSEC\n0\nEOF\n")
    })
}

fn layer(out: &mut dyn Write, name: &str, color: u8) -> std::io::Result<()> {
    write!(
        out,
        "0\nLAYER\n2\n{name}\n70\n0\n62\n{color}\n6\nCONTINUOUS\n"
    )
}

/// The coordinates of the corners of an entity.
fn corners(out: &mut dyn Write, points: &[[String; 3]], vertices: &[u32]) -> std::io::Result<()> {
    for (corner, vertex) in vertices.iter().enumerate() {
        let [x, y, z] = &points[*vertex as usize];
        write!(out, "1{corner}\n{x}\n2{corner}\n{y}\n3{corner}\n{z}\n")?;
    }
    Ok(())
}

/// A triangle; its last corner is repeated. Bits of group 70 hide edges that are no side.
fn face(
    out: &mut dyn Write,
    points: &[[String; 3]],
    layer: &str,
    [a, b, c]: &[u32; 3],
    sides: &[[u32; 2]],
) -> std::io::Result<()> {
    write!(out, "0\n3DFACE\n8\n{layer}\n")?;
    corners(out, points, &[*a, *b, *c, *c])?;
    // The third edge is the repeated corner, the fourth leads back to the first.
    let edges = [(a, b, 1), (b, c, 2), (c, a, 8)];
    let is_hidden = |it: &&(&u32, &u32, u8)| !sides.contains(&[*it.0.min(it.1), *it.0.max(it.1)]);
    let hidden: u8 = edges.iter().filter(is_hidden).map(|it| it.2).sum();
    match hidden {
        0 => Ok(()),
        hidden => write!(out, "70\n{hidden}\n"),
    }
}
