use linecarve_carving::VertexId;
use nalgebra::Point3;

use super::*;
use crate::map::surface::VertexSource;

/// Numbers between -1 and 1 that look random.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(0x5851_f42d_4c95_7f2d)
            .wrapping_add(0x1405_7b7e_f767_814f);
        (self.0 >> 33) as f64 / (1u64 << 30) as f64 - 1.0
    }

    /// The sum of three has a deviation of 1, and nearly a normal distribution.
    fn normal(&mut self) -> f64 {
        self.next() + self.next() + self.next()
    }
}

const CENTERS: [[f64; 3]; 3] = [[1.0, 2.0, 9.0], [6.0, 3.0, 8.0], [3.0, 7.0, 9.0]];

/// A square of 8 by 8 at height 0, seen from above, with noise and a tenth of wrong points.
fn square(count: usize, sigma: f64) -> Vec<SeenPoint> {
    let mut noise = Noise(7);
    let mut point = |index: usize| {
        let mut at = [4.0 + 3.9 * noise.next(), 4.0 + 3.9 * noise.next(), 0.4];
        at.iter_mut().for_each(|x| *x += sigma * noise.normal());
        if index.is_multiple_of(10) {
            at[2] += 3.0 + 2.0 * noise.next();
        }
        SeenPoint {
            position: Point3::from(at),
            color: Some([index as u8, 10, 200]),
            views: vec![0, 1 + (index % 2) as u32],
            sigma: Some(0.001),
            pixel: Some(0.02),
        }
    };
    (0..count).map(&mut point).collect()
}

fn centers() -> Vec<Point3<f64>> {
    CENTERS.map(Point3::from).to_vec()
}

fn joined(points: Vec<SeenPoint>) -> Vec<JoinedPoint> {
    join(points, top_level(32.0), &centers())
}

#[test]
fn noise_is_measured_in_spite_of_wrong_points() {
    for sigma in [0.005, 0.01, 0.02, 0.05] {
        let points = square(40_000, sigma);
        // Of joined points the deviation is that of the mean.
        let mut single: Vec<f64> = Vec::new();
        for point in joined(points).iter().filter(|point| point.is_dense) {
            let members = point.rays.iter().map(|[_, count]| count).max();
            let members = f64::from(*members.unwrap());
            single.extend(point.sigma.map(|sigma| sigma * members.sqrt().min(4.0)));
        }
        assert!(single.len() > 200, "{}", single.len());
        single.sort_unstable_by(f64::total_cmp);
        let median = single[single.len() / 2];
        assert!((median / sigma - 1.0).abs() < 0.3, "{median} for {sigma}");
    }
}

#[test]
fn points_join_in_any_order_and_part_by_part() {
    let points = square(60_000, 0.01);
    let whole = joined(points.clone());
    assert!(whole.len() < points.len() / 2, "{}", whole.len());
    let rays = |points: &[JoinedPoint]| -> u32 {
        let rays = points.iter().flat_map(|point| &point.rays);
        rays.map(|[_, count]| count).sum()
    };
    assert_eq!(rays(&whole), 2 * 60_000);
    let mut other = points.clone();
    other.reverse();
    other.rotate_left(777);
    assert_eq!(joined(other), whole);
    // Cubes of the top level, one after the other.
    let top = top_level(32.0);
    let mut sorted = points;
    sorted.sort_by_key(|point| top_cube(&point.position, top));
    let parts = sorted.chunk_by(|a, b| top_cube(&a.position, top) == top_cube(&b.position, top));
    let parts: Vec<JoinedPoint> = parts.flat_map(|part| joined(part.to_vec())).collect();
    assert_eq!(parts, whole);
}

#[test]
fn sparse_points_and_both_sides_of_a_plate_stay_apart() {
    let mut points = square(2_000, 0.01);
    points.iter_mut().for_each(|point| point.pixel = Some(1e-4));
    let sparse = joined(points);
    assert!(sparse.len() == 2_000 && sparse.iter().all(|point| !point.is_dense));
    // The same points, a part of them seen from below.
    let mut points = square(20_000, 0.01);
    points
        .iter_mut()
        .step_by(3)
        .for_each(|point| point.views = vec![3]);
    let mut centers = centers();
    centers.push(Point3::new(4.0, 4.0, -9.0));
    let joined = join(points, top_level(32.0), &centers);
    let dense = joined.iter().filter(|point| point.is_dense);
    let is_mixed =
        |point: &&JoinedPoint| point.rays.len() > 1 && point.rays.iter().any(|ray| ray[0] == 3);
    assert_eq!(dense.filter(is_mixed).count(), 0);
}

#[test]
fn wide_triangles_need_a_view_that_faces_them() {
    let point = |position: [f64; 3]| JoinedPoint {
        position: Point3::from(position),
        color: None,
        rays: vec![[0, 1]],
        sigma: Some(0.01),
        reach: Some(0.5),
        is_dense: true,
    };
    let corners = [
        [0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [0.0, 2.0, 0.0],
        [0.2, 0.0, 0.0],
        [0.0, 0.2, 0.0],
    ];
    let points = corners.map(point);
    let at = |height: f64| CloudSurface::of(points.iter(), vec![Point3::new(0.5, -9.0, height)]);
    let wide = [0, 1, 2].map(|index: usize| points[index].position);
    let small = [0, 3, 4].map(|index: usize| points[index].position);
    // The view sees the triangle at 45 degrees, at 85 degrees, and from below.
    assert!(at(9.0).supports(wide));
    let far = wide.map(|corner| Point3::from(9.0 * corner.coords));
    assert!(at(9.0).supports(far), "nothing is known of the corners");
    assert!(!at(0.8).supports(wide) && !at(-9.0).supports(wide));
    assert!(at(0.8).supports(small));
    let surface = at(9.0);
    let mut bytes = Vec::new();
    for point in &points {
        append_record(point, &mut bytes);
    }
    append_centers(surface.centers(), &mut bytes);
    let read = CloudSurface::from_bytes(&bytes).unwrap();
    assert!(read.supports(wide) && read.supports(small));
    let far_below = [0, 1, 2].map(|k: usize| wide[k] + nalgebra::Vector3::z());
    assert!(read.supports(far_below));
    let position = |_: VertexId| points[1].position;
    let vertices = CloudVertices {
        surface: &read,
        position,
    };
    assert_eq!(vertices.fit(VertexId::from_index(0)).bound, 0.02);
    // Cut off, and with views that there are not.
    assert!(CloudSurface::from_bytes(&bytes[3..]).is_none());
    let mut without_views = bytes[..bytes.len() - 32].to_vec();
    append_centers(&[], &mut without_views);
    assert!(CloudSurface::from_bytes(&without_views).is_none());
}

#[test]
fn least_views_follow_from_the_model() {
    use linecarve_sequence::{ModelObservation, ModelPoint, ModelView};
    let view = ModelView {
        name: String::new(),
        world_from_camera: nalgebra::Isometry3::identity(),
        camera: None,
        size_px: Some([100, 100]),
    };
    let views = vec![view; 4];
    let point = |count: u32| ModelPoint {
        point_in_world: Point3::origin(),
        color: None,
        observations: (0..count)
            .map(|view| ModelObservation { view, pixel: None })
            .collect(),
    };
    let least = |pairs: usize, triples: usize| {
        let points: Vec<ModelPoint> = (0..pairs)
            .map(|_| point(2))
            .chain((0..triples).map(|_| point(3)))
            .collect();
        ViewStatistics::of(&points).least_views(&views)
    };
    assert_eq!(
        [least(10, 50), least(50, 10), least(10, 10), least(100, 300)],
        [3, 2, 3, 2]
    );
}

/// The median standard deviation around the points of a cloud.
fn median_deviation(points: impl Iterator<Item = Point3<f64>>) -> f64 {
    const TOP: i32 = 3;
    let mut keyed: Vec<([i64; 3], u64, Point3<f64>)> = points
        .map(|point| (top_cube(&point, TOP), octree::morton(&point, TOP), point))
        .collect();
    keyed.sort_by_key(|(cube, code, _)| (*cube, *code));
    let mut deviations = Vec::new();
    for block in keyed.chunk_by(|a, b| a.0 == b.0) {
        let positions: Vec<Point3<f64>> = block.iter().map(|(.., point)| *point).collect();
        let codes: Vec<u64> = block.iter().map(|(_, code, _)| *code).collect();
        let patches = noise::patches(&positions, &codes, f64::from(TOP).exp2());
        deviations.extend(patches.into_iter().flatten().map(|patch| patch.sigma));
    }
    assert!(deviations.len() > 10_000, "{}", deviations.len());
    deviations.sort_unstable_by(f64::total_cmp);
    deviations[deviations.len() / 2]
}

#[test]
fn the_noise_of_a_city_is_measured_in_spite_of_wrong_points() {
    for noise in [0.01, 0.02, 0.05] {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path().join("city");
        let mut options = linecarve_synth::CityOptions::new(60_000, 1);
        (options.noise, options.wrong) = (noise, 0.1);
        linecarve_synth::write_city(&options, &at).unwrap();
        let cloud = linecarve_sequence::DenseCloud::open(&at.join("fused.ply"));
        let mut points = Vec::new();
        let visited = cloud.unwrap().unwrap().visit(|point| {
            points.push(point.point_in_world);
            Ok::<(), linecarve_sequence::SequenceError>(())
        });
        visited.unwrap();
        let median = median_deviation(points.into_iter());
        assert!((median / noise - 1.0).abs() < 0.3, "{median} for {noise}");
    }
}
