//! Meshes and lines in the formats asked for.

use std::path::Path;

use nalgebra::Isometry3;

use linecarve_mesh::feature_edges::CREASE_COLOR;
use linecarve_mesh::texture::EncodedTexture;
use linecarve_mesh::{
    Geometry, GlbPart, GltfFrame, LineSet, MeshFileError, TriangleMesh, files_of_textured_obj,
    write_glb, write_lines_obj, write_lines_ply, write_mesh_obj, write_mesh_ply,
    write_textured_obj,
};
use linecarve_sequence::Sequence;
use linecarve_sequence::export::{PosedImage, TrajectoryFormat, posed_images, write_trajectory};

use super::output_folder::OutputFolder;

/// File formats of meshes and lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// glTF 2.0, binary, +Y up.
    Glb,
    /// Wavefront OBJ in the frame of the poses.
    Obj,
    /// Binary PLY in the frame of the poses.
    Ply,
}

/// Colour of meshes that have none of their own.
const CLAY: [u8; 3] = [214, 206, 192];
/// Colour of segments.
const SEGMENT: [u8; 3] = [222, 88, 40];
/// Colour of clusters.
const CLUSTER: [u8; 3] = [32, 96, 200];
/// Name of the edges of a mesh, as files and as a node.
pub(crate) const FEATURE_EDGES: &str = "feature-edges";

/// Writes a mesh or lines as `<name>.<extension>` in each of the formats.
pub(crate) fn write_geometry(
    output: &mut OutputFolder,
    name: &str,
    part: GlbPart<'_>,
    formats: &[Format],
    frame: &GltfFrame,
) -> anyhow::Result<()> {
    for format in distinct(formats) {
        let path = output.file(&format!("{name}.{}", extension(format)))?;
        if let (Format::Obj, Geometry::Textured(_, texture)) = (format, part.geometry) {
            for beside in files_of_textured_obj(&path, texture) {
                let beside = beside.strip_prefix(output.root()).unwrap_or(&beside);
                output.file(&beside.display().to_string())?;
            }
        }
        write_part(&path, part, format, frame)?;
    }
    Ok(())
}

/// Writes a mesh or lines to a file; a textured OBJ file has [others](files_of_textured_obj) beside it.
pub(crate) fn write_part(
    path: &Path,
    part: GlbPart<'_>,
    format: Format,
    frame: &GltfFrame,
) -> Result<(), MeshFileError> {
    match (format, part.geometry) {
        (Format::Glb, _) => write_glb(path, &[part], *frame)?,
        (Format::Obj, Geometry::Mesh(mesh)) => write_mesh_obj(path, mesh)?,
        (Format::Obj, Geometry::Textured(mesh, texture)) => {
            write_textured_obj(path, mesh, texture)?;
        }
        (Format::Obj, Geometry::Lines(lines)) => write_lines_obj(path, lines)?,
        (Format::Ply, Geometry::Mesh(mesh) | Geometry::Textured(mesh, _)) => {
            write_mesh_ply(path, mesh)?;
        }
        (Format::Ply, Geometry::Lines(lines)) => write_lines_ply(path, lines)?,
    }
    Ok(())
}

/// Name and colour of the surface in GLB files.
pub(crate) const SURFACE: (&str, [u8; 3]) = ("surface", CLAY);

/// The surface as a node of a GLB file.
pub(crate) fn surface_part(mesh: &TriangleMesh) -> GlbPart<'_> {
    GlbPart {
        name: SURFACE.0,
        geometry: Geometry::Mesh(mesh),
        color: SURFACE.1,
    }
}

/// The surface with its texture as a node of a GLB file.
pub(crate) fn textured_part<'a>(
    mesh: &'a TriangleMesh,
    texture: &'a EncodedTexture,
) -> GlbPart<'a> {
    GlbPart {
        geometry: Geometry::Textured(mesh, texture),
        ..surface_part(mesh)
    }
}

/// The segments of all keyframes as a node of a GLB file.
pub(crate) fn segments_part(lines: &LineSet) -> GlbPart<'_> {
    GlbPart {
        name: "segments",
        geometry: Geometry::Lines(lines),
        color: SEGMENT,
    }
}

/// The clusters of segments as a node of a GLB file.
pub(crate) fn clusters_part(lines: &LineSet) -> GlbPart<'_> {
    GlbPart {
        name: "clusters",
        geometry: Geometry::Lines(lines),
        color: CLUSTER,
    }
}

/// The edges of the surface as a node of a GLB file; each has the colour of its kind.
pub(crate) fn feature_edges_part(lines: &LineSet) -> GlbPart<'_> {
    GlbPart {
        name: FEATURE_EDGES,
        geometry: Geometry::Lines(lines),
        color: CREASE_COLOR,
    }
}

/// The formats asked for, each once, in a fixed order.
fn distinct(asked: &[Format]) -> Vec<Format> {
    let mut formats = asked.to_vec();
    formats.sort_unstable();
    formats.dedup();
    formats
}

/// The file name extension of a format.
fn extension(format: Format) -> &'static str {
    match format {
        Format::Glb => "glb",
        Format::Obj => "obj",
        Format::Ply => "ply",
    }
}

/// Writes `poses.txt`, the poses of the colour camera at some frames, in the order and format of TUM.
pub(crate) fn write_poses(
    output: &mut OutputFolder,
    sequence: &Sequence,
    poses: impl Iterator<Item = (usize, Isometry3<f64>)>,
) -> anyhow::Result<()> {
    let given = posed_images(sequence);
    let images: Vec<PosedImage> = poses
        .map(|(frame, world_from_camera)| PosedImage {
            world_from_camera,
            ..given[frame].clone()
        })
        .collect();
    write_trajectory(&output.file("poses.txt")?, TrajectoryFormat::Tum, &images)?;
    Ok(())
}
