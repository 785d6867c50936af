//! Exported meshes: repair, filters, parts of the surface.

use linecarve_carving::{
    ExportOptions, Hull, IncidentCells, IndexedMesh, Triangle, TrianglePart, TriangleRole,
    VertexId, VertexOrigin,
};
use nalgebra::Point3;
use std::collections::{BTreeMap, BTreeSet};

use crate::helpers::carvings::random_carving;

/// Exports the triangles that are wanted.
fn only(is_wanted: impl Fn(Triangle) -> bool) -> impl Fn(&Triangle) -> TriangleRole {
    move |triangle| match is_wanted(*triangle) {
        true => TriangleRole::Exported,
        false => TriangleRole::Counted,
    }
}

/// Triangles by undirected edge.
fn edges(mesh: &IndexedMesh) -> BTreeMap<(u32, u32), Vec<usize>> {
    let mut edges: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, t) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default().push(index);
        }
    }
    edges
}

/// The surface of a carving with its non-manifold vertices, and repaired.
fn plain_and_repaired(seed: u64, is_hull_dropped: bool) -> [IndexedMesh; 2] {
    let hull = if is_hull_dropped {
        Hull::Drop
    } else {
        Hull::Keep
    };
    let carver = random_carving(seed, hull);
    [false, true].map(|manifold| {
        let mut options = ExportOptions::default();
        options.manifold = manifold;
        carver.mesh(&options)
    })
}

/// Every edge has at most two triangles, and every vertex one fan: its triangles hang together by edges at the vertex.
fn assert_manifold(mesh: &IndexedMesh, seed: u64) {
    let edges = edges(mesh);
    for (edge, triangles) in &edges {
        assert!(
            triangles.len() <= 2,
            "seed {seed}: {edge:?} has {triangles:?}"
        );
    }
    let mut at_vertex: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (index, t) in mesh.triangles.iter().enumerate() {
        for &v in t {
            at_vertex.entry(v).or_default().push(index);
        }
    }
    assert_eq!(at_vertex.len(), mesh.vertices.len());
    for (vertex, around) in at_vertex {
        let mut reached = BTreeSet::from([around[0]]);
        let mut queue = vec![around[0]];
        while let Some(triangle) = queue.pop() {
            for &other in &mesh.triangles[triangle] {
                let key = (vertex.min(other), vertex.max(other));
                for &next in edges.get(&key).into_iter().flatten() {
                    if reached.insert(next) {
                        queue.push(next);
                    }
                }
            }
        }
        assert_eq!(reached.len(), around.len(), "seed {seed}: vertex {vertex}");
    }
}

#[test]
fn repaired_meshes_are_manifold_and_cover_the_same_surface() {
    let mut split = 0;
    for seed in 0..20 {
        let is_hull_dropped = seed % 3 == 0;
        let [plain, repaired] = plain_and_repaired(seed, is_hull_dropped);
        split += repaired.vertices.len() - plain.vertices.len();
        let corners = |mesh: &IndexedMesh| -> BTreeSet<[[u64; 3]; 3]> {
            let at = |v: u32| {
                let p = mesh.vertices[v as usize];
                [p.x, p.y, p.z].map(f64::to_bits)
            };
            (mesh.triangles.iter())
                .map(|t| {
                    let mut corners = t.map(at);
                    let first = (0..3).min_by_key(|&k| corners[k]).unwrap();
                    corners.rotate_left(first);
                    corners
                })
                .collect()
        };
        let common = corners(&plain).intersection(&corners(&repaired)).count();
        let halved = plain.triangles.len() - common;
        assert!(repaired.triangles.len() >= common + 2 * halved);
        let area = |mesh: &IndexedMesh| -> f64 {
            let one = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
                (b - a).cross(&(c - a)).norm()
            };
            mesh.triangles.iter().map(one).sum()
        };
        assert!((area(&plain) - area(&repaired)).abs() < 1e-9 * area(&plain));
        assert_manifold(&repaired, seed);
        if !is_hull_dropped {
            assert!(
                edges(&repaired)
                    .values()
                    .all(|triangles| triangles.len() == 2)
            );
        }
    }
    assert!(split > 0, "no case needed repair");
}

/// A line that is known by the positions of its ends is found again on a repaired surface: repair copies vertices and halves edges, but moves
/// nothing and fills nothing.
#[test]
fn repair_keeps_every_edge_where_it_was() {
    type Bits = [u64; 3];
    let bits = |p: &Point3<f64>| -> Bits { [p.x, p.y, p.z].map(f64::to_bits) };
    let segments = |mesh: &IndexedMesh| -> BTreeSet<[Bits; 2]> {
        let ends = edges(mesh).into_keys().map(|(a, b)| {
            let mut ends = [a, b].map(|v| bits(&mesh.vertices[v as usize]));
            ends.sort_unstable();
            ends
        });
        ends.collect()
    };
    let mut copied = 0;
    let mut halved = 0;
    for seed in 0..40 {
        let [plain, repaired] = plain_and_repaired(seed, seed % 2 == 0);
        let (before, after) = (segments(&plain), segments(&repaired));
        let known: BTreeSet<Bits> = plain.vertices.iter().map(bits).collect();
        for (a, b) in edges(&plain).into_keys() {
            let [p, q] = [a, b].map(|v| plain.vertices[v as usize]);
            let sorted = |x: Bits, y: Bits| [x.min(y), x.max(y)];
            let middle = bits(&nalgebra::center(&p, &q));
            let is_whole = after.contains(&sorted(bits(&p), bits(&q)));
            let is_halved = after.contains(&sorted(bits(&p), middle))
                && after.contains(&sorted(middle, bits(&q)));
            assert!(is_whole || is_halved, "seed {seed}: {p} {q}");
            halved += usize::from(!is_whole);
        }
        // What is new ends at a midpoint.
        for ends in after.difference(&before) {
            assert!(ends.iter().any(|end| !known.contains(end)), "seed {seed}");
        }
        copied += repaired.vertices.len() - plain.vertices.len();
    }
    assert!(copied > 0, "no case needed repair, {halved} halved");
}

#[test]
fn filters_drop_long_triangles_and_small_components() {
    for seed in 0..10 {
        let carver = random_carving(seed, Hull::Drop);
        let all = carver.mesh(&ExportOptions::default());
        let length = |mesh: &IndexedMesh, a: u32, b: u32| {
            (mesh.vertices[a as usize] - mesh.vertices[b as usize]).norm()
        };
        let longest = 4.0;
        let mut options = ExportOptions::default();
        options.longest_edge = Some(longest);
        let short = carver.mesh(&options);
        let is_short = |mesh: &IndexedMesh, t: &&[u32; 3]| {
            (0..3).all(|k| length(mesh, t[k], t[(k + 1) % 3]) <= longest)
        };
        let expected = all.triangles.iter().filter(|t| is_short(&all, t)).count();
        assert_eq!(short.triangles.len(), expected);
        assert!(short.triangles.iter().all(|t| is_short(&short, &t)));
        let mut options = ExportOptions::default();
        options.minimum_component = 5;
        options.manifold = true;
        let large = carver.mesh(&options);
        // In a repaired mesh, components are what vertices connect.
        let mut component: Vec<usize> = (0..large.vertices.len()).collect();
        fn root(component: &mut [usize], mut v: usize) -> usize {
            while component[v] != v {
                component[v] = component[component[v]];
                v = component[v];
            }
            v
        }
        for t in &large.triangles {
            for k in 1..3 {
                let a = root(&mut component, t[0] as usize);
                let b = root(&mut component, t[k] as usize);
                component[a] = b;
            }
        }
        let mut sizes: BTreeMap<usize, usize> = BTreeMap::new();
        for t in &large.triangles {
            *sizes
                .entry(root(&mut component, t[0] as usize))
                .or_default() += 1;
        }
        assert!(sizes.values().all(|&size| size >= 5), "{sizes:?}");
    }
}

#[test]
fn the_unwanted_are_left_out_and_vertices_know_their_origin() {
    for seed in 0..10 {
        let carver = random_carving(seed, Hull::Keep);
        let is_wanted = |triangle: Triangle| !triangle[0].index().is_multiple_of(3);
        for manifold in [false, true] {
            let mut options = ExportOptions::default();
            options.manifold = manifold;
            let (mesh, origins) = carver.mesh_where(&options, only(is_wanted));
            let wanted = carver.triangles().filter(|t| is_wanted(*t)).count();
            assert!(wanted > 0 && wanted < carver.triangle_count());
            // Splitting an edge makes two triangles of one.
            assert!(mesh.triangles.len() >= wanted && (manifold || mesh.triangles.len() == wanted));
            assert_eq!(origins.len(), mesh.vertices.len());
            for (position, origin) in mesh.vertices.iter().zip(&origins) {
                match origin.vertex() {
                    Some(vertex) => assert_eq!(*position, carver.tetrahedra().position(vertex)),
                    None => assert!(manifold, "midpoints come from repair alone"),
                }
            }
            assert_eq!(
                carver.mesh_where(&options, only(|_| true)).0,
                carver.mesh(&options)
            );
            assert_eq!(
                carver
                    .mesh_where(&options, only(|_| false))
                    .0
                    .vertices
                    .len(),
                0
            );
        }
    }
}

#[test]
fn gaps_of_one_triangle_are_filled_and_larger_ones_are_not() {
    let carver = random_carving(0, Hull::Keep);
    let mut filled = ExportOptions::default();
    filled.fill_gaps = true;
    let whole = carver.mesh(&ExportOptions::default());
    let mut triangles: Vec<Triangle> = carver.triangles().collect();
    triangles.sort_unstable();
    let mut larger = 0;
    for gap in triangles.iter().take(60) {
        assert_eq!(carver.mesh_where(&filled, only(|it| it != *gap)).0, whole);
        let neighbor = |it: &&Triangle| it.iter().filter(|v| gap.contains(v)).count() == 2;
        // One of the neighbours, where each edge has two triangles.
        if let [neighbor, _, _] = triangles.iter().filter(neighbor).collect::<Vec<_>>()[..] {
            let is_wanted = |it: Triangle| it != *gap && it != *neighbor;
            let left_out = whole.triangles.len()
                - carver
                    .mesh_where(&filled, only(is_wanted))
                    .0
                    .triangles
                    .len();
            assert_eq!(left_out, 2);
            larger += 1;
        }
    }
    assert!(larger > 0);
}

#[test]
fn parts_of_triangles_have_their_areas_and_stay_manifold() {
    let mut parts = 0;
    for seed in 0..20 {
        let carver = random_carving(seed, Hull::Keep);
        // Two edges of every third triangle, one of the next.
        let part = |triangle: &Triangle| {
            let kept = match triangle.iter().map(|v| v.index()).sum::<usize>() % 3 {
                0 => [true, false, true],
                1 => [false, true, false],
                _ => return None,
            };
            let weights = [1, 3, 2];
            Some(TrianglePart {
                weights,
                edges: kept,
            })
        };
        let role = |it: &Triangle| part(it).map_or(TriangleRole::Exported, TriangleRole::Part);
        let mut options = ExportOptions::default();
        options.manifold = true;
        let (mesh, origins) = carver.mesh_where(&options, role);
        assert_manifold(&mesh, seed);
        let area = |corners: [Point3<f64>; 3]| {
            let [a, b, c] = corners;
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        let at = |vertices: [VertexId; 3]| vertices.map(|v| carver.tetrahedra().position(v));
        let whole = carver
            .triangles()
            .filter(|triangle| part(triangle).is_none());
        let mut expected: f64 = whole.map(|triangle| area(at(triangle))).sum();
        let mut is_inside = vec![false; origins.len()];
        for ((origin, position), is_inside) in
            origins.iter().zip(&mesh.vertices).zip(&mut is_inside)
        {
            let VertexOrigin::Inside { corners, part } = *origin else {
                continue;
            };
            *is_inside = true;
            let positions = at(corners);
            let weighted = |k: usize| positions[k].coords * f64::from(part.weights[k]) / 6.0;
            let expected_position = weighted(0) + weighted(1) + weighted(2);
            assert!((expected_position - position.coords).norm() < 1e-12);
            // A part at an edge has the share of the weight of the corner off the edge.
            let kept = (0..3).filter(|k| part.edges[*k]);
            let shares = kept.map(|k| f64::from(part.weights[(k + 2) % 3]) / 6.0);
            expected += area(positions) * shares.sum::<f64>();
        }
        let found: f64 = (mesh.triangles.iter())
            .map(|triangle| area(triangle.map(|v| mesh.vertices[v as usize])))
            .sum();
        assert!((found - expected).abs() < 1e-9 * expected);
        // Parts are attached to whole triangles.
        let edges = edges(&mesh);
        for triangle in &mesh.triangles {
            if let Some(k) = (0..3).find(|k| is_inside[triangle[*k] as usize]) {
                let [a, b] = [triangle[(k + 1) % 3], triangle[(k + 2) % 3]];
                assert_eq!(edges[&(a.min(b), a.max(b))].len(), 2);
                parts += 1;
            }
        }
    }
    assert!(parts > 100);
}

#[test]
fn what_is_left_of_a_large_component_may_be_small() {
    let carver = random_carving(0, Hull::Keep);
    let mut options = ExportOptions::default();
    options.minimum_component = 5;
    options.manifold = true;
    let whole = carver
        .mesh_where(&options, only(|_| true))
        .0
        .triangles
        .len();
    let mut triangles: Vec<Triangle> = carver.triangles().collect();
    triangles.sort_unstable();
    let alone = triangles.iter().filter(|one| {
        let (mesh, _) = carver.mesh_where(&options, only(|triangle| triangle == **one));
        !mesh.triangles.is_empty()
    });
    // Every triangle of a component that is large enough is written when it is the only one wanted.
    assert!(whole > 0 && alone.count() >= whole / 2);
}

#[test]
fn triangles_around_a_vertex_are_those_of_the_surface_with_that_corner() {
    let mut scratch = IncidentCells::new();
    for seed in 0..6 {
        let hull = [Hull::Drop, Hull::Keep][seed as usize % 2];
        let carver = random_carving(seed, hull);
        let surface: Vec<Triangle> = carver.triangles().collect();
        for point in carver.points() {
            let vertex = carver.vertex_of(point).unwrap();
            let mut around = Vec::new();
            carver.triangles_around(vertex, &mut scratch, &mut around);
            around.sort_unstable();
            let mut expected: Vec<Triangle> = surface
                .iter()
                .filter(|triangle| triangle.contains(&vertex))
                .copied()
                .collect();
            expected.sort_unstable();
            assert_eq!(around, expected);
        }
    }
}
