//! Anti-aliased segments with a depth test.

use nalgebra::{Point3, Vector2};

use super::buffer::SampleBuffer;
use super::options::RenderOptions;
use super::view::View;
use crate::LineSet;
use crate::srgb::linear_color;

/// The visible part of a line in picture coordinates.
struct Projected {
    ends_px: [Vector2<f64>; 2],
    inverse_depths: [f64; 2],
    colors: [[f64; 3]; 2],
}

/// Draws `lines` into `picture` (linear light, row by row), the farthest first.
///
/// A sample of a line is visible if it lies in front of the mesh or behind it within the tolerance.
pub(super) fn draw_segments(
    picture: &mut [[f64; 3]],
    lines: &LineSet,
    view: &View,
    buffer: &SampleBuffer,
    options: &RenderOptions,
) {
    let mut projected: Vec<Projected> = lines
        .lines
        .iter()
        .filter_map(|line| project(lines, line, view, options))
        .collect();
    // Stable: lines at the same depth keep their order.
    projected.sort_by(|a, b| {
        let nearness = |p: &Projected| p.inverse_depths[0] + p.inverse_depths[1];
        nearness(a).total_cmp(&nearness(b))
    });
    for line in &projected {
        draw(picture, line, view, buffer, options);
    }
}

fn project(
    lines: &LineSet,
    line: &[u32; 2],
    view: &View,
    options: &RenderOptions,
) -> Option<Projected> {
    let [a, b] = line.map(|end| end as usize);
    let (first, second) = (lines.points.get(a)?, lines.points.get(b)?);
    let camera_from_world = view.world_from_camera.inverse();
    let mut ends = [camera_from_world * first, camera_from_world * second];
    if !ends.iter().all(|end| end.iter().all(|v| v.is_finite())) {
        return None;
    }
    let color_of = |end: usize| {
        let own = lines.colors.as_ref().and_then(|colors| colors.get(end));
        linear_color(own.copied().unwrap_or(options.line_color))
    };
    let mut colors = [color_of(a), color_of(b)];
    // Clips at a near plane, relative to the length of the line.
    let near = 1e-3 * ends[0].z.max(ends[1].z);
    if near <= 0.0 {
        return None;
    }
    for (own, other) in [(0, 1), (1, 0)] {
        if ends[own].z < near {
            let t = (near - ends[own].z) / (ends[other].z - ends[own].z);
            ends[own] = Point3::from(ends[own].coords.lerp(&ends[other].coords, t));
            ends[own].z = near;
            let (from, to) = (colors[own], colors[other]);
            colors[own] = std::array::from_fn(|c| from[c] + t * (to[c] - from[c]));
        }
    }
    let [Some(start), Some(end)] = [0, 1].map(|i| view.camera.project(&ends[i])) else {
        return None;
    };
    clip_to_picture(
        Projected {
            ends_px: [start.coords, end.coords],
            inverse_depths: [1.0 / ends[0].z, 1.0 / ends[1].z],
            colors,
        },
        view,
        options.line_width_px,
    )
}

/// Clips to the picture: a line that passes near the camera may be millions of pixels long.
fn clip_to_picture(line: Projected, view: &View, width_px: f64) -> Option<Projected> {
    let margin = width_px + 2.0;
    let [start, end] = line.ends_px;
    let along = end - start;
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (axis, size) in [(0, view.width), (1, view.height)] {
        let (low, high) = (-margin, f64::from(size) + margin);
        if along[axis] == 0.0 {
            if start[axis] < low || start[axis] > high {
                return None;
            }
            continue;
        }
        let (first, second) = (
            (low - start[axis]) / along[axis],
            (high - start[axis]) / along[axis],
        );
        from = from.max(first.min(second));
        to = to.min(first.max(second));
    }
    if from > to {
        return None;
    }
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    Some(Projected {
        ends_px: [start + along * from, start + along * to],
        inverse_depths: [from, to].map(|t| mix(line.inverse_depths[0], line.inverse_depths[1], t)),
        colors: [from, to]
            .map(|t| std::array::from_fn(|c| mix(line.colors[0][c], line.colors[1][c], t))),
    })
}

fn draw(
    picture: &mut [[f64; 3]],
    line: &Projected,
    view: &View,
    buffer: &SampleBuffer,
    options: &RenderOptions,
) {
    let [start, end] = line.ends_px;
    let along = end - start;
    let length_squared = along.norm_squared();
    let radius = 0.5 * options.line_width_px;
    let reach = radius + 0.5;
    // Steps along the longer axis and covers the few pixels across at each step.
    let major = usize::from(along.y.abs() > along.x.abs());
    let minor = 1 - major;
    let sizes = [view.width as usize, view.height as usize];
    let (low, high) = (start[major].min(end[major]), start[major].max(end[major]));
    let slant = if along[major] == 0.0 {
        1.0
    } else {
        along.norm() / along[major].abs()
    };
    let Some(majors) = pixels(low - reach, high + reach, sizes[major]) else {
        return;
    };
    for m in majors {
        let at = if along[major] == 0.0 {
            start[minor]
        } else {
            let t = ((m as f64 - start[major]) / along[major]).clamp(0.0, 1.0);
            start[minor] + along[minor] * t
        };
        let half = reach * slant + 1.0;
        let Some(minors) = pixels(at - half, at + half, sizes[minor]) else {
            continue;
        };
        for n in minors {
            let (x, y) = if major == 0 { (m, n) } else { (n, m) };
            let pixel = Vector2::new(x as f64, y as f64);
            let t = if length_squared == 0.0 {
                0.0
            } else {
                ((pixel - start).dot(&along) / length_squared).clamp(0.0, 1.0)
            };
            let distance = (pixel - (start + along * t)).norm();
            let coverage = (reach - distance).clamp(0.0, 1.0) * options.line_width_px.min(1.0);
            if coverage == 0.0 {
                continue;
            }
            let inverse =
                line.inverse_depths[0] + t * (line.inverse_depths[1] - line.inverse_depths[0]);
            let opacity = coverage * visible_share(buffer, x, y, 1.0 / inverse, options);
            let target = &mut picture[y * sizes[0] + x];
            for (channel, value) in target.iter_mut().enumerate() {
                let color = line.colors[0][channel]
                    + t * (line.colors[1][channel] - line.colors[0][channel]);
                *value += opacity * (color - *value);
            }
        }
    }
}

/// Whole pixels between two coordinates, inside the picture.
fn pixels(low: f64, high: f64, size: usize) -> Option<std::ops::RangeInclusive<usize>> {
    let last = size.checked_sub(1)? as f64;
    (high >= 0.0 && low <= last)
        .then(|| low.ceil().max(0.0) as usize..=high.floor().min(last) as usize)
}

/// Share of a pixel's samples at which a point at `depth` is visible.
fn visible_share(
    buffer: &SampleBuffer,
    x: usize,
    y: usize,
    depth: f64,
    options: &RenderOptions,
) -> f64 {
    let step = buffer.supersampling;
    let nearest = depth * (1.0 - options.line_depth_tolerance);
    let mut visible = 0;
    for row in y * step..(y + 1) * step {
        for column in x * step..(x + 1) * step {
            let shown = buffer
                .at(column, row)
                .is_none_or(|sample| f64::from(sample.depth) >= nearest);
            visible += usize::from(shown);
        }
    }
    visible as f64 / (step * step) as f64
}
