//! Edge points on no segment: curved edges, and straight ones too short or too noisy for a fit.
//!
//! Without a depth camera most depth lies on edges; without these points the surface lacks all that is on no segment.

use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::edges::EdgeChains;
use linecarve_lines::fit::Segment;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

/// Least share of the pixels of a piece with a depth.
const MIN_KNOWN_SHARE: f64 = 0.5;
/// Least share of these that agree with their median.
const MIN_AGREEING_SHARE: f64 = 0.75;
/// Largest difference of agreeing depths, in standard deviations.
const AGREEMENT_SIGMAS: f32 = 2.0;

/// A single point on an image edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EdgePoint {
    /// Position in the image.
    pub pixel: Point2<f64>,
    /// Inverse depth.
    pub inverse_depth: f64,
    /// Standard deviation of the inverse depth.
    pub sigma: f64,
}

/// Points of the chains that are on none of `segments`. Each represents a piece of `spacing_px` pixels whose depths agree, by
/// the pixel with the median depth. A spacing of 0 gives none.
///
/// # Complexity
/// Linear in the number of chain pixels.
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
            for piece in (from..from + free).step_by(spacing_px) {
                let end = piece.saturating_add(spacing_px).min(from + free);
                known.clear();
                known.extend((piece..end).filter_map(|position| {
                    let [x, y] = chain[position];
                    let measured = depth.get(usize::from(x), usize::from(y))?;
                    Some((measured.rho, measured.sigma, start + position))
                }));
                if let Some(point) = representative(&mut known, end - piece, spacing_px) {
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

/// The median depth of a piece, if it is long enough and its depths agree.
fn representative(
    known: &mut [(f32, f32, usize)],
    length: usize,
    spacing_px: usize,
) -> Option<(f32, f32, usize)> {
    let is_long = length >= spacing_px.div_ceil(2) && !known.is_empty();
    if !is_long || (known.len() as f64) < MIN_KNOWN_SHARE * length as f64 {
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
    (agreeing as f64 >= MIN_AGREEING_SHARE * known.len() as f64).then_some(median)
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::depth::InverseDepth;
    use linecarve_lines::edges::EdgeDetector;
    use linecarve_lines::image::GrayImage;

    /// The chains of an image with one vertical edge, and a depth for each of its pixels by their index along the edge.
    fn edge(rho: impl Fn(usize) -> Option<f32>) -> (EdgeChains, InverseDepthMap) {
        let samples = (0..64 * 64)
            .map(|at| if at % 64 < 32 { 20 } else { 200 })
            .collect();
        let image = GrayImage::new(64, 64, samples).expect("the sizes agree");
        let chains = EdgeDetector::default().detect(&image);
        let mut depth = InverseDepthMap::unknown(64, 64).expect("not empty");
        for (position, [x, y]) in chains.pixels().iter().enumerate() {
            let measured = rho(position).and_then(|rho| InverseDepth::new(rho, 0.01));
            depth.set(usize::from(*x), usize::from(*y), measured);
        }
        (chains, depth)
    }

    #[test]
    fn pieces_with_agreeing_depths_have_a_point_each() {
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
    fn pieces_with_few_or_disagreeing_depths_have_none() {
        let (chains, depth) = edge(|position| Some(0.5 + 0.1 * (position % 3) as f32));
        assert!(edge_points(&chains, &depth, &[], 10).is_empty());
        let (chains, depth) = edge(|position| (position % 4 == 0).then_some(0.5));
        assert!(edge_points(&chains, &depth, &[], 10).is_empty());
    }
}
