//! The surface after each keyframe: as a whole, or what came and went.

use std::time::Instant;

use linecarve_mesh::files::write_unsynced;
use linecarve_mesh::{GlbWriter, MeshFileError};

use super::output::SURFACE;
use super::output_folder::OutputFolder;
use crate::report::growth_delta::encode;
use linecarve_engine::map::Map;
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
    /// Reused memory: getting it anew from the system for each keyframe takes longer than the file itself.
    bytes: Vec<u8>,
    index: Vec<u32>,
    writer: GlbWriter,
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
            bytes: Vec::new(),
            index: Vec::new(),
            writer: GlbWriter::default(),
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
        let name = format!("{FOLDER}/{:06}", update.order);
        match self.growth {
            Growth::Whole => {
                let path = self.output.file(&format!("{name}.glb"))?;
                let counts = [surface.vertex_count(), surface.triangle_count()];
                let elements = surface.elements(&mut self.index);
                self.writer
                    .write_surface(&path, SURFACE, elements, counts, &recording.origin)?;
            }
            Growth::Delta => {
                let path = self.output.file(&format!("{name}.delta"))?;
                encode(surface, change, &recording.origin, &mut self.bytes);
                write_unsynced(&path, |out| out.write_all(&self.bytes))
                    .map_err(MeshFileError::from)?;
            }
        }
        update.times.write = milliseconds(start.elapsed());
        Ok(())
    }
}
