use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Segments scattered about a few hundred lines of a room of 4 units, and which line each belongs to.
fn scattered(
    seed: u64,
    lines: usize,
    per_line: usize,
    noise: f64,
) -> Vec<([Point3<f64>; 2], usize)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut all = Vec::new();
    let mut point = |scale: f64| Vector3::from_fn(|_, _| rng.random_range(-scale..scale));
    let ideal: Vec<_> = (0..lines)
        .map(|_| (point(2.0), point(1.0).normalize()))
        .collect();
    for _ in 0..per_line {
        for (line, (center, direction)) in ideal.iter().enumerate() {
            let ends = point(0.5);
            let (from, to) = (ends.x - 0.2, ends.y.abs() + ends.x + 0.1);
            let ends = [from, to].map(|t| Point3::from(center + direction * t + point(noise)));
            all.push((ends, line));
        }
    }
    all
}

fn clusterer() -> SegmentClusterer {
    SegmentClusterer::new(ClusterOptions::default(), 1.0).unwrap()
}

fn check(clusterer: &SegmentClusterer) {
    let mut seen = vec![false; clusterer.segment_count()];
    for (id, cluster) in clusterer.all_clusters() {
        let members: Vec<_> = clusterer.members(cluster).collect();
        assert_eq!(members.len(), cluster.size as usize);
        for member in members {
            assert!(!std::mem::replace(&mut seen[member.0 as usize], true));
            assert_eq!(clusterer.cluster_of[member.0 as usize], id.0);
        }
    }
    let has_cluster = |id: usize| clusterer.cluster_of[id] != NONE;
    assert!((0..seen.len()).all(|id| seen[id] == has_cluster(id)));
    assert_eq!(clusterer.index.len(), clusterer.all_clusters().count());
    assert_eq!(clusterer.cluster_count(), clusterer.clusters().count());
}

#[test]
fn members_of_a_line_share_a_cluster() {
    let segments = scattered(3, 60, 12, 0.002);
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    for (ends, _) in &segments {
        clusterer.insert(*ends, &mut events).unwrap();
    }
    check(&clusterer);
    let mut mixed = 0;
    let clusters: Vec<_> = clusterer.clusters().collect();
    assert!(clusters.len() <= 64, "{}", clusters.len());
    for (_, cluster) in &clusters {
        let lines: Vec<_> = clusterer
            .members(cluster)
            .map(|id| segments[id.0 as usize].1)
            .collect();
        mixed += usize::from(lines.iter().any(|&line| line != lines[0]));
    }
    assert!(mixed <= 2, "{mixed}");
    let covered: u32 = clusters.iter().map(|(_, c)| c.size).sum();
    assert!(covered > 700, "{covered}");
}

#[test]
fn scaled_and_turned_scene_gives_the_same_clusters() {
    let segments = scattered(5, 80, 8, 0.004);
    let motion = Isometry3::new(
        Vector3::new(300.0, -20.0, 7.0),
        Vector3::new(0.3, -1.1, 0.7),
    );
    let mut plain = clusterer();
    let mut moved = SegmentClusterer::new(ClusterOptions::default(), 1000.0).unwrap();
    let (mut plain_events, mut moved_events) = (Vec::new(), Vec::new());
    for (ends, _) in &segments {
        let a = plain.insert(*ends, &mut plain_events);
        let b = moved.insert(ends.map(|end| motion * (end * 1000.0)), &mut moved_events);
        assert_eq!(a, b);
    }
    assert_eq!(plain_events, moved_events);
    for ((_, a), (_, b)) in plain.all_clusters().zip(moved.all_clusters()) {
        for (a, b) in a.representative.ends.iter().zip(&b.representative.ends) {
            assert!((motion * (a * 1000.0) - b).norm() < 1e-6);
        }
    }
}

#[test]
fn events_tell_the_story() {
    let mut clusterer = clusterer();
    let at = |from: f64, to: f64| [Point3::new(from, 0.0, 1.0), Point3::new(to, 0.0, 1.0)];
    let mut events = Vec::new();
    let mut insert = |ends| {
        events.clear();
        let inserted = clusterer.insert(ends, &mut events);
        (
            inserted.map(|(segment, cluster)| (segment.0, cluster.0)),
            events.clone(),
        )
    };
    use ClusterEvent::{Created, Extended, Merged, Moved};
    let id = ClusterId;
    assert_eq!(insert(at(0.0, 1.0)), (Some((0, 0)), vec![Created(id(0))]));
    assert_eq!(insert(at(2.0, 3.0)), (Some((1, 1)), vec![Created(id(1))]));
    let (_, extended) = insert(at(0.2, 0.9));
    assert_eq!(extended[0], Extended(id(0)));
    // The bridge joins the first and brings the two together.
    let (inserted, bridged) = insert(at(0.9, 2.1));
    assert_eq!(inserted, Some((3, 0)));
    assert!(bridged.contains(&Merged {
        into: id(0),
        from: id(1)
    }));
    assert_eq!(bridged.last(), Some(&Moved(id(0))));
    assert_eq!(insert([Point3::origin(); 2]), (None, vec![]));
    assert_eq!(
        insert([Point3::new(f64::NAN, 0.0, 0.0), Point3::origin()]),
        (None, vec![])
    );
    check(&clusterer);
    assert!(clusterer.cluster(id(1)).is_none());
    let (only, cluster) = clusterer.clusters().next().unwrap();
    assert_eq!((only, cluster.size), (id(0), 4));
    let members: Vec<u32> = clusterer.members(cluster).map(|m| m.0).collect();
    assert_eq!(members, [0, 2, 3, 1]);
    assert!((cluster.representative.length() - 3.0).abs() < 1e-9);
}

#[test]
fn parallel_lines_stay_apart() {
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    for i in 0..20 {
        let y = 0.03 * f64::from(i % 5);
        let shift = 0.01 * f64::from(i);
        clusterer
            .insert(
                [Point3::new(shift, y, 1.0), Point3::new(1.0 + shift, y, 1.0)],
                &mut events,
            )
            .unwrap();
    }
    assert_eq!(clusterer.clusters().count(), 5);
}

#[test]
fn the_best_fit_wins_over_the_first() {
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    let at = |y: f64| [Point3::new(0.0, y, 1.0), Point3::new(1.0, y, 1.0)];
    clusterer.insert(at(0.0), &mut events).unwrap();
    clusterer.insert(at(0.0065), &mut events).unwrap();
    let (_, cluster) = clusterer.insert(at(0.005), &mut events).unwrap();
    assert_eq!(cluster, ClusterId(1));
}

#[test]
fn bad_scale_is_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(SegmentClusterer::new(ClusterOptions::default(), bad).is_err());
    }
}

/// Pairs of segments near the limits of a fit.
fn near_limits(rng: &mut ChaCha8Rng) -> [[Point3<f64>; 2]; 2] {
    let mut vector = |scale: f64| Vector3::from_fn(|_, _| rng.random_range(-scale..scale));
    // Near an axis, where boxes are thin.
    let direction = (Vector3::x() + vector(0.3)).normalize();
    let across = direction.cross(&vector(1.0)).normalize();
    let turned = (direction + vector(0.1)).normalize();
    let [length, other] = [vector(1.0), vector(1.0)].map(|v| v.x.abs() + 0.01);
    let gap = vector(0.012);
    let start = Point3::from(vector(1.0));
    let next = start + direction * (length + gap.x) + across * gap.y;
    [
        [start, start + direction * length],
        [next, next + turned * other],
    ]
}

#[test]
fn no_cluster_that_fits_is_missed() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (mut fitting, mut beyond_half_distance) = (0, 0);
    for _ in 0..200_000 {
        let pair = near_limits(&mut rng);
        let [first, second] = pair.map(|ends| WorldSegment::new(ends).unwrap());
        let mut clusterer = clusterer();
        clusterer.insert(pair[0], &mut Vec::new()).unwrap();
        let fits = clusterer
            .misfit(&first, &second, clusterer.offset)
            .is_some();
        let found = clusterer.best_cluster(&second, None, clusterer.offset);
        assert_eq!(found.is_some(), fits, "{pair:?}");
        fitting += usize::from(fits);
        let corners = |segment: &WorldSegment| {
            let [a, b] = &segment.ends;
            (a.inf(b), a.sup(b))
        };
        let (a, b) = (corners(&first), corners(&second));
        let gap = (0..3)
            .map(|axis| (a.0[axis] - b.1[axis]).max(b.0[axis] - a.1[axis]))
            .fold(f64::NEG_INFINITY, f64::max);
        beyond_half_distance += usize::from(fits && gap > 0.01);
    }
    assert!(
        fitting > 10_000 && beyond_half_distance > 10,
        "{fitting} {beyond_half_distance}"
    );
}

#[test]
fn clusters_that_moved_are_found() {
    // Short and long ones, some with more cells than the index holds, near the origin and far from it.
    for (length, far) in [(1.0, 0.0), (300.0, 0.0), (1.0, 1e6), (0.1, 1e12)] {
        let mut segments = scattered(7, 40, 12, 0.003);
        for (ends, _) in &mut segments {
            ends[1] = ends[0] + (ends[1] - ends[0]) * length;
            ends.iter_mut().for_each(|end| end.x += far);
        }
        let mut clusterer = clusterer();
        for (ends, _) in &segments {
            let Some(segment) = WorldSegment::new(*ends) else {
                continue;
            };
            let expected = clusterer
                .all_clusters()
                .filter_map(|(id, cluster)| {
                    let misfit =
                        clusterer.misfit(&cluster.representative, &segment, clusterer.offset)?;
                    Some((misfit, id.0))
                })
                .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let found = clusterer.best_cluster(&segment, None, clusterer.offset);
            assert_eq!(found, expected.map(|(_, id)| id), "{length} {far}");
            clusterer.insert(*ends, &mut Vec::new());
        }
        check(&clusterer);
    }
}

#[test]
fn all_clusters_near_a_position_are_found() {
    let segments = scattered(11, 40, 12, 0.003);
    let mut clusterer = clusterer();
    for (ends, _) in &segments {
        clusterer.insert(*ends, &mut Vec::new()).unwrap();
    }
    let reach = 0.4 * clusterer.distance;
    let mut found = 0;
    for (ends, _) in &segments {
        let position = ends[0] + 0.3 * (ends[1] - ends[0]);
        let near: Vec<[Point3<f64>; 2]> = clusterer.clusters_near(&position, reach).collect();
        for (_, cluster) in clusterer.clusters() {
            let [from, to] = cluster.representative.ends;
            let along = to - from;
            let share = (position - from).dot(&along) / along.norm_squared();
            let foot = from + share.clamp(0.0, 1.0) * along;
            if (foot - position).norm() <= reach {
                assert!(near.contains(&cluster.representative.ends));
                found += 1;
            }
        }
    }
    assert!(found > 100, "{found}");
}

#[test]
fn lines_of_opposite_direction_share_a_cluster() {
    // The sign of a direction is arbitrary.
    for direction in [
        Vector3::x(),
        Vector3::y(),
        Vector3::z(),
        Vector3::new(0.0, -1.0, 1.0),
    ] {
        for turn in [
            Vector3::zeros(),
            Vector3::new(0.1, -0.1, 0.05),
            Vector3::new(-0.05, 0.1, -0.1),
        ] {
            let mut clusterer = clusterer();
            let center = Point3::new(0.3, -0.2, 2.0);
            let half = 0.02 * direction.normalize();
            let turned = 0.02 * (direction.normalize() + turn).normalize();
            let ends = [
                [center - half, center + half],
                [center + turned, center - turned],
            ];
            for ends in ends {
                clusterer.insert(ends, &mut Vec::new()).unwrap();
            }
            assert_eq!(clusterer.all_clusters().count(), 1, "{direction} {turn}");
        }
    }
}

#[test]
fn moved_segments_leave_their_clusters_and_join_others() {
    let segments = scattered(5, 40, 8, 0.002);
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    let mut ends: Vec<[Point3<f64>; 2]> = Vec::new();
    for (segment, _) in &segments {
        clusterer.insert(*segment, &mut events).unwrap();
        ends.push(*segment);
    }
    let before: Vec<_> = clusterer
        .clusters()
        .map(|(_, c)| c.representative)
        .collect();
    // A quarter of all go far away, together, and come back.
    let chosen: Vec<u32> = (0..ends.len() as u32).filter(|id| id % 4 == 1).collect();
    for shift in [10.0, -10.0] {
        let moved: Vec<_> = chosen
            .iter()
            .map(|id| {
                let ends = ends[*id as usize].map(|end| end + Vector3::new(shift, 0.0, 0.0));
                (SegmentId(*id), Some(ends))
            })
            .collect();
        clusterer.change(&moved, |id| ends[id.0 as usize], &mut events);
        for (id, new) in moved {
            ends[id.0 as usize] = new.unwrap();
        }
        check(&clusterer);
        let far = |c: &Cluster| c.representative.ends.iter().any(|end| end.x > 5.0);
        assert_eq!(clusterer.clusters().any(|(_, c)| far(c)), shift > 0.0);
    }
    let after: Vec<_> = clusterer
        .clusters()
        .map(|(_, c)| c.representative)
        .collect();
    assert!(
        before.len().abs_diff(after.len()) <= 2,
        "{} {}",
        before.len(),
        after.len()
    );
}

#[test]
fn removed_segments_leave_no_cluster() {
    let segments = scattered(7, 10, 4, 0.002);
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    for (ends, _) in &segments {
        clusterer.insert(*ends, &mut events).unwrap();
    }
    let all: Vec<_> = (0..segments.len() as u32)
        .map(|id| (SegmentId(id), None))
        .collect();
    let ends = |id: SegmentId| segments[id.0 as usize].0;
    clusterer.change(&all[..5], ends, &mut events);
    check(&clusterer);
    clusterer.change(&all, ends, &mut events);
    check(&clusterer);
    assert_eq!(clusterer.all_clusters().count(), 0);
    assert!(events.iter().any(|e| matches!(e, ClusterEvent::Removed(_))));
}

#[test]
fn closed_clusters_take_no_more_segments() {
    let segments = scattered(11, 12, 3, 0.0005);
    let mut clusterer = clusterer();
    let mut events = Vec::new();
    for (ends, _) in &segments {
        clusterer.insert(*ends, &mut events).unwrap();
    }
    // One alone, and one far away that has a companion.
    let shifted = |ends: &[Point3<f64>; 2], by| ends.map(|end| end + Vector3::new(by, 0.0, 0.0));
    let [alone, paired] = [20.0, 40.0].map(|by| shifted(&segments[0].0, by));
    let mut insert = |clusterer: &mut SegmentClusterer, ends| {
        let (id, cluster) = clusterer.insert(ends, &mut events).unwrap();
        let members = clusterer.cluster(cluster).unwrap().size;
        (id, members)
    };
    let (first_alone, _) = insert(&mut clusterer, alone);
    let (first_paired, _) = insert(&mut clusterer, paired);
    assert_eq!(insert(&mut clusterer, paired).1, 2);
    clusterer.close_single([first_alone, first_paired]);
    assert_eq!(insert(&mut clusterer, paired).1, 3);
    // A new cluster in the same place, open, beside the closed one.
    assert_eq!(insert(&mut clusterer, alone).1, 1);
    assert_eq!(insert(&mut clusterer, alone).1, 2);
    assert_eq!(
        clusterer.index.len() + 1,
        clusterer.all_clusters().count(),
        "the closed cluster is still there"
    );
    // A closed cluster whose segment moves is open again.
    let moved = shifted(&alone, 40.0);
    clusterer.change(&[(first_alone, Some(moved))], |_| alone, &mut Vec::new());
    check(&clusterer);
    assert_eq!(insert(&mut clusterer, moved).1, 2);
    // Segments without a cluster have none to close.
    clusterer.change(&[(first_alone, None)], |_| moved, &mut Vec::new());
    clusterer.close_single([first_alone]);
    check(&clusterer);
}
