//! A room with exact truth.

use std::collections::BTreeMap;

use linecarve_mesh::{GltfFrame, TriangleMesh, read_geometry};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::*;

/// Cells along x, y and z, and their size.
const CELLS: [i32; 3] = [40, 30, 25];
const CELL: f64 = 0.1;
/// The doorway in the wall at x = 0: cells along y and z, and the wall behind it.
const DOOR: [std::ops::Range<i32>; 2] = [10..18, 0..20];
const BEHIND: f64 = -1.5;

/// A room of 4 x 3 x 2.5 with a doorway, behind which a wall stands, z up. Vertices are off by independent errors and by errors that
/// neighbours within half a metre have in common, both with this standard deviation.
pub(crate) fn room(sigma: f64, seed: u64) -> TriangleMesh {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = move || {
        let [a, b]: [f64; 2] = [random.random(), random.random()];
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let mut numbers: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut shared: BTreeMap<(usize, bool, [i32; 3]), f64> = BTreeMap::new();
    let mut mesh = TriangleMesh::default();
    let mut quad = |axis: usize, is_high: bool, corner: [i32; 3]| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| {
            let mut at = corner;
            at[u] += a;
            at[v] += b;
            *numbers.entry(at).or_insert_with(|| {
                let mut position = at.map(|it| CELL * f64::from(it));
                for axis in 0..3 {
                    for is_high in [false, true] {
                        if at[axis] == if is_high { CELLS[axis] } else { 0 } {
                            let block = (axis, is_high, at.map(|it| it.div_euclid(5)));
                            let common = *shared.entry(block).or_insert_with(&mut normal);
                            position[axis] += sigma * (common + normal());
                        }
                    }
                }
                mesh.positions.push(position.into());
                mesh.positions.len() as u32 - 1
            })
        });
        // Seen from inside.
        if is_high {
            corners.reverse();
        }
        let [a, b, c, d] = corners;
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (is_high, at) in [(false, 0), (true, CELLS[axis])] {
            for (a, b) in (0..CELLS[u]).flat_map(|a| (0..CELLS[v]).map(move |b| (a, b))) {
                let is_door = axis == 0 && !is_high && DOOR[0].contains(&a) && DOOR[1].contains(&b);
                if !is_door {
                    let mut corner = [0; 3];
                    (corner[axis], corner[u], corner[v]) = (at, a, b);
                    quad(axis, is_high, corner);
                }
            }
        }
    }
    let first = mesh.positions.len() as u32;
    let behind = [[0.0, 0.0], [3.0, 0.0], [3.0, 2.5], [0.0, 2.5]];
    mesh.positions
        .extend(behind.map(|[y, z]| Point3::new(BEHIND, y, z)));
    mesh.triangles
        .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    mesh
}

fn up() -> StructureOptions {
    StructureOptions {
        up: Vector3::z(),
        ..StructureOptions::default()
    }
}

fn between(structure: &Structure, kinds: [Kind; 2], truth: f64) -> Distance {
    let is_it = |it: &&Distance| {
        let mut own = it.planes.map(|plane| structure.planes[plane as usize].kind);
        own.sort();
        own == kinds && it.facing && (it.value - truth).abs() < 0.2
    };
    *structure
        .distances
        .iter()
        .find(is_it)
        .expect("the planes are found")
}

/// Height, length and width of the room.
fn sizes(structure: &Structure) -> [(Distance, f64); 3] {
    [
        ([Kind::Floor, Kind::Ceiling], 2.5),
        ([Kind::Wall; 2], 4.0),
        ([Kind::Wall; 2], 3.0),
    ]
    .map(|(kinds, truth)| (between(structure, kinds, truth), truth))
}

#[test]
fn an_exact_room_is_six_polygons_that_share_their_corners() {
    let found = structure(&room(0.0, 1), &[], &up());
    assert_eq!(found.planes.len(), 6);
    assert_eq!(found.polygons.len(), 6);
    // What is behind has too few triangles for a polygon.
    assert_eq!(found.rest.len(), 2);
    for (distance, truth) in sizes(&found) {
        assert!((distance.value - truth).abs() < 1e-9, "{distance:?}");
    }
    assert!(
        found
            .angles
            .iter()
            .all(|it| (it.degrees - 90.0).abs() < 1e-6)
    );
    // Four corners each; the doorway adds four to its wall and two to the floor.
    let corners: usize = found.polygons.iter().map(|it| it.rings[0].len()).sum();
    assert_eq!(corners, 6 * 4 + 4 + 2);
    let area: f64 = found.planes.iter().map(|it| it.area).sum();
    assert!(
        (area - (2.0 * (12.0 + 10.0 + 7.5) - 1.6)).abs() < 1e-9,
        "{area}"
    );
    for plane in &found.planes {
        let truth = match plane.kind {
            Kind::Wall if plane.normal.x.abs() > 0.5 => [3.0, 2.5],
            Kind::Wall => [4.0, 2.5],
            _ => [4.0, 3.0],
        };
        let mut size = plane.size;
        if plane.kind != Kind::Wall {
            size.sort_by(|a, b| b.total_cmp(a));
        }
        assert!(
            (0..2).all(|it| (size[it] - truth[it]).abs() < 1e-9),
            "{plane:?}"
        );
    }
    // Four sides of each height and length, without the 0.8 of the doorway.
    let met: f64 = found.edges.iter().map(|it| it.length).sum();
    assert!(
        (met - (4.0 * (4.0 + 3.0 + 2.5) - 0.8)).abs() < 1e-9,
        "{met}"
    );
    // Each side belongs to two polygons, except three sides of the doorway and the floor before it.
    let mut sides: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for ring in found.polygons.iter().flat_map(|it| &it.rings) {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            *sides.entry([*a.min(b), *a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    assert_eq!(sides.values().filter(|it| **it != 0).count(), 4);
}

#[test]
fn corners_of_one_polygon_never_lie_inside_a_side_of_another() {
    let found = structure(&room(0.002, 7), &[], &up());
    let rings = || found.polygons.iter().flat_map(|it| &it.rings);
    for ring in rings() {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            let [from, to] = [a, b].map(|it| found.positions[*it as usize]);
            for vertex in rings().flatten().filter(|it| *it != a && *it != b) {
                let at = found.positions[*vertex as usize];
                let share = (at - from).dot(&(to - from)) / (to - from).norm_squared();
                let off = (from + share * (to - from) - at).norm();
                assert!(
                    !(0.0..1.0).contains(&share) || off > 1e-6,
                    "{vertex} on {a} {b}"
                );
            }
        }
    }
}

#[test]
fn stated_deviations_hold_for_errors_that_neighbours_share() {
    let mut held = 0;
    for seed in 0..40 {
        let found = structure(&room(0.002, seed), &[], &up());
        for (distance, truth) in sizes(&found) {
            let off = (distance.value - truth).abs();
            assert!(off < 0.002, "seed {seed}: {distance:?}");
            // A block of a metre has about four common errors, a distance has two planes.
            assert!(
                (0.0005..0.003).contains(&distance.sigma),
                "seed {seed}: {distance:?}"
            );
            held += i32::from(off <= 2.0 * distance.sigma);
        }
    }
    // Of 120.
    assert!(held >= 114, "{held}");
}

#[test]
fn frames_do_not_matter() {
    let turn = Rotation3::from_euler_angles(0.3, -0.2, 1.1);
    let shift = Vector3::new(4e5, -5e6, 30.0);
    let plain = structure(&room(0.001, 3), &[], &up());
    let mut mesh = room(0.001, 3);
    mesh.positions
        .iter_mut()
        .for_each(|it| *it = turn * *it + shift);
    let options = StructureOptions {
        up: turn * Vector3::z(),
        ..up()
    };
    let moved = structure(&mesh, &[], &options);
    for ((one, _), (other, _)) in sizes(&plain).into_iter().zip(sizes(&moved)) {
        assert!((one.value - other.value).abs() < 1e-5, "{one:?} {other:?}");
    }
    for plane in &moved.planes {
        assert!((plane.normal.dot(&plane.center.coords) - plane.offset).abs() < 1e-6);
    }
}

#[test]
fn a_border_lies_on_the_segment_along_it() {
    // The top of the doorway is 1 cm higher than the mesh has it.
    let segment = [[1.0, 2.01], [1.8, 2.01]].map(|[y, z]| Point3::new(0.0, y, z));
    let found = structure(&room(0.0, 1), &[segment], &up());
    let has = |y: f64, z: f64| {
        let corner = Point3::new(0.0, y, z);
        found.positions.iter().any(|it| (it - corner).norm() < 1e-9)
    };
    assert!(has(1.0, 2.01) && has(1.8, 2.01) && has(1.0, 0.0));
}

#[test]
fn the_plan_shows_walls_and_the_doorway() {
    let found = structure(&room(0.0, 1), &[], &up());
    let plan = Plan::new(&found).unwrap();
    assert_eq!(plan.openings.len(), 1);
    assert!((plan.openings[0].width - 0.8).abs() < 1e-9);
    assert!((0.0..2.0).contains(&plan.height));
    assert_eq!(plan.walls.len(), 5);
    let length: f64 = plan
        .walls
        .iter()
        .map(|it| (it.ends[1] - it.ends[0]).norm())
        .sum();
    assert!((length - (14.0 - 0.8)).abs() < 1e-9, "{length}");
    // The wall behind.
    assert_eq!(plan.rest.len(), 2);
    // A frame of 3 cm before the wall and 10 cm behind it, 8 cm into the doorway on each side.
    let mut framed = room(0.0, 1);
    for y in [1.08, 1.72] {
        let first = framed.positions.len() as u32;
        let corners = [[-0.1, 0.0], [0.03, 0.0], [0.03, 2.0], [-0.1, 2.0]];
        framed
            .positions
            .extend(corners.map(|[x, z]| Point3::new(x, y, z)));
        framed
            .triangles
            .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    let plan = Plan::new(&structure(&framed, &[], &up())).unwrap();
    assert!(
        (plan.openings[0].width - 0.64).abs() < 1e-9,
        "{:?}",
        plan.openings
    );
}

#[test]
fn nothing_comes_of_nothing() {
    for triangles in [vec![], vec![[0, 1, 2]], vec![[0, 0, 0]]] {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let mesh = TriangleMesh {
            positions: corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec(),
            triangles,
            colors: None,
        };
        let found = structure(&mesh, &[], &up());
        assert!(found.polygons.is_empty() && Plan::new(&found).is_none());
        let summary = StructureSummary::new(&found, None, None);
        assert_eq!((summary.polygons, summary.planes.len()), (0, 0));
    }
    let empty = structure(&TriangleMesh::default(), &[], &up());
    assert!(empty.positions.is_empty() && empty.samples(100).is_empty());
}

#[test]
fn files_hold_the_structure() {
    let found = structure(&room(0.0, 1), &[], &up());
    let plan = Plan::new(&found);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| std::fs::read_to_string(path(name)).unwrap();
    let frame = GltfFrame::upright(Vector3::zeros(), &found.up);
    write_structure_glb(&path("a.glb"), &found, frame).unwrap();
    let shape = read_geometry(&path("a.glb")).unwrap();
    assert_eq!(shape.triangles.len(), found.mesh().triangles.len());

    write_structure_obj(&path("a.obj"), &found).unwrap();
    let obj = text("a.obj");
    let faces = obj.lines().filter(|it| it.starts_with("f ")).count();
    assert_eq!(faces, 6 + 2);
    assert!(obj.contains("\ng plane_000_") && text("a.mtl").contains("newmtl rest"));

    write_dxf(&path("a.dxf"), &found).unwrap();
    let dxf = text("a.dxf");
    let count = |what: &str| dxf.lines().filter(|it| *it == what).count();
    assert_eq!(count("3DFACE"), found.mesh().triangles.len());
    // 12 edges of a box; the doorway splits one and adds three.
    assert_eq!(count("LINE"), 12 + 2 + 3);
    assert!(dxf.ends_with("0\nEOF\n"));

    write_ifc(&path("a.ifc"), &found).unwrap();
    let ifc = text("a.ifc");
    assert_eq!(ifc.matches("=IFCWALL(").count(), 4);
    assert_eq!(ifc.matches("=IFCINDEXEDPOLYGONALFACE(").count(), 8);
    assert!(ifc.contains(".FLOOR.") && ifc.contains(".CEILING."));

    write_usda(&path("a.usda"), &found).unwrap();
    assert_eq!(text("a.usda").matches("def Mesh").count(), 7);
    let svg = svg(&found, plan.as_ref());
    assert!(
        svg.contains("1 : 20,") && svg.contains(">0.800<") && svg.contains("3.000000 ± 0.00000"),
        "{svg}"
    );

    let summary = StructureSummary::new(&found, plan.as_ref(), Some(0.0));
    write_json(&path("a.json"), &summary).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text("a.json")).unwrap();
    assert_eq!(json["polygons"], 6);
    assert_eq!(json["planes"].as_array().unwrap().len(), 6);
    assert_eq!(json["distances"].as_array().unwrap().len(), 3);
    assert_eq!(json["edges"].as_array().unwrap().len(), 12);
    assert_eq!(json["planes"][0]["normal"].as_array().unwrap().len(), 3);
}

/// Turned about zero, a tilt of 1e-4 moved heights by hundreds of metres.
#[test]
fn structures_far_from_zero_stay_where_they_are() {
    let offset = Vector3::new(500_000.25, 5_400_000.5, 100.0);
    let mut mesh = room(0.0, 1);
    mesh.translate(&offset);
    let mut found = structure(&mesh, &[], &up());
    let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), 1e-4);
    found.main_directions = found.main_directions.map(|it| it.map(|it| tilt * it));
    found.up = tilt * found.up;
    let upright = found.upright_from_original();
    let heights = found.positions.iter().map(|it| (upright * it).z - it.z);
    assert!(heights.fold(0.0, |a: f64, b| a.max(b.abs())) < 1e-3);
    let plan = Plan::new(&found).unwrap();
    assert!((100.0..102.5).contains(&plan.height), "{}", plan.height);
    let above = plan.above_floor.unwrap();
    assert!((plan.height - 100.0 - above).abs() < 1e-3, "{above}");
    let summary = StructureSummary::new(&found, Some(&plan), None);
    assert_eq!(summary.upright_translation, upright.translation.vector);

    // Points of USD have single precision.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    write_usda(&path, &found).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let numbers = |line: &str| -> Vec<f64> {
        let (_, list) = line.split_once('=').unwrap();
        let parts = list.split(['[', '(', ',', ' ', ')', ']']);
        parts.filter_map(|it| it.parse().ok()).collect()
    };
    let line = |name: &str| text.lines().find(|it| it.contains(name)).unwrap();
    let origin = numbers(line("xformOp:translate ="));
    let points = numbers(line("point3f[] points"));
    assert!(points.iter().all(|it| it.abs() < 10.0), "{points:?}");
    let first = Point3::from_slice(&points[..3]) + Vector3::from_column_slice(&origin);
    let apart = |it: &Point3<f64>| (upright * it - first).norm();
    assert!(found.positions.iter().map(apart).fold(1.0, f64::min) < 1e-5);
}

/// Of a structure with another axis up, that axis becomes the height.
#[test]
fn the_axis_nearest_to_up_becomes_z_far_from_zero() {
    let offset = Vector3::new(300.0, -1e6, 2e6);
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let mut mesh = room(0.0, 1);
    for position in &mut mesh.positions {
        *position = turn * *position + offset;
    }
    let mut options = up();
    options.up = -Vector3::y();
    let found = structure(&mesh, &[], &options);
    let upright = found.upright_from_original();
    for position in &found.positions {
        let turned = upright * position;
        assert!((turned.z + position.y).abs() < 1e-6, "{turned}");
        assert!((turned.x.abs() - 300.0).abs() < 10.0 || (turned.y.abs() - 300.0).abs() < 10.0);
    }
}

#[test]
fn a_value_has_the_digits_of_its_deviation() {
    let texts = [
        (2.5, 0.12),
        (2.5, 0.0019),
        (3.8, 0.000017),
        (3.8, 0.0),
        (120.0, 7.0),
    ];
    assert_eq!(
        texts.map(|(value, deviation)| measured_text(value, deviation)),
        [
            "2.50 ± 0.12",
            "2.5000 ± 0.0019",
            "3.800000 ± 0.000017",
            "3.800000 ± 0.000000",
            "120.0 ± 7.0"
        ]
    );
}
