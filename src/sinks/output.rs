//! The output folder, and meshes and lines in the formats asked for.

use std::path::{Path, PathBuf};

use anyhow::Context;

use nalgebra::Isometry3;

use linecarve_mesh::feature_edges::CREASE_COLOR;
use linecarve_mesh::files::remove_unfinished;
use linecarve_mesh::texture::EncodedTexture;
use linecarve_mesh::{
    Geometry, GlbPart, GltfFrame, LineSet, MeshFileError, TriangleMesh, write_glb, write_lines_obj,
    write_lines_ply, write_mesh_obj, write_mesh_ply, write_textured_obj,
};
use linecarve_sequence::Sequence;
use linecarve_sequence::export::{PosedImage, TrajectoryFormat, posed_images, write_trajectory};

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

/// A folder that results go to, and the names of the files that went there.
pub(crate) struct OutputFolder {
    root: PathBuf,
    written: Vec<String>,
}

impl OutputFolder {
    /// Makes the folder when it is missing and proves that files can be made in it, before any work is spent.
    pub(crate) fn create(root: &Path) -> anyhow::Result<Self> {
        let remedy = || {
            format!(
                "cannot write to the output folder {}: choose another with --out, or make it writable",
                root.display()
            )
        };
        std::fs::create_dir_all(root).with_context(remedy)?;
        tempfile::NamedTempFile::new_in(root).with_context(remedy)?;
        remove_unfinished(root).with_context(remedy)?;
        Ok(Self {
            root: root.to_owned(),
            written: Vec::new(),
        })
    }

    /// A folder inside, made when it is missing.
    pub(crate) fn subfolder(&self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.root.join(name);
        std::fs::create_dir_all(&path)
            .with_context(|| format!("cannot make the folder {}", path.display()))?;
        remove_unfinished(&path)
            .with_context(|| format!("cannot clear the folder {}", path.display()))?;
        Ok(path)
    }

    /// A folder inside for numbered files, those of an earlier run removed: a shorter run would leave a mixture.
    pub(crate) fn numbered(&self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.subfolder(name)?;
        let entries =
            std::fs::read_dir(&path).with_context(|| format!("cannot read {}", path.display()))?;
        for entry in entries.flatten() {
            if is_numbered(&entry.file_name().to_string_lossy()) {
                std::fs::remove_file(entry.path())
                    .with_context(|| format!("cannot remove {}", entry.path().display()))?;
            }
        }
        Ok(path)
    }

    /// The path of a file that is about to be written; `name` is remembered.
    pub(crate) fn file(&mut self, name: &str) -> PathBuf {
        self.written.push(name.to_owned());
        self.root.join(name)
    }

    /// The folder itself.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the files so far, in the order of writing.
    pub(crate) fn written(&self) -> &[String] {
        &self.written
    }
}

/// Whether a file name is six digits and `.glb` or `.delta`, as this program writes them.
fn is_numbered(name: &str) -> bool {
    name.strip_suffix(".glb")
        .or_else(|| name.strip_suffix(".delta"))
        .is_some_and(|stem| stem.len() == 6 && stem.bytes().all(|byte| byte.is_ascii_digit()))
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
        let path = output.file(&format!("{name}.{}", extension(format)));
        for beside in write_part(&path, part, format, frame)? {
            let beside = beside.strip_prefix(output.root()).unwrap_or(&beside);
            let beside = beside.display().to_string();
            output.file(&beside);
        }
    }
    Ok(())
}

/// Writes a mesh or lines to a file; returns the paths of files beside it.
pub(crate) fn write_part(
    path: &Path,
    part: GlbPart<'_>,
    format: Format,
    frame: &GltfFrame,
) -> Result<Vec<PathBuf>, MeshFileError> {
    match (format, part.geometry) {
        (Format::Glb, _) => write_glb(path, &[part], *frame)?,
        (Format::Obj, Geometry::Mesh(mesh)) => write_mesh_obj(path, mesh)?,
        (Format::Obj, Geometry::Textured(mesh, texture)) => {
            return write_textured_obj(path, mesh, texture).map(Vec::from);
        }
        (Format::Obj, Geometry::Lines(lines)) => write_lines_obj(path, lines)?,
        (Format::Ply, Geometry::Mesh(mesh) | Geometry::Textured(mesh, _)) => {
            write_mesh_ply(path, mesh)?;
        }
        (Format::Ply, Geometry::Lines(lines)) => write_lines_ply(path, lines)?,
    }
    Ok(Vec::new())
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
    write_trajectory(&output.file("poses.txt"), TrajectoryFormat::Tum, &images)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_files_of_an_earlier_run_go_and_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        let output = OutputFolder::create(&root).unwrap();
        let inside = output.numbered("keyframes").unwrap();
        let unfinished = ".linecarve-unfinished-aB3";
        for name in [
            "000041.glb",
            "000041.delta",
            "notes.txt",
            "1.glb",
            unfinished,
        ] {
            std::fs::write(inside.join(name), "old").unwrap();
        }
        output.numbered("keyframes").unwrap();
        for name in ["000041.glb", "000041.delta", unfinished] {
            assert!(!inside.join(name).exists(), "{name}");
        }
        assert!(inside.join("notes.txt").exists() && inside.join("1.glb").exists());
    }
}
