//! The parts of a line that enough views see.

use nalgebra::{Point3, Vector3};

use super::grouping::Member;
use super::line::Line;
use super::options::MatchedOptions;
use super::view::View;

/// A position where a view begins or ceases to see the line.
struct Change {
    position: f64,
    view: u32,
    begins: bool,
}

/// The parts of a line that at least the minimum number of views see and that are long enough in the image.
pub(super) fn cut(
    views: &[View],
    members: &[Member],
    line: &Line,
    options: &MatchedOptions,
) -> Vec<[Point3<f64>; 2]> {
    let origin = line.points[0];
    let direction = line.direction();
    let mut changes = Vec::with_capacity(2 * members.len());
    let mut longest: Option<(f64, u32)> = None;
    for member in members {
        let view = &views[member.view as usize];
        let segment = &view.segments[member.segment as usize];
        let positions = segment
            .rays
            .map(|ray| nearest(&origin, &direction, &view.center, &ray));
        let [Some(a), Some(b)] = positions else {
            continue;
        };
        for (position, begins) in [(a.min(b), true), (a.max(b), false)] {
            changes.push(Change {
                position,
                view: member.view,
                begins,
            });
        }
        if longest.is_none_or(|(length, _)| segment.length_px > length) {
            longest = Some((segment.length_px, member.view));
        }
    }
    let Some((_, reference)) = longest else {
        return Vec::new();
    };
    // Beginnings come before ends at the same position: parts that touch become one.
    changes.sort_by(|x, y| {
        x.position
            .total_cmp(&y.position)
            .then(y.begins.cmp(&x.begins))
            .then(x.view.cmp(&y.view))
    });
    // Number of segments of each view over the current position; a view with two counts once.
    let mut open: Vec<(u32, u32)> = Vec::new();
    let mut start = None;
    let mut parts = Vec::new();
    for change in &changes {
        if change.begins {
            match open.iter_mut().find(|(view, _)| *view == change.view) {
                Some((_, count)) => *count += 1,
                None => open.push((change.view, 1)),
            }
        } else if let Some(index) = open.iter().position(|(view, _)| *view == change.view) {
            open[index].1 -= 1;
            if open[index].1 == 0 {
                open.swap_remove(index);
            }
        }
        if open.len() >= options.minimum_views {
            start = start.or(Some(change.position));
        } else if let Some(from) = start.take() {
            parts.push([from, change.position].map(|t| origin + direction * t));
        }
    }
    let view = &views[reference as usize];
    parts.retain(|ends| {
        let pixel = |end: &Point3<f64>| view.camera.project(&(view.camera_from_world * end));
        match (pixel(&ends[0]), pixel(&ends[1])) {
            (Some(a), Some(b)) => (b - a).norm() >= view.minimum_length_px,
            _ => false,
        }
    });
    parts
}

/// Position along a line (unit direction) of the point nearest to a ray (unit direction); `None` when they are parallel.
fn nearest(
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    center: &Point3<f64>,
    ray: &Vector3<f64>,
) -> Option<f64> {
    let cosine = direction.dot(ray);
    let sine_squared = 1.0 - cosine * cosine;
    let to_center = center - origin;
    let position = (to_center.dot(direction) - cosine * to_center.dot(ray)) / sine_squared;
    (sine_squared > 1e-12 && position.is_finite()).then_some(position)
}
