//! Times one commit of 100 000 points, each seen by one of 100 views in a room, and prints it as JSON:
//! `commit_points [votes|cut]`. `python/examples/commit_points.py` does the same from Python.

use std::io::Write;
use std::time::Instant;

use linecarve_carving::{Carver, CarverOptions, CutOptions, Labels, Votes};
use nalgebra::Point3;

const POINTS: u64 = 100_000;
const VIEWS: u64 = 100;

/// A number in `0..1` that a counter gives (SplitMix64).
fn random(counter: u64) -> f64 {
    let mut z = counter.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A point on a wall of a room of 10 by 8 by 3.
fn on_wall(number: u64) -> Point3<f64> {
    let side = [10.0, 8.0, 3.0];
    let wall = (random(4 * number) * 6.0) as usize;
    let mut point = [1, 2, 3].map(|k| random(4 * number + k));
    point[wall / 2] = (wall % 2) as f64;
    Point3::new(point[0] * side[0], point[1] * side[1], point[2] * side[2])
}

/// A centre well within it.
fn inside(number: u64) -> Point3<f64> {
    let [x, y, z] = [0, 1, 2].map(|k| 0.1 + 0.8 * random(1 << 40 | (3 * number + k)));
    Point3::new(10.0 * x, 8.0 * y, 3.0 * z)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let labels = std::env::args().nth(1).unwrap_or("votes".to_owned());
    let kind = match labels.as_str() {
        "cut" => Labels::Cut(CutOptions::default()),
        _ => Labels::Votes(Votes::default()),
    };
    let points: Vec<_> = (0..POINTS).map(on_wall).collect();
    let centers: Vec<_> = (0..VIEWS).map(inside).collect();
    let mut carver = Carver::new(CarverOptions::with_labels(kind));
    let start = Instant::now();
    let mut transaction = carver.transaction();
    let mut views = Vec::new();
    for center in centers {
        views.push(transaction.add_view(center)?);
    }
    for (number, point) in points.into_iter().enumerate() {
        let id = transaction.add_point(point)?;
        transaction.set_sigma(id, Some(0.01))?;
        transaction.add_observation(views[number % views.len()], id, 1)?;
    }
    transaction.commit()?;
    let seconds = start.elapsed().as_secs_f64();
    let triangles = carver.triangle_count();
    let mut stdout = std::io::stdout();
    writeln!(
        stdout,
        "{{\"labels\":\"{labels}\",\"triangles\":{triangles},\"seconds\":{seconds:.3}}}"
    )?;
    Ok(())
}
