//! Reading meshes, line sets and point clouds.
//!
//! [`read_geometry`] reads PLY (ASCII and binary), OBJ, STL (ASCII and binary), glTF and GLB, and text with one point
//! per row, into a [`Shape`]. The content decides the format where it can, otherwise the name. The result is checked:
//! coordinates are finite and indices in range.

mod accessor;
mod ears;
mod error;
mod gltf;
mod obj;
mod ply;
mod polygon;
mod rows;
mod stl;
mod texture;

use std::path::Path;

use crate::files::read_regular;
use crate::shape::Shape;
use crate::texture::Texture;
pub use error::ReadError;

/// Input formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Ply,
    Obj,
    Stl,
    Gltf,
    Rows,
}

/// Reads a mesh, a line set or a point cloud.
///
/// Points keep the order of the file; colours become 8-bit sRGB. Polygons are triangulated, convex ones as fans, polylines split
/// into lines. glTF is transformed to the frame that `extras.original_from_gltf` of its scene defines, if present.
/// STL corners with equal coordinates are merged.
///
/// An empty file of a known format gives an empty [`Shape`], not an error.
///
/// # Errors
/// When the file cannot be read, its format is not known, its content is damaged, a coordinate is not finite or an
/// index is out of range.
pub fn read_geometry(path: &Path) -> Result<Shape, ReadError> {
    read(path, false).map(|(shape, _)| shape)
}

/// [`read_geometry`] with the texture of the triangles, where a GLB, glTF or OBJ file has one image for all of them.
///
/// Texture coordinates beyond the image are moved to its edge: images are not repeated.
///
/// # Errors
/// As [`read_geometry`], and when the image is missing or cannot be decoded.
pub fn read_textured(path: &Path) -> Result<(Shape, Option<Texture>), ReadError> {
    read(path, true)
}

fn read(path: &Path, is_textured: bool) -> Result<(Shape, Option<Texture>), ReadError> {
    let bytes = read_regular(path).map_err(|source| ReadError::Open {
        path: path.to_owned(),
        source,
    })?;
    let format = format_of(path, &bytes).ok_or_else(|| ReadError::UnknownFormat {
        path: path.to_owned(),
    })?;
    if is_utf16(&bytes) {
        let problem = "its encoding is UTF-16; save it as UTF-8".to_owned();
        return Err(ReadError::content(path, "text")(problem));
    }
    let plain = |shape: Shape| (shape, None);
    let (shape, texture) = match format {
        Format::Ply => ply::parse(&bytes)
            .map(plain)
            .map_err(ReadError::content(path, "PLY")),
        Format::Obj => {
            let texture_beside = is_textured.then_some(path);
            obj::parse(&bytes, texture_beside).map_err(ReadError::content(path, "OBJ"))
        }
        Format::Stl => stl::parse(&bytes)
            .map(plain)
            .map_err(ReadError::content(path, "STL")),
        Format::Gltf => {
            gltf::parse(&bytes, path, is_textured).map_err(ReadError::content(path, "glTF"))
        }
        Format::Rows => rows::parse(&bytes)
            .map(plain)
            .map_err(ReadError::content(path, "x y z")),
    }?;
    shape.validate().map_err(|fault| ReadError::Geometry {
        path: path.to_owned(),
        fault,
    })?;
    Ok((shape, texture))
}

/// Whether the bytes begin with the byte order mark of UTF-16 and an ASCII character.
fn is_utf16(bytes: &[u8]) -> bool {
    matches!(
        bytes,
        [0xFF, 0xFE, 1..=0x7F, 0, ..] | [0xFE, 0xFF, 0, 1..=0x7F, ..]
    )
}

fn format_of(path: &Path, bytes: &[u8]) -> Option<Format> {
    if bytes.starts_with(b"glTF") {
        return Some(Format::Gltf);
    }
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        return Some(Format::Ply);
    }
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    match extension.as_str() {
        "ply" => Some(Format::Ply),
        "obj" => Some(Format::Obj),
        "stl" => Some(Format::Stl),
        "glb" | "gltf" => Some(Format::Gltf),
        "xyz" | "txt" | "csv" => Some(Format::Rows),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
