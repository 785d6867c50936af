//! The pictures of README.md and of the documents: those that the program makes.

use std::path::{Path, PathBuf};

use image::{GenericImage, RgbImage};

use crate::program::{expect_status, text};

/// Set to write the pictures anew in place of comparing with them.
const BLESS: &str = "LINECARVE_BLESS";

/// Levels that the channels of a pixel may differ, and share of the pixels that may differ by more: for processors whose mathematics
/// round otherwise.
const LEVELS: u8 = 8;
const SHARE: f64 = 0.01;

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Reconstructs the sample into a folder, with the options beside what all have.
fn reconstruct(out: &Path, options: &[&str]) {
    let sample = project("assets/room");
    let fixed = ["reconstruct", text(&sample), "--out", text(out)];
    let rest = ["--final-only", "--no-page", "--quiet"];
    expect_status(0, fixed.iter().chain(&rest).chain(options));
}

/// What a frame of the sample saw of a mesh, with lines over it.
fn view(mesh: &Path, frame: &str, lines: Option<&Path>) -> RgbImage {
    let (sample, picture) = (project("assets/room"), mesh.with_extension("png"));
    let fixed = ["render", text(mesh), "--out", text(&picture)];
    let seen = ["--sequence", text(&sample), "--frame", frame];
    let lines = lines.iter().flat_map(|lines| ["--lines", text(lines)]);
    expect_status(0, fixed.into_iter().chain(seen).chain(lines));
    open(&picture)
}

fn open(path: &Path) -> RgbImage {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    image.to_rgb8()
}

fn beside(left: &RgbImage, right: &RgbImage) -> RgbImage {
    let mut both = RgbImage::new(left.width() + right.width(), left.height());
    both.copy_from(left, 0, 0).unwrap();
    both.copy_from(right, left.width(), 0).unwrap();
    both
}

/// Writes a picture of `assets/`, or compares with it.
fn settle(name: &str, made: &RgbImage) {
    let path = project("assets").join(name);
    if std::env::var_os(BLESS).is_some() {
        made.save(&path).unwrap();
        return;
    }
    let kept = open(&path);
    assert_eq!(kept.dimensions(), made.dimensions(), "{name}");
    let differs = |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| {
        a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > LEVELS)
    };
    let others = kept.pixels().zip(made.pixels()).filter(differs).count();
    let share = others as f64 / f64::from(kept.width() * kept.height());
    assert!(
        share <= SHARE,
        "{:.1} % of the pixels of assets/{name} are others. If the change is meant, look at the new picture: {BLESS}=1 cargo test --test \
         commands pictures -- --include-ignored",
        100.0 * share
    );
}

#[test]
fn readme_shows_what_the_program_makes() {
    let folder = tempfile::tempdir().unwrap();
    let [cut, votes] = ["cut", "votes"].map(|name| folder.path().join(name));
    reconstruct(&cut, &["--texture"]);
    reconstruct(&votes, &["--labels", "votes", "--no-picture"]);
    settle("reconstruction.png", &open(&cut.join("picture.png")));
    // Read with its texture, and with colours of vertices.
    let [textured, colored] = ["mesh.glb", "mesh.ply"].map(|name| cut.join(name));
    let pair = [&colored, &textured].map(|mesh| view(mesh, "20", None));
    settle("texture.png", &beside(&pair[0], &pair[1]));
    settle("labels-cut.png", &view(&colored, "32", None));
    settle(
        "labels-votes.png",
        &view(&votes.join("mesh.ply"), "32", None),
    );
    let edges = cut.join("feature-edges.ply");
    settle("feature-edges.png", &view(&colored, "27", Some(&edges)));
}

#[test]
#[ignore = "depth from images takes a minute in development builds; with LINECARVE_BLESS it makes the picture"]
fn the_page_on_inputs_shows_what_the_program_makes() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--depth", "semi-dense", "--texture", "--no-picture"];
    reconstruct(folder.path(), &options);
    let meshes = ["mesh.ply", "mesh.glb"].map(|name| folder.path().join(name));
    let pair = meshes.map(|mesh| view(&mesh, "12", None));
    settle("images-alone.png", &beside(&pair[0], &pair[1]));
}
