use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_lines::image::Plane;
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::*;
use crate::edge_uses::for_each_edge;
use crate::feature_edges::UniquePositions;

fn camera() -> Camera {
    Camera::pinhole(160.0, 160.0, 99.5, 74.5).unwrap()
}

/// Depth of a scene, given by the distance along a ray from a point, as a view with this pose has it.
fn depth_of(
    pose: &Isometry3<f64>,
    hit: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>,
) -> CompactDepth {
    let camera = camera();
    let samples = (0..150)
        .flat_map(|y| (0..200).map(move |x| (x, y)))
        .map(|(x, y)| {
            let ray = Vector3::new(
                (f64::from(x) - 99.5) / 160.0,
                (f64::from(y) - 74.5) / 160.0,
                1.0,
            );
            hit(&pose.translation.vector.into(), &(pose * ray)).unwrap_or(0.0) as f32
        });
    let depth = Plane::new(200, 150, samples.collect()).unwrap();
    let sensor = DepthSensor::registered(&camera, SensorNoise::relative_at(0.003, 2.0, 0.0));
    CompactDepth::new(&depth, &sensor, &camera)
}

/// The sphere of radius 0.5 around the origin.
fn sphere(from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let (a, b) = (ray.norm_squared(), from.coords.dot(ray));
    let c = from.coords.norm_squared() - 0.25;
    let root = b * b - a * c;
    (root > 0.0).then(|| (-b - root.sqrt()) / a)
}

/// A pose at two units from the origin that looks at it.
fn looking_from(direction: Vector3<f64>) -> Isometry3<f64> {
    let up = if direction.x.abs() > 0.9 {
        Vector3::y()
    } else {
        Vector3::x()
    };
    let rotation = Rotation3::face_towards(&-direction, &up);
    Isometry3::from_parts((2.0 * direction).into(), UnitQuaternion::from(rotation))
}

fn around() -> Vec<Isometry3<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    axes.iter()
        .flat_map(|axis| [*axis, -axis])
        .map(looking_from)
        .collect()
}

fn fused(poses: &[Isometry3<f64>], depths: &[CompactDepth], side: f64) -> TriangleMesh {
    fused_along(&[], poses, depths, side)
}

fn fused_along(
    segments: &[[Point3<f64>; 2]],
    poses: &[Isometry3<f64>],
    depths: &[CompactDepth],
    side: f64,
) -> TriangleMesh {
    let views: Vec<PosedDepth<'_>> = poses
        .iter()
        .zip(depths)
        .map(|(pose, depth)| PosedDepth::new(depth, pose))
        .collect();
    fuse_depth(&views, segments, &FusionOptions::with_side(side))
}

#[test]
fn a_sphere_seen_from_all_sides_is_closed_and_round() {
    let poses = around();
    let depths: Vec<_> = poses.iter().map(|pose| depth_of(pose, sphere)).collect();
    let mesh = fused(&poses, &depths, 0.05);
    mesh.validate().unwrap();
    assert!(mesh.triangles.len() > 2000);
    let off = |position: &Point3<f64>| (position.coords.norm() - 0.5).abs();
    let sum: f64 = mesh.positions.iter().map(off).sum();
    assert!(sum < 0.015 * mesh.positions.len() as f64, "{sum}");
    // More where views see the sphere at a grazing angle, and only the nearest pixel counts.
    assert!(mesh.positions.iter().map(off).all(|off| off < 0.06));
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .collect();
    edges.sort_unstable();
    for [a, b] in &edges {
        assert!(edges.binary_search(&[*b, *a]).is_ok(), "an open edge");
    }
    edges.dedup();
    assert_eq!(edges.len(), 3 * mesh.triangles.len());
    // Euler: a sphere.
    assert_eq!(mesh.positions.len() * 2, mesh.triangles.len() + 4);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        assert!(
            (b - a).cross(&(c - a)).dot(&a.coords) > 0.0,
            "turned inside"
        );
    }
}

#[test]
fn the_order_of_views_does_not_matter() {
    let mut poses = around();
    let mut depths: Vec<_> = poses.iter().map(|pose| depth_of(pose, sphere)).collect();
    let mesh = fused(&poses, &depths, 0.06);
    poses.reverse();
    depths.reverse();
    let reversed = fused(&poses, &depths, 0.06);
    assert_eq!(mesh.triangles, reversed.triangles);
    for (a, b) in mesh.positions.iter().zip(&reversed.positions) {
        assert!((a - b).norm() < 1e-6);
    }
}

/// A board of the given half width before a wall three units away.
fn board(from: &Point3<f64>, ray: &Vector3<f64>, half: f64) -> Option<f64> {
    let at = from + ray * ((2.0 - from.z) / ray.z);
    let is_hit = at.x.abs() <= half && at.y.abs() <= half;
    Some(if is_hit { 2.0 - from.z } else { 3.0 - from.z } / ray.z * ray.z)
}

#[test]
fn a_board_reaches_to_its_outline_and_nothing_connects_it_with_the_wall() {
    let side = 0.03;
    let poses: Vec<_> = [-0.2, 0.0, 0.2]
        .map(|x| Isometry3::translation(x, 0.0, 0.0))
        .into();
    let depths: Vec<_> = poses
        .iter()
        .map(|pose| depth_of(pose, |from, ray| board(from, ray, 0.3)))
        .collect();
    let mesh = fused(&poses, &depths, side);
    let near: Vec<_> = mesh.positions.iter().filter(|p| p.z < 2.5).collect();
    let reach = |along: fn(&Point3<f64>) -> f64| near.iter().map(|p| along(p)).fold(0.0, f64::max);
    let directions: [fn(&Point3<f64>) -> f64; 4] = [|p| p.x, |p| -p.x, |p| p.y, |p| -p.y];
    for along in directions {
        let reach = reach(along);
        assert!((0.3 - 1.5 * side..0.3 + side).contains(&reach), "{reach}");
    }
    assert!(
        mesh.positions
            .iter()
            .all(|p| (p.z - 2.0).abs() < 0.01 || (p.z - 3.0).abs() < 0.01)
    );
}

/// The inside of a box corner at z = 2 + |x|: two planes that meet along a vertical edge.
fn ridge(from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let hit = |sign: f64| {
        let depth = (2.0 - from.z + sign * from.x) / (ray.z - sign * ray.x);
        let x = from.x + ray.x * depth;
        (sign * x >= 0.0).then_some(depth)
    };
    hit(1.0).or_else(|| hit(-1.0))
}

/// Share of the line from (x, -0.5, z) to (x, 0.5, z) along which a vertical edge of the mesh lies within `reach`.
fn share_along(mesh: &TriangleMesh, [x, z]: [f64; 2], reach: f64) -> f64 {
    let is_near = |p: &Point3<f64>| (p.x - x).hypot(p.z - z) < reach;
    let covers = |y: f64| {
        mesh.triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|edge| edge.map(|end| mesh.positions[end as usize]))
            .any(|[p, q]| is_near(&p) && is_near(&q) && (p.y - y) * (q.y - y) <= 0.0)
    };
    (0..100)
        .filter(|k| covers(f64::from(*k) / 100.0 - 0.5))
        .count() as f64
        / 100.0
}

#[test]
fn an_edge_and_a_boundary_lie_on_segments_and_texture_does_not_count() {
    let side = 0.05;
    let vertical = |x: f64, z: f64| [-0.6, 0.6].map(|y| Point3::new(x, y, z));
    let poses: Vec<_> = [-0.2, 0.013, 0.2]
        .map(|x| Isometry3::translation(x, 0.0, 0.0))
        .into();
    let depths = |hit: fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>| -> Vec<_> {
        poses.iter().map(|pose| depth_of(pose, hit)).collect()
    };
    let edge = depths(ridge);
    assert!(share_along(&fused(&poses, &edge, side), [0.0, 2.0], 1e-9) < 0.1);
    let sharp = fused_along(&[vertical(0.0, 2.0)], &poses, &edge, side);
    assert!(share_along(&sharp, [0.0, 2.0], 1e-9) > 0.9);
    // Nor is the surface beside the edge rounded, wherever the grid lies.
    for side in [0.043, 0.047] {
        let sharp = fused_along(&[vertical(0.0, 2.0)], &poses, &edge, side);
        let inside = sharp.positions.iter().filter(|p| p.y.abs() < 0.5);
        let near = inside.filter(|p| p.x.abs() < 2.0 * side);
        let off = near.map(|p| (p.z - 2.0 - p.x.abs()).abs());
        let worst = off.fold(0.0, f64::max);
        assert!(worst < 0.02 * side, "{worst}");
    }

    let boundary = depths(|from, ray| board(from, ray, 0.6).filter(|depth| *depth < 2.5));
    let rough = fused(&poses, &boundary, side);
    assert!(share_along(&rough, [0.607, 2.0], 1e-9) < 0.1);
    let straight = fused_along(&[vertical(0.607, 2.0)], &poses, &boundary, side);
    assert!(share_along(&straight, [0.607, 2.0], 1e-9) > 0.9);

    // Beside the surface, and far away or not finite as well.
    let texture = vertical(0.21, 2.004);
    let others = [texture, vertical(f64::NAN, 2.0), vertical(1e30, 2.0)];
    assert!(fused_along(&others, &poses, &boundary, side) == rough);
}

/// Open edges of the mesh within 0.3 of the line x = 0 and 0.5 of the line y = 0.
fn open_edges_in_the_middle(mesh: &TriangleMesh) -> usize {
    let is_in_the_middle = |end: &u32| {
        let position = mesh.positions[*end as usize];
        position.x.abs() < 0.3 && position.y.abs() < 0.5
    };
    let mut count = 0;
    for_each_edge(&mesh.triangles, mesh.positions.len(), |ends, corners| {
        count += usize::from(corners.len() == 1 && ends.iter().all(is_in_the_middle));
    });
    count
}

#[test]
fn lips_of_a_slit_along_a_segment_are_joined_but_not_surfaces_at_two_depths() {
    let side = 0.05;
    let segment = [-0.6, 0.6].map(|y| Point3::new(0.0, y, 2.0));
    let poses: Vec<_> = [-0.1, 0.013, 0.1]
        .map(|x| Isometry3::translation(x, 0.0, 0.0))
        .into();
    // The first is a wall on which a strip has no depth. In the second, what is to its right lies two cubes further away.
    for (right, start, is_joined) in [(2.0, 0.09, true), (2.1, 0.04, false)] {
        let hit = |from: &Point3<f64>, ray: &Vector3<f64>| {
            let depths = [2.0, right].map(|z| (z - from.z) / ray.z);
            let [left, right] = depths.map(|depth| (depth, from.x + ray.x * depth));
            let is_left = left.1 < -0.09;
            (is_left || right.1 > start).then_some(if is_left { left.0 } else { right.0 })
        };
        let depths: Vec<_> = poses.iter().map(|pose| depth_of(pose, hit)).collect();
        let open = open_edges_in_the_middle(&fused(&poses, &depths, side));
        assert!(open > 30, "{open}");
        let mesh = fused_along(&[segment], &poses, &depths, side);
        mesh.validate().unwrap();
        let open = open_edges_in_the_middle(&mesh);
        assert_eq!(open < 3, is_joined, "{open}");
    }
}

/// A table top at y = 0.3 that ends at z = 2, 0.15 before a wall.
fn table(from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let to_top = (0.3 - from.y) / ray.y;
    let is_top = ray.y > 0.0 && from.z + to_top * ray.z <= 2.0;
    Some(if is_top {
        to_top
    } else {
        (2.15 - from.z) / ray.z
    })
}

#[test]
fn no_surface_leads_through_the_shadow_of_a_rim_that_a_segment_shows() {
    let side = 0.05;
    let poses: Vec<_> = [-0.3, -0.22, -0.13, -0.05, 0.04]
        .map(|y| Isometry3::translation(0.01, y, 0.0))
        .into();
    let depths: Vec<_> = poses.iter().map(|pose| depth_of(pose, table)).collect();
    // Within a cube of the rim.
    let in_shadow = |mesh: &TriangleMesh| {
        let is_in = |p: &&Point3<f64>| (2.01..2.05).contains(&p.z) && p.x.abs() < 0.6;
        mesh.positions.iter().filter(is_in).count()
    };
    let rim = [-0.8, 0.8].map(|x| Point3::new(x, 0.3, 2.0));
    // A line on the top ends nothing.
    let line = [-0.8, 0.8].map(|x| Point3::new(x, 0.3, 1.7));
    let rough = fused_along(&[line], &poses, &depths, side);
    assert!(in_shadow(&rough) > 20, "{}", in_shadow(&rough));
    let mesh = fused_along(&[line, rim], &poses, &depths, side);
    mesh.validate().unwrap();
    assert_eq!(in_shadow(&mesh), 0);
    let on_rim = |p: &&Point3<f64>| (p.y - 0.3).hypot(p.z - 2.0) < 1e-9 && p.x.abs() < 0.6;
    let count = mesh.positions.iter().filter(on_rim).count();
    assert!(count > 20, "{count}");
    // The wall and the rest of the top stay.
    let elsewhere = |mesh: &TriangleMesh| {
        let is_elsewhere = |p: &&Point3<f64>| p.z < 1.9 || p.z > 2.13 && p.y < 0.2;
        mesh.positions.iter().filter(is_elsewhere).count()
    };
    assert_eq!(elsewhere(&mesh), elsewhere(&rough));
}

#[test]
fn a_boundary_has_the_corner_at_which_two_segments_would_meet() {
    let poses: Vec<_> = [-0.2, 0.0, 0.2]
        .map(|x| Isometry3::translation(x, 0.0, 0.0))
        .into();
    let depths: Vec<_> = poses
        .iter()
        .map(|pose| depth_of(pose, |from, ray| board(from, ray, 0.6)))
        .collect();
    let corner = Point3::new(0.6, 0.6, 2.0);
    let to_corner = |from: [f64; 3]| [Point3::from(from), corner - Vector3::new(0.05, 0.05, 0.0)];
    let [mut upright, mut level] = [[0.6, -0.5, 2.0], [-0.5, 0.6, 2.0]].map(to_corner);
    (upright[1].x, level[1].y) = (0.6, 0.6);
    let apart = |mesh: &TriangleMesh| {
        let apart = |p: &Point3<f64>| (p - corner).norm();
        mesh.positions
            .iter()
            .map(apart)
            .fold(f64::INFINITY, f64::min)
    };
    let both = fused_along(&[upright, level], &poses, &depths, 0.05);
    both.validate().unwrap();
    assert!(apart(&both) < 1e-9, "{}", apart(&both));
    assert!(apart(&fused_along(&[upright], &poses, &depths, 0.05)) > 1e-3);
}

#[test]
fn sheets_that_touch_are_separate() {
    // Two tetrahedra with a common edge.
    let positions: Vec<Point3<f64>> = [
        [0, 0, 0],
        [0, 0, 1],
        [1, 0, 0],
        [0, 1, 0],
        [-1, 0, 0],
        [0, -1, 0],
    ]
    .map(|p: [i32; 3]| Point3::from(p.map(f64::from)))
    .into();
    let tetrahedron = |[a, b, c, d]: [u32; 4]| [[a, c, b], [a, b, d], [b, c, d], [a, d, c]];
    let triangles: Vec<[u32; 3]> = [[0, 1, 2, 3], [0, 1, 4, 5]]
        .into_iter()
        .flat_map(tetrahedron)
        .collect();
    let (positions, triangles) = sheets::separate(positions, triangles, 4);
    assert_eq!((positions.len(), triangles.len()), (8, 8));
    assert_eq!(
        sheets::separate(positions.clone(), triangles.clone(), 5)
            .1
            .len(),
        0
    );
    let unique = UniquePositions::new(&positions);
    assert_eq!((0..8).filter(|vertex| unique.is_shared(*vertex)).count(), 4);
}

#[test]
fn without_depth_or_with_a_useless_side_there_is_no_surface() {
    assert_eq!(
        fuse_depth(&[], &[], &FusionOptions::with_side(0.1)),
        TriangleMesh::default()
    );
    let pose = Isometry3::identity();
    let nothing = depth_of(&pose, |_, _| None);
    assert!(fused(&[pose], &[nothing], 0.1).triangles.is_empty());
    let wall = depth_of(&pose, |_, _| Some(2.0));
    for side in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(
            fused(&[pose], std::slice::from_ref(&wall), side)
                .triangles
                .is_empty()
        );
    }
    let far = Isometry3::translation(f64::NAN, 0.0, 0.0);
    assert!(fused(&[far], &[wall], 0.1).triangles.is_empty());
}
