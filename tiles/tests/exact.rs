//! Tiles against one carver: the same mesh, bit for bit.

#![allow(clippy::unwrap_used, reason = "a test ends where anything fails")]
use linecarve_carving::internals::assemble;
use linecarve_carving::{
    Carver, CarverOptions, CutOptions, ExportOptions, Hull, IndexedMesh, Labels, TriangleRole,
    Votes,
};
use linecarve_tiles::{PlanOptions, Stage, TilesError, Work};
use linecarve_tiles::{merged_mesh, merged_surface, plan, run, run_item};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Positions, centres, and which view sees which point.
#[derive(Default)]
struct Scene {
    points: Vec<[f64; 3]>,
    views: Vec<[f64; 3]>,
    rays: Vec<(usize, usize)>,
    has_sigmas: bool,
}

impl Scene {
    /// Every point is seen by every view that `sees` says.
    fn new(points: Vec<[f64; 3]>, views: Vec<[f64; 3]>, every: usize) -> Self {
        let pairs = (0..points.len()).flat_map(|p| (0..views.len()).map(move |v| (v, p)));
        let rays = pairs
            .filter(|&(v, p)| (v * 7 + p * 3) % every == 0 && views[v] != points[p])
            .collect();
        Self {
            points,
            views,
            rays,
            has_sigmas: true,
        }
    }

    fn carver(&self, options: CarverOptions) -> Carver {
        let mut carver = Carver::deferred(options);
        let mut transaction = carver.transaction();
        let views: Vec<_> = (self.views.iter())
            .map(|v| transaction.add_view(Point3::from(*v)).unwrap())
            .collect();
        let points: Vec<_> = (self.points.iter().enumerate())
            .map(|(i, p)| {
                let point = transaction.add_point(Point3::from(*p)).unwrap();
                let sigma = (self.has_sigmas && i % 3 > 0).then_some(0.01 * (1 + i % 5) as f64);
                transaction.set_sigma(point, sigma).unwrap();
                point
            })
            .collect();
        for &(v, p) in &self.rays {
            let weight = 1 + (v + p) as u32 % 2;
            (transaction.add_observation(views[v], points[p], weight)).unwrap();
        }
        transaction.commit().unwrap();
        carver
    }
}

fn votes(hull: Hull) -> CarverOptions {
    CarverOptions::new(Labels::Votes(Votes::default()), hull)
}

fn cut() -> CarverOptions {
    CarverOptions::new(Labels::Cut(CutOptions::default()), Hull::Drop)
}

fn tiled(carver: &Carver, export: &ExportOptions, options: &PlanOptions) -> (IndexedMesh, u64) {
    let folder = tempfile::tempdir().unwrap();
    let work = plan(folder.path(), carver, export, options, String::new()).unwrap();
    run(&work, 1, |item| run_item(&work, item, || None)).unwrap();
    let counts = work.items(Stage::Settle).filter_map(|item| work.done(item));
    let settled = counts.flat_map(|manifest| manifest.counts);
    let settled = settled
        .filter(|(name, _)| name == "settled")
        .map(|(_, n)| n);
    (merged_mesh(&work).unwrap(), settled.sum())
}

fn assert_same(scene: &Scene, options: CarverOptions, splits: &[(usize, u64, u32)]) {
    let mut export = ExportOptions::default();
    export.longest_edge = None;
    export.minimum_component = 8;
    export.manifold = true;
    assert_same_with(scene, options, &export, splits);
}

fn assert_same_with(
    scene: &Scene,
    options: CarverOptions,
    export: &ExportOptions,
    splits: &[(usize, u64, u32)],
) {
    let mut whole = scene.carver(options);
    whole.carve();
    let whole = whole.mesh(export);
    let carver = scene.carver(options);
    for &(tiles, seed, halo) in splits {
        let mut options = PlanOptions::default();
        options.tiles = tiles;
        options.seed = seed;
        options.halo = halo;
        options.sample = if seed % 2 == 0 { 1 << 20 } else { 64 };
        options.keeps_neighbors = false;
        let (mesh, _) = tiled(&carver, export, &options);
        assert!(mesh == whole, "{tiles} tiles, seed {seed}, halo {halo}");
    }
    if let (Some(&(tiles, seed, halo)), None) = (splits.last(), export.longest_edge) {
        assert_same_later(&carver, &whole, export, (tiles, seed, halo));
    }
}

/// Filters and repair come after the merge.
fn assert_same_later(
    carver: &Carver,
    whole: &IndexedMesh,
    export: &ExportOptions,
    (tiles, seed, halo): (usize, u64, u32),
) {
    let mut options = PlanOptions::default();
    options.tiles = tiles;
    options.seed = seed;
    options.halo = halo;
    options.keeps_neighbors = true;
    let folder = tempfile::tempdir().unwrap();
    let work = plan(folder.path(), carver, export, &options, String::new()).unwrap();
    run(&work, 1, |item| run_item(&work, item, || None)).unwrap();
    let surface = merged_surface(&work).unwrap();
    let all = vec![TriangleRole::Exported; surface.triangles.len()];
    let (mesh, _) = assemble(&surface, &all, export);
    assert!(mesh == *whole, "{tiles} tiles, seed {seed}, later");
}

/// A rough terrain with blocks on it, seen from above and from the streets, with wrong points.
fn city(count: usize, seed: u64) -> Scene {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let side = (count as f64).sqrt();
    let mut points = Vec::new();
    for i in 0..count {
        let (x, y): (f64, f64) = (
            random.random_range(0.0..side),
            random.random_range(0.0..side),
        );
        let is_block = (x / 6.0) as i64 % 2 == 0 && (y / 6.0) as i64 % 2 == 0;
        let ground =
            0.5 * (0.3 * x).sin() * (0.2 * y).cos() + 0.02 * random.random_range(-1.0..1.0);
        let z = if is_block {
            4.0 + 0.1 * random.random_range(-1.0..1.0)
        } else {
            ground
        };
        points.push(match i % 40 {
            0 => [x, y, random.random_range(-2.0..8.0)],
            _ => [x, y, z],
        });
    }
    let mut views = Vec::new();
    for _ in 0..12 {
        views.push([
            random.random_range(0.0..side),
            random.random_range(0.0..side),
            30.0,
        ]);
    }
    for _ in 0..12 {
        views.push([
            random.random_range(0.0..side),
            random.random_range(0.0..side),
            2.0,
        ]);
    }
    let mut scene = Scene::new(points, views, 5);
    // Street views see what is near.
    scene.rays.retain(|&(v, p)| {
        let (view, point) = (scene.views[v], scene.points[p]);
        v < 12 || (view[0] - point[0]).hypot(view[1] - point[1]) < 15.0
    });
    scene
}

const SPLITS: [(usize, u64, u32); 6] = [
    (1, 0, 4),
    (2, 0, 4),
    (7, 0, 24),
    (7, 5, 4),
    (7, 9, 0),
    (64, 2, 6),
];

#[test]
fn a_city_by_votes_has_the_bytes_of_one_process() {
    let scene = city(2000, 1);
    assert_same(&scene, votes(Hull::Drop), &SPLITS);
    assert_same(&scene, votes(Hull::Keep), &[(7, 1, 0)]);
}

#[test]
fn a_city_by_cut_has_the_bytes_of_one_process() {
    let scene = city(2000, 2);
    assert_same(&scene, cut(), &SPLITS);
}

#[test]
fn long_edges_and_export_without_repair_are_the_same() {
    let scene = city(800, 3);
    for (longest_edge, minimum_component, manifold) in [
        (Some(4.0), 20, true),
        (Some(2.5), 1, false),
        (None, 0, true),
    ] {
        let mut export = ExportOptions::default();
        export.longest_edge = longest_edge;
        export.minimum_component = minimum_component;
        export.manifold = manifold;
        assert_same_with(&scene, votes(Hull::Drop), &export, &[(5, 1, 0)]);
    }
}

#[test]
fn surfaces_that_touch_themselves_across_tiles_are_repaired_alike() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    // What the surfaces of tiles had to tell the merge, so that the test tests it.
    let mut told = std::collections::BTreeMap::<String, u64>::new();
    for round in 0..24 {
        let mut position = || [0; 3].map(|_| random.random_range(-1.0..1.0));
        let points = (0..260).map(|_| position()).collect();
        let views = (0..9).map(|_| position()).collect();
        let scene = Scene::new(points, views, 4 + round % 3);
        let options = match round % 2 {
            0 => votes(if round % 4 == 0 {
                Hull::Drop
            } else {
                Hull::Keep
            }),
            _ => cut(),
        };
        let mut export = ExportOptions::default();
        export.longest_edge = (round % 5 == 0).then_some(0.6);
        export.minimum_component = [8, 30, 100, 1][round % 4];
        export.manifold = round % 6 != 5;
        let mut whole = scene.carver(options);
        whole.carve();
        let whole = whole.mesh(&export);
        let carver = scene.carver(options);
        for tiles in [3, 12] {
            let mut options = PlanOptions::default();
            options.tiles = tiles;
            options.seed = round as u64;
            options.halo = 2;
            let folder = tempfile::tempdir().unwrap();
            let work = plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
            run(&work, 1, |item| run_item(&work, item, || None)).unwrap();
            let mesh = merged_mesh(&work).unwrap();
            assert!(mesh == whole, "round {round}, {tiles} tiles");
            for item in work.items(Stage::Surface) {
                for (name, count) in work.done(item).unwrap().counts {
                    *told.entry(name).or_default() += count;
                }
            }
        }
    }
    for what in [
        "corners_in_later_fans",
        "sides_of_repeated_edges",
        "triangles_of_small_components",
    ] {
        assert!(told[what] > 50, "{told:?}");
    }
    eprintln!("{told:?}");
}

#[test]
fn degenerate_sets_have_the_bytes_of_one_process() {
    let grid = |n: i32| {
        let cube = (0..n * n * n).map(move |i| [i % n, i / n % n, i / (n * n)].map(f64::from));
        cube.collect::<Vec<[f64; 3]>>()
    };
    let views = vec![
        [1.5, 1.5, 1.25],
        [9.0, 2.0, 3.0],
        [-3.0, -3.0, -3.0],
        [2.0, 2.0, 9.0],
        [1.0, 1.0, 0.5],
    ];
    let mut doubled = grid(5);
    doubled.extend(grid(5));
    doubled.push([1e6, -1e6, 3e5]);
    let slab: Vec<[f64; 3]> = (grid(7).into_iter())
        .filter(|p| p[2] < 1.0)
        .chain([[3.0, 3.0, 0.25], [1.0, 5.0, -0.5]])
        .collect();
    let sphere: Vec<[f64; 3]> = (0..3000)
        .map(|i| [i % 15 - 7, i / 15 % 15 - 7, i / 225 - 7].map(f64::from))
        .filter(|p| p.iter().map(|x| x * x).sum::<f64>() == 49.0 || p == &[0.0; 3])
        .collect();
    let far = grid(5)
        .into_iter()
        .map(|p| [p[0] + 4.5e5, p[1] + 5.4e6, p[2] + 600.0]);
    let far_views: Vec<[f64; 3]> = (views.iter())
        .map(|p| [p[0] + 4.5e5, p[1] + 5.4e6, p[2] + 600.0])
        .collect();
    let scenes = [
        Scene::new(grid(6), views.clone(), 3),
        Scene::new(doubled, views.clone(), 2),
        Scene::new(slab, views.clone(), 2),
        Scene::new(sphere, views.clone(), 1),
        Scene::new(far.collect(), far_views, 2),
        Scene::new(grid(2), views, 1),
    ];
    for scene in &scenes {
        for options in [votes(Hull::Keep), cut()] {
            assert_same(scene, options, &[(5, 1, 3), (30, 3, 2)]);
        }
    }
}

#[test]
fn a_plane_is_refused_as_it_has_no_surface() {
    let plane = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 1.0]);
    let scene = Scene::new(plane.collect(), vec![[3.3, 3.3, 5.0]], 1);
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("work");
    let carver = scene.carver(votes(Hull::Drop));
    let planned = plan(
        &folder,
        &carver,
        &ExportOptions::default(),
        &PlanOptions::default(),
        String::new(),
    );
    assert!(matches!(planned, Err(TilesError::Flat { points: 100 })));
    assert!(!folder.exists());
}

#[test]
fn a_small_halo_leaves_more_to_settle_and_the_same_mesh() {
    let scene = city(1500, 4);
    let carver = scene.carver(cut());
    let export = ExportOptions::default();
    let mut settled = Vec::new();
    let mut meshes = Vec::new();
    for halo in [0, 3, 40] {
        let mut options = PlanOptions::default();
        options.tiles = 6;
        options.halo = halo;
        let (mesh, count) = tiled(&carver, &export, &options);
        settled.push(count);
        meshes.push(mesh);
    }
    assert!(meshes[0] == meshes[1] && meshes[1] == meshes[2]);
    assert!(settled[0] > settled[2], "{settled:?}");
}

#[test]
fn damage_is_noticed_and_made_good() {
    let scene = city(600, 5);
    let carver = scene.carver(cut());
    let export = ExportOptions::default();
    let folder = tempfile::tempdir().unwrap();
    let mut options = PlanOptions::default();
    options.tiles = 3;
    options.halo = 2;
    let planned = plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
    let carry_out = |work: &Work| run(work, 2, |item| run_item(work, item, || None));
    let all = carry_out(&planned).unwrap();
    let whole = merged_mesh(&planned).unwrap();
    let work = Work::open(folder.path()).unwrap();
    assert_eq!(carry_out(&work).unwrap(), 0);
    for (number, stage) in Stage::ALL.into_iter().enumerate() {
        let item = work.items(stage).next().unwrap();
        let path = work.path(item);
        let bytes = std::fs::read(&path).unwrap();
        let mut flipped = bytes.clone();
        let at = bytes.len() * (number + 1) / 10;
        flipped[at] ^= 1 << (number % 8);
        for damaged in [flipped, bytes[..bytes.len() - 5].to_vec(), Vec::new()] {
            std::fs::write(&path, damaged).unwrap();
            assert_eq!(carry_out(&work).unwrap(), 1, "{stage:?}");
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(carry_out(&work).unwrap(), 1);
        std::fs::remove_file(work.manifest_path(item)).unwrap();
        assert_eq!(carry_out(&work).unwrap(), 1);
        assert_eq!(merged_mesh(&work).unwrap(), whole);
    }
    assert!(all > 8);
    // Another plan does not go into the same folder, and the same does.
    let mut other = options;
    other.tiles = 4;
    let refused = plan(folder.path(), &carver, &export, &other, String::new());
    assert!(matches!(refused, Err(TilesError::Planned { .. })));
    plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
    // The plan's own files cannot be made again from nothing.
    let rays = folder.path().join("plan/rays/000001.tile");
    let mut bytes = std::fs::read(&rays).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&rays, bytes).unwrap();
    let error = carry_out(&work).unwrap_err();
    assert!(error.to_string().contains("000001.tile"), "{error}");
    let text = std::fs::read_to_string(folder.path().join("plan.json")).unwrap();
    std::fs::write(
        folder.path().join("plan.json"),
        text.replace("\"halo\": 2", "\"halo\": 3"),
    )
    .unwrap();
    assert!(matches!(
        Work::open(folder.path()),
        Err(TilesError::DamagedPlan { .. })
    ));
    std::fs::write(
        folder.path().join("plan.json"),
        text.replace("(files", "(other files"),
    )
    .unwrap();
    assert!(matches!(
        Work::open(folder.path()),
        Err(TilesError::OtherProgram { .. })
    ));
}
