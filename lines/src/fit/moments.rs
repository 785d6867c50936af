//! Running sums for line fits in constant time.
//!
//! Coordinates are in pixels relative to the first pixel of the segment, so that the sums stay small and accurate.

use nalgebra::Vector2;

/// Running sums of pixels for a total least squares line.
#[derive(Debug, Clone, Copy, Default)]
pub struct ImageMoments {
    /// Number of pixels.
    pub n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

/// A line in the image: the centroid of its pixels and a unit direction.
#[derive(Debug, Clone, Copy)]
pub struct ImageLine {
    /// Centroid of the pixels.
    pub center: Vector2<f64>,
    /// Unit direction.
    pub direction: Vector2<f64>,
    /// Root mean square distance of the pixels from the line.
    pub rms_px: f64,
    /// Sum of squared positions along the line, about the centroid.
    pub spread: f64,
}

impl ImageMoments {
    /// Adds a pixel.
    pub fn add(&mut self, p: Vector2<f64>) {
        self.n += 1.0;
        self.x += p.x;
        self.y += p.y;
        self.xx += p.x * p.x;
        self.xy += p.x * p.y;
        self.yy += p.y * p.y;
    }

    /// Removes a pixel that was added.
    pub fn remove(&mut self, p: Vector2<f64>) {
        self.n -= 1.0;
        self.x -= p.x;
        self.y -= p.y;
        self.xx -= p.x * p.x;
        self.xy -= p.x * p.y;
        self.yy -= p.y * p.y;
    }

    /// The total least squares line, oriented like `towards`; `None` when the pixels have no dominant direction.
    pub fn line(&self, towards: Vector2<f64>) -> Option<ImageLine> {
        if self.n < 2.0 {
            return None;
        }
        let center = Vector2::new(self.x, self.y) / self.n;
        let xx = self.xx - self.x * center.x;
        let xy = self.xy - self.x * center.y;
        let yy = self.yy - self.y * center.y;
        let mean = 0.5 * (xx + yy);
        let half = 0.5 * (xx - yy);
        let root = (half * half + xy * xy).sqrt();
        let (spread, rest) = (mean + root, (mean - root).max(0.0));
        // The better conditioned row of (S - spread I) v = 0.
        let v = if half >= 0.0 {
            Vector2::new(root + half, xy)
        } else {
            Vector2::new(xy, root - half)
        };
        let norm = v.norm();
        if norm.is_nan() || norm <= 0.0 || root <= 0.0 {
            return None;
        }
        let sign = if v.dot(&towards) < 0.0 { -1.0 } else { 1.0 };
        Some(ImageLine {
            center,
            direction: v * (sign / norm),
            rms_px: (rest / self.n).sqrt(),
            spread,
        })
    }
}

impl ImageLine {
    /// Distance of a pixel from the line.
    pub fn distance(&self, p: Vector2<f64>) -> f64 {
        let d = p - self.center;
        (d.x * self.direction.y - d.y * self.direction.x).abs()
    }

    /// Position of a pixel along the line, 0 at the centroid.
    pub fn position(&self, p: Vector2<f64>) -> f64 {
        (p - self.center).dot(&self.direction)
    }
}

/// Running sums of inliers for the depth line. Values are inverse depths (weight 1 / variance) or depths (weight 1).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DepthMoments {
    pub(super) n: f64,
    w: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    v: f64,
    xv: f64,
    yv: f64,
    vv: f64,
}

/// A line of a value over the position along an [`ImageLine`].
#[derive(Debug, Clone, Copy)]
pub(super) struct DepthLine {
    /// Weighted mean position and value.
    pub(super) position: f64,
    pub(super) value: f64,
    pub(super) slope: f64,
    /// Sum of weights, and weighted sum of squared positions about the mean.
    pub(super) weight: f64,
    pub(super) spread: f64,
    /// Weighted sum of squared vertical residuals.
    pub(super) chi2: f64,
}

impl DepthMoments {
    pub(super) fn add(&mut self, p: Vector2<f64>, value: f64, weight: f64) {
        self.accumulate(p, value, weight, 1.0);
    }

    pub(super) fn remove(&mut self, p: Vector2<f64>, value: f64, weight: f64) {
        self.accumulate(p, value, -weight, -1.0);
    }

    fn accumulate(&mut self, p: Vector2<f64>, value: f64, weight: f64, count: f64) {
        let (wx, wy, wv) = (weight * p.x, weight * p.y, weight * value);
        self.n += count;
        self.w += weight;
        self.x += wx;
        self.y += wy;
        self.v += wv;
        self.xx += wx * p.x;
        self.xy += wx * p.y;
        self.yy += wy * p.y;
        self.xv += wv * p.x;
        self.yv += wv * p.y;
        self.vv += wv * value;
    }

    /// Mean value.
    pub(super) fn mean(&self) -> f64 {
        self.v / self.w
    }

    /// The depth line over an image line: least squares in the value, or total least squares in (position, `scale` x value) with a scale;
    /// `None` when the pixels have no extent along the image line.
    pub(super) fn line(&self, image: &ImageLine, scale: Option<f64>) -> Option<DepthLine> {
        if self.n < 2.0 || self.w <= 0.0 {
            return None;
        }
        let (dx, dy) = (image.direction.x, image.direction.y);
        let (mx, my, mv) = (self.x / self.w, self.y / self.w, self.v / self.w);
        let xx = self.xx - self.x * mx;
        let xy = self.xy - self.x * my;
        let yy = self.yy - self.y * my;
        let xv = self.xv - self.x * mv;
        let yv = self.yv - self.y * mv;
        let vv = (self.vv - self.v * mv).max(0.0);
        let spread = dx * dx * xx + 2.0 * dx * dy * xy + dy * dy * yy;
        let cross = dx * xv + dy * yv;
        if spread.is_nan() || spread <= 1e-9 * self.w {
            return None;
        }
        let slope = match scale {
            None => cross / spread,
            Some(scale) => {
                // Direction of the larger eigenvalue of ((spread, s cross), (s cross, s^2 vv)).
                let (c, q) = (scale * cross, scale * scale * vv);
                let half = 0.5 * (spread - q);
                let root = (half * half + c * c).sqrt();
                if half + root <= 0.0 {
                    return None;
                }
                c / (half + root) / scale
            }
        };
        let chi2 = (vv - 2.0 * slope * cross + slope * slope * spread).max(0.0);
        Some(DepthLine {
            position: (Vector2::new(mx, my) - image.center).dot(&image.direction),
            value: mv,
            slope,
            weight: self.w,
            spread,
            chi2,
        })
    }
}

impl DepthLine {
    /// The value at a position along the image line.
    pub(super) fn at(&self, position: f64) -> f64 {
        self.value + self.slope * (position - self.position)
    }

    /// Variance of the value at a position when the weights are inverse variances.
    pub(super) fn variance(&self, position: f64) -> f64 {
        let lever = position - self.position;
        1.0 / self.weight + lever * lever / self.spread
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_line_is_recovered() {
        for degrees in (0..180).step_by(7) {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let direction = Vector2::new(cos, sin);
            let (mut image, mut depth) = (ImageMoments::default(), DepthMoments::default());
            for i in 0..20 {
                let p = direction * f64::from(i) + Vector2::new(3.0, -2.0);
                image.add(p);
                depth.add(p, 0.5 + 0.01 * f64::from(i), 1.0 + f64::from(i % 3));
            }
            let line = image.line(direction).unwrap();
            assert!((line.direction - direction).norm() < 1e-9);
            assert!(line.rms_px < 1e-6);
            for scale in [None, Some(500.0)] {
                let fitted = depth.line(&line, scale).unwrap();
                assert!((fitted.slope - 0.01).abs() < 1e-9);
                assert!((fitted.at(-9.5) - 0.5).abs() < 1e-9);
                assert!(fitted.chi2 < 1e-9);
            }
        }
    }

    #[test]
    fn removal_restores() {
        let points: Vec<Vector2<f64>> = (0..12)
            .map(|i| Vector2::new(f64::from(i), f64::from(i * i % 5)))
            .collect();
        let (mut all, mut some) = (ImageMoments::default(), ImageMoments::default());
        for (i, &p) in points.iter().enumerate() {
            all.add(p);
            if i >= 4 {
                some.add(p);
            }
        }
        for &p in &points[..4] {
            all.remove(p);
        }
        let (a, b) = (
            all.line(Vector2::x()).unwrap(),
            some.line(Vector2::x()).unwrap(),
        );
        assert!((a.center - b.center).norm() < 1e-12 && (a.direction - b.direction).norm() < 1e-12);
    }

    #[test]
    fn coincident_pixels_have_no_direction() {
        let mut image = ImageMoments::default();
        for _ in 0..5 {
            image.add(Vector2::new(1.0, 1.0));
        }
        assert!(image.line(Vector2::x()).is_none());
    }
}
