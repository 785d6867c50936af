//! Point sets that break tetrahedralisations which are not exact.

use nalgebra::Point3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A named point set.
pub(crate) struct Family {
    pub(crate) name: &'static str,
    pub(crate) points: Vec<Point3<f64>>,
}

/// Whether the long mode was asked for.
pub(crate) fn long_mode() -> bool {
    std::env::var_os("LINECARVE_LONG_TESTS").is_some_and(|value| value != "0")
}

/// An `n` by `n` grid in a plane.
pub(crate) fn plane(n: i32) -> Vec<Point3<f64>> {
    (0..n * n)
        .map(|i| Point3::new(f64::from(i % n), f64::from(i / n), 0.0))
        .collect()
}

/// `value`, unless zero, moved by up to two units in the last place.
fn jiggle(value: f64, rng: &mut impl Rng) -> f64 {
    let mut moved = value;
    for _ in 0..rng.random_range(0..3) {
        moved = if value == 0.0 {
            value
        } else if rng.random() {
            moved.next_up()
        } else {
            moved.next_down()
        };
    }
    moved
}

/// All sets, of 60 to 200 points each.
pub(crate) fn families(seed: u64) -> Vec<Family> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut families = vec![];
    let mut add = |name, points: Vec<Point3<f64>>| families.push(Family { name, points });
    let uniform =
        |rng: &mut ChaCha8Rng| Point3::new(rng.random::<f64>(), rng.random(), rng.random());
    let small = |rng: &mut ChaCha8Rng, n: i32| {
        Point3::from(std::array::from_fn::<f64, 3, _>(|_| {
            f64::from(rng.random_range(0..n))
        }))
    };

    add("uniform", (0..150).map(|_| uniform(rng)).collect());
    add(
        "grid with duplicates",
        (0..150).map(|_| small(rng, 4)).collect(),
    );
    add(
        "coarse grid with duplicates",
        (0..60).map(|_| small(rng, 2)).collect(),
    );
    add(
        "coplanar points",
        (0..120)
            .map(|_| {
                let mut p = small(rng, 6);
                p.z = f64::from(rng.random_range(0..2)) * 5.0;
                p
            })
            .collect(),
    );
    add(
        "slanted plane with a few points off it",
        (0..100)
            .map(|i| {
                let mut p = small(rng, 8);
                p.z = p.x * 2.0 - p.y * 3.0 + f64::from(i8::from(i % 25 == 24));
                p
            })
            .collect(),
    );
    add(
        "lines",
        (0..90)
            .map(|i| {
                let s = f64::from(rng.random_range(0..30));
                match i % 3 {
                    0 => Point3::new(s, 0.0, 0.0),
                    1 => Point3::new(s, s, 0.0),
                    _ => Point3::new(3.0, 3.0, s),
                }
            })
            .collect(),
    );
    // Integer points at distance exactly 65 = 5 * 13 from the origin.
    let mut sphere = vec![];
    for x in -65i32..=65 {
        for y in -65i32..=65 {
            let rest = 65 * 65 - x * x - y * y;
            if rest >= 0 {
                let z = f64::from(rest).sqrt().round() as i32;
                if z * z == rest {
                    sphere.push(Point3::new(f64::from(x), f64::from(y), f64::from(z)));
                    sphere.push(Point3::new(f64::from(x), f64::from(y), -f64::from(z)));
                }
            }
        }
    }
    let picked = (0..150)
        .map(|_| sphere[rng.random_range(0..sphere.len())])
        .collect();
    add("exact sphere", picked);
    add(
        "near sphere",
        (0..120)
            .map(|_| {
                let d = uniform(rng).coords.add_scalar(-0.5);
                Point3::from(d / d.norm())
            })
            .collect(),
    );
    add(
        "ulps apart",
        (0..100)
            .map(|_| {
                let p = small(rng, 3).coords.add_scalar(0.1);
                Point3::new(jiggle(p.x, rng), jiggle(p.y, rng), jiggle(p.z, rng))
            })
            .collect(),
    );
    add(
        "millimetres at ten million",
        (0..120)
            .map(|_| {
                let p = small(rng, 4);
                Point3::new(1e7 + p.x * 1e-3, -1e7 + p.y * 1e-3, 5e6 + p.z * 1e-3)
            })
            .collect(),
    );
    add(
        "all magnitudes",
        (0..100)
            .map(|_| {
                Point3::from(std::array::from_fn::<f64, 3, _>(|_| {
                    let exponent = rng.random_range(-149..190);
                    let sign = if rng.random() { 1.0 } else { -1.0 };
                    sign * rng.random_range(1.0..2.0) * 2f64.powi(exponent)
                }))
            })
            .collect(),
    );
    add(
        "walls with millimetre noise",
        (0..150)
            .map(|i| {
                let mut p = uniform(rng);
                p[i % 3] = f64::from(rng.random_range(0..2)) + rng.random_range(-1e-3..1e-3);
                p
            })
            .collect(),
    );
    add(
        "mixture",
        (0..150)
            .map(|i| match i % 5 {
                0 => uniform(rng) * 3.0,
                1 => small(rng, 4),
                2 => sphere[rng.random_range(0..sphere.len())] / 65.0,
                3 => Point3::new(rng.random_range(0.0..3.0), 1.0, 1.0),
                _ => {
                    let p = small(rng, 4);
                    Point3::new(jiggle(p.x, rng), p.y, jiggle(p.z, rng))
                }
            })
            .collect(),
    );
    families
}
