//! Algorithm 1 on one edge chain.

use nalgebra::{Point2, Point3, Vector2};

use super::PaperOptions;
use crate::camera::Camera;
use crate::depth::InverseDepthMap;
use crate::fit::{ImageLine, ImageMoments};

/// Fewer depths determine no line that could be wrong.
const LEAST_DEPTHS: usize = 3;

/// The constants for one image size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// L.
    window: usize,
    /// e1.
    image_px: f64,
    /// e2.
    depth_px: f64,
    /// Focal length in pixels over the unit of the map.
    scale: f64,
}

impl Limits {
    /// For images whose shorter side is `side`.
    pub(super) fn new(options: &PaperOptions, side: f64, focal_px: f64) -> Self {
        Self {
            window: (options.window_share * side)
                .round()
                .max(LEAST_DEPTHS as f64) as usize,
            image_px: options.image_tolerance_share * side,
            depth_px: options.depth_tolerance_share * side,
            scale: focal_px / options.unit,
        }
    }
}

/// A pixel with its scaled depth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// Place in its chain.
    pub(super) index: usize,
    pub(super) position: Vector2<f64>,
    /// Depth times focal length.
    z: f64,
}

/// A segment of a chain.
pub(super) struct Found<'a> {
    /// The ends in the frame of the camera.
    pub(super) ends: [Point3<f64>; 2],
    /// The pixels of the segment.
    pub(super) pixels: &'a [Pixel],
    pub(super) image_rms_px: f64,
    /// Depth times focal length, as distances are.
    pub(super) depth_rms_px: f64,
}

/// The two lines, and the axis on which distances D are measured.
struct Lines {
    origin: Vector2<f64>,
    axis: Vector2<f64>,
    image: ImageLine,
    depth: ImageLine,
}

impl Lines {
    /// Fits both lines; `None` when the pixels do not determine them.
    fn fit(pixels: &[Pixel]) -> Option<Self> {
        let (first, last) = (pixels.first()?, pixels.last()?);
        let origin = first.position;
        let axis = (last.position - origin).try_normalize(0.0)?;
        let (mut image, mut depth) = (ImageMoments::default(), ImageMoments::default());
        for pixel in pixels {
            let p = pixel.position - origin;
            image.add(p);
            // Relative to the first depth, so that the sums stay accurate.
            depth.add(Vector2::new(p.dot(&axis), pixel.z - first.z));
        }
        let mut depth = depth.line(Vector2::x())?;
        depth.center.y += first.z;
        Some(Self {
            origin,
            axis,
            image: image.line(axis)?,
            depth,
        })
    }

    fn accepts(&self, pixel: &Pixel, limits: &Limits) -> bool {
        let p = pixel.position - self.origin;
        let on_axis = Vector2::new(p.dot(&self.axis), pixel.z);
        self.image.distance(p) < limits.image_px && self.depth.distance(on_axis) < limits.depth_px
    }

    /// A pixel projected on the lines; `None` when its depth is not positive.
    fn end(&self, pixel: &Pixel, camera: &Camera, scale: f64) -> Option<Point3<f64>> {
        let along = self.image.position(pixel.position - self.origin);
        let p = self.image.center + self.image.direction * along;
        let slope = self.depth.direction.y / self.depth.direction.x;
        let z = self.depth.center.y + slope * (p.dot(&self.axis) - self.depth.center.x);
        let depth = z / scale;
        if !(depth.is_finite() && depth > 0.0) {
            return None;
        }
        let on_line = Point2::from(self.origin + p);
        camera.point_at_depth(&on_line, depth).ok()
    }
}

/// Passes the segments of a chain, in the frame of the camera, to `found`.
pub(super) fn segments(
    chain: &[[u16; 2]],
    depth: &InverseDepthMap,
    camera: &Camera,
    limits: &Limits,
    mut found: impl FnMut(Found<'_>),
) {
    let pixel = |index: usize| -> Option<Pixel> {
        let [x, y] = chain[index];
        let measurement = depth.get(usize::from(x), usize::from(y))?;
        Some(Pixel {
            index,
            position: Vector2::new(f64::from(x), f64::from(y)),
            z: limits.scale * measurement.depth(),
        })
    };
    let mut next = 0;
    let mut pixels: Vec<Pixel> = Vec::new();
    while next + limits.window <= chain.len() {
        pixels.clear();
        pixels.extend((next..next + limits.window).filter_map(pixel));
        let lines = (pixels.len() >= LEAST_DEPTHS)
            .then(|| Lines::fit(&pixels))
            .flatten();
        let Some(lines) = lines else {
            next += 1;
            continue;
        };
        let mut outliers = limits.window - pixels.len();
        next += limits.window;
        while next < chain.len() && outliers <= limits.window {
            match pixel(next).filter(|pixel| lines.accepts(pixel, limits)) {
                Some(pixel) => pixels.push(pixel),
                None => outliers += 1,
            }
            next += 1;
        }
        if pixels.len() <= limits.window {
            continue;
        }
        let ends = Lines::fit(&pixels).and_then(|lines| {
            let end = |pixel: &Pixel| lines.end(pixel, camera, limits.scale);
            let ends = [end(pixels.first()?)?, end(pixels.last()?)?];
            Some((ends, lines.image.rms_px, lines.depth.rms_px))
        });
        if let Some((ends, image_rms_px, depth_rms_px)) = ends {
            found(Found {
                ends,
                pixels: &pixels,
                image_rms_px,
                depth_rms_px,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::depth::InverseDepth;

    use super::*;

    const WIDTH: usize = 200;
    const ROW: usize = 60;

    fn camera() -> Camera {
        Camera::pinhole(180.0, 180.0, 99.5, 59.5).unwrap()
    }

    fn limits() -> Limits {
        Limits {
            window: 10,
            image_px: 0.96,
            depth_px: 1.44,
            scale: 180.0,
        }
    }

    fn found(z: impl Fn(usize) -> Option<f64>) -> Vec<[Point3<f64>; 2]> {
        let mut depth = InverseDepthMap::unknown(WIDTH, 120).unwrap();
        for x in 0..WIDTH {
            if let Some(z) = z(x) {
                depth.set(x, ROW, InverseDepth::new((1.0 / z) as f32, 0.01));
            }
        }
        let chain: Vec<[u16; 2]> = (0..WIDTH as u16).map(|x| [x, ROW as u16]).collect();
        let mut all = Vec::new();
        segments(&chain, &depth, &camera(), &limits(), |it| all.push(it.ends));
        all
    }

    #[test]
    fn a_line_of_linear_depth_is_one_segment() {
        let all = found(|x| Some(2.0 + 0.001 * x as f64));
        assert_eq!(all.len(), 1);
        let [a, b] = all[0];
        assert!((a.z - 2.0).abs() < 1e-5 && (b.z - 2.199).abs() < 1e-5);
        assert!((a.x - 2.0 * -99.5 / 180.0).abs() < 1e-5);
    }

    #[test]
    fn a_jump_of_depth_divides_and_leaves_more_than_the_window_out() {
        let all = found(|x| Some(if x < 100 { 2.0 } else { 3.0 }));
        assert_eq!(all.len(), 2);
        assert!(all[0].iter().all(|end| (end.z - 2.0).abs() < 1e-5));
        assert!(all[1].iter().all(|end| (end.z - 3.0).abs() < 1e-5));
        // Eleven outliers are gone before the second segment begins.
        let pixel = camera().project(&all[1][0]).unwrap();
        assert!((pixel.x - 111.0).abs() < 1e-3, "{pixel}");
    }

    #[test]
    fn pixels_without_depth_are_outliers_in_total() {
        // Every third pixel lacks a depth: 10 of 40, plus those of the windows.
        let all = found(|x| (x % 3 != 0).then_some(2.0));
        assert!(all.len() > 3, "{}", all.len());
        assert!(found(|_| None).is_empty());
    }
}
