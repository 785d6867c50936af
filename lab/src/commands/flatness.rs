//! `linecarve-lab flatness`: how flat meshes are where the truth is a plane.

use linecarve::commands::Outcome;
use linecarve_lab::flatness::{Flatness, FlatnessOptions, flatness, largest_planes};
use linecarve_mesh::read_geometry;
use serde::Serialize;

use super::published::publish;
use crate::cli::FlatnessArgs;

/// Figures of one mesh, plane by plane.
#[derive(Debug, Serialize)]
struct Row {
    mesh: String,
    planes: Vec<Flatness>,
}

/// Runs the command.
///
/// # Errors
/// When a mesh cannot be read, or the truth has no plane.
pub(super) fn run(args: &FlatnessArgs) -> anyhow::Result<Outcome> {
    let options = FlatnessOptions {
        planes: args.planes,
        thickness: args.thickness,
        within: args.within,
        seed: args.seed,
    };
    for (name, value) in [("--thickness", args.thickness), ("--within", args.within)] {
        anyhow::ensure!(
            value > 0.0 && value.is_finite(),
            "{name} {value}: a length above 0 is needed"
        );
    }
    let truth = read_geometry(&args.ground_truth)?;
    let planes = largest_planes(&truth, &options);
    anyhow::ensure!(
        !planes.is_empty(),
        "{}: no plane was found; a mesh with triangles is needed",
        args.ground_truth.display()
    );
    let mut rows = Vec::new();
    for mesh in &args.meshes {
        let shape = read_geometry(mesh)?;
        anyhow::ensure!(
            !shape.triangles.is_empty(),
            "{}: a mesh with triangles is needed",
            mesh.display()
        );
        rows.push(Row {
            mesh: mesh.display().to_string(),
            planes: flatness(&shape, &planes, &options),
        });
    }
    let mut table = String::from("| mesh |");
    for plane in &planes {
        table.push_str(&format!(" {:.1} % |", 100.0 * plane.share));
    }
    table.push_str("\n|---|");
    table.push_str(&"---|".repeat(planes.len()));
    table.push('\n');
    for row in &rows {
        table.push_str(&format!("| {} |", row.mesh));
        for plane in &row.planes {
            let (rms, angle) = (1e3 * plane.rms_distance, plane.mean_angle_degrees);
            table.push_str(&format!(" {rms:.1}, {angle:.1} |"));
        }
        table.push('\n');
    }
    publish("flatness", &table, &rows, &args.output)?;
    Ok(Outcome::Done)
}
