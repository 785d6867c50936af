//! Helpers of the end-to-end tests: the program, a small rendered sequence, contents of folders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use linecarve_synth::{SceneKind, SynthOptions, write_sequence};
use tempfile::TempDir;

/// Runs the program and demands an exit status.
pub(crate) fn expect_status(status: i32, arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_linecarve-lab"))
        .args(arguments)
        .output()
        .expect("the program starts");
    let error = stderr(&output);
    assert_eq!(
        output.status.code(),
        Some(status),
        "\nstdout: {}\nstderr: {error}",
        String::from_utf8_lossy(&output.stdout)
    );
    assert!(!error.contains("panicked"), "{error}");
    output
}

/// Standard error as text.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("the path is UTF-8")
}

/// The folder of the repository.
pub(crate) fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The sample.
pub(crate) fn sample() -> PathBuf {
    repository().join("assets/room")
}

/// A recording below `LINECARVE_DATA`.
pub(crate) fn data(name: &str) -> PathBuf {
    let root = std::env::var_os("LINECARVE_DATA")
        .expect("LINECARVE_DATA names the folder of the recordings");
    let path = PathBuf::from(root).join(name);
    assert!(path.exists(), "{} does not exist", path.display());
    path
}

/// A rendered sequence with its ground truth, in `sequence` below a temporary folder.
pub(crate) fn small_sequence(frames: u32) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut options = SynthOptions::default();
    options.scene = SceneKind::Boxes;
    options.frames = frames;
    options.width = 320;
    options.height = 240;
    write_sequence(&options, &folder.path().join("sequence"), &|_, _| {})
        .expect("a writable folder");
    folder
}

/// Makes every image of a sequence black.
pub(crate) fn blacken(sequence: &Path) {
    for entry in std::fs::read_dir(sequence.join("rgb")).expect("the layout has a colour folder") {
        let path = entry.expect("a readable entry").path();
        image::RgbImage::new(320, 240)
            .save(path)
            .expect("a writable image");
    }
}

/// Every file of a folder with its bytes.
pub(crate) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    std::fs::read_dir(folder)
        .expect("a readable folder")
        .map(|entry| {
            let path = entry.expect("a readable entry").path();
            let bytes = std::fs::read(&path).expect("a readable file");
            let name = path.file_name().expect("a file").into();
            (name, bytes)
        })
        .collect()
}
