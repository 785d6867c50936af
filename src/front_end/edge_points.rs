//! Points on image edges that are on no segment: curved edges, and straight ones too short or too noisy for a fit.
//!
//! From images alone edges are most of what has a depth, so that what lies on no segment is missing from the surface as well.

use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::depth::semi_dense::SurfacePoint;
use linecarve_lines::edges::EdgeChains;
use linecarve_lines::fit::Segment;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

/// Of the pixels of a stretch at least this share must have a depth.
const LEAST_SHARE: f64 = 0.5;
/// Of those at least this share must agree with their median.
const LEAST_AGREEING: f64 = 0.75;
/// Depths agree that differ by at most this many of their standard deviations.
const AGREEMENT_SIGMAS: f32 = 2.0;

/// A point by itself: of an image edge, or between edges.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EdgePoint {
    /// Where it is in the image.
    pub pixel: Point2<f64>,
    /// Its inverse depth.
    pub inverse_depth: f64,
    /// Standard deviation of that.
    pub sigma: f64,
}

impl From<SurfacePoint> for EdgePoint {
    fn from(point: SurfacePoint) -> Self {
        Self {
            pixel: point.pixel.map(f64::from).into(),
            inverse_depth: point.depth.rho.into(),
            sigma: point.depth.sigma.into(),
        }
    }
}

/// The points of edges that are on none of `segments`, which were found along these chains in this depth. Each stands for a
/// stretch of `spacing_px` pixels whose depths agree with each other: the pixel with the median depth. With a spacing of 0 there are
/// none.
///
/// # Complexity
/// Linear in the pixels of all chains.
pub(super) fn edge_points(
    chains: &EdgeChains,
    depth: &InverseDepthMap,
    segments: &[Segment],
    spacing_px: usize,
) -> Vec<EdgePoint> {
    if spacing_px == 0 {
        return Vec::new();
    }
    let mut is_on_segment = vec![false; chains.pixels().len()];
    for segment in segments {
        is_on_segment[segment.pixels.start as usize..segment.pixels.end as usize].fill(true);
    }
    let mut points = Vec::new();
    let mut known: Vec<(f32, f32, usize)> = Vec::new();
    for (index, chain) in chains.iter().enumerate() {
        let start = chains.start(index);
        let on_segment = &is_on_segment[start..start + chain.len()];
        let mut from = 0;
        while from < chain.len() {
            let free = on_segment[from..].iter().take_while(|is| !**is).count();
            for stretch in (from..from + free).step_by(spacing_px) {
                let end = stretch.saturating_add(spacing_px).min(from + free);
                known.clear();
                known.extend((stretch..end).filter_map(|position| {
                    let [x, y] = chain[position];
                    let measured = depth.get(usize::from(x), usize::from(y))?;
                    Some((measured.rho, measured.sigma, start + position))
                }));
                if let Some(point) = representative(&mut known, end - stretch, spacing_px) {
                    points.push(EdgePoint {
                        pixel: chains.positions()[point.2].map(f64::from).into(),
                        inverse_depth: point.0.into(),
                        sigma: point.1.into(),
                    });
                }
            }
            from += free.max(1);
        }
    }
    points
}

/// The median of the known depths of a stretch, if that is long enough and they agree.
fn representative(
    known: &mut [(f32, f32, usize)],
    length: usize,
    spacing_px: usize,
) -> Option<(f32, f32, usize)> {
    let is_long = length >= spacing_px.div_ceil(2) && !known.is_empty();
    if !is_long || (known.len() as f64) < LEAST_SHARE * length as f64 {
        return None;
    }
    let middle = known.len() / 2;
    known.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let median = known[middle];
    let agreeing = known
        .iter()
        .filter(|(rho, sigma, _)| {
            (rho - median.0).abs() <= AGREEMENT_SIGMAS * sigma.hypot(median.1)
        })
        .count();
    (agreeing as f64 >= LEAST_AGREEING * known.len() as f64).then_some(median)
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::depth::InverseDepth;
    use linecarve_lines::edges::EdgeDetector;
    use linecarve_lines::image::GrayImage;

    /// The chains of an image with one upright edge, and the depths that its pixels have, by their places on the edge.
    fn edge(rho: impl Fn(usize) -> Option<f32>) -> (EdgeChains, InverseDepthMap) {
        let samples = (0..64 * 64)
            .map(|at| if at % 64 < 32 { 20 } else { 200 })
            .collect();
        let image = GrayImage::new(64, 64, samples).expect("the sizes agree");
        let chains = EdgeDetector::default().detect(&image);
        let mut depth = InverseDepthMap::unknown(64, 64).expect("not empty");
        for (place, [x, y]) in chains.pixels().iter().enumerate() {
            let measured = rho(place).and_then(|rho| InverseDepth::new(rho, 0.01));
            depth.set(usize::from(*x), usize::from(*y), measured);
        }
        (chains, depth)
    }

    #[test]
    fn stretches_with_agreeing_depths_have_a_point_each() {
        let (chains, depth) = edge(|_| Some(0.5));
        let points = edge_points(&chains, &depth, &[], 10);
        assert!(points.len() >= chains.pixels().len() / 10 && points.len() >= 4);
        for point in &points {
            assert!((point.inverse_depth - 0.5).abs() < 1e-6);
            assert!((point.pixel.x - 31.5).abs() < 1.0, "{}", point.pixel);
        }
    }

    #[test]
    fn no_points_without_a_spacing_or_with_one_longer_than_any_edge() {
        let (chains, depth) = edge(|_| Some(0.5));
        for spacing_px in [0, usize::MAX] {
            assert!(edge_points(&chains, &depth, &[], spacing_px).is_empty());
        }
    }

    #[test]
    fn stretches_that_disagree_or_are_hardly_known_have_none() {
        let (chains, depth) = edge(|place| Some(0.5 + 0.1 * (place % 3) as f32));
        assert!(edge_points(&chains, &depth, &[], 10).is_empty());
        let (chains, depth) = edge(|place| (place % 4 == 0).then_some(0.5));
        assert!(edge_points(&chains, &depth, &[], 10).is_empty());
    }
}
