//! The surface after each keyframe: as a whole, or what came and went.

use std::time::Instant;

use linecarve_mesh::files::write_unsynced;
use linecarve_mesh::{GlbWriter, GltfFrame, MeshElements, MeshFileError};
use nalgebra::Vector3;

use super::output::SURFACE;
use super::output_folder::OutputFolder;
use crate::report::growth_delta::encode;
use linecarve_engine::map::{Map, MapSurface, SurfaceChange};
use linecarve_engine::run::milliseconds;
use linecarve_engine::{KeyframeUpdate, Recording, Sink, SinkError};

/// Folder of the files of keyframes.
const FOLDER: &str = "keyframes";

/// What is written of the surface after each keyframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Growth {
    /// The whole surface, as `keyframes/NNNNNN.glb`.
    Whole,
    /// Its change, as `keyframes/NNNNNN.delta`.
    Delta,
}

/// Writes a file for each keyframe that could be read, numbered from 0.
pub(crate) struct GrowthFiles<'a> {
    output: &'a mut OutputFolder,
    growth: Growth,
    /// The last keyframe.
    last: Option<usize>,
    /// Reused memory: getting it anew from the system for each keyframe takes longer than the file itself.
    bytes: Vec<u8>,
    index: Vec<u32>,
    writer: GlbWriter,
    /// Of all files: poses do not change during a run.
    frame: Option<GltfFrame>,
}

impl<'a> GrowthFiles<'a> {
    /// Files in a folder of the output, which is made, or cleared of an earlier run.
    ///
    /// # Errors
    /// When the folder cannot be made or cleared.
    pub(crate) fn new(output: &'a mut OutputFolder, growth: Growth) -> anyhow::Result<Self> {
        output.numbered(FOLDER, &["glb", "delta"])?;
        Ok(Self {
            output,
            growth,
            last: None,
            bytes: Vec::new(),
            index: Vec::new(),
            writer: GlbWriter::default(),
            frame: None,
        })
    }
}

impl Sink for GrowthFiles<'_> {
    fn wants_surface(&self) -> bool {
        true
    }

    fn update(
        &mut self,
        recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        let (Some(surface), Some(change)) = (map.followed_surface(), &update.surface) else {
            return Ok(());
        };
        let start = Instant::now();
        self.last = Some(update.order);
        let name = format!("{FOLDER}/{:06}", update.order);
        match self.growth {
            Growth::Whole => {
                let path = self.output.file(&format!("{name}.glb"))?;
                let counts = [surface.vertex_count(), surface.triangle_count()];
                let elements = surface.elements(&mut self.index);
                let frame = *self.frame.get_or_insert_with(|| recording.gltf_frame());
                self.writer
                    .write_surface(&path, SURFACE, elements, counts, frame)?;
            }
            Growth::Delta => {
                let name = format!("{name}.delta");
                self.write_change(&name, surface, change, &recording.origin)?;
            }
        }
        update.times.write = milliseconds(start.elapsed());
        Ok(())
    }

    /// The surface after the last keyframe is the final one: in the same order, its file has the same geometry byte for byte.
    fn finished(
        &mut self,
        recording: &Recording,
        map: &Map,
        change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        let (Some(surface), Some(change), Some(last)) = (map.followed_surface(), change, self.last)
        else {
            return Ok(());
        };
        match self.growth {
            Growth::Whole => {
                let path = self.output.file(&format!("{FOLDER}/{last:06}.glb"))?;
                let mesh = surface.to_mesh();
                let counts = [mesh.positions.len(), mesh.triangles.len()];
                let elements = MeshElements {
                    positions: mesh.positions.iter().copied(),
                    colors: mesh.colors.as_ref().map(|colors| colors.iter().copied()),
                    elements: mesh.triangles.iter().copied(),
                };
                let frame = *self.frame.get_or_insert_with(|| recording.gltf_frame());
                self.writer
                    .write_surface(&path, SURFACE, elements, counts, frame)?;
            }
            Growth::Delta => {
                // One more than keyframes: what the end of the map changed.
                let name = format!("{FOLDER}/{:06}.delta", last + 1);
                self.write_change(&name, surface, change, &recording.origin)?;
            }
        }
        Ok(())
    }
}

impl GrowthFiles<'_> {
    fn write_change(
        &mut self,
        name: &str,
        surface: &MapSurface,
        change: &SurfaceChange,
        origin: &Vector3<f64>,
    ) -> Result<(), SinkError> {
        let path = self.output.file(name)?;
        encode(surface, change, origin, &mut self.bytes);
        write_unsynced(&path, |out| out.write_all(&self.bytes)).map_err(MeshFileError::from)?;
        Ok(())
    }
}
