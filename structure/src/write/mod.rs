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
pub use json::{StructureSummary, write_json};
pub use obj::write_structure_obj;
pub use svg::{deviation_text, measured_text, svg};
pub use usda::write_usda;

use std::borrow::Cow;

use linecarve_mesh::{GltfFrame, far_origin};
use nalgebra::{IsometryMatrix3, Point3, Rotation3, Vector3};

use crate::kind::Kind;
use crate::structure::{Polygon, Structure};
use crate::surface::{rank, unique};

impl Structure {
    /// The transform into the upright frame: z is up, x is the first main direction, or any level direction without. Structures far from
    /// zero turn about their middle, and stay about where they are.
    pub fn upright_from_original(&self) -> IsometryMatrix3<f64> {
        let rotation = self.upright_rotation();
        let [original, upright] = self.origins();
        IsometryMatrix3::from_parts((upright - rotation * original).into(), rotation)
    }

    /// The rotation into the upright frame.
    pub(crate) fn upright_rotation(&self) -> Rotation3<f64> {
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

    /// The position about which the structure turns, zero unless it lies far off, and the same in the upright frame: the axis nearest to up
    /// becomes z, and no coordinate is mixed with another.
    fn origins(&self) -> [Vector3<f64>; 2] {
        let origin = far_origin(&self.positions);
        let mut axis = Vector3::zeros();
        axis[self.up.iamax()] = self.up[self.up.iamax()].signum();
        let gltf_from_original = GltfFrame::upright(Vector3::zeros(), &axis).gltf_from_original;
        let in_gltf = gltf_from_original * origin;
        [origin, Vector3::new(in_gltf.x, -in_gltf.z, in_gltf.y)]
    }
}

/// What files hold under one name: the polygons of a plane, or the triangles on no plane.
struct Part<'a> {
    name: String,
    /// `None` for the rest.
    kind: Option<Kind>,
    color: [u8; 3],
    polygons: Cow<'a, [Polygon]>,
}

/// All planes, and the rest as the last part, even when there is none.
fn parts(structure: &Structure) -> Vec<Part<'_>> {
    let groups = structure.polygons.chunk_by(|a, b| a.plane == b.plane);
    let planes = groups.map(|group| {
        let plane = &structure.planes[group[0].plane as usize];
        Part {
            name: plane.name.clone(),
            kind: Some(plane.kind),
            color: plane.color.unwrap_or_else(|| plane.kind.color()),
            polygons: group.into(),
        }
    });
    let rest = structure.rest.iter().map(|triangle| Polygon {
        plane: u32::MAX,
        rings: vec![triangle.to_vec()],
        triangles: vec![*triangle],
    });
    let rest = Part {
        name: "rest".to_owned(),
        kind: None,
        color: [150; 3],
        polygons: rest.collect(),
    };
    planes.chain([rest]).collect()
}

/// Faces of a polygon for formats without holes: the polygon itself, or its triangles when it has holes.
fn faces(polygon: &Polygon) -> Vec<Vec<u32>> {
    match polygon.rings.as_slice() {
        [outer] => vec![outer.clone()],
        _ => polygon.triangles.iter().map(|it| it.to_vec()).collect(),
    }
}

/// The vertices that faces use, ascending, and the faces with the ranks of their vertices among them.
fn ranked<F>(mut faces: Vec<F>) -> (Vec<u32>, Vec<F>)
where
    for<'f> &'f F: IntoIterator<Item = &'f u32>,
    for<'f> &'f mut F: IntoIterator<Item = &'f mut u32>,
{
    let used = unique(faces.iter().flatten().copied());
    (faces.iter_mut().flatten()).for_each(|it| *it = rank(&used, it));
    (used, faces)
}

/// The coordinates of all vertices, transformed, with as many decimals as the size of the structure asks for: a ten millionth of the extent,
/// which is what single precision resolves.
fn texts(structure: &Structure, transform: &IsometryMatrix3<f64>) -> Vec<[String; 3]> {
    let diagonal = structure.mesh().diagonal();
    let decimals = match diagonal > 0.0 {
        true => (-(diagonal * 1e-7).log10()).ceil().clamp(0.0, 15.0) as usize,
        false => 6,
    };
    let texts =
        |it: &Point3<f64>| <[f64; 3]>::from((transform * it).coords).map(|it| text(it, decimals));
    structure.positions.iter().map(texts).collect()
}

/// A number without a sign before zero, and without zeros at the end.
fn text(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    match text {
        "-0" => "0".to_owned(),
        text => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_short_as_they_can_be() {
        let texts = [1.0, -0.00001, 0.25, 1234.56789, -2.5, 100.0].map(|it| text(it, 4));
        assert_eq!(texts, ["1", "0", "0.25", "1234.5679", "-2.5", "100"]);
        assert_eq!(text(100.0, 0), "100");
    }
}
