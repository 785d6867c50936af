//! Colours of the vertices of a surface that was made from depth images.

use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;
use rayon::prelude::*;

use super::surface::DEFAULT_COLOR;
use super::surface_points::KeyframeSurface;
use crate::front_end::{KeyframeColors, PackedColors};

/// Keyframes whose colours are unpacked at a time.
const UNPACKED_KEYFRAMES: usize = 16;

/// The colours of the vertices: means over the keyframes that measured a surface there, weighted by the area of a pixel. Others have that
/// of their neighbours. `None` when no vertex has a colour. `surfaces` and `colors` are those of the same keyframes.
///
/// # Complexity
/// O(vertices x keyframes).
pub(super) fn vertex_colors(
    mesh: &TriangleMesh,
    surfaces: &[KeyframeSurface<'_>],
    colors: &[Option<&PackedColors>],
) -> Option<Vec<[u8; 3]>> {
    let mut sums = vec![ColorSum::default(); mesh.positions.len()];
    let batches = surfaces.chunks(UNPACKED_KEYFRAMES);
    for (surfaces, colors) in batches.zip(colors.chunks(UNPACKED_KEYFRAMES)) {
        let colors = colors.par_iter();
        let colors: Vec<Option<KeyframeColors>> = colors
            .map(|colors| colors.map(PackedColors::unpack))
            .collect();
        let vertices = mesh.positions.par_iter().zip(&mut sums);
        vertices.for_each(|(position, sum)| sum.observe(position, surfaces, &colors));
    }
    let mut found: Vec<Option<[u8; 3]>> = sums.iter().map(ColorSum::mean).collect();
    found.iter().any(Option::is_some).then(|| {
        spread(&mut found, &mesh.triangles);
        let color = |color: Option<[u8; 3]>| color.unwrap_or(DEFAULT_COLOR);
        found.into_iter().map(color).collect()
    })
}

/// Weighted colours of a vertex.
#[derive(Clone, Copy, Default)]
struct ColorSum {
    sums: [f64; 3],
    total: f64,
}

impl ColorSum {
    /// Adds the colours that keyframes observed, in their order.
    fn observe(
        &mut self,
        position: &Point3<f64>,
        surfaces: &[KeyframeSurface<'_>],
        colors: &[Option<KeyframeColors>],
    ) {
        for (surface, colors) in surfaces.iter().zip(colors) {
            let Some((pixel, rho)) = surface.place_on(position) else {
                continue;
            };
            if let Some(color) = colors.as_ref().and_then(|colors| colors.at(&pixel)) {
                let weight = rho * rho;
                for (sum, value) in self.sums.iter_mut().zip(color) {
                    *sum += weight * f64::from(value);
                }
                self.total += weight;
            }
        }
    }

    /// `None` where no keyframe observed one.
    fn mean(&self) -> Option<[u8; 3]> {
        (self.total > 0.0).then(|| self.sums.map(|sum| (sum / self.total).round() as u8))
    }
}

/// Gives vertices without a colour the mean of those of their neighbours, from neighbour to neighbour.
fn spread(colors: &mut [Option<[u8; 3]>], triangles: &[[u32; 3]]) {
    loop {
        let mut sums = vec![[0_u32; 4]; colors.len()];
        for triangle in triangles {
            for (vertex, neighbour) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
                let [vertex, neighbour] =
                    [vertex, neighbour].map(|it: usize| triangle[it] as usize);
                if let (None, Some([r, g, b])) = (colors[vertex], colors[neighbour]) {
                    for (sum, value) in sums[vertex].iter_mut().zip([r, g, b, 1]) {
                        *sum += u32::from(value);
                    }
                }
            }
        }
        let mut is_changed = false;
        for (color, [r, g, b, count]) in colors.iter_mut().zip(sums) {
            if count > 0 {
                *color = Some([r, g, b].map(|sum| ((sum + count / 2) / count) as u8));
                is_changed = true;
            }
        }
        if !is_changed {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
    use linecarve_lines::triangulation::{SampleOptions, SurfaceSamples};
    use linecarve_sequence::ColorImage;
    use nalgebra::Isometry3;

    use super::*;
    use crate::options::SurfacePointOptions;

    /// Colours of an image that is `left` in its left half and `right` in the other.
    fn halves(left: [u8; 3], right: [u8; 3]) -> KeyframeColors {
        let color = |x, _| image::Rgb(if x < 80 { left } else { right });
        KeyframeColors::of(&ColorImage::from_fn(160, 120, color))
    }

    #[test]
    fn colors_are_those_of_the_keyframes_that_measured_the_surface() {
        let mut map = InverseDepthMap::unknown(160, 120).unwrap();
        for (x, y) in (0..160).flat_map(|x| (0..120).map(move |y| (x, y))) {
            map.set(x, y, InverseDepth::new(0.5, 0.001));
        }
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5).unwrap();
        let options = SurfacePointOptions::default();
        // The last one measured a surface in front of the wall.
        let poses = [0.0, 0.0, -1.0].map(|z| Isometry3::translation(0.0, 0.0, z));
        let surface = |pose| KeyframeSurface::new(&samples, &camera, pose, &options, 0.0);
        let surfaces: Vec<_> = poses.iter().map(surface).collect();
        let colors = [
            halves([10, 0, 0], [0, 100, 0]),
            halves([20, 0, 0], [0, 100, 0]),
            halves([255; 3], [255; 3]),
        ];
        let packed = colors.map(|colors| colors.packed());
        let colors = packed.each_ref().map(Some);
        let mesh = TriangleMesh {
            positions: vec![
                Point3::new(-0.4, 0.0, 2.0),
                Point3::new(0.4, 0.1, 2.0),
                // No keyframe measured these two.
                Point3::new(-0.4, 0.1, 9.0),
                Point3::new(0.0, 5.0, 9.0),
                // Without neighbours.
                Point3::new(0.0, 5.0, 9.0),
            ],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
            colors: None,
        };
        let found = vertex_colors(&mesh, &surfaces, &colors).unwrap();
        // Both triangles of the edge between the second and the third vertex count.
        let expected = [
            [15, 0, 0],
            [0, 100, 0],
            [5, 67, 0],
            [0, 100, 0],
            DEFAULT_COLOR,
        ];
        assert_eq!(found, expected);
        // Without colours there are none.
        assert_eq!(vertex_colors(&mesh, &surfaces, &[None; 3]), None);
    }
}
