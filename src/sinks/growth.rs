//! The surface after each keyframe, as `keyframes/NNNNNN.glb`.

use std::time::Instant;

use linecarve_mesh::write_glb;

use super::output::{OutputFolder, surface_part};
use crate::error::SinkError;
use crate::map::Map;
use crate::mapper::KeyframeUpdate;
use crate::reconstruction::Sink;
use crate::recording::Recording;
use crate::run::milliseconds;

/// Folder of the surfaces after each keyframe.
const FOLDER: &str = "keyframes";

/// Writes the surface after each keyframe that could be read, numbered from 0.
pub(crate) struct GrowthFiles<'a> {
    output: &'a mut OutputFolder,
}

impl<'a> GrowthFiles<'a> {
    /// Files in a folder of the output, which is made, or cleared of an earlier run.
    ///
    /// # Errors
    /// When the folder cannot be made or cleared.
    pub(crate) fn new(output: &'a mut OutputFolder) -> anyhow::Result<Self> {
        output.numbered(FOLDER)?;
        Ok(Self { output })
    }
}

impl Sink for GrowthFiles<'_> {
    fn wants_surface(&self) -> bool {
        true
    }

    fn update(
        &mut self,
        recording: &Recording,
        _map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        let Some(surface) = &update.surface else {
            return Ok(());
        };
        let start = Instant::now();
        let mut surface = surface.clone();
        surface.translate(&recording.origin);
        let path = self
            .output
            .file(&format!("{FOLDER}/{:06}.glb", update.order));
        write_glb(&path, &[surface_part(&surface)], &recording.origin)?;
        update.times.write = milliseconds(start.elapsed());
        Ok(())
    }
}
