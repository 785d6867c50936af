//! Colour scale of distances, and its legend.

use image::{Rgb, RgbImage};

use super::lettering::{draw_text, text_width};
use crate::evaluate::heat_color;

/// A colour scale of distances: dark at 0, bright from the maximum on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeatScale {
    max: f64,
}

impl HeatScale {
    /// A scale from 0 to `max`; `None` when `max` is not a positive length.
    pub fn new(max: f64) -> Option<Self> {
        (max > 0.0 && max.is_finite()).then_some(Self { max })
    }

    /// The distance at the bright end.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// The sRGB colour of a distance; NaN is grey.
    pub fn color(&self, distance: f64) -> [u8; 3] {
        heat_color(distance / self.max)
    }

    /// The colours of the map, equally spaced.
    pub fn colors() -> Vec<[u8; 3]> {
        const STOPS: u32 = 10;
        (0..STOPS)
            .map(|stop| heat_color(f64::from(stop) / f64::from(STOPS - 1)))
            .collect()
    }

    /// Tick positions on the scale, 0 to 1, and their labels; the last stands for all larger distances.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        const PARTS: u32 = 4;
        // Two significant digits of the maximum, without trailing zeros.
        let decimals = (2.0 - self.max.log10().floor()).clamp(0.0, 9.0) as usize;
        (0..=PARTS)
            .map(|part| {
                let share = f64::from(part) / f64::from(PARTS);
                let text = format!("{:.decimals$}", share * self.max);
                let text = match text.contains('.') {
                    true => text.trim_end_matches('0').trim_end_matches('.'),
                    false => &text,
                };
                let sign = if part == PARTS { "≥ " } else { "" };
                (share, format!("{sign}{text}"))
            })
            .collect()
    }
}

/// Height of the legend.
const STRIP_PX: u32 = 58;
/// Height of capitals.
const LETTER_PX: f64 = 12.0;
const INK: [u8; 3] = [45, 52, 60];

/// Adds a legend below a picture: label, colour bar, ticks.
pub fn with_color_bar(picture: &RgbImage, scale: &HeatScale, label: &str) -> RgbImage {
    let (width, height) = picture.dimensions();
    let mut result = RgbImage::from_pixel(width, height + STRIP_PX, Rgb([255; 3]));
    image::imageops::replace(&mut result, picture, 0, 0);
    let (wide, top) = (f64::from(width), f64::from(height));
    // The label goes left of the bar, or above it when space is short.
    let room = text_width(label, LETTER_PX) + 56.0;
    let left = if room < 0.55 * wide {
        draw_text(&mut result, (12.0, top + 24.0), LETTER_PX, label, INK);
        room
    } else {
        34.0
    };
    let right = wide - 46.0;
    if right - left < 60.0 {
        return result;
    }
    for column in left as u32..right as u32 {
        let share = (f64::from(column) + 0.5 - left) / (right - left);
        let color = scale.color(share * scale.max);
        for row in 10..28 {
            result.put_pixel(column, height + row, Rgb(color));
        }
    }
    for (share, text) in scale.ticks() {
        let x = left + share * (right - left);
        for row in 28..32 {
            result.put_pixel((x as u32).min(width - 1), height + row, Rgb(INK));
        }
        let start = x - 0.5 * text_width(&text, LETTER_PX);
        draw_text(&mut result, (start, top + 48.0), LETTER_PX, &text, INK);
    }
    result
}

/// Height of the caption.
const CAPTION_PX: u32 = 34;

/// Adds a caption above a picture.
pub fn with_caption(picture: &RgbImage, caption: &str) -> RgbImage {
    let (width, height) = picture.dimensions();
    let mut result = RgbImage::from_pixel(width, height + CAPTION_PX, Rgb([255; 3]));
    image::imageops::replace(&mut result, picture, 0, i64::from(CAPTION_PX));
    draw_text(&mut result, (4.0, 23.0), 13.0, caption, INK);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_the_scale_have_the_end_colours() {
        let scale = HeatScale::new(0.1).unwrap();
        assert_eq!(scale.color(0.0), HeatScale::colors()[0]);
        assert_eq!(scale.color(0.1), HeatScale::colors()[9]);
        assert_eq!(scale.color(f64::INFINITY), HeatScale::colors()[9]);
        assert_eq!(scale.color(f64::NAN), [128; 3]);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(HeatScale::new(bad), None);
        }
    }

    #[test]
    fn ticks_are_short_for_scales_of_any_size() {
        let texts = |end: f64| -> Vec<String> {
            let ticks = HeatScale::new(end).unwrap().ticks();
            ticks.into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(texts(0.1), ["0", "0.025", "0.05", "0.075", "≥ 0.1"]);
        assert_eq!(texts(100.0), ["0", "25", "50", "75", "≥ 100"]);
        assert_eq!(texts(3.0), ["0", "0.75", "1.5", "2.25", "≥ 3"]);
    }

    #[test]
    fn a_bar_of_colours_stands_below_the_picture() {
        let picture = RgbImage::from_pixel(640, 100, Rgb([1, 2, 3]));
        let scale = HeatScale::new(0.1).unwrap();
        let result = with_color_bar(&picture, &scale, "distance");
        assert_eq!(result.dimensions(), (640, 100 + STRIP_PX));
        assert_eq!(result.get_pixel(320, 50).0, [1, 2, 3]);
        // The last column of the bar lies half a pixel before the end of the scale.
        let [red, green, blue] = result.get_pixel(640 - 47, 120).0;
        let end = *HeatScale::colors().last().unwrap();
        assert!(
            red.abs_diff(end[0]) < 3 && green.abs_diff(end[1]) < 3 && blue.abs_diff(end[2]) < 3
        );
        let tiny = RgbImage::new(16, 16);
        assert_eq!(with_color_bar(&tiny, &scale, "distance").width(), 16);
        assert_eq!(with_caption(&tiny, "a caption").height(), 16 + CAPTION_PX);
    }
}
