//! `render` of lines and points without a mesh.

use std::path::Path;

use crate::program::{linecarve, stderr, text};

/// Pixels that are darker than the background.
fn dark_pixels(path: &Path, arguments: &[&str]) -> Vec<(u32, u32)> {
    let picture = path.with_extension("png");
    let fixed = [
        "render",
        text(path),
        "--size",
        "200x100",
        "--out",
        text(&picture),
    ];
    let output = linecarve(fixed.iter().chain(arguments));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let picture = image::open(&picture).unwrap().to_luma8();
    let dark = picture
        .enumerate_pixels()
        .filter(|(.., pixel)| pixel[0] < 215);
    dark.map(|(x, y, _)| (x, y)).collect()
}

/// From 5 in front of the origin; one unit is 17.3 pixels there.
const VIEW: [&str; 4] = ["--eye", "0,0,-5", "--target", "0,0,0"];

#[test]
fn lines_without_a_mesh_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let obj = folder.path().join("lines.obj");
    std::fs::write(&obj, "v -2 0 0\nv 2 0 0\nv 2 1 0\nl 1 2 3\n").unwrap();
    let ply = folder.path().join("edges.ply");
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n";
    std::fs::write(&ply, format!("{header}-2 0 0\n2 0 0\n2 1 0\n0 1\n1 2\n")).unwrap();
    let drawn = dark_pixels(&obj, &VIEW);
    // Four units across and one down.
    assert!((60..220).contains(&drawn.len()), "{} pixels", drawn.len());
    assert!(
        drawn.iter().all(|(_, y)| (48..=68).contains(y)),
        "{drawn:?}"
    );
    assert_eq!(drawn, dark_pixels(&ply, &VIEW));
    // From outside, without a view.
    assert!(dark_pixels(&obj, &[]).len() > 60);
}

#[test]
fn points_without_a_mesh_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let ply = folder.path().join("points.ply");
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let points = "-2 0 0 0 0 0\n2 0 0 0 0 0\n0 2 0 0 0 0\n";
    std::fs::write(&ply, format!("{header}{points}")).unwrap();
    let drawn = dark_pixels(&ply, &VIEW);
    assert!((6..40).contains(&drawn.len()), "{drawn:?}");
    let near = |x: u32, y: u32| {
        drawn
            .iter()
            .any(|&(a, b)| a.abs_diff(x) + b.abs_diff(y) < 4)
    };
    assert!(near(65, 50) && near(134, 50) && near(100, 84), "{drawn:?}");
    assert!(dark_pixels(&ply, &[]).len() > 3);
}

#[test]
fn files_that_cannot_be_drawn_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, one) = (
        folder.path().join("empty.ply"),
        folder.path().join("one.obj"),
    );
    let picture = folder.path().join("picture.png");
    std::fs::write(&empty, "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n").unwrap();
    std::fs::write(&one, "v 1 2 3\n").unwrap();
    let draw = |path: &Path, more: &[&str]| {
        let fixed = ["render", text(path), "--out", text(&picture)];
        let output = linecarve(fixed.iter().chain(more));
        (output.status.code(), stderr(&output))
    };
    let (status, message) = draw(&empty, &[]);
    assert!(
        status == Some(1) && message.contains("holds nothing to draw"),
        "{message}"
    );
    let (status, message) = draw(&one, &[]);
    assert!(status == Some(2) && message.contains("--eye"), "{message}");
    let (status, message) = draw(&one, &["--errors", text(&one)]);
    assert!(
        status == Some(2) && message.contains("colours triangles"),
        "{message}"
    );
    assert_eq!(draw(&one, &VIEW).0, Some(0));
}
