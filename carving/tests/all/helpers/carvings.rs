//! A carving that several tests look at.

use linecarve_carving::{Carver, CarverOptions, Hull, Labels, PointId, Votes};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Free points in a cube, seen by several views: a carving with caves and bridges.
pub(crate) fn random_carving(seed: u64, hull: Hull) -> Carver {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut carver = Carver::new(CarverOptions::new(Labels::Votes(Votes::default()), hull));
    let mut transaction = carver.transaction();
    let grid = seed.is_multiple_of(2);
    let points: Vec<PointId> = (0..80)
        .map(|_| {
            let p: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.0..6.0));
            let p = if grid { p.map(f64::round) } else { p };
            transaction.add_point(Point3::from(p)).unwrap()
        })
        .collect();
    for _ in 0..3 {
        let center = std::array::from_fn(|_| rng.random_range(-1.1..7.3));
        let view = transaction.add_view(Point3::from(center)).unwrap();
        for &point in &points {
            if rng.random_range(0..3) == 0 {
                transaction.add_observation(view, point, 1).unwrap();
            }
        }
    }
    transaction.commit().unwrap();
    carver
}
