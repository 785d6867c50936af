//! Grey levels between pixels.

use linecarve_lines::image::GrayImage;

/// Samples of a patch one pixel apart, row by row, from its left upper one, by bilinear interpolation; `None` at the border of the image.
pub(crate) fn sample<const N: usize>(
    image: &GrayImage,
    left: f64,
    top: f64,
    columns: usize,
    out: &mut [f64; N],
) -> Option<()> {
    let (width, height) = (image.width() as f64, image.height() as f64);
    let rows = N / columns;
    let is_inside = left >= 0.0
        && top >= 0.0
        && left + columns as f64 <= width - 1.0
        && top + rows as f64 <= height - 1.0;
    if !is_inside {
        return None;
    }
    let (x0, y0) = (left as usize, top as usize);
    let (ax, ay) = (left - x0 as f64, top - y0 as f64);
    for (row, out) in out.chunks_exact_mut(columns).enumerate() {
        let (above, below) = (image.row(y0 + row), image.row(y0 + row + 1));
        for (column, out) in out.iter_mut().enumerate() {
            let at = x0 + column;
            let mix = |row: &[u8]| f64::from(row[at]) * (1.0 - ax) + f64::from(row[at + 1]) * ax;
            *out = mix(above) * (1.0 - ay) + mix(below) * ay;
        }
    }
    Some(())
}
