//! Stroke font for captions and legends. It needs no font file and renders the same pixels everywhere.

use image::{Rgb, RgbImage};
use nalgebra::Vector2;

/// Height of capitals on the grid of the glyphs.
const CAPITAL: f64 = 6.0;
/// Distance between letters on that grid.
const GAP: f64 = 1.9;
/// Width of a space.
const SPACE: f64 = 2.6;
/// Width of strokes as a share of the height of capitals.
const STROKE: f64 = 0.13;

/// The strokes of a letter: polylines separated by `/`, points as column and row on a grid of 5 columns, capitals from
/// row 0 to the base line in row 6, small letters from row 2, descenders to row 8.
fn strokes(letter: char) -> &'static str {
    match letter {
        '0' => "10 30 41 45 36 16 05 01 10",
        '1' => "11 20 26",
        '2' => "01 10 30 41 42 06 46",
        '3' => "01 10 30 41 42 33 13/33 44 45 36 16 05",
        '4' => "36 30 04 44",
        '5' => "40 00 03 33 44 45 36 16 05",
        '6' => "41 30 10 01 05 16 36 45 44 33 13 04",
        '7' => "00 40 16",
        '8' => "13 02 01 10 30 41 42 33 13 04 05 16 36 45 44 33",
        '9' => "05 16 36 45 41 30 10 01 02 13 33 42",
        'a' => "12 32 43 46/44 14 05 16 36 45",
        'b' => "00 06/03 12 32 43 45 36 16 05",
        'c' => "43 32 12 03 05 16 36 45",
        'd' => "40 46/43 32 12 03 05 16 36 45",
        'e' => "04 44 43 32 12 03 05 16 36 45",
        'f' => "30 20 11 16/02 32",
        'g' => "42 47 38 18 07/43 32 12 03 05 16 36 45",
        'h' => "00 06/03 12 32 43 46",
        'i' => "22 26/20 20",
        'j' => "22 27 18/20 20",
        'k' => "00 06/42 04/14 46",
        'l' => "20 26",
        'm' => "02 06/03 12 23 26/23 32 43 46",
        'n' => "02 06/03 12 32 43 46",
        'o' => "12 32 43 45 36 16 05 03 12",
        'p' => "02 08/03 12 32 43 45 36 16 05",
        'q' => "42 48/43 32 12 03 05 16 36 45",
        'r' => "02 06/03 12 32",
        's' => "43 32 12 03 14 34 45 36 16 05",
        't' => "10 15 26 36/02 32",
        'u' => "02 05 16 36 45/42 46",
        'v' => "02 26 42",
        'w' => "02 16 23 36 42",
        'x' => "02 46/42 06",
        'y' => "02 26/42 26 18 08",
        'z' => "02 42 06 46",
        'D' => "00 06 26 45 41 20 00",
        'F' => "06 00 40/03 33",
        '.' | '·' => "16 16",
        ',' => "16 07",
        ':' => "12 12/16 16",
        '-' => "03 33",
        '_' => "06 46",
        '+' => "03 43/21 25",
        '/' => "06 40",
        '(' => "20 11 15 26",
        ')' => "10 21 25 16",
        '%' => "06 40/00 10 11 01 00/35 45 46 36 35",
        '≥' => "00 42 04/06 46",
        '>' => "01 43 05",
        '=' => "02 42/04 44",
        _ => "00 40 46 06 00",
    }
}

/// The polylines of a letter, moved so that they start at column 0, and their width.
fn glyph(letter: char) -> (Vec<Vec<Vector2<f64>>>, f64) {
    // Capitals without a glyph use the small letter.
    let known = letter.is_ascii_uppercase() && !matches!(letter, 'D' | 'F');
    let letter = if known {
        letter.to_ascii_lowercase()
    } else {
        letter
    };
    let digit = |byte: u8| f64::from(byte - b'0');
    let mut lines: Vec<Vec<Vector2<f64>>> = strokes(letter)
        .split('/')
        .map(|line| {
            let points = line.split(' ').map(str::as_bytes);
            points
                .map(|point| Vector2::new(digit(point[0]), digit(point[1])))
                .collect()
        })
        .collect();
    let columns = || lines.iter().flatten().map(|point| point.x);
    let (low, high) = (
        columns().fold(f64::MAX, f64::min),
        columns().fold(f64::MIN, f64::max),
    );
    for point in lines.iter_mut().flatten() {
        point.x -= low;
    }
    (lines, high - low)
}

/// Width in pixels of a text whose capitals are `height` pixels high.
pub fn text_width(text: &str, height: f64) -> f64 {
    let units: f64 = text
        .chars()
        .map(|letter| {
            if letter == ' ' {
                SPACE
            } else {
                glyph(letter).1 + GAP
            }
        })
        .sum();
    (units - GAP).max(0.0) * height / CAPITAL
}

/// Draws a text with its left end at column `x` and its base line at row `y`; capitals are `height` pixels high.
pub fn draw_text(
    picture: &mut RgbImage,
    (x, y): (f64, f64),
    height: f64,
    text: &str,
    color: [u8; 3],
) {
    let unit = height / CAPITAL;
    let mut left = x;
    for letter in text.chars() {
        if letter == ' ' {
            left += SPACE * unit;
            continue;
        }
        let (lines, width) = glyph(letter);
        for line in &lines {
            let points: Vec<Vector2<f64>> = line
                .iter()
                .map(|point| Vector2::new(left + point.x * unit, y + (point.y - CAPITAL) * unit))
                .collect();
            draw_stroke(picture, &points, STROKE * height, color);
        }
        left += (width + GAP) * unit;
    }
}

/// Draws a polyline with round ends, each pixel once, so that overlapping parts do not darken.
fn draw_stroke(picture: &mut RgbImage, points: &[Vector2<f64>], width: f64, color: [u8; 3]) {
    let reach = 0.5 * width + 0.5;
    let (low, high) = points.iter().fold(
        (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN)),
        |(low, high), point| (low.inf(point), high.sup(point)),
    );
    let range = |axis: usize, size: u32| {
        let first = (low[axis] - reach).floor().max(0.0) as u32;
        let last = (high[axis] + reach).ceil().max(0.0) as u32;
        first..(last + 1).min(size)
    };
    for row in range(1, picture.height()) {
        for column in range(0, picture.width()) {
            let pixel = Vector2::new(f64::from(column), f64::from(row));
            let distance = points
                .windows(2)
                .map(|ends| distance_to(&pixel, &ends[0], &ends[1]))
                .fold(f64::MAX, f64::min);
            let coverage = (reach - distance).clamp(0.0, 1.0);
            if coverage > 0.0 {
                let Rgb(target) = picture.get_pixel_mut(column, row);
                for (value, ink) in target.iter_mut().zip(color) {
                    let mixed = f64::from(*value) + coverage * (f64::from(ink) - f64::from(*value));
                    *value = mixed.round() as u8;
                }
            }
        }
    }
}

fn distance_to(point: &Vector2<f64>, from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
    let along = to - from;
    let squared = along.norm_squared();
    let t = if squared > 0.0 {
        ((point - from).dot(&along) / squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (point - (from + along * t)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_has_strokes_on_the_grid() {
        for letter in (' '..='~').chain(['≥', '·', 'ß']) {
            let (lines, width) = glyph(letter);
            assert!((0.0..=4.0).contains(&width), "{letter}");
            for point in lines.iter().flatten() {
                assert!(
                    (0.0..=4.0).contains(&point.x) && (0.0..=8.0).contains(&point.y),
                    "{letter}"
                );
            }
        }
    }

    #[test]
    fn text_fills_the_width_that_it_is_said_to_have() {
        let height = 24.0;
        let width = text_width("0.05 m", height);
        let mut picture = RgbImage::from_pixel(300, 60, Rgb([255; 3]));
        draw_text(&mut picture, (10.0, 40.0), height, "0.05 m", [0; 3]);
        let inked: Vec<u32> = picture
            .enumerate_pixels()
            .filter_map(|(x, _, pixel)| (pixel.0[0] < 128).then_some(x))
            .collect();
        let (first, last) = (inked.iter().min().unwrap(), inked.iter().max().unwrap());
        assert!((f64::from(*first) - 10.0).abs() <= 3.0, "{first}");
        assert!(
            (f64::from(*last) - (10.0 + width)).abs() <= 3.0,
            "{last} {width}"
        );
    }

    #[test]
    fn text_beyond_the_picture_is_cut_off() {
        let drawn = |size: [u32; 2], origin: (f64, f64)| {
            let mut picture = RgbImage::new(size[0], size[1]);
            draw_text(&mut picture, origin, 12.0, "outside", [255; 3]);
            picture
        };
        let whole = drawn([120, 40], (20.0, 24.0));
        // All four sides cut letters.
        let part = drawn([40, 8], (-12.0, 8.0));
        for (x, y, pixel) in part.enumerate_pixels() {
            let expected = whole.get_pixel(x + 32, y + 16);
            assert!(pixel.0[0].abs_diff(expected.0[0]) <= 1, "{x} {y}");
        }
        let has_ink = |picture: &RgbImage| picture.pixels().any(|pixel| pixel.0[0] > 0);
        assert!(has_ink(&part));
        assert!(!has_ink(&drawn([8, 8], (1e4, -1e4))));
        assert!(!has_ink(&drawn([8, 8], (-1e4, 1e4))));
    }
}
