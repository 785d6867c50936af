//! Files of structures. OBJ and GLB are in the frames of the other files of a run; DXF, IFC and USD are upright: z is up, and x is a main
//! direction when there are any.

mod dxf;
mod glb;
mod ifc;
mod json;
mod obj;
mod svg;
mod usda;

pub use dxf::write_dxf;
pub use glb::write_structure_glb;
pub use ifc::write_ifc;
pub use json::{PlaneSummary, StructureSummary, write_json};
pub use obj::write_structure_obj;
pub use svg::write_svg;
pub use usda::write_usda;

use nalgebra::{Point3, Rotation3, Vector3};

use crate::structure::{Polygon, Structure};

impl Structure {
    /// The rotation into the upright frame: z is up, x is the first main direction, or any level direction without.
    pub fn upright_from_original(&self) -> Rotation3<f64> {
        let x = match self.main_directions {
            Some([x, _, _]) => x,
            None => {
                let mut level = Vector3::zeros();
                level[self.up.iamin()] = 1.0;
                (level - level.dot(&self.up) * self.up).normalize()
            }
        };
        let rows = [x, self.up.cross(&x), self.up].map(|row| row.transpose());
        Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_rows(&rows))
    }

    /// The name of a plane in files: its number and its kind.
    pub fn plane_name(&self, plane: usize) -> String {
        format!("plane_{plane:03}_{}", self.planes[plane].kind.name())
    }

    /// The colour of a plane: the mean colour of its vertices, else that of its kind.
    pub fn plane_color(&self, plane: usize) -> [u8; 3] {
        let plane = &self.planes[plane];
        plane.color.unwrap_or_else(|| plane.kind.color())
    }

    /// Polygons of each plane.
    fn by_plane(&self) -> impl Iterator<Item = (usize, &[Polygon])> {
        let groups = self.polygons.chunk_by(|a, b| a.plane == b.plane);
        groups.map(|group| (group[0].plane as usize, group))
    }
}

/// Faces of a polygon for formats without holes: the polygon itself, or its triangles when it has holes.
fn faces(polygon: &Polygon) -> Vec<Vec<u32>> {
    match polygon.rings.as_slice() {
        [outer] => vec![outer.clone()],
        _ => polygon.triangles.iter().map(|it| it.to_vec()).collect(),
    }
}

/// The vertices that faces use, ascending, and the faces with the ranks of their vertices among them.
fn ranked(faces: &[Vec<u32>]) -> (Vec<u32>, Vec<Vec<usize>>) {
    let mut used: Vec<u32> = faces.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let rank = |vertex: &u32| used.binary_search(vertex).unwrap_or(0);
    let ranked = faces
        .iter()
        .map(|face| face.iter().map(rank).collect())
        .collect();
    (used, ranked)
}

/// Writes coordinates with as many decimals as the size of the structure asks for.
struct Decimals(usize);

impl Decimals {
    /// A ten millionth of the extent, which is what single precision resolves.
    fn of(structure: &Structure) -> Self {
        let Some(first) = structure.positions.first() else {
            return Self(6);
        };
        let bounds = structure
            .positions
            .iter()
            .fold((*first, *first), |(a, b), it| (a.inf(it), b.sup(it)));
        let diagonal = (bounds.1 - bounds.0).norm();
        match diagonal > 0.0 {
            true => Self((-(diagonal * 1e-7).log10()).ceil().clamp(0.0, 15.0) as usize),
            false => Self(6),
        }
    }

    fn text(&self, value: f64) -> String {
        let text = format!("{value:.*}", self.0);
        // No sign before zero, and no zeros at the end.
        let text = match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.'),
            false => &text,
        };
        match text {
            "-0" => "0".to_owned(),
            text => text.to_owned(),
        }
    }

    fn join(&self, point: &Point3<f64>, separator: &str) -> String {
        [point.x, point.y, point.z]
            .map(|it| self.text(it))
            .join(separator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_short_as_they_can_be() {
        let decimals = Decimals(4);
        let texts = [1.0, -0.00001, 0.25, 1234.56789, -2.5, 100.0].map(|it| decimals.text(it));
        assert_eq!(texts, ["1", "0", "0.25", "1234.5679", "-2.5", "100"]);
        assert_eq!(Decimals(0).text(100.0), "100");
    }
}
