//! Labels by minimum cut from outside: wrong points, scale, motion, order, threads.

use std::collections::BTreeSet;

use linecarve_carving::{
    Carver, CarverOptions, CutOptions, ExportOptions, Hull, IndexedMesh, Labels, PointId, Votes,
};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::helpers::rooms::{self, HALF_M};

/// A camera with the points that it sees, by number.
struct Keyframe {
    center: Point3<f64>,
    seen: Vec<usize>,
}

/// Points with deviations, and who sees them.
struct Room {
    points: Vec<(Point3<f64>, f64)>,
    keyframes: Vec<Keyframe>,
}

/// Standard deviation of a point along the ray that measured it, as a share of its distance.
const NOISE: f64 = 0.004;

/// A room whose walls are seen by cameras on a loop inside, each point by those that have it in a cone of 90 degrees and
/// measured with noise along the ray of the first; a share `wrong` of the points at 0.3 to 1.7 times their distance.
fn room(points: usize, keyframes: usize, wrong: f64, seed: u64) -> Room {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let poses = rooms::poses(keyframes);
    let mut room = Room {
        points: vec![],
        keyframes: (poses.iter())
            .map(|pose| Keyframe {
                center: pose.center,
                seen: vec![],
            })
            .collect(),
    };
    while room.points.len() < points {
        let p = rooms::wall_point(&mut rng);
        // The same numbers are drawn for every share of wrong points.
        let noise = rooms::noise(&mut rng);
        let (draw, depth) = (rng.random_range(0.0..1.0), rng.random_range(0.3..1.7));
        let views = rooms::views_of(&poses, &p);
        let Some(&first) = views.first() else {
            continue;
        };
        let to = p - poses[first].center;
        let share = if draw < wrong {
            depth
        } else {
            1.0 + NOISE * noise
        };
        for view in views {
            room.keyframes[view].seen.push(room.points.len());
        }
        room.points
            .push((poses[first].center + share * to, NOISE * to.norm()));
    }
    room
}

fn carve(room: &Room, labels: Labels) -> (Carver, Vec<PointId>) {
    let mut carver = Carver::new(CarverOptions::new(labels, Hull::Drop));
    let mut ids: Vec<Option<PointId>> = vec![None; room.points.len()];
    for keyframe in &room.keyframes {
        let mut transaction = carver.transaction();
        let view = transaction.add_view(keyframe.center).unwrap();
        for &number in &keyframe.seen {
            let id = *ids[number].get_or_insert_with(|| {
                let (position, sigma) = room.points[number];
                let id = transaction.add_point(position).unwrap();
                transaction.set_sigma(id, Some(sigma)).unwrap();
                id
            });
            transaction.add_observation(view, id, 1).unwrap();
        }
        transaction.commit().unwrap();
    }
    (carver, ids.into_iter().map(Option::unwrap).collect())
}

fn cut() -> Labels {
    Labels::Cut(CutOptions::default())
}

/// Distance from a point to the walls.
fn distance_to_walls(p: &Point3<f64>) -> f64 {
    let beyond = Vector3::from_fn(|k, _| p[k].abs() - HALF_M[k]);
    if beyond.max() <= 0.0 {
        -beyond.max()
    } else {
        beyond.map(|b| b.max(0.0)).norm()
    }
}

/// Mean distance to the walls over the surface, and its area.
fn mean_error(mesh: &IndexedMesh) -> (f64, f64) {
    /// Each triangle is sampled at the centres of so many times so many parts.
    const PARTS: usize = 6;
    let (mut sum, mut area) = (0.0, 0.0);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
        let (ab, ac) = (b - a, c - a);
        let share = ab.cross(&ac).norm() / 2.0 / (PARTS * PARTS) as f64;
        for i in 0..PARTS {
            for j in 0..PARTS {
                let (mut s, mut t) = (
                    (i as f64 + 0.5) / PARTS as f64,
                    (j as f64 + 0.5) / PARTS as f64,
                );
                if s + t > 1.0 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                sum += share * distance_to_walls(&(a + s * ab + t * ac));
                area += share;
            }
        }
    }
    (sum / area, area)
}

#[test]
fn two_wrong_points_in_a_hundred_do_little_harm() {
    let surface = |wrong: f64, labels: Labels| {
        let (carver, _) = carve(&room(2500, 40, wrong, 3), labels);
        mean_error(&carver.mesh(&ExportOptions::default()))
    };
    let votes = [0.0, 0.02].map(|wrong| surface(wrong, Labels::Votes(Votes::default())));
    let cut = [0.0, 0.02].map(|wrong| surface(wrong, cut()));
    let walls = 8.0 * (HALF_M[0] * HALF_M[1] + HALF_M[1] * HALF_M[2] + HALF_M[2] * HALF_M[0]);
    // Nearly all of the walls is there, once.
    for (_, area) in cut {
        assert!((0.9..1.3).contains(&(area / walls)), "{area} of {walls}");
    }
    assert!(cut[1].0 < 2.0 * cut[0].0, "{cut:?}");
    assert!(cut[0].0 <= votes[0].0, "{cut:?} {votes:?}");
    assert!(cut[1].0 < 0.5 * votes[1].0, "{cut:?} {votes:?}");
}

/// Surface triangles by the numbers of their points, smallest first, winding kept.
fn triangles(carver: &Carver, ids: &[PointId]) -> BTreeSet<[usize; 3]> {
    let mut number = vec![usize::MAX; carver.tetrahedra().vertex_capacity()];
    for (index, &id) in ids.iter().enumerate() {
        number[carver.vertex_of(id).unwrap().index()] = index;
    }
    carver
        .triangles()
        .map(|t| {
            let mut t = t.map(|v| number[v.index()]);
            while t[0] != *t.iter().min().unwrap() {
                t.rotate_left(1);
            }
            t
        })
        .collect()
}

/// The room with other coordinates, lengths stretched by `scale`.
fn moved(room: &Room, scale: f64, map: impl Fn(&Point3<f64>) -> Point3<f64>) -> Room {
    Room {
        points: (room.points.iter())
            .map(|(p, sigma)| (map(p), sigma * scale))
            .collect(),
        keyframes: (room.keyframes.iter())
            .map(|k| Keyframe {
                center: map(&k.center),
                seen: k.seen.clone(),
            })
            .collect(),
    }
}

#[test]
fn scale_motion_order_and_threads_do_not_change_the_surface() {
    let original = room(600, 16, 0.02, 4);
    let (carver, ids) = carve(&original, cut());
    let expected = triangles(&carver, &ids);
    assert!(expected.len() > 700, "{}", expected.len());
    for scale in [1000.0, 0.001] {
        let (carver, ids) = carve(&moved(&original, scale, |p| p * scale), cut());
        assert!(triangles(&carver, &ids) == expected, "scale {scale}");
    }
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.3);
    let shift = Vector3::new(30.0, -7.0, 11.0);
    let (carver, ids) = carve(&moved(&original, 1.0, |p| turn * p + shift), cut());
    assert!(triangles(&carver, &ids) == expected, "turned and shifted");

    let mesh = |room: &Room| carve(room, cut()).0.mesh(&ExportOptions::default());
    let mut permuted = moved(&original, 1.0, |p| *p);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for keyframe in &mut permuted.keyframes {
        keyframe.seen.shuffle(&mut rng);
    }
    permuted.keyframes.shuffle(&mut rng);
    let expected = mesh(&original);
    assert!(mesh(&permuted) == expected, "permuted");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert!(pool.install(|| mesh(&original)) == expected, "{threads}");
    }
}

/// Without deviations of their own points have a share of their distance, and nothing else changes.
#[test]
fn points_without_deviations_are_soft_in_proportion_to_their_distance() {
    let mut room = room(600, 16, 0.02, 5);
    for (_, sigma) in &mut room.points {
        *sigma = 0.0;
    }
    let hard = carve(&room, cut()).0.mesh(&ExportOptions::default());
    let (mut carver, ids) = carve(&room, cut());
    let mut transaction = carver.transaction();
    for id in ids {
        transaction.set_sigma(id, None).unwrap();
    }
    transaction.commit().unwrap();
    carver.check_surface().unwrap();
    let soft = carver.mesh(&ExportOptions::default());
    let [hard, soft] = [&hard, &soft].map(|mesh| mean_error(mesh).0);
    assert!(soft < 0.05 && hard < 0.1, "{soft} {hard}");
    assert_eq!(carver.snapshot(), carver.rebuilt(true).snapshot());
}
