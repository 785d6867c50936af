//! Noise model of a structured-light depth sensor.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::photo::RenderedFrame;

/// Focal length times baseline of the sensor, in metres times pixels of a 640 pixel wide image: 585 px and 7.5 cm, those
/// of the first Kinect.
const FOCAL_TIMES_BASELINE: f64 = 585.0 * 0.075;
/// Smallest step of disparity.
const DISPARITY_STEP_PX: f64 = 0.125;
/// Standard deviation of disparity, in steps.
const DISPARITY_NOISE_STEPS: f64 = 1.0 / 6.0;
/// Standard deviation of the measured pixel position.
const LATERAL_NOISE_PX: f64 = 0.5;
/// Probability of a lost pixel where disparity jumps within the matching window.
const EDGE_LOSS: f64 = 0.45;
/// Half the side of that window.
const WINDOW_PX: i64 = 2;
/// Disparity jump that prevents a match, in pixels.
const JUMP_PX: f64 = 1.0;
/// Range of the sensor.
const RANGE_M: (f64, f64) = (0.4, 5.0);

/// Depth as measured by a sensor with the given noise strength; `None` where it measures nothing.
///
/// The measured pixel position is jittered, and disparity is disturbed and rounded to eighths of a pixel, so that the
/// error grows with the square of the depth. Pixels near depth jumps and out of range are lost. Each frame has its
/// own random stream.
///
/// # Reference
/// J. T. Barron, J. Malik, *Intrinsic Scene Properties from a Single RGB-D Image*, CVPR 2013 (jitter and rounding), as used
/// by A. Handa, T. Whelan, J. McDonald, A. J. Davison, *A Benchmark for RGB-D Visual Odometry, 3D Reconstruction and SLAM*,
/// ICRA 2014. *Differs from the papers*: the losses, and a range.
pub(super) fn sensor_depth(
    photo: &RenderedFrame,
    strength: f64,
    seed: u64,
    frame: u64,
) -> Vec<Option<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // Even streams belong to colour, odd ones to depth.
    random.set_stream(2 * frame + 3);
    let (width, height) = (i64::from(photo.width), i64::from(photo.height));
    // Scales the sensor to the image width.
    let focal_times_baseline = FOCAL_TIMES_BASELINE * photo.width as f64 / 640.0;
    let lateral = Normal::new(0.0, LATERAL_NOISE_PX * strength).expect("strength is positive");
    let disparity_noise =
        Normal::new(0.0, DISPARITY_NOISE_STEPS * strength).expect("strength is positive");
    let exact = |x: i64, y: i64| photo.depth[(y * width + x) as usize];
    let mut measured = Vec::with_capacity(photo.depth.len());
    for y in 0..height {
        for x in 0..width {
            // Every pixel draws the same amount of random numbers, whatever its outcome.
            let shift_x = lateral.sample(&mut random).round() as i64;
            let shift_y = lateral.sample(&mut random).round() as i64;
            let disturbance = disparity_noise.sample(&mut random);
            let fate: f64 = random.random();
            let from_x = (x + shift_x).clamp(0, width - 1);
            let from_y = (y + shift_y).clamp(0, height - 1);
            let depth = exact(from_x, from_y).and_then(|depth| {
                let steps = focal_times_baseline / depth / DISPARITY_STEP_PX;
                let rounded = (steps + disturbance).round();
                let depth = focal_times_baseline / (rounded * DISPARITY_STEP_PX);
                (rounded > 0.0 && depth >= RANGE_M.0 && depth <= RANGE_M.1).then_some(depth)
            });
            let lost = fate < EDGE_LOSS
                && depth.is_some()
                && jumps(&exact, (x, y), (width, height), focal_times_baseline);
            measured.push(depth.filter(|_| !lost));
        }
    }
    measured
}

/// Whether disparity jumps within the matcher's window around a pixel.
fn jumps(
    exact: &impl Fn(i64, i64) -> Option<f64>,
    (x, y): (i64, i64),
    (width, height): (i64, i64),
    focal_times_baseline: f64,
) -> bool {
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for other_y in (y - WINDOW_PX).max(0)..=(y + WINDOW_PX).min(height - 1) {
        for other_x in (x - WINDOW_PX).max(0)..=(x + WINDOW_PX).min(width - 1) {
            let disparity =
                exact(other_x, other_y).map_or(0.0, |depth| focal_times_baseline / depth);
            low = low.min(disparity);
            high = high.max(disparity);
        }
    }
    high - low > JUMP_PX
}
