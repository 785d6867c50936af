//! Carves the inside of a box that one view sees.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;

use linecarve_carving::{Carver, CarverOptions, ExportOptions, Hull};
use nalgebra::Point3;

fn main() -> Result<(), Box<dyn Error>> {
    // The walls of the box lie on the convex hull of its corners: keep the surface there.
    let mut carver = Carver::new(CarverOptions::with_hull(Hull::Keep));
    let mut keyframe = carver.transaction();
    let view = keyframe.add_view(Point3::new(0.5, 0.4, 0.45))?;
    for corner in 0..8 {
        let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2].map(f64::from);
        let point = keyframe.add_point(Point3::new(x, y, z))?;
        keyframe.add_observation(view, point, 1)?;
    }
    let report = keyframe.commit()?;
    let mesh = carver.mesh(&ExportOptions::default());
    println!(
        "{} triangles added; mesh of {} vertices, {} triangles",
        report.surface.added.len(),
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    Ok(())
}
