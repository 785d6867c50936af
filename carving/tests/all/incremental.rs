//! A mesh kept up to date equals the one extracted anew, whatever the carver went through.

use std::collections::{BTreeMap, BTreeSet};

use linecarve_carving::{
    Carver, CarverOptions, ChangeLog, CutOptions, ExportOptions, Face, Hull, IncrementalMesh,
    Labels, MeshChange, PointId, SurfaceDelta, Transaction, Triangle, TrianglePart, TriangleRole,
    VertexId, VertexOrigin, ViewId, Votes,
};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A position on a small grid, where triangles share edges and vertices in every way, or anywhere.
fn position(rng: &mut ChaCha8Rng, is_grid: bool) -> Point3<f64> {
    Point3::from(std::array::from_fn(|_| match is_grid {
        true => f64::from(rng.random_range(0..5)),
        false => rng.random_range(0.0..5.0),
    }))
}

fn center(rng: &mut ChaCha8Rng) -> Point3<f64> {
    Point3::from(std::array::from_fn(|_| rng.random_range(-1.0..6.0)))
}

/// A random part of a triangle.
fn part(rng: &mut ChaCha8Rng) -> TrianglePart {
    let mut edges = [true, false, rng.random()];
    edges.rotate_left(rng.random_range(0..3));
    TrianglePart {
        weights: std::array::from_fn(|_| rng.random_range(1..9)),
        edges,
    }
}

/// Adds a random event; those that do not apply are left out.
fn push_event(rng: &mut ChaCha8Rng, is_grid: bool, transaction: &mut Transaction<'_>) {
    let carver = transaction.before();
    let view = ViewId(rng.random_range(0..carver.next_view().0.max(1)));
    let point = PointId(rng.random_range(0..carver.next_point().0.max(1)));
    let _ = match rng.random_range(0..14) {
        0..4 => transaction
            .add_point(position(rng, is_grid))
            .and_then(|point| transaction.add_observation(view, point, 1)),
        4..8 => transaction.add_observation(view, point, 1),
        8 => transaction.remove_point(point),
        9 | 10 => transaction.move_point(point, position(rng, is_grid)),
        11 => transaction.move_view(view, center(rng)),
        12 => transaction.remove_observation(view, point),
        _ if rng.random_range(0..4) == 0 => transaction.remove_view(view),
        _ => Ok(()),
    };
}

/// A view that sees many of the points, and some new ones.
fn push_keyframe(rng: &mut ChaCha8Rng, is_grid: bool, transaction: &mut Transaction<'_>) {
    let points: Vec<PointId> = transaction.before().points().collect();
    let view = transaction.add_view(center(rng)).unwrap();
    for _ in 0..rng.random_range(0..12) {
        let point = transaction.add_point(position(rng, is_grid)).unwrap();
        let _ = transaction.add_observation(view, point, 1);
    }
    for point in points {
        if rng.random_range(0..4) == 0 {
            let _ = transaction.add_observation(view, point, 1);
        }
    }
}

/// What a reader of changes holds.
#[derive(Default)]
struct Follower {
    positions: BTreeMap<u32, [u64; 3]>,
    faces: BTreeMap<Face, [[u64; 3]; 3]>,
}

fn bits(mesh: &IncrementalMesh, number: u32) -> [u64; 3] {
    let p = mesh.position(number);
    [p.x, p.y, p.z].map(f64::to_bits)
}

impl Follower {
    fn follow(&mut self, mesh: &IncrementalMesh, change: &MeshChange) {
        for face in &change.removed {
            assert!(self.faces.remove(face).is_some());
        }
        for number in &change.freed {
            self.positions.remove(number);
        }
        for number in &change.placed {
            self.positions.insert(*number, bits(mesh, *number));
        }
        let at = |face: &Face, known: &BTreeMap<u32, [u64; 3]>| face.map(|number| known[&number]);
        for face in &change.reshaped {
            let known = at(face, &self.positions);
            assert!(self.faces.insert(*face, known).is_some());
        }
        for face in &change.added {
            let known = at(face, &self.positions);
            assert!(self.faces.insert(*face, known).is_none());
        }
        let numbers = (0..mesh.vertex_capacity() as u32).filter(|number| mesh.is_vertex(*number));
        let expected: BTreeMap<_, _> = numbers.map(|number| (number, bits(mesh, number))).collect();
        assert_eq!(self.positions, expected);
        assert_eq!(mesh.vertex_count(), expected.len());
        // The positions at which the faces were last reported are the current ones.
        let faces: BTreeMap<_, _> = mesh
            .faces()
            .map(|face| (face, at(&face, &expected)))
            .collect();
        assert_eq!(mesh.face_count(), faces.len());
        assert_eq!(self.faces, faces);
    }
}

/// Roles of triangles that are not those of most.
type Roles = BTreeMap<Triangle, TriangleRole>;

struct Run {
    carver: Carver,
    mesh: IncrementalMesh,
    options: ExportOptions,
    roles: Roles,
    follower: Follower,
    /// Follows the sums of several changes.
    late: Follower,
    log: ChangeLog,
}

impl Run {
    fn new(rng: &mut ChaCha8Rng, seed: u64) -> Self {
        let labels = match seed % 3 {
            0 => Labels::Cut(CutOptions::default()),
            _ => Labels::Votes(Votes::default()),
        };
        let mut options = ExportOptions::default();
        options.longest_edge = rng.random::<bool>().then_some(3.0);
        options.minimum_component = [0, 2, 5, 12][rng.random_range(0..4)];
        options.manifold = rng.random_range(0..5) > 0;
        options.fill_gaps = rng.random();
        Self {
            carver: Carver::new(CarverOptions::new(
                labels,
                [Hull::Drop, Hull::Keep][rng.random_range(0..2)],
            )),
            mesh: IncrementalMesh::new(&options),
            options,
            roles: Roles::new(),
            follower: Follower::default(),
            late: Follower::default(),
            log: ChangeLog::default(),
        }
    }

    fn role(&self, triangle: &Triangle) -> TriangleRole {
        let longest = self.options.longest_edge;
        if longest.is_some_and(|longest| !self.carver.has_edges_within(triangle, longest)) {
            return TriangleRole::Ignored;
        }
        let role = self.roles.get(triangle).copied();
        role.unwrap_or(TriangleRole::Exported)
    }

    /// Some triangles are wanted no more, others are again.
    fn change_roles(&mut self, rng: &mut ChaCha8Rng) -> Vec<Triangle> {
        let mut surface: Vec<Triangle> = self.carver.triangles().collect();
        surface.sort_unstable();
        surface.retain(|_| rng.random_range(0..30) == 0);
        for triangle in &surface {
            match self.roles.remove(triangle) {
                Some(_) => {}
                None => {
                    let role = match rng.random_range(0..2) {
                        0 => TriangleRole::Counted,
                        _ => TriangleRole::Part(part(rng)),
                    };
                    self.roles.insert(*triangle, role);
                }
            }
        }
        surface
    }

    fn update(&mut self, deltas: &[SurfaceDelta], touched: &[Triangle]) {
        let mut mesh = std::mem::take(&mut self.mesh);
        self.carver
            .update_mesh(&mut mesh, deltas, touched, |triangle| self.role(triangle));
        self.mesh = mesh;
    }

    fn check(&mut self) {
        let role = |triangle: &Triangle| {
            let role = self.roles.get(triangle).copied();
            role.unwrap_or(TriangleRole::Exported)
        };
        let (expected, origins) = self.carver.mesh_where(&self.options, role);
        let (mesh, numbers) = self.mesh.to_mesh();
        assert_eq!(mesh, expected);
        let found: Vec<_> = numbers
            .iter()
            .map(|&number| self.mesh.vertex_origin(number))
            .collect();
        assert_eq!(same_names(found), same_names(origins));
        let change = self.mesh.take_change();
        self.follower.follow(&self.mesh, &change);
        self.log.append(&change);
    }
}

/// Corners of triangles in an order of their own: they begin with any of them.
fn same_names(mut origins: Vec<VertexOrigin<VertexId>>) -> Vec<VertexOrigin<VertexId>> {
    for origin in &mut origins {
        if let VertexOrigin::Inside { corners, part } = origin {
            let first = (0..3).min_by_key(|k| corners[*k]).unwrap();
            corners.rotate_left(first);
            *part = part.rotated(first);
        }
    }
    origins
}

/// How many meshes had a copied vertex, a split edge, a part of a triangle, and a triangle left out.
#[derive(Default)]
struct Cases {
    copies: usize,
    parts: usize,
    splits: usize,
    left_out: usize,
}

fn run(seed: u64, cases: &mut Cases) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let is_grid = rng.random();
    let mut run = Run::new(&mut rng, seed);
    for step in 0..24 {
        let mut deltas = Vec::new();
        // Several commits before the mesh follows.
        for _ in 0..rng.random_range(1..4) {
            let mut transaction = run.carver.transaction();
            if rng.random_range(0..2) == 0 {
                push_keyframe(&mut rng, is_grid, &mut transaction);
            }
            for _ in 0..rng.random_range(0..10) {
                push_event(&mut rng, is_grid, &mut transaction);
            }
            if let Ok(report) = transaction.commit() {
                deltas.push(report.surface);
            }
        }
        let touched = run.change_roles(&mut rng);
        run.update(&deltas, &touched);
        run.check();
        if step % 5 == 4 {
            let change = run.log.take();
            run.late.follow(&run.mesh, &change);
        }
        let numbers = 0..run.mesh.vertex_capacity() as u32;
        let mut origins: Vec<_> = numbers
            .filter(|number| run.mesh.is_vertex(*number))
            .map(|number| run.mesh.vertex_origin(number))
            .collect();
        cases.splits += usize::from(origins.contains(&VertexOrigin::Middle));
        let is_inside = |it: &VertexOrigin<_>| matches!(it, VertexOrigin::Inside { .. });
        cases.parts += usize::from(origins.iter().any(is_inside));
        origins.retain(|origin| origin.vertex().is_some());
        let count = origins.len();
        let distinct: BTreeSet<_> = origins.iter().map(|origin| origin.vertex()).collect();
        cases.copies += usize::from(distinct.len() < count);
        cases.left_out += usize::from(run.mesh.face_count() < run.carver.triangle_count());
    }
    // A new mesh takes over the whole surface.
    run.mesh = IncrementalMesh::new(&run.options);
    run.follower = Follower::default();
    let mut added: Vec<Triangle> = run.carver.triangles().collect();
    added.sort_unstable();
    let whole = SurfaceDelta {
        added,
        ..SurfaceDelta::default()
    };
    run.update(&[whole], &[]);
    run.check();
}

#[test]
fn an_incremental_mesh_equals_the_one_extracted_anew() {
    let count = match std::env::var("LINECARVE_LONG_TESTS") {
        Ok(value) if value == "1" => 5000,
        _ => 150,
    };
    let mut cases = Cases::default();
    for seed in 0..count {
        run(seed, &mut cases);
    }
    assert!(cases.copies > 0 && cases.splits > 0 && cases.parts > 0 && cases.left_out > 0);
}
