//! The files of a surface: the mesh, its edges, and the lines that it was made with.

use nalgebra::Vector3;

use super::output::{
    FEATURE_EDGES, Format, clusters_part, feature_edges_part, segments_part, surface_part,
    textured_part, write_geometry,
};
use super::output_folder::OutputFolder;
use linecarve_mesh::texture::EncodedTexture;
use linecarve_mesh::{GlbPart, GltfFrame, LineSet, TriangleMesh};

/// A surface and its lines.
#[derive(Debug)]
pub(crate) struct SurfaceFiles {
    pub(crate) mesh: TriangleMesh,
    pub(crate) texture: Option<EncodedTexture>,
    /// Segments and clusters, where it was made with lines.
    pub(crate) lines: Option<(LineSet, LineSet)>,
    pub(crate) edges: LineSet,
}

impl SurfaceFiles {
    /// Moves everything.
    pub(crate) fn translate(&mut self, shift: &Vector3<f64>) {
        self.mesh.translate(shift);
        self.edges.translate(shift);
        if let Some((segments, clusters)) = &mut self.lines {
            segments.translate(shift);
            clusters.translate(shift);
        }
    }

    /// The nodes of a scene.
    pub(crate) fn parts(&self) -> Vec<GlbPart<'_>> {
        self.named().into_iter().map(|(_, part)| part).collect()
    }

    /// Writes each as `<folder><name>.<extension>` in each of the formats.
    pub(crate) fn write(
        &self,
        output: &mut OutputFolder,
        folder: &str,
        formats: &[Format],
        frame: &GltfFrame,
    ) -> anyhow::Result<()> {
        for (name, part) in self.named() {
            write_geometry(output, &format!("{folder}{name}"), part, formats, frame)?;
        }
        Ok(())
    }

    /// Everything by the name of its file.
    fn named(&self) -> Vec<(&'static str, GlbPart<'_>)> {
        let surface = match &self.texture {
            Some(texture) => textured_part(&self.mesh, texture),
            None => surface_part(&self.mesh),
        };
        let mut named = vec![("mesh", surface)];
        if let Some((segments, clusters)) = &self.lines {
            named.push(("segments", segments_part(segments)));
            named.push(("clusters", clusters_part(clusters)));
        }
        named.push((FEATURE_EDGES, feature_edges_part(&self.edges)));
        named
    }
}
