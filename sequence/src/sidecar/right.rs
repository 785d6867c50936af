//! The right camera of a stereo pair in the sidecar file.

use nalgebra::Isometry3;
use serde::Deserialize;

use super::camera::CameraKeys;
use crate::calibration::{CalibratedCamera, RightCamera};
use crate::rigid;
use crate::stereo::check_position;

/// Section `[right]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RightSection {
    #[serde(flatten)]
    camera: CameraKeys,
    baseline: Option<f64>,
    color_from_right: Option<[[f64; 4]; 4]>,
}

impl RightSection {
    /// The right camera; without intrinsics it has those of the left one.
    pub(super) fn camera(
        self,
        left: Option<&CalibratedCamera>,
        source: &str,
    ) -> Result<RightCamera, String> {
        let color_from_right = match (self.baseline, &self.color_from_right) {
            (Some(baseline), None) if (1e-9..=1e9).contains(&baseline) => {
                Isometry3::translation(baseline, 0.0, 0.0)
            }
            (Some(baseline), None) => {
                return Err(format!(
                    "[right] baseline = {baseline} must be positive and finite, from 1e-9 to 1e9: the distance of the cameras in units of the poses"
                ));
            }
            (None, Some(rows)) => rigid::from_matrix(rows)
                .map_err(|error| format!("[right] color_from_right {error}"))?,
            _ => {
                return Err(
                    "[right] needs baseline (rectified images: the distance of the cameras), or color_from_right, a 4x4 matrix from \
                     right to colour camera coordinates; not both"
                        .to_owned(),
                );
            }
        };
        let camera = match self.camera.camera("right", source)? {
            Some(camera) => camera,
            None => left.cloned().ok_or(
                "[right] needs fx, fy, cx and cy; only with a [color] section can all intrinsics be left out, which are then the same",
            )?,
        };
        let right = RightCamera {
            camera,
            color_from_right,
        };
        check_position(&right).map_err(|problem| format!("[right] {problem}"))?;
        Ok(right)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Sidecar;

    #[test]
    fn a_right_camera_is_read_or_refused() {
        let color = "[color]\nfx = 450\nfy = 450\ncx = 320\ncy = 240\n";
        let of = |section: &str| Sidecar::parse(&format!("{color}[right]\n{section}"), "x");
        let rectified = of("baseline = 0.11").unwrap().right.unwrap();
        assert_eq!(rectified.camera.camera.fx(), 450.0);
        assert_eq!(rectified.color_from_right.translation.x, 0.11);
        let own = "fx = 460\nfy = 460\ncx = 330\ncy = 250\n";
        let posed = "color_from_right = [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
        let free = of(&format!("{own}{posed}")).unwrap().right.unwrap();
        assert_eq!(free.camera.camera.cx(), 330.0);
        assert_eq!(free.color_from_right.translation.x, 0.2);
        for (section, message) in [
            (String::new(), "[right] needs baseline"),
            (format!("baseline = 0.1\n{posed}"), "not both"),
            ("baseline = -0.1".to_owned(), "[right] baseline = -0.1"),
            ("baseline = nan".to_owned(), "[right] baseline = NaN"),
            ("baselines = 0.1".to_owned(), "baselines"),
            ("baseline = 0.1\nfx = 450".to_owned(), "together"),
            ("baseline = 0.1\nwidth = 3".to_owned(), "[right] needs fx"),
            (posed.replace("0.2", "-0.2"), "exchanged"),
            (
                posed.replace("[1,", "[2,"),
                "color_from_right is not a rotation",
            ),
        ] {
            let error = of(&section).unwrap_err();
            assert!(error.contains(message), "{section}: {error}");
        }
        assert!(Sidecar::parse("[right]\nbaseline = 0.1", "x").is_err());
    }
}
