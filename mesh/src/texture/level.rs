//! Offsets that bring each view to the mean of all views at the vertices, so that neighbouring charts meet in one colour.

use rustc_hash::FxHashMap;

use super::observe::Observation;
use super::quality::leveled;
use crate::TriangleMesh;

/// Largest offset of a channel, in sRGB steps.
const MAX_OFFSET: f32 = 48.0;

/// An offset for each corner of each triangle, to add to the levelled colours of its view; zero for triangles without one.
///
/// At a vertex, a view's offset is the mean over the triangles around the vertex that the view sees of the difference between
/// the mean of all views and its own colour. Charts of two views that meet at the vertex differ by what the means do not share.
pub(super) fn offsets(
    mesh: &TriangleMesh,
    of_triangle: &[Vec<Observation>],
    labels: &[Option<usize>],
    gains: &[[f32; 3]],
) -> Vec<[[f32; 3]; 3]> {
    let mut sums: FxHashMap<(u32, u32), ([f32; 3], f32)> = FxHashMap::default();
    let view = |triangle: usize| labels[triangle].map(|at| of_triangle[triangle][at].view);
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(view) = view(triangle) {
            for corner in corners {
                sums.entry((*corner, view)).or_default();
            }
        }
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let observations = &of_triangle[triangle];
        let Some(mean) = mean(observations, gains) else {
            continue;
        };
        let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize]);
        let area = 0.5 * (b - a).cross(&(c - a)).norm() as f32;
        for observation in observations.iter().filter(|o| o.is_comparable()) {
            let color = leveled(observation, gains);
            let weight = area * observation.share;
            for corner in corners {
                if let Some((sum, total)) = sums.get_mut(&(*corner, observation.view)) {
                    for channel in 0..3 {
                        sum[channel] += weight * (mean[channel] - color[channel]);
                    }
                    *total += weight;
                }
            }
        }
    }
    let offset = |vertex: u32, view: u32| match sums.get(&(vertex, view)) {
        Some((sum, total)) if *total > 0.0 => {
            sum.map(|value| (value / total).clamp(-MAX_OFFSET, MAX_OFFSET))
        }
        _ => [0.0; 3],
    };
    let triangles = mesh.triangles.iter().enumerate();
    triangles
        .map(|(triangle, corners)| match view(triangle) {
            Some(view) => corners.map(|corner| offset(corner, view)),
            None => [[0.0; 3]; 3],
        })
        .collect()
}

/// Mean colour of a triangle over the views that see all of it, weighted by quality.
fn mean(observations: &[Observation], gains: &[[f32; 3]]) -> Option<[f32; 3]> {
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for observation in observations.iter().filter(|o| o.is_comparable()) {
        for (sum, value) in sum.iter_mut().zip(leveled(observation, gains)) {
            *sum += observation.quality * value;
        }
        total += observation.quality;
    }
    (total > 0.0).then(|| sum.map(|value| value / total))
}
