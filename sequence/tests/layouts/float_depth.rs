//! Floating-point depth, and standard deviations of depth.

use std::path::Path;

use linecarve_sequence::FrameError;

use crate::support::write_seven_scenes;
use crate::{folder_with, open};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

fn write_npy(path: &Path, value: impl Fn(usize) -> f32) {
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({HEIGHT}, {WIDTH}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..WIDTH * HEIGHT).flat_map(|index| value(index).to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
}

/// A folder with `count` frames whose depth is in NPY files, registered to colour.
fn float_folder(count: usize) -> tempfile::TempDir {
    folder_with(|folder| {
        write_seven_scenes(folder, count);
        for index in 0..count {
            let name = format!("frame-{index:06}.depth");
            std::fs::remove_file(folder.join(format!("{name}.png"))).unwrap();
            let special = [0.0, -1.0, f32::NAN, f32::INFINITY, 1.25];
            write_npy(&folder.join(format!("{name}.npy")), |i| special[i % 5]);
        }
    })
}

fn write_sidecar(folder: &Path, text: &str) {
    std::fs::write(folder.join("linecarve.toml"), text).unwrap();
}

#[test]
fn floating_point_depth_is_in_units_of_the_poses_unless_scaled() {
    let folder = float_folder(1);
    let sequence = open(folder.path()).unwrap();
    let calibration = sequence.depth_calibration().unwrap();
    assert!(calibration.is_float && calibration.registered);
    assert_eq!(calibration.sensor(0.003, 2.0).noise.depth_step, 0.0);
    let depth = sequence.load_depth(0).unwrap().unwrap();
    assert_eq!(depth.samples()[..5], [0.0, 0.0, 0.0, 0.0, 1.25]);
    assert!(
        sequence
            .conventions()
            .iter()
            .any(|it| it.contains("floating-point"))
    );
    assert!(sequence.load_depth_sigma(0).unwrap().is_none());

    write_sidecar(folder.path(), "[depth]\nscale = 2.0");
    let sequence = open(folder.path()).unwrap();
    let depth = sequence.load_depth(0).unwrap().unwrap();
    assert_eq!(depth.samples()[4], 0.625);
}

#[test]
fn standard_deviations_come_from_their_folder() {
    let folder = float_folder(2);
    std::fs::create_dir(folder.path().join("sigma")).unwrap();
    write_npy(&folder.path().join("sigma/frame-000000.depth.npy"), |i| {
        i as f32
    });
    write_sidecar(folder.path(), "[depth]\nsigma = \"sigma\"");
    let sequence = open(folder.path()).unwrap();
    let sigma = sequence.load_depth_sigma(0).unwrap().unwrap();
    assert_eq!(sigma.samples()[..3], [0.0, 1.0, 2.0]);
    let error = sequence.load_depth_sigma(1).unwrap_err();
    assert!(matches!(error, FrameError::SigmaMissing { .. }) && error.is_limited_to_frame());
    let text = error.to_string();
    for part in ["frame-000001.depth.npy", "linecarve.toml", "[depth]"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn integers_among_floating_point_depth_are_refused() {
    let folder = float_folder(2);
    let replaced = folder.path().join("frame-000001.depth.npy");
    std::fs::remove_file(&replaced).unwrap();
    image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(64, 48, image::Luma([2000]))
        .save(replaced.with_extension("png"))
        .unwrap();
    let error = open(folder.path())
        .unwrap()
        .load_depth(1)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("integers") && error.contains("one type"),
        "{error}"
    );
}

#[test]
fn truncated_depth_names_the_file() {
    let folder = float_folder(2);
    let path = folder.path().join("frame-000001.depth.npy");
    let bytes = std::fs::read(&path).unwrap();
    let sequence = open(folder.path()).unwrap();
    for length in [0, 3, 8, 60, 128, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = sequence.load_depth(1).unwrap_err();
        assert!(error.is_limited_to_frame(), "{length}: {error}");
        assert!(
            error.to_string().contains("frame-000001.depth.npy"),
            "{error}"
        );
    }
}

#[test]
fn standard_deviations_need_registered_depth() {
    let folder = float_folder(1);
    write_sidecar(
        folder.path(),
        "[depth]\nsigma = \"sigma\"\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5",
    );
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("registered") && error.contains("linecarve.toml"),
        "{error}"
    );
}
