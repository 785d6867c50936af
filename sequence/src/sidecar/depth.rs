//! The depth camera in the sidecar file.

use std::path::PathBuf;

use nalgebra::Isometry3;
use serde::Deserialize;

use super::camera::CameraKeys;
use crate::DepthValues;
use crate::calibration::DepthGeometry;
use crate::rigid;

/// Section `[depth]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthSection {
    #[serde(flatten)]
    camera: CameraKeys,
    pub(super) scale: Option<f64>,
    pub(super) values: Option<DepthValues>,
    pub(super) sigma: Option<PathBuf>,
    pub(super) view: Option<DepthView>,
    color_from_depth: Option<[[f64; 4]; 4]>,
}

/// What depth images show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum DepthView {
    /// What the colour images show, at a size of their own.
    Color,
}

impl DepthSection {
    /// The depth camera, if the section has intrinsics.
    pub(super) fn geometry(&self, source: &str) -> Result<Option<DepthGeometry>, String> {
        if let Some(scale) = self.scale
            && !(1e-9..=1e9).contains(&scale)
        {
            return Err(format!(
                "[depth] scale = {scale} must be positive and finite, from 1e-9 to 1e9"
            ));
        }
        let camera = self.camera.camera("depth", source)?;
        if self.view.is_some() && camera.is_some() {
            return Err(
                "[depth] view = \"color\" gives depth the camera of colour: remove it, or fx, fy, cx and cy"
                    .to_owned(),
            );
        }
        let color_from_depth = match (&self.color_from_depth, &camera) {
            (Some(_), None) => {
                return Err(
                    "[depth] color_from_depth needs fx, fy, cx and cy together; registered depth has only a scale"
                        .to_owned(),
                );
            }
            (Some(rows), Some(_)) => rigid::from_matrix(rows)
                .map_err(|error| format!("[depth] color_from_depth {error}"))?,
            (None, _) => Isometry3::identity(),
        };
        Ok(camera.map(|camera| DepthGeometry {
            camera,
            color_from_depth,
        }))
    }
}
