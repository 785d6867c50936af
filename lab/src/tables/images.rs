//! Distances of projected lines to image edges of other keyframes, and the share of edges that lines explain.
//!
//! Distance to a surface does not change when a line slides along the surface; distance to an image edge does.

use crate::baselines::{FoundSegment, LineSegment2d};
use linecarve_lines::camera::Camera;
use linecarve_lines::edges::EdgeChains;
use nalgebra::{Isometry3, Point2, Point3, Vector2};
use serde::Serialize;

use super::depth_buffer::DepthBuffer;
use super::edge_field::{EdgeField, direction_bin};
use super::surface::Distances;
use linecarve_mesh::raycast::RayScene;

/// A line is measured in a keyframe where at least this many of its pixels are visible.
const LEAST_VISIBLE_PX: usize = 8;
/// Number of direction bins over half a turn, for explained edges.
const BINS: usize = 16;
/// An edge pixel is explained by a line that passes within this many pixels.
const REACH_PX: usize = 2;
/// Lines are shifted sideways by this much to measure the distance that chance gives.
const CHANCE_SHIFT_PX: f64 = 25.0;

/// A keyframe with its edges, on which lines are measured.
pub struct ImageEdges<'a> {
    /// Number of the keyframe.
    pub keyframe: u32,
    /// Its pinhole camera.
    pub camera: &'a Camera,
    /// Its pose.
    pub world_from_camera: Isometry3<f64>,
    /// Edge chains of its image.
    pub chains: &'a EdgeChains,
    /// Its long straight edges.
    pub long_edges: &'a [LineSegment2d],
}

/// Measurements of one set of lines in one keyframe.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Mean distance to the nearest edge of each visible line, in pixels.
    reprojection: Vec<f64>,
    /// The same for the shifted lines.
    chance: Vec<f64>,
    explained: usize,
    long_edge_pixels: usize,
}

/// Measurements of one set of lines in all keyframes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ImageMeasure {
    /// Distance of lines to the nearest edge of similar direction, in pixels, at most 10. Each line has an entry for every
    /// *other* keyframe that sees it; a line made from several keyframes has one for every keyframe that sees it.
    pub reprojection_px: Distances,
    /// Mean distance of lines shifted by 25 pixels: what chance gives.
    pub chance_mean_px: f64,
    /// Share of the pixels on long straight edges that a line from another keyframe covers.
    pub explained_share: f64,
}

impl ImageMeasure {
    /// Joins the tallies of all keyframes, in order.
    pub fn new(tallies: Vec<Tally>) -> Self {
        let explained: usize = tallies.iter().map(|tally| tally.explained).sum();
        let pixels: usize = tallies.iter().map(|tally| tally.long_edge_pixels).sum();
        let (mut all, mut chance) = (Vec::new(), Vec::new());
        for tally in tallies {
            all.extend(tally.reprojection);
            chance.extend(tally.chance);
        }
        Self {
            reprojection_px: Distances::new(all),
            chance_mean_px: Distances::new(chance).mean,
            explained_share: explained as f64 / pixels.max(1) as f64,
        }
    }
}

/// Measures several sets of lines in one keyframe. Lines hidden by the ground truth `scene` do not count.
pub fn tally(image: &ImageEdges<'_>, scene: &RayScene, sets: &[&[FoundSegment]]) -> Vec<Tally> {
    let size = [image.chains.width(), image.chains.height()];
    let field = EdgeField::new(image.chains);
    let buffer = DepthBuffer::new(scene, image.camera, &image.world_from_camera, size);
    let camera_from_world = image.world_from_camera.inverse();
    let mut marks = Marks::new(size);
    sets.iter()
        .map(|segments| {
            let mut tally = Tally::default();
            marks.clear();
            for segment in *segments {
                if segment.keyframe == Some(image.keyframe) {
                    continue;
                }
                let ends = segment.ends_in_world.map(|end| camera_from_world * end);
                let Some(trace) = Trace::new(image.camera, ends, size) else {
                    continue;
                };
                trace.measure(&field, &buffer, &mut marks, &mut tally);
            }
            marks.count(image, &mut tally);
            tally
        })
        .collect()
}

/// A projected line, clipped to the image.
struct Trace {
    start: Point2<f64>,
    along: Vector2<f64>,
    length_px: f64,
    /// Inverse depth at both ends; linear between them.
    inverse_depths: [f64; 2],
}

impl Trace {
    fn new(camera: &Camera, ends: [Point3<f64>; 2], size: [usize; 2]) -> Option<Self> {
        let ends = in_front(ends)?;
        let pixels = [camera.project(&ends[0])?, camera.project(&ends[1])?];
        let rho = [1.0 / ends[0].z, 1.0 / ends[1].z];
        let whole = pixels[1] - pixels[0];
        // The part of the line inside the image, after Liang and Barsky.
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let limit = size[axis] as f64 - 1.0;
            if whole[axis] == 0.0 {
                if !(0.0..=limit).contains(&pixels[0][axis]) {
                    return None;
                }
                continue;
            }
            let at = |bound: f64| (bound - pixels[0][axis]) / whole[axis];
            let (a, b) = (at(0.0), at(limit));
            low = low.max(a.min(b));
            high = high.min(a.max(b));
        }
        let length_px = whole.norm() * (high - low);
        if !(length_px.is_finite() && length_px >= 1.0 && low < high) {
            return None;
        }
        let between = |share: f64| rho[0] + share * (rho[1] - rho[0]);
        Some(Self {
            start: pixels[0] + whole * low,
            along: whole * (high - low),
            length_px,
            inverse_depths: [between(low), between(high)],
        })
    }

    fn measure(
        &self,
        field: &EdgeField,
        buffer: &DepthBuffer,
        marks: &mut Marks,
        tally: &mut Tally,
    ) {
        let bin = EdgeField::bin(self.along);
        let mark = 1 << direction_bin(self.along, BINS);
        let shift = Vector2::new(-self.along.y, self.along.x) * (CHANCE_SHIFT_PX / self.length_px);
        let steps = self.length_px.ceil() as usize;
        let (mut count, mut sum, mut by_chance) = (0, 0.0, 0.0);
        for step in 0..=steps {
            let share = step as f64 / steps as f64;
            let pixel = self.start + self.along * share;
            let [from, to] = self.inverse_depths;
            let depth = 1.0 / (from + share * (to - from));
            if !buffer.sees(pixel, depth) {
                continue;
            }
            marks.set(pixel, mark);
            count += 1;
            sum += field.distance(pixel, bin);
            by_chance += field.distance(pixel + shift, bin);
        }
        if count >= LEAST_VISIBLE_PX {
            tally.reprojection.push(sum / f64::from(count as u32));
            tally.chance.push(by_chance / f64::from(count as u32));
        }
    }
}

/// The part of a segment in front of the camera; `None` when there is none.
fn in_front(ends: [Point3<f64>; 2]) -> Option<[Point3<f64>; 2]> {
    // A thousandth of the farther end: nothing nearer is ever in view.
    let near = 1e-3 * ends[0].z.max(ends[1].z);
    if !(near.is_finite() && near > 0.0) {
        return None;
    }
    let [a, b] = ends;
    let clip = |end: Point3<f64>, other: Point3<f64>| {
        if end.z >= near {
            end
        } else {
            end + (other - end) * ((near - end.z) / (other.z - end.z))
        }
    };
    Some([clip(a, b), clip(b, a)])
}

/// Directions of the lines that cover each pixel, as bit masks.
struct Marks {
    width: usize,
    height: usize,
    directions: Vec<u16>,
}

impl Marks {
    fn new([width, height]: [usize; 2]) -> Self {
        Self {
            width,
            height,
            directions: vec![0; width * height],
        }
    }

    fn clear(&mut self) {
        self.directions.fill(0);
    }

    fn set(&mut self, pixel: Point2<f64>, direction: u16) {
        let (x, y) = (pixel.x.round() as usize, pixel.y.round() as usize);
        if x < self.width && y < self.height {
            self.directions[y * self.width + x] |= direction;
        }
    }

    /// Counts the explained pixels of the long edges.
    fn count(&self, image: &ImageEdges<'_>, tally: &mut Tally) {
        for edge in image.long_edges {
            let bin = direction_bin(edge.ends_px[1] - edge.ends_px[0], BINS);
            let similar = [bin, bin + 1, bin + BINS - 1]
                .iter()
                .fold(0_u16, |mask, bin| mask | 1 << (bin % BINS));
            for &[x, y] in
                &image.chains.pixels()[edge.pixels.start as usize..edge.pixels.end as usize]
            {
                let (x, y) = (usize::from(x), usize::from(y));
                let is_explained = (y.saturating_sub(REACH_PX)..=y + REACH_PX)
                    .filter(|&y| y < self.height)
                    .any(|y| {
                        let from = x.saturating_sub(REACH_PX);
                        let to = (x + REACH_PX + 1).min(self.width);
                        self.directions[y * self.width + from..y * self.width + to]
                            .iter()
                            .any(|directions| directions & similar != 0)
                    });
                tally.long_edge_pixels += 1;
                tally.explained += usize::from(is_explained);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::baselines::{LineDetector, LineDetectorOptions};
    use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
    use linecarve_lines::image::GrayImage;

    use super::*;
    use linecarve_mesh::TriangleMesh;

    /// A vertical edge in the middle of the image.
    fn measured(segments: &[FoundSegment], scene: &RayScene) -> ImageMeasure {
        let (width, height) = (160, 120);
        let samples = (0..width * height).map(|i| if i % width < 80 { 40 } else { 200 });
        let image = GrayImage::new(width, height, samples.collect()).unwrap();
        let chains = EdgeDetector::new(EdgeOptions::default())
            .unwrap()
            .detect(&image);
        let long_edges = LineDetector::new(LineDetectorOptions::default())
            .unwrap()
            .detect(&image, &chains);
        let camera = Camera::pinhole(100.0, 100.0, 79.5, 59.5).unwrap();
        let edges = ImageEdges {
            keyframe: 1,
            camera: &camera,
            world_from_camera: Isometry3::identity(),
            chains: &chains,
            long_edges: &long_edges,
        };
        ImageMeasure::new(tally(&edges, scene, &[segments]))
    }

    fn vertical(x_px: f64, keyframe: u32) -> FoundSegment {
        let at = |y: f64| Point3::new((x_px - 79.5) / 100.0 * 2.0, y, 2.0);
        FoundSegment {
            ends_in_world: [at(-0.8), at(0.8)],
            keyframe: Some(keyframe),
        }
    }

    #[test]
    fn a_line_beside_its_edge_is_as_far_off_as_it_is() {
        let nothing = RayScene::new(&TriangleMesh::default());
        let on = measured(&[vertical(79.5, 0)], &nothing);
        assert!(on.reprojection_px.mean < 0.6, "{on:?}");
        assert!(on.explained_share > 0.65, "{on:?}");
        assert_eq!(on.chance_mean_px, EdgeField::CAP);
        let beside = measured(&[vertical(84.5, 0)], &nothing);
        assert!(
            (beside.reprojection_px.mean - 5.0).abs() < 0.6,
            "{beside:?}"
        );
        assert_eq!(beside.explained_share, 0.0);
    }

    #[test]
    fn a_keyframe_does_not_judge_its_own_lines() {
        let nothing = RayScene::new(&TriangleMesh::default());
        let own = measured(&[vertical(79.5, 1)], &nothing);
        assert_eq!((own.reprojection_px.count, own.explained_share), (0, 0.0));
    }

    #[test]
    fn hidden_lines_do_not_count() {
        let wall = TriangleMesh {
            positions: vec![
                Point3::new(-9.0, -9.0, 1.0),
                Point3::new(9.0, -9.0, 1.0),
                Point3::new(0.0, 9.0, 1.0),
            ],
            triangles: vec![[0, 1, 2]],
            colors: None,
        };
        let hidden = measured(&[vertical(79.5, 0)], &RayScene::new(&wall));
        assert_eq!(hidden.reprojection_px.count, 0);
    }

    #[test]
    fn lines_behind_or_beside_the_camera_do_no_harm() {
        let nothing = RayScene::new(&TriangleMesh::default());
        let behind = |z: f64| FoundSegment {
            ends_in_world: [Point3::new(0.0, 0.0, z), Point3::new(0.1, 0.0, -1.0)],
            keyframe: None,
        };
        let far = FoundSegment {
            ends_in_world: [Point3::new(-1e300, 0.0, 1.0), Point3::new(1e300, 1.0, 1.0)],
            keyframe: None,
        };
        let lost = FoundSegment {
            ends_in_world: [Point3::new(f64::NAN, 0.0, 1.0), Point3::new(0.0, 1.0, 1.0)],
            keyframe: None,
        };
        let seen = vertical(79.5, 0);
        let invisible = [behind(-2.0), behind(0.0), far, lost, seen];
        assert_eq!(measured(&invisible, &nothing), measured(&[seen], &nothing));

        // The part in front of the camera crosses half of the image, at right angles to its edge.
        let crossing = measured(&[behind(2.0)], &nothing);
        assert_eq!(crossing.reprojection_px.count, 1);
        assert_eq!(crossing.reprojection_px.mean, EdgeField::CAP);
        assert_eq!(crossing.explained_share, 0.0);
    }
}
