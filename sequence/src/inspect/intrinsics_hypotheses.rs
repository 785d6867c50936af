//! Intrinsics to test: those of another image size, and other focal lengths.

use linecarve_lines::camera::{Camera, Distortion};

use super::depth_alternatives::rounded;

/// Ratio of the focal lengths that are tried.
pub(super) const FOCAL_STEP: f64 = 1.06;

/// Focal lengths that differ by more than this share are not those of square pixels.
const NOT_SQUARE: f64 = 0.03;

/// Focal lengths on either side of that of the files.
const FOCAL_STEPS: i32 = 24;

/// Intrinsics of images of another size: the factors.
const SIZE_FACTORS: [f64; 10] = [
    0.2,
    0.25,
    1.0 / 3.0,
    0.5,
    2.0 / 3.0,
    1.5,
    2.0,
    3.0,
    4.0,
    5.0,
];

/// Pinhole cameras with other focal lengths and principal points, for images of `size`.
pub(super) fn focal_hypotheses(camera: &Camera, size: [u32; 2]) -> Vec<Camera> {
    let center = size.map(|side| 0.5 * (f64::from(side) - 1.0));
    let of_size = SIZE_FACTORS.into_iter().filter_map(|factor| {
        let scaled = |c: f64| factor * (c + 0.5) - 0.5;
        let c = [scaled(camera.cx()), scaled(camera.cy())];
        let is_inside = c
            .iter()
            .zip(size)
            .all(|(c, side)| *c > 0.0 && *c < f64::from(side));
        if !is_inside {
            return None;
        }
        pinhole(factor * camera.fx(), factor * camera.fy(), c)
    });
    let read = [camera.fx(), camera.fy()];
    let of_focal = (-FOCAL_STEPS..=FOCAL_STEPS)
        .flat_map(|step| {
            let factor = FOCAL_STEP.powi(step);
            let focals = square_pixels(read).into_iter().chain([read]);
            focals.map(move |focal| focal.map(|f| factor * f))
        })
        .filter(|focal| *focal != read)
        .flat_map(|[fx, fy]| [[camera.cx(), camera.cy()], center].map(|c| pinhole(fx, fy, c)))
        .flatten();
    of_size.chain(of_focal).collect()
}

/// Focal lengths of pixels as wide as high, if those read are not: one of them was scaled for another shape of the image.
fn square_pixels([fx, fy]: [f64; 2]) -> Option<[f64; 2]> {
    ((fx / fy - 1.0).abs() > NOT_SQUARE).then_some([fx, fx])
}

/// Cameras with focal lengths within a ratio of that of `camera`.
pub(super) fn refined(camera: &Camera, ratio: f64) -> Vec<Camera> {
    (-6..=6)
        .filter_map(|step| {
            let factor = ratio.powf(f64::from(step) / 6.0);
            let c = [camera.cx(), camera.cy()];
            pinhole(factor * camera.fx(), factor * camera.fy(), c)
        })
        .collect()
}

fn pinhole(fx: f64, fy: f64, [cx, cy]: [f64; 2]) -> Option<Camera> {
    Camera::pinhole(fx, fy, cx, cy).ok()
}

/// Focal lengths within this share of each other are one.
const SAME_FOCAL: f64 = 0.01;

/// What differs, in words.
pub(super) fn description(read: &Camera, found: &Camera) -> String {
    let [focal, of_read] = [found, read].map(|camera| rounded(camera.mean_focal_px()));
    let [center, center_read] = [found, read].map(|camera| [camera.cx(), camera.cy()]);
    if (focal / of_read - 1.0).abs() < SAME_FOCAL && center != center_read {
        let [[cx, cy], [cx_read, cy_read]] = [center, center_read];
        return format!("the principal point ({cx}, {cy}) instead of ({cx_read}, {cy_read})");
    }
    format!("a focal length of about {focal} instead of {of_read}")
}

/// The section of a sidecar with a camera that was found for images without distortion, in place of `pinhole`. `stored` is the camera of
/// the stored images, whose distortion is kept.
pub(super) fn section(name: &str, found: &Camera, pinhole: &Camera, stored: &Camera) -> String {
    let of_stored = |found: f64, pinhole: f64, stored: f64| stored * found / pinhole;
    let focal = [
        of_stored(found.fx(), pinhole.fx(), stored.fx()),
        of_stored(found.fy(), pinhole.fy(), stored.fy()),
    ];
    let moved = |found: f64, pinhole: f64, stored: f64| stored + found - pinhole;
    let center = [
        moved(found.cx(), pinhole.cx(), stored.cx()),
        moved(found.cy(), pinhole.cy(), stored.cy()),
    ];
    let [fx, fy] = focal.map(rounded);
    let [cx, cy] = center.map(|value| (2.0 * value).round() / 2.0);
    let model = match stored.distortion() {
        Distortion::None => String::new(),
        distortion => {
            let name = match distortion {
                Distortion::KannalaBrandt { .. } => "kannala-brandt",
                _ => "radial-tangential",
            };
            format!(
                "\nmodel = {name:?}\ndistortion = {:?}",
                distortion.coefficients()
            )
        }
    };
    format!("[{name}]\nfx = {fx:?}\nfy = {fy:?}\ncx = {cx:?}\ncy = {cy:?}{model}")
}
