use nalgebra::Vector3;

use super::super::options::Alignment;
use super::*;

/// A square of the given side in the plane z, of two triangles.
fn square(side: f64, z: f64) -> Shape {
    Shape {
        positions: [
            [0.0, 0.0, z],
            [side, 0.0, z],
            [side, side, z],
            [0.0, side, z],
        ]
        .map(Point3::from)
        .to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Shape::default()
    }
}

fn options() -> EvaluationOptions {
    EvaluationOptions {
        samples: 20_000,
        region: Region::Everywhere,
        ..EvaluationOptions::default()
    }
}

#[test]
fn a_shifted_square_has_its_shift_for_a_distance() {
    let found = evaluate(&square(2.0, 0.03), &square(2.0, 0.0), &options()).unwrap();
    for statistics in [found.accuracy, found.completeness, found.vertices] {
        let statistics = statistics.unwrap();
        assert!((statistics.mean - 0.03).abs() < 1e-12);
        assert!((statistics.max - 0.03).abs() < 1e-12);
    }
    let f: Vec<_> = found.at.iter().map(|score| score.f.unwrap()).collect();
    assert_eq!(f, [0.0, 1.0, 1.0]);
    assert_eq!(found.at[0].vertex_precision, 0.0);
    assert!(found.warnings.is_empty());
}

#[test]
fn a_half_is_exact_and_incomplete() {
    let half = Shape {
        triangles: vec![[0, 1, 2]],
        ..square(2.0, 0.0)
    };
    let found = evaluate(&half, &square(2.0, 0.0), &options()).unwrap();
    assert!(found.accuracy.unwrap().max < 1e-12);
    assert_eq!(found.at[0].precision, 1.0);
    // Of the other half a strip along the diagonal is nearer than the threshold: depth t of a height of sqrt(2).
    for score in &found.at {
        let t = score.threshold / 2.0_f64.sqrt();
        let expected = 0.5 + 0.5 * (1.0 - (1.0 - t).powi(2));
        assert!(
            (score.recall.unwrap() - expected).abs() < 0.005,
            "{score:?}"
        );
    }
    // Mean distance over the far half: a third of its height.
    let mean = found.completeness.unwrap().mean;
    assert!((mean - 0.5 * 2.0_f64.sqrt() / 3.0).abs() < 0.005, "{mean}");
}

#[test]
fn points_outside_the_box_of_the_truth_do_not_count() {
    let large = square(4.0, 0.0);
    let inside = EvaluationOptions {
        region: Region::GroundTruth,
        ..options()
    };
    let found = evaluate(&large, &square(2.0, 0.0), &inside).unwrap();
    let share = found.outside_region as f64 / found.drawn as f64;
    assert!((share - 0.75).abs() < 0.01, "{share}");
    assert!(found.accuracy.unwrap().max < 1e-12);
    let lifted = evaluate(&square(4.0, 0.1), &square(2.0, 0.0), &inside).unwrap();
    assert_eq!(lifted.accuracy, None);
    assert!(lifted.warnings[0].contains("region of interest"));
}

#[test]
fn lines_are_measured_along_and_at_their_ends() {
    let lines = Shape {
        positions: vec![Point3::new(0.5, 0.5, 0.0), Point3::new(0.5, 0.5, 0.1)],
        lines: vec![[0, 1]],
        ..Shape::default()
    };
    let found = evaluate(&lines, &square(2.0, 0.0), &options()).unwrap();
    assert_eq!(found.drawn, 11);
    let along = found.accuracy.unwrap();
    assert!((along.mean - 0.05).abs() < 1e-12 && (along.max - 0.1).abs() < 1e-12);
    let ends = found.vertices.unwrap();
    assert_eq!(ends.count, 2);
    assert!((ends.mean - 0.05).abs() < 1e-12);
    assert_eq!(found.completeness, None);
    assert_eq!((found.at[0].recall, found.at[0].f), (None, None));
    assert!((found.at[0].precision - 2.0 / 11.0).abs() < 1e-12);
}

#[test]
fn clouds_are_measured_by_their_points() {
    let cloud = Shape {
        triangles: Vec::new(),
        ..square(2.0, 0.0)
    };
    let lifted = square(2.0, 0.04);
    let found = evaluate(&cloud, &lifted, &options()).unwrap();
    assert_eq!(found.accuracy.unwrap().count, 4);
    assert!((found.accuracy.unwrap().mean - 0.04).abs() < 1e-12);
    let found = evaluate(&lifted, &cloud, &options()).unwrap();
    assert_eq!(found.completeness.unwrap().count, 4);
    assert!((found.completeness.unwrap().mean - 0.04).abs() < 1e-12);
    assert!(found.accuracy.unwrap().mean > 0.5);
}

#[test]
fn alignments_undo_a_known_motion() {
    let room = crate::test_room::room();
    let motion = Similarity3::new(
        Vector3::new(0.03, -0.02, 0.04),
        Vector3::new(0.02, 0.01, -0.03),
        1.0,
    );
    let mut given = room.clone();
    given.transform(&motion.to_homogeneous());
    let with = |alignment| EvaluationOptions {
        alignment,
        ..options()
    };
    let mean = |alignment| {
        let found = evaluate(&given, &room, &with(alignment)).unwrap();
        found.accuracy.unwrap().mean
    };
    assert!(mean(Alignment::None) > 0.01);
    assert!(mean(Alignment::Given(motion.inverse())) < 1e-9);
    let start = Similarity3::identity();
    assert!(mean(Alignment::Icp { start }) < 1e-4);

    // In millimetres, the scale has to be found.
    let mut scaled = given.clone();
    for position in &mut scaled.positions {
        *position *= 1000.0;
    }
    let found = evaluate(&scaled, &room, &with(Alignment::None)).unwrap();
    assert!(found.warnings[0].contains("units"), "{:?}", found.warnings);
    let found = evaluate(&scaled, &room, &with(Alignment::Similarity { start: None })).unwrap();
    assert!(
        (found.alignment.scale - 0.001).abs() < 1e-6,
        "{:?}",
        found.alignment
    );
    assert!(found.accuracy.unwrap().mean < 1e-3);
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

#[test]
fn what_no_keyframe_looked_at_does_not_count() {
    let both = Shape {
        positions: [square(2.0, 0.0).positions, square(2.0, 1.0).positions].concat(),
        triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        ..Shape::default()
    };
    let observed = ObservedShape {
        shape: square(2.0, 0.0),
        vertices: [[true; 4], [false; 4]].concat(),
        share: 0.5,
        keyframes: 1,
    };
    let found = evaluate_observed(&both, Some(&observed), &square(2.0, 0.0), &options()).unwrap();
    assert!(found.accuracy.unwrap().max < 1e-12);
    assert_eq!(found.vertices.unwrap().count, 4);
    assert_eq!(found.shape.triangles, 4);
    assert_eq!(found.observed.unwrap().share, 0.5);
    let nothing = ObservedShape {
        shape: Shape::default(),
        vertices: vec![false; 8],
        share: 0.0,
        keyframes: 1,
    };
    let found = evaluate_observed(&both, Some(&nothing), &square(2.0, 0.0), &options()).unwrap();
    assert_eq!((found.accuracy, found.completeness), (None, None));
    assert_eq!(found.at[2].f, Some(0.0));
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let truth = square(2.0, 0.0);
    assert_eq!(
        evaluate(&Shape::default(), &truth, &options()),
        Err(EvaluationError::Empty)
    );
    assert!(evaluate(&truth, &Shape::default(), &options()).is_err());
    let lines = Shape {
        triangles: Vec::new(),
        lines: vec![[0, 1]],
        ..square(2.0, 0.0)
    };
    assert!(evaluate(&truth, &lines, &options()).is_err());
    let mut broken = truth.clone();
    broken.triangles.push([0, 1, 9]);
    assert!(evaluate(&broken, &truth, &options()).is_err());
    broken.triangles.pop();
    broken.positions[0].x = f64::NAN;
    assert!(evaluate(&truth, &broken, &options()).is_err());
    let bad = EvaluationOptions {
        samples: 0,
        ..options()
    };
    assert!(evaluate(&truth, &truth, &bad).is_err());
    // All triangles without area: there is nothing to draw on, and that is said.
    let flat = Shape {
        triangles: vec![[0, 1, 1]],
        ..square(2.0, 0.0)
    };
    let found = evaluate(&flat, &truth, &options()).unwrap();
    assert_eq!(found.drawn, 0);
    assert!(!found.warnings.is_empty());
}

#[test]
fn the_same_seed_gives_the_same_result_for_any_number_of_threads() {
    let room = crate::test_room::room();
    let mut other = room.clone();
    for (index, position) in other.positions.iter_mut().enumerate() {
        position.x += 0.001 * (index % 7) as f64;
    }
    let aligned = EvaluationOptions {
        alignment: Alignment::Icp {
            start: Similarity3::identity(),
        },
        ..options()
    };
    let on = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| evaluate(&other, &room, &aligned).unwrap())
    };
    let one = on(1);
    assert_eq!(one, on(3));
    let text = serde_json::to_string(&one).unwrap();
    assert!(text.contains("\"completeness\":{\"count\":20000"), "{text}");
}

#[test]
fn a_step_that_gives_too_many_samples_is_refused_with_one_that_does() {
    let lines = Shape {
        positions: vec![Point3::origin(), Point3::new(10.0, 0.0, 0.0)],
        lines: vec![[0, 1]],
        ..Shape::default()
    };
    let with = |step| EvaluationOptions {
        step: Some(step),
        ..options()
    };
    let refused = evaluate(&lines, &square(2.0, 0.0), &with(1e-7)).unwrap_err();
    assert!(
        refused.to_string().contains("at least 5.05e-7"),
        "{refused}"
    );
    assert!(evaluate(&lines, &square(2.0, 0.0), &with(1e-3)).is_ok());
}
