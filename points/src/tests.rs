//! Images for the tests of several modules.

use std::path::Path;

use linecarve_lines::image::{GrayImage, Plane};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Bright and dark squares at random positions.
pub(crate) fn squares(width: usize, height: usize) -> GrayImage {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut image = Plane::new(width, height, vec![90_u8; width * height]).unwrap();
    for _ in 0..width * height / 300 {
        let (x, y) = (
            random.random_range(0..width),
            random.random_range(0..height),
        );
        let (side, value) = (random.random_range(4..20), random.random_range(0..=255));
        for row in y..(y + side).min(height) {
            for column in x..(x + side).min(width) {
                image.samples_mut()[row * width + column] = value;
            }
        }
    }
    image
}

/// Some frames of the sample sequence.
pub(crate) fn room_images() -> Vec<GrayImage> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room/rgb");
    ["1.000000", "1.500000", "2.100000"]
        .map(|name| {
            let file = folder.join(format!("{name}.jpg"));
            let image = image::open(file).unwrap().into_rgb8();
            let (width, height) = image.dimensions();
            Plane::from_rgb8(width as usize, height as usize, &image).unwrap()
        })
        .into()
}
