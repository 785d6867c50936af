use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

fn image(width: usize, height: usize, sample: impl Fn(f64, f64) -> f64) -> GrayImage {
    let samples = (0..width * height)
        .map(|i| sample((i % width) as f64, (i / width) as f64).clamp(0.0, 255.0) as u8)
        .collect();
    GrayImage::new(width, height, samples).unwrap()
}

fn detect(image: &GrayImage) -> EdgeChains {
    let mut detector = EdgeDetector::new(EdgeOptions::default()).unwrap();
    let chains = detector.detect(image);
    assert_eq!(chains.check(), Ok(()));
    for chain in chains.iter() {
        assert!(chain.len() >= detector.options().minimum_length_px);
        for &[x, y] in chain {
            let index = usize::from(y) * image.width() + usize::from(x);
            assert!(detector.gradient().strength(index) >= 36);
        }
    }
    chains
}

#[test]
fn straight_edges_of_every_direction_are_one_chain() {
    for degrees in (0..180).step_by(5) {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let half = image(120, 90, |x, y| {
            let distance = (x - 60.0) * cos + (y - 45.0) * sin;
            128.0 + 100.0 * distance.clamp(-1.0, 1.0)
        });
        let chains = detect(&half);
        let longest = chains.iter().map(<[_]>::len).max().unwrap();
        assert!(longest >= 80, "{degrees} degrees: {longest}");
        for &[x, y] in chains.pixels() {
            let distance = (f64::from(x) - 60.0) * cos + (f64::from(y) - 45.0) * sin;
            assert!(distance.abs() < 1.5, "{degrees} degrees: {distance}");
        }
    }
}

#[test]
fn positions_follow_the_edge_within_a_tenth_of_a_pixel() {
    for degrees in [
        1.0_f64, 2.0, 5.0, 20.0, 45.0, 70.0, 88.0, 91.0, 137.0, 178.0,
    ] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let half = image(160, 120, |x, y| {
            let distance = (x - 80.3) * cos + (y - 60.2) * sin;
            128.0 + 100.0 * distance.clamp(-1.0, 1.0)
        });
        let chains = detect(&half);
        let (mut sum, mut count) = (0.0, 0);
        for &[x, y] in chains.positions() {
            let distance = (f64::from(x) - 80.3) * cos + (f64::from(y) - 60.2) * sin;
            assert!(distance.abs() < 0.6, "{degrees} degrees: {distance}");
            sum += distance * distance;
            count += 1;
        }
        let rms = (sum / f64::from(count)).sqrt();
        assert!(rms < 0.1, "{degrees} degrees: {rms} px");
    }
}

#[test]
fn circle_is_followed_around() {
    let disc = image(120, 120, |x, y| {
        128.0 + 100.0 * ((x - 60.0).hypot(y - 60.0) - 40.0).clamp(-1.0, 1.0)
    });
    let chains = detect(&disc);
    // An 8-connected circle of radius 40 has 8 * 40 / sqrt(2) = 226 pixels.
    assert!(chains.pixels().len() > 200);
    for &[x, y] in chains.pixels() {
        let radius = (f64::from(x) - 60.0).hypot(f64::from(y) - 60.0);
        assert!((radius - 40.0).abs() < 1.5);
    }
}

#[test]
fn checkerboard_chains_keep_apart() {
    for period in [2, 3, 5, 8, 13] {
        let board = image(97, 83, |x, y| {
            if (x as usize / period + y as usize / period).is_multiple_of(2) {
                255.0
            } else {
                0.0
            }
        });
        detect(&board);
    }
}

#[test]
fn noise_obeys_the_invariants() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for contrast in [10, 60, 255] {
        for (width, height) in [(3, 3), (64, 48), (201, 77)] {
            let samples = (0..width * height)
                .map(|_| (rng.random_range(0..=contrast)) as u8)
                .collect();
            detect(&GrayImage::new(width, height, samples).unwrap());
        }
    }
}

#[test]
fn flat_and_tiny_images_have_no_edges() {
    for (width, height) in [(0, 0), (1, 1), (2, 9), (50, 40)] {
        let flat = GrayImage::new(width, height, vec![90; width * height]).unwrap();
        assert!(detect(&flat).is_empty());
    }
}

#[test]
fn memory_is_reused_without_a_trace() {
    let a = image(80, 60, |x, y| 3.0 * x + 40.0 * (y / 7.0).sin());
    let b = image(50, 70, |x, y| {
        120.0 + 90.0 * (x / 5.0).sin() * (y / 6.0).cos()
    });
    let mut detector = EdgeDetector::new(EdgeOptions::default()).unwrap();
    for current in [&a, &b, &a] {
        assert_eq!(detector.detect(current), detect(current));
    }
}

#[test]
fn zero_threshold_is_refused() {
    let options = EdgeOptions {
        gradient_threshold: 0,
        ..EdgeOptions::default()
    };
    assert_eq!(
        EdgeDetector::new(options).unwrap_err(),
        EdgeOptionsError::GradientThreshold
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn blocky_images_obey_the_invariants(seed in any::<u64>(), cell in 1_usize..6, length in 1_usize..12, anchor in 0_u16..40) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let levels: Vec<u8> = (0..64 * 64).map(|_| [0, 30, 200, 255][rng.random_range(0..4)]).collect();
        let blocks = image(64, 64, |x, y| f64::from(levels[y as usize / cell * 64 + x as usize / cell]));
        let options = EdgeOptions { minimum_length_px: length, anchor_threshold: anchor, gradient_threshold: 1 + anchor };
        let chains = EdgeDetector::new(options).unwrap().detect(&blocks);
        prop_assert_eq!(chains.check(), Ok(()));
    }
}

#[test]
fn colours_of_one_brightness_meet_in_an_edge() {
    // Brown planks before a green wall.
    let half = |x: usize| {
        if x < 30 {
            [140, 110, 60]
        } else {
            [60, 140, 116]
        }
    };
    let rgb: Vec<u8> = (0..64 * 48).flat_map(|i| half(i % 64)).collect();
    let image = GrayImage::from_rgb8(64, 48, &rgb).unwrap();
    let mut detector = EdgeDetector::default();
    let mut chains = detector.detect(&image);
    assert!(chains.is_empty());
    detector.detect_into(&image, Some(&rgb), &mut chains);
    assert_eq!((chains.len(), chains.check()), (1, Ok(())));
    for [x, _] in chains.positions() {
        assert!((x - 29.5).abs() < 0.1, "{x}");
    }
    assert!(chains.pixels().len() >= 44);
}

#[test]
fn grey_edges_stay_where_they_are_in_grey_colours() {
    let image = image(64, 48, |x, y| {
        40.0 + 3.0 * y + if x < 30.0 { 0.0 } else { 20.0 }
    });
    let rgb: Vec<u8> = image.samples().iter().flat_map(|&v| [v; 3]).collect();
    let mut detector = EdgeDetector::default();
    let grey = detector.detect(&image);
    let mut chains = EdgeChains::default();
    detector.detect_into(&image, Some(&rgb), &mut chains);
    assert!(!grey.is_empty());
    assert_eq!(chains, grey);
}
