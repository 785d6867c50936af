//! `keyframes/NNNNNN.delta`: what a keyframe changed of the surface. The live page gets the same bytes.
//!
//! The format is described in `docs/outputs.md`; `clients/read_growth.py` and `assets/report/viewer/live.js` read it.

use nalgebra::{Point3, Vector3};

use linecarve_engine::map::{MapSurface, SurfaceChange};

/// First bytes of a file: name and version of the format.
const MAGIC: &[u8; 8] = b"LCDELTA1";
/// Colour of vertices without an observed one: middle grey, not opaque.
const NO_COLOR: [u8; 4] = [128, 128, 128, 0];

/// A surface whose vertices have numbers.
pub(crate) trait NumberedSurface {
    /// Number of vertices.
    fn vertex_count(&self) -> usize;
    /// Number of triangles.
    fn triangle_count(&self) -> usize;
    /// Position of a vertex.
    fn position(&self, number: u32) -> Point3<f64>;
    /// Observed colour of a vertex.
    fn color(&self, number: u32) -> Option<[u8; 3]>;
}

impl NumberedSurface for MapSurface {
    fn vertex_count(&self) -> usize {
        self.vertex_count()
    }

    fn triangle_count(&self) -> usize {
        self.triangle_count()
    }

    fn position(&self, number: u32) -> Point3<f64> {
        self.position(number)
    }

    fn color(&self, number: u32) -> Option<[u8; 3]> {
        self.color(number)
    }
}

/// Replaces `bytes` by the file of a change, after which the surface is `surface`.
pub(crate) fn encode(
    surface: &(impl NumberedSurface + ?Sized),
    change: &SurfaceChange,
    origin: &Vector3<f64>,
    bytes: &mut Vec<u8>,
) {
    let mesh = &change.mesh;
    bytes.clear();
    bytes.extend_from_slice(MAGIC);
    for coordinate in origin {
        bytes.extend_from_slice(&coordinate.to_le_bytes());
    }
    let counts = [
        surface.vertex_count(),
        surface.triangle_count(),
        mesh.removed.len(),
        mesh.freed.len(),
        mesh.placed.len(),
        change.recolored.len(),
        mesh.added.len(),
    ];
    push(bytes, counts.map(|count| count as u32));
    push(bytes, mesh.removed.iter().flatten().copied());
    push(bytes, mesh.freed.iter().copied());
    for &number in &mesh.placed {
        push(bytes, [number]);
        let position = surface.position(number);
        for coordinate in position.iter() {
            bytes.extend_from_slice(&(*coordinate as f32).to_le_bytes());
        }
        bytes.extend_from_slice(&color(surface, number));
    }
    for &number in &change.recolored {
        push(bytes, [number]);
        bytes.extend_from_slice(&color(surface, number));
    }
    push(bytes, mesh.added.iter().flatten().copied());
}

fn push(bytes: &mut Vec<u8>, numbers: impl IntoIterator<Item = u32>) {
    for number in numbers {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
}

fn color(surface: &(impl NumberedSurface + ?Sized), number: u32) -> [u8; 4] {
    let color = surface.color(number);
    color.map_or(NO_COLOR, |[red, green, blue]| [red, green, blue, 255])
}
