//! `reconstruct --texture`: files, report, page and pictures.

use std::path::Path;

use crate::program::{contents, expect_status, linecarve, small_sequence, stderr, text};
use linecarve_mesh::{read_geometry, read_textured};
use serde_json::Value;

fn reconstruct(sequence: &Path, out: &Path, more: &[&str]) -> String {
    let fixed = [
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--final-only",
    ];
    let arguments = fixed.iter().chain(more).copied();
    let output = expect_status(0, arguments.chain(["--no-picture", "--out", text(out)]));
    stderr(&output)
}

fn report(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap()
}

#[test]
fn the_mesh_gets_a_texture_in_every_file_that_can_hold_one() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let [one, two, plain] = ["one", "two", "plain"].map(|name| folder.path().join(name));
    reconstruct(&sequence, &one, &["--texture", "--threads", "1"]);
    reconstruct(&sequence, &two, &["--texture=jpeg", "--threads", "2"]);
    reconstruct(&sequence, &plain, &["--threads", "2"]);

    let (mut first, second) = (contents(&one), contents(&two));
    // Both tell durations.
    for name in ["report.json", "report.html"] {
        first.remove(Path::new(name));
    }
    for (name, bytes) in &first {
        assert!(
            second[name] == *bytes,
            "{} depends on threads",
            name.display()
        );
    }
    let report = report(&one);
    let files = report["result"]["files"].as_array().unwrap();
    for name in ["mesh.mtl", "mesh_texture.jpg"] {
        assert!(first.contains_key(Path::new(name)), "{name}");
        assert!(
            files.contains(&Value::from(name)),
            "{name} is not in the report"
        );
    }
    assert_eq!(report["result"]["texture"]["views"], 6);
    assert!(report["result"]["texture"]["charts"].as_u64().unwrap() > 0);

    // The same mesh, and no texture where none was asked for.
    let mesh = read_geometry(&plain.join("mesh.ply")).unwrap();
    assert_eq!(read_geometry(&one.join("mesh.ply")).unwrap(), mesh);
    for name in ["mesh.glb", "mesh.obj", "scene.glb"] {
        assert_eq!(read_textured(&plain.join(name)).unwrap().1, None);
        let (shape, texture) = read_textured(&one.join(name)).unwrap();
        let texture = texture.unwrap();
        assert_eq!(shape.triangles.len(), mesh.triangles.len());
        let size: Vec<u32> =
            serde_json::from_value(report["result"]["texture"]["size"].clone()).unwrap();
        assert_eq!([texture.image.width(), texture.image.height()], size[..]);
    }
    let page = std::fs::read_to_string(one.join("report.html")).unwrap();
    assert!(page.contains("\"texture\":{\"media_type\":\"image/jpeg\""));
}

#[test]
fn a_textured_mesh_is_drawn_like_the_image() {
    let folder = small_sequence(6, "tum");
    let [sequence, out, picture] =
        ["sequence", "out", "view.png"].map(|name| folder.path().join(name));
    reconstruct(&sequence, &out, &["--texture=png"]);
    let image = report(&out)["keyframes"][2]["index"].as_u64().unwrap();
    for name in ["mesh.glb", "mesh.obj"] {
        let mesh = out.join(name);
        let arguments = [
            "render",
            text(&mesh),
            "--sequence",
            text(&sequence),
            "--frame",
        ];
        let index = image.to_string();
        expect_status(
            0,
            arguments
                .into_iter()
                .chain([index.as_str(), "--out", text(&picture)]),
        );
        let drawn = image::open(&picture).unwrap().into_rgb8();
        let opened = linecarve_sequence::Sequence::open(&sequence, &Default::default()).unwrap();
        let photo = opened.load_color(image as usize).unwrap();
        // The background is brighter than everything in the scene.
        let pairs = drawn.pixels().zip(photo.pixels());
        let covered: Vec<u8> = pairs
            .filter(|(drawn, _)| drawn.0.iter().any(|channel| *channel < 220))
            .map(|(a, b)| (0..3).map(|i| a.0[i].abs_diff(b.0[i])).fold(0, u8::max))
            .collect();
        let near = covered
            .iter()
            .filter(|difference| **difference < 16)
            .count();
        let share = near as f64 / covered.len() as f64;
        assert!(covered.len() > 320 * 240 / 5, "{name}: {}", covered.len());
        // The rest is at outlines.
        assert!(share > 0.75, "{name}: {share}");
    }
}

#[test]
fn an_unknown_image_format_is_refused() {
    let output = linecarve(["reconstruct", "none", "--texture=bmp", "--out", "none"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("jpeg"), "{}", stderr(&output));
}
