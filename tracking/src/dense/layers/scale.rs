//! The common scale of corrected layers: that of the path as given.

use linecarve_lines::depth::DepthCorrection;
use linecarve_lines::fit_similarity;
use nalgebra::{Isometry3, Point3, Vector3};

use super::layer::{DepthLayer, LayerPlacement};

/// The path says another scale if that is so many standard deviations away.
const SIGNIFICANT: f64 = 2.0;

/// Makes the path as long as it was given. Overlaps of layers with free scales do not tell how large all of them are together: the poses do.
pub(super) fn keep_scale_of_path(layers: &[DepthLayer], placements: &mut [LayerPlacement]) {
    let place = |pose: &Isometry3<f64>| Point3::from(pose.translation.vector);
    let given: Vec<Point3<f64>> = layers.iter().map(|layer| place(layer.given())).collect();
    let corrected: Vec<Point3<f64>> = placements
        .iter()
        .map(|placement| place(&placement.world_from_camera))
        .collect();
    let Some(scale) = significant_scale(&corrected, &given) else {
        return;
    };
    let middle = mean(&corrected);
    for placement in placements {
        let translation = &mut placement.world_from_camera.translation.vector;
        *translation = middle + scale * (*translation - middle);
        let depth = placement.depth;
        placement.depth = DepthCorrection {
            scale: scale * depth.scale,
            shift: scale * depth.shift,
            ..depth
        };
    }
}

/// Factor on `from` that makes them as large as `to`; `None` unless it differs significantly from one.
fn significant_scale(from: &[Point3<f64>], to: &[Point3<f64>]) -> Option<f64> {
    let similarity = fit_similarity(from, to, true)?;
    let squared: f64 = from
        .iter()
        .zip(to)
        .map(|(from, to)| (similarity * from - to).norm_squared())
        .sum();
    // Seven of the coordinates are used up by the similarity.
    let unused = (3 * from.len()).checked_sub(7).filter(|left| *left > 0)?;
    let middle = mean(from);
    let spread: f64 = from
        .iter()
        .map(|p| (p.coords - middle).norm_squared())
        .sum();
    let sigma = (squared / unused as f64 / spread).sqrt();
    let scale = similarity.scaling();
    ((scale - 1.0).abs() > SIGNIFICANT * sigma).then_some(scale)
}

fn mean(points: &[Point3<f64>]) -> Vector3<f64> {
    points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(radius: f64, wobble: f64) -> Vec<Point3<f64>> {
        (0..20)
            .map(|i| {
                let angle = 0.3 * f64::from(i);
                let wobble = if i % 2 == 0 { wobble } else { -wobble };
                Point3::new(
                    radius * angle.cos(),
                    radius * angle.sin(),
                    0.1 * angle + wobble,
                )
            })
            .collect()
    }

    #[test]
    fn the_scale_of_the_path_is_kept_unless_noise_explains_it() {
        let given = circle(1.0, 0.0);
        let shrunk: Vec<Point3<f64>> = given.iter().map(|p| p * 0.9).collect();
        let scale = significant_scale(&shrunk, &given).unwrap();
        assert!((scale - 1.0 / 0.9).abs() < 1e-9, "{scale}");
        assert_eq!(significant_scale(&circle(0.999, 0.05), &given), None);
        // A straight path has no similarity.
        let line: Vec<Point3<f64>> = (0..9)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .collect();
        assert_eq!(significant_scale(&line, &line), None);
    }
}
