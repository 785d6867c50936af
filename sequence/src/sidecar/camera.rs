//! The keys of a camera in a section of the sidecar file.

use linecarve_lines::camera::{Camera, Distortion};
use serde::Deserialize;

use crate::calibration::{CalibratedCamera, ImageSize};

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Model {
    #[default]
    Pinhole,
    RadialTangential,
    KannalaBrandt,
}

/// Largest number of a camera, in pixels or as a coefficient.
const MOST: f64 = 1e6;

/// The keys of a camera, of which a section may have none.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraKeys {
    model: Option<Model>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    distortion: Option<Vec<f64>>,
    width: Option<u32>,
    height: Option<u32>,
}

impl CameraKeys {
    /// The camera; `None` without any key.
    pub(super) fn camera(
        &self,
        section: &str,
        source: &str,
    ) -> Result<Option<CalibratedCamera>, String> {
        let in_section = |problem: String| format!("[{section}] {problem}");
        let (Some(fx), Some(fy), Some(cx), Some(cy)) = (self.fx, self.fy, self.cx, self.cy) else {
            let has_any = [self.fx, self.fy, self.cx, self.cy]
                .iter()
                .any(Option::is_some)
                || [self.width, self.height].iter().any(Option::is_some)
                || self.model.is_some()
                || self.distortion.is_some();
            return match has_any {
                true => Err(in_section("needs fx, fy, cx and cy together".to_owned())),
                false => Ok(None),
            };
        };
        let size = match (self.width, self.height) {
            (None, None) => None,
            (Some(width), Some(height)) if width > 0 && height > 0 => {
                Some(ImageSize { width, height })
            }
            _ => {
                return Err(in_section(
                    "width and height must both be positive, or both be absent".into(),
                ));
            }
        };
        let sides = [self.width, self.height].map(|side| f64::from(side.unwrap_or(1)));
        let coefficients = self.distortion.iter().flatten().copied();
        if let Some(number) = [fx, fy, cx, cy]
            .into_iter()
            .chain(sides)
            .chain(coefficients)
            .find(|number| number.abs() > MOST)
        {
            return Err(in_section(format!(
                "{number} is no number of a camera: at most {MOST} is needed"
            )));
        }
        let distortion = self.distortion().map_err(in_section)?;
        let camera = Camera::with_distortion(fx, fy, cx, cy, distortion)
            .map_err(|error| in_section(error.to_string()))?;
        Ok(Some(CalibratedCamera::known(camera, size, source)))
    }

    fn distortion(&self) -> Result<Distortion, String> {
        let d = self.distortion.as_deref().unwrap_or_default();
        let model = self.model.unwrap_or_default();
        Ok(match (model, d.len()) {
            (Model::Pinhole, 0) => Distortion::None,
            (Model::RadialTangential, 4 | 5) => Distortion::RadialTangential {
                k1: d[0],
                k2: d[1],
                p1: d[2],
                p2: d[3],
                k3: d.get(4).copied().unwrap_or(0.0),
            },
            (Model::KannalaBrandt, 4) => Distortion::KannalaBrandt {
                k1: d[0],
                k2: d[1],
                k3: d[2],
                k4: d[3],
            },
            (model, count) => {
                let needs = match model {
                    Model::Pinhole => "none (or model = \"radial-tangential\")",
                    Model::RadialTangential => "4 or 5: [k1, k2, p1, p2, k3]",
                    Model::KannalaBrandt => "4: [k1, k2, k3, k4]",
                };
                return Err(format!(
                    "distortion has {count} coefficients, the model takes {needs}"
                ));
            }
        })
    }
}
