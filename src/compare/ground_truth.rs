//! What surfaces are measured against.

use std::path::Path;

use anyhow::{Context, ensure};
use linecarve_mesh::evaluate::{
    Evaluation, EvaluationOptions, NearestPointIndex, ShapeSummary, evaluate,
};
use linecarve_mesh::render::HeatScale;
use linecarve_mesh::{Shape, TriangleMesh, read_geometry};
use nalgebra::Vector3;

use super::pictures::ErrorPaint;
use super::result::GroundTruthSummary;

/// What the colours of errors mean.
pub(super) const ERROR_LABEL: &str = "distance to ground truth (units of the poses)";

/// A mesh or cloud that surfaces are measured against.
pub(crate) struct GroundTruth {
    pub(super) shape: Shape,
    pub(super) index: NearestPointIndex,
    pub(crate) summary: GroundTruthSummary,
    pub(super) scale: HeatScale,
    options: EvaluationOptions,
}

impl GroundTruth {
    /// Reads a mesh or cloud. Colours of errors end at `error_end`, by default at the largest threshold.
    ///
    /// # Errors
    /// When the file cannot be read or holds neither triangles nor points, or a length is out of range.
    pub(crate) fn read(
        path: &Path,
        options: EvaluationOptions,
        error_end: Option<f64>,
    ) -> anyhow::Result<Self> {
        let shape = read_geometry(path)?;
        ensure!(
            !shape.triangles.is_empty() || (shape.lines.is_empty() && !shape.positions.is_empty()),
            "{}: holds neither triangles nor a cloud of points, so nothing can be measured against it",
            path.display()
        );
        let largest = options.thresholds.iter().copied().fold(0.0, f64::max);
        let end = error_end.unwrap_or(largest);
        let scale = HeatScale::new(end)
            .with_context(|| format!("--error-end {end}: give a positive length"))?;
        let file = path.file_name().unwrap_or(path.as_os_str());
        Ok(Self {
            index: NearestPointIndex::new(&shape),
            summary: GroundTruthSummary {
                file: file.to_string_lossy().into_owned(),
                shape: ShapeSummary::new(&shape),
            },
            shape,
            scale,
            options,
        })
    }

    /// Measures a surface in the frame of computation, whose origin is `origin`; `None` when it is empty.
    ///
    /// # Errors
    /// When it cannot be measured.
    pub(crate) fn measure(
        &self,
        mesh: &TriangleMesh,
        origin: &Vector3<f64>,
    ) -> anyhow::Result<Option<Evaluation>> {
        if mesh.is_empty() {
            return Ok(None);
        }
        let mut mesh = mesh.clone();
        mesh.translate(origin);
        Ok(Some(evaluate(
            &Shape::from(mesh),
            &self.shape,
            &self.options,
        )?))
    }

    /// Colours for surfaces in the frame of computation.
    pub(super) fn paint(&self, origin: &Vector3<f64>) -> ErrorPaint<'_> {
        ErrorPaint {
            ground_truth: &self.index,
            origin: *origin,
            scale: self.scale,
            label: ERROR_LABEL,
        }
    }
}
