//! The 3D line of a group: fitted to its members in space, then refined on their images.

use nalgebra::{Matrix3, Matrix4, Point3, SymmetricEigen, Vector3, Vector4};

use super::grouping::{Hypotheses, Member};
use super::options::MatchedOptions;
use super::view::View;

/// An infinite line through two points; their distance is the extent of the segments that it was fitted to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) points: [Point3<f64>; 2],
}

impl Line {
    /// Unit direction from the first point to the second.
    pub(super) fn direction(&self) -> Vector3<f64> {
        (self.points[1] - self.points[0]).normalize()
    }
}

/// The line of largest variance through the ends of the members; `None` when they have no direction.
pub(super) fn fit(views: &[View], hypotheses: &Hypotheses, members: &[Member]) -> Option<Line> {
    let ends: Vec<Point3<f64>> = members
        .iter()
        .filter_map(|&member| hypotheses.ends(views, member))
        .flatten()
        .collect();
    let count = ends.len() as f64;
    let origin = *ends.first()?;
    let mean = ends.iter().map(|end| end - origin).sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> = ends
        .iter()
        .map(|end| {
            let d = end - origin - mean;
            d * d.transpose()
        })
        .sum();
    let eigen = SymmetricEigen::try_new(scatter, f64::EPSILON, 100)?;
    let largest = eigen.eigenvalues.imax();
    let direction = eigen.eigenvectors.column(largest).into_owned();
    let deviation = (eigen.eigenvalues[largest] / count).sqrt();
    let center = origin + mean;
    let line = Line {
        points: [-deviation, deviation].map(|t| center + direction * t),
    };
    let length = (line.points[1] - line.points[0]).norm();
    (length.is_finite() && length > 0.0).then_some(line)
}

/// Refines a line by Levenberg-Marquardt with Huber weights over its four degrees of freedom. Residuals are the distances in
/// pixels of both ends of each member's image segment from the projected line.
pub(super) fn refine(
    views: &[View],
    members: &[Member],
    start: Line,
    options: &MatchedOptions,
) -> Line {
    let mut line = start;
    let mut system = System::new(views, members, &line, options);
    let mut damping = 1e-3;
    for _ in 0..options.refine_iterations {
        let mut matrix = system.matrix;
        for axis in 0..4 {
            matrix[(axis, axis)] *= 1.0 + damping;
        }
        let Some(step) = matrix.lu().solve(&-system.gradient) else {
            break;
        };
        let moved = system.moved(&line, &step);
        let next = System::new(views, members, &moved, options);
        if !next.cost.is_finite() || next.cost >= system.cost {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
            continue;
        }
        let gain = system.cost - next.cost;
        let is_done = gain <= 1e-9 * system.cost;
        line = moved;
        system = next;
        damping = (damping * 0.1).max(1e-9);
        if is_done {
            break;
        }
    }
    line
}

/// The normal equations at a line. Parameters: each of its two points perpendicular to it, in two directions.
struct System {
    across: [Vector3<f64>; 2],
    matrix: Matrix4<f64>,
    gradient: Vector4<f64>,
    cost: f64,
}

impl System {
    fn new(views: &[View], members: &[Member], line: &Line, options: &MatchedOptions) -> Self {
        let direction = line.direction();
        let first = direction.cross(&Vector3::ith(direction.iamin(), 1.0));
        let first = first.normalize();
        let mut system = Self {
            across: [first, direction.cross(&first)],
            matrix: Matrix4::zeros(),
            gradient: Vector4::zeros(),
            cost: 0.0,
        };
        for member in members {
            system.add(views, *member, line, options.huber_px);
        }
        system
    }

    fn add(&mut self, views: &[View], member: Member, line: &Line, huber_px: f64) {
        let view = &views[member.view as usize];
        let segment = &view.segments[member.segment as usize];
        let camera = &view.camera;
        let [a, b] = line.points.map(|p| (view.camera_from_world * p).coords);
        // The plane of camera and line: its normal in pixels is (x / fx, y / fy, ...).
        let normal = a.cross(&b);
        let across = self.across.map(|d| view.camera_from_world * d);
        let turned = [
            across[0].cross(&b),
            across[1].cross(&b),
            a.cross(&across[0]),
            a.cross(&across[1]),
        ];
        let (ux, uy) = (1.0 / camera.fx(), 1.0 / camera.fy());
        let slope =
            |n: &Vector3<f64>, by: &Vector3<f64>| n.x * by.x * ux * ux + n.y * by.y * uy * uy;
        let length = slope(&normal, &normal).sqrt();
        if !(length.is_finite() && length > 0.0) {
            return;
        }
        for end in &segment.ends_px {
            let ray = Vector3::new((end.x - camera.cx()) * ux, (end.y - camera.cy()) * uy, 1.0);
            let height = normal.dot(&ray);
            let residual = height / length;
            let jacobian = Vector4::from_fn(|i, _| {
                turned[i].dot(&ray) / length - height * slope(&normal, &turned[i]) / length.powi(3)
            });
            let size = residual.abs();
            let (weight, cost) = if size <= huber_px {
                (1.0, residual * residual)
            } else {
                (huber_px / size, huber_px * (2.0 * size - huber_px))
            };
            self.matrix += jacobian * jacobian.transpose() * weight;
            self.gradient += jacobian * (weight * residual);
            self.cost += cost;
        }
    }

    fn moved(&self, line: &Line, step: &Vector4<f64>) -> Line {
        let [a, b] = line.points;
        Line {
            points: [
                a + self.across[0] * step[0] + self.across[1] * step[1],
                b + self.across[0] * step[2] + self.across[1] * step[3],
            ],
        }
    }
}
