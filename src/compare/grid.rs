//! Pictures in rows and columns.

use image::{Rgb, RgbImage};

/// Pixels between panels.
const GAP_PX: u32 = 8;

/// Panels in rows on white, those of a row from left to right, a missing one as empty space. Columns are as wide and rows
/// as high as their largest panel.
pub fn panel_grid(rows: &[Vec<Option<RgbImage>>]) -> RgbImage {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let panels = |column: usize| rows.iter().filter_map(move |row| row.get(column)?.as_ref());
    let widths: Vec<u32> = (0..columns)
        .map(|column| panels(column).map(RgbImage::width).max().unwrap_or(0))
        .collect();
    let heights: Vec<u32> = rows
        .iter()
        .map(|row| {
            row.iter()
                .flatten()
                .map(RgbImage::height)
                .max()
                .unwrap_or(0)
        })
        .collect();
    let extent = |sizes: &[u32]| {
        let filled = sizes.iter().filter(|size| **size > 0);
        let gaps = filled.clone().count().saturating_sub(1) as u32 * GAP_PX;
        (filled.sum::<u32>() + gaps).max(1)
    };
    let mut grid = RgbImage::from_pixel(extent(&widths), extent(&heights), Rgb([255; 3]));
    let mut y = 0;
    for (row, height) in rows.iter().zip(&heights) {
        let mut x = 0;
        for (panel, width) in row.iter().zip(&widths) {
            if let Some(panel) = panel {
                image::imageops::replace(&mut grid, panel, x, y);
            }
            x += if *width > 0 {
                i64::from(width + GAP_PX)
            } else {
                0
            };
        }
        y += if *height > 0 {
            i64::from(height + GAP_PX)
        } else {
            0
        };
    }
    grid
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_stand_in_their_places() {
        let panel =
            |width, height, value| Some(RgbImage::from_pixel(width, height, Rgb([value; 3])));
        let grid = panel_grid(&[
            vec![panel(10, 4, 1), panel(6, 4, 2)],
            vec![None, panel(6, 3, 3)],
        ]);
        assert_eq!(grid.dimensions(), (10 + GAP_PX + 6, 4 + GAP_PX + 3));
        assert_eq!(grid.get_pixel(9, 3).0, [1; 3]);
        assert_eq!(grid.get_pixel(10 + GAP_PX, 0).0, [2; 3]);
        assert_eq!(grid.get_pixel(0, 4 + GAP_PX).0, [255; 3]);
        assert_eq!(grid.get_pixel(10 + GAP_PX, 4 + GAP_PX).0, [3; 3]);
        assert_eq!(panel_grid(&[]).dimensions(), (1, 1));
    }
}
