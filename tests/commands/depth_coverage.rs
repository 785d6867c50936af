//! Depth that covers little of each image gives little surface, and no wrong one.

use std::path::PathBuf;

use image::{ImageBuffer, Luma};
use linecarve_mesh::evaluate::{EvaluationOptions, evaluate};
use linecarve_mesh::{Shape, read_geometry};

use crate::program::{expect_status, reconstruct_mesh, text};

type Depth = ImageBuffer<Luma<u16>, Vec<u16>>;

/// Keeps a share of the rows of depth images, as lines of so many rows.
fn keep_rows(depths: &[(PathBuf, Depth)], rows: u32, share: f64) {
    let period = (f64::from(rows) / share).round() as u32;
    for (path, depth) in depths {
        let mut depth = depth.clone();
        for (_, row, pixel) in depth.enumerate_pixels_mut() {
            if row % period >= rows {
                pixel.0 = [0];
            }
        }
        depth.save(path).unwrap();
    }
}

#[test]
fn sparse_depth_gives_a_part_of_the_surface_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let room = folder.path().join("room");
    let size = ["--frames", "12", "--size", "320x240"];
    let place = ["--quiet", "--out", text(&room)];
    expect_status(0, ["synth", "room"].into_iter().chain(size).chain(place));
    let truth = read_geometry(&room.join("ground-truth-observed.ply")).unwrap();
    let depths: Vec<(PathBuf, Depth)> = std::fs::read_dir(room.join("depth"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.clone(), image::open(path).unwrap().into_luma16()))
        .collect();
    let mut recalls = Vec::new();
    // Lines of two rows are too thin for the planes of windows of seven pixels.
    for (rows, share) in [(6, 0.05), (6, 0.1), (6, 0.2), (6, 0.5), (2, 0.2)] {
        let out = folder.path().join(format!("out-{rows}-{share}"));
        keep_rows(&depths, rows, share);
        let status = i32::from(rows == 2);
        reconstruct_mesh(status, &room, &[], &out);
        if status == 1 {
            continue;
        }
        let mesh = read_geometry(&out.join("mesh.ply")).unwrap().into_mesh();
        let mut options = EvaluationOptions::default();
        options.samples = 20_000;
        let near = evaluate(&Shape::from(mesh), &truth, &options).unwrap().at[0];
        assert!(near.precision > 0.95, "{share}: {}", near.precision);
        recalls.push(near.recall.expect("the truth is a mesh"));
    }
    assert!(recalls.is_sorted() && recalls[0] > 0.02, "{recalls:.3?}");
}
