use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use linecarve_lines::edges::{EdgeChains, EdgeDetector, EdgeOptions};
use linecarve_lines::image::GrayImage;

fn detect(image: &GrayImage, options: LineDetectorOptions) -> Vec<LineSegment2d> {
    let chains = EdgeDetector::new(EdgeOptions::default())
        .unwrap()
        .detect(image);
    LineDetector::new(options).unwrap().detect(image, &chains)
}

/// A bright convex polygon on a dark ground, its outline smoothed over a pixel.
fn polygon(width: usize, height: usize, corners: &[Point2<f64>]) -> GrayImage {
    let inside = |p: Point2<f64>| {
        let edges = corners.iter().zip(corners.iter().cycle().skip(1));
        edges
            .map(|(a, b)| (b - a).perp(&(p - a)) / (b - a).norm())
            .fold(f64::INFINITY, f64::min)
    };
    let samples = (0..width * height).map(|i| {
        let p = Point2::new((i % width) as f64, (i / width) as f64);
        (60.0 + 140.0 * (inside(p) + 0.5).clamp(0.0, 1.0)) as u8
    });
    GrayImage::new(width, height, samples.collect()).unwrap()
}

#[test]
fn the_sides_of_a_tilted_square_are_found_to_a_fraction_of_a_pixel() {
    let corners = [
        Point2::new(60.3, 30.2),
        Point2::new(130.7, 55.1),
        Point2::new(105.8, 125.5),
        Point2::new(35.4, 100.6),
    ];
    let segments = detect(&polygon(170, 150, &corners), LineDetectorOptions::default());
    assert_eq!(segments.len(), 4, "{segments:?}");
    for segment in &segments {
        let length = segment.length_px();
        assert!((60.0..76.0).contains(&length), "{length}");
        let side = corners
            .iter()
            .zip(corners.iter().cycle().skip(1))
            .map(|(a, b)| {
                let normal = (b - a).normalize();
                let normal = Vector2::new(-normal.y, normal.x);
                let off = segment.ends_px.map(|end| (end - a).dot(&normal).abs());
                off[0].max(off[1])
            })
            .fold(f64::INFINITY, f64::min);
        assert!(side < 0.35, "{side}");
    }
}

#[test]
fn pieces_on_one_line_are_joined_across_a_bump_when_asked() {
    // A row of pixels that steps aside by three pixels for six of them.
    let width = 120;
    let row = |x: u32| if (57..63).contains(&x) { 23 } else { 20 };
    let indices: Vec<u32> = (5..115).map(|x| row(x) * width + x).collect();
    let mut chains = EdgeChains::new(width as usize, 40);
    chains.push(&indices);
    let image = GrayImage::new(width as usize, 40, vec![0; width as usize * 40]).unwrap();
    let long = |join_error_px| {
        let options = LineDetectorOptions {
            join_error_px,
            join_gap_px: 10.0,
            validate: false,
            ..LineDetectorOptions::default()
        };
        let found = LineDetector::new(options).unwrap().detect(&image, &chains);
        let lengths = found.iter().map(LineSegment2d::length_px);
        lengths.filter(|length| *length > 40.0).collect::<Vec<_>>()
    };
    assert_eq!(long(0.0).len(), 2);
    let joined = long(1.3);
    assert_eq!(joined.len(), 1);
    assert!(joined[0] > 105.0, "{joined:?}");
}

#[test]
fn noise_has_hardly_a_segment_once_validated() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut found = [0, 0];
    for _ in 0..4 {
        let samples = (0..320 * 240).map(|_| rng.random_range(90..166)).collect();
        let image = GrayImage::new(320, 240, samples).unwrap();
        for (validate, count) in [true, false].into_iter().zip(&mut found) {
            let options = LineDetectorOptions {
                validate,
                ..LineDetectorOptions::default()
            };
            *count += detect(&image, options).len();
        }
    }
    assert!(found[0] <= 8, "{found:?}");
    assert!(found[1] > 10 * found[0].max(1), "{found:?}");
}

#[test]
fn images_without_edges_have_no_segments() {
    for (width, height) in [(0, 0), (3, 2), (64, 48)] {
        for value in [0, 128, 255] {
            let image = GrayImage::new(width, height, vec![value; width * height]).unwrap();
            assert!(detect(&image, LineDetectorOptions::default()).is_empty());
        }
    }
}

#[test]
fn options_out_of_range_are_named() {
    for (name, options) in [
        (
            "line_error_px",
            LineDetectorOptions {
                line_error_px: f64::NAN,
                ..LineDetectorOptions::default()
            },
        ),
        (
            "alignment_rad",
            LineDetectorOptions {
                alignment_rad: 2.0,
                ..LineDetectorOptions::default()
            },
        ),
        (
            "outliers_in_a_row",
            LineDetectorOptions {
                outliers_in_a_row: 0,
                ..LineDetectorOptions::default()
            },
        ),
    ] {
        assert_eq!(LineDetector::new(options).unwrap_err().name, name);
    }
}
