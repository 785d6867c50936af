//! The same sums and the same mesh on every platform: digests of what one of them computed.

#![allow(clippy::unwrap_used, reason = "a test ends where anything fails")]
use linecarve_carving::{Carver, CarverOptions, CutOptions, ExportOptions, Hull, Labels, Votes};
use linecarve_tiles::{PlanOptions, Stage, merged_mesh, plan, run, run_item};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use xxhash_rust::xxh3::Xxh3;

const POINTS: usize = 10_000;
/// Bytes of a file before its sections.
const HEADER: usize = 64;
/// Digests of sums and mesh. They change with the formats of these files, and with what a ray says about a cell.
const BY_VOTES: [u64; 2] = [0xcaaa_2f63_bbe2_5ced, 0x46ec_4b15_0cf8_3327];
const BY_CUT: [u64; 2] = [0x52f0_3166_8430_9b72, 0x6ad5_10b8_36c7_7a12];

/// Ground with blocks, seen from above and from between the blocks. No function of a system's library has a part in it.
fn carver(labels: Labels) -> Carver {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut carver = Carver::deferred(CarverOptions::new(labels, Hull::Drop));
    let mut change = carver.transaction();
    let views: Vec<_> = (0..16)
        .map(|view| {
            let height = if view % 8 > 0 { 40.0 } else { 2.0 };
            let center = [0; 2].map(|_| random.random_range(0.0..100.0));
            let view = Point3::new(center[0], center[1], height);
            change.add_view(view).unwrap()
        })
        .collect();
    for number in 0..POINTS {
        let [x, y] = [0; 2].map(|_| random.random_range(0.0..100.0_f64));
        let is_block = (x / 12.5) as i64 % 2 == 0 && (y / 12.5) as i64 % 2 == 0;
        let noise = 0.05 * random.random_range(-1.0..1.0_f64);
        let z = match number % 40 {
            0 => random.random_range(-2.0..8.0),
            _ if is_block => 6.0 + noise,
            _ => noise + (0.01 * x * (100.0 - x)).sqrt(),
        };
        let point = change.add_point(Point3::new(x, y, z)).unwrap();
        let sigma = (number % 3 > 0).then_some(0.01 * (1 + number % 5) as f64);
        change.set_sigma(point, sigma).unwrap();
        for _ in 0..3 {
            let view = views[random.random_range(0..views.len())];
            change.add_observation(view, point, 1).unwrap();
        }
    }
    change.commit().unwrap();
    carver
}

/// Digests of the sums over rays and of the mesh.
fn digests(labels: Labels) -> [u64; 2] {
    let folder = tempfile::tempdir().unwrap();
    let mut options = PlanOptions::default();
    options.tiles = 4;
    let export = ExportOptions::default();
    let carver = carver(labels);
    let work = plan(folder.path(), &carver, &export, &options, String::new()).unwrap();
    run(&work, 1, |item| run_item(&work, item, || None)).unwrap();
    let mut sums = Xxh3::new();
    for stage in [Stage::Carve, Stage::Giants] {
        for item in work.items(stage) {
            sums.update(&std::fs::read(work.path(item)).unwrap()[HEADER..]);
        }
    }
    let mesh = merged_mesh(&work).unwrap();
    assert!(mesh.triangles.len() > POINTS / 2);
    let mut surface = Xxh3::new();
    for coordinate in mesh.vertices.iter().flat_map(|vertex| vertex.iter()) {
        surface.update(&coordinate.to_le_bytes());
    }
    for corner in mesh.triangles.as_flattened() {
        surface.update(&corner.to_le_bytes());
    }
    [sums.digest(), surface.digest()]
}

#[test]
fn sums_and_mesh_by_votes_are_those_of_other_platforms() {
    assert_eq!(digests(Labels::Votes(Votes::default())), BY_VOTES);
}

#[test]
fn sums_and_mesh_by_cut_are_those_of_other_platforms() {
    assert_eq!(digests(Labels::Cut(CutOptions::default())), BY_CUT);
}
