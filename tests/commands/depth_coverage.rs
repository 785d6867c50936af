//! Depth that covers little of each image gives little surface, and no wrong one.

use std::path::Path;

use linecarve_mesh::evaluate::{EvaluationOptions, evaluate};
use linecarve_mesh::{Shape, read_geometry};

use crate::program::{expect_status, text};

/// Keeps a share of the rows of all depth images, as lines of so many rows.
fn keep_rows(sequence: &Path, rows: u32, share: f64) {
    let period = (f64::from(rows) / share).round() as u32;
    for entry in std::fs::read_dir(sequence.join("depth")).unwrap() {
        let path = entry.unwrap().path();
        let mut depth = image::open(&path).unwrap().into_luma16();
        for (_, row, pixel) in depth.enumerate_pixels_mut() {
            if row % period >= rows {
                pixel.0 = [0];
            }
        }
        depth.save(&path).unwrap();
    }
}

#[test]
fn sparse_depth_gives_a_part_of_the_surface_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut recalls = Vec::new();
    // Lines of two rows are too thin for the planes of windows of seven pixels.
    for (rows, share) in [(6, 0.05), (6, 0.1), (6, 0.2), (6, 0.5), (2, 0.2)] {
        let name = |name: &str| folder.path().join(format!("{name}-{rows}-{share}"));
        let [room, out] = ["room", "out"].map(name);
        let size = ["--frames", "20", "--size", "320x240"];
        let place = ["--quiet", "--out", text(&room)];
        expect_status(0, ["synth", "room"].into_iter().chain(size).chain(place));
        keep_rows(&room, rows, share);
        let fixed = [
            "--final-only",
            "--no-page",
            "--no-picture",
            "--format",
            "ply",
            "--quiet",
        ];
        let place = ["--out", text(&out)];
        let run = ["reconstruct", text(&room)]
            .into_iter()
            .chain(fixed)
            .chain(place);
        if rows == 2 {
            expect_status(1, run);
            continue;
        }
        expect_status(0, run);
        let mesh = read_geometry(&out.join("mesh.ply")).unwrap().into_mesh();
        let truth = read_geometry(&room.join("ground-truth-observed.ply")).unwrap();
        let options = EvaluationOptions {
            samples: 20_000,
            ..EvaluationOptions::default()
        };
        let near = evaluate(&Shape::from(mesh), &truth, &options).unwrap().at[0];
        assert!(near.precision > 0.95, "{share}: {}", near.precision);
        recalls.push(near.recall.expect("the truth is a mesh"));
    }
    assert!(recalls.is_sorted() && recalls[0] > 0.02, "{recalls:.3?}");
}
