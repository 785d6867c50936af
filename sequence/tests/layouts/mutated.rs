//! Seeded damage: 500 damaged copies of the files of each reader are read or refused with a message that names the file,
//! without a panic and with bounded memory.

use std::path::{Path, PathBuf};

use linecarve_mesh::read_geometry;
use linecarve_sequence::export::{TrajectoryFormat, posed_images, write_trajectory};
use linecarve_sequence::{OpenOptions, Sequence};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::geometry_files::write_geometry_files;
use super::writers::write_pose_list;
use super::{LAYOUTS, MODELS, Writer, folder_with, open};

/// Number of damaged copies for each layout; `LINECARVE_LONG_TESTS=1` gives many more.
fn copies() -> usize {
    if std::env::var_os("LINECARVE_LONG_TESTS").is_some() {
        20_000
    } else {
        500
    }
}

/// The files of a sequence that are not images, sorted.
fn data_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_none_or(|end| end != "png") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Applies one kind of damage.
fn mutate(bytes: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let at = random.random_range(0..bytes.len().max(1));
    match random.random_range(0..12) {
        0 => out.truncate(at),
        1 => out.clear(),
        2 => {
            for _ in 0..random.random_range(1..9) {
                let at = random.random_range(0..out.len().max(1));
                if let Some(byte) = out.get_mut(at) {
                    *byte ^= 1 << random.random_range(0..8);
                }
            }
        }
        3 => {
            // A huge count, at any offset of a binary file.
            let huge: [u8; 8] = [
                u64::MAX.to_le_bytes(),
                (u64::MAX >> 1).to_le_bytes(),
                (1_u64 << 40).to_le_bytes(),
                0x7FFF_FFFF_u64.to_le_bytes(),
            ][random.random_range(0..4)];
            for (slot, value) in out[at.min(bytes.len())..].iter_mut().zip(huge) {
                *slot = value;
            }
        }
        4 | 5 => replace_number(&mut out, random),
        6 => {
            let text = String::from_utf8_lossy(bytes).replace('\n', "\r");
            out = text.into_bytes();
        }
        7 => {
            let text = String::from_utf8_lossy(bytes).replace('\n', "\r\n");
            out = text.into_bytes();
        }
        8 => {
            let is_little = random.random_range(0..2) == 0;
            out = if is_little {
                vec![0xFF, 0xFE]
            } else {
                vec![0xFE, 0xFF]
            };
            for unit in String::from_utf8_lossy(bytes).encode_utf16() {
                out.extend(if is_little {
                    unit.to_le_bytes()
                } else {
                    unit.to_be_bytes()
                });
            }
        }
        9 => {
            let mut garbage = vec![0; random.random_range(1..64)];
            random.fill_bytes(&mut garbage);
            out.splice(at.min(bytes.len())..at.min(bytes.len()), garbage);
        }
        10 => {
            let to = random.random_range(at..bytes.len().max(at + 1));
            out.drain(at.min(bytes.len())..to.min(bytes.len()));
        }
        _ => out.extend_from_slice(&bytes[at.min(bytes.len())..]),
    }
    out
}

/// Makes a number of a text invalid, far too large, or negative.
fn replace_number(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let starts: Vec<usize> = (0..bytes.len())
        .filter(|&i| bytes[i].is_ascii_digit() && (i == 0 || !bytes[i - 1].is_ascii_digit()))
        .collect();
    let Some(&start) = starts.get(random.random_range(0..starts.len().max(1))) else {
        return;
    };
    let length = bytes[start..]
        .iter()
        .take_while(|byte| byte.is_ascii_digit() || **byte == b'.')
        .count();
    let with = [
        "nan",
        "inf",
        "-1",
        "1e308",
        "18446744073709551615",
        "99999999999999999999999999",
        "0",
        "2147483648",
        "",
    ][random.random_range(0..9)];
    bytes.splice(start..start + length, with.bytes());
}

fn check(name: &str, write: Writer, seed: u64) {
    let folder = folder_with(write);
    let files = data_files(folder.path());
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (copies, mut refused) = (copies(), 0);
    for copy in 0..copies {
        let path = &files[random.random_range(0..files.len())];
        let bytes = std::fs::read(path).unwrap();
        std::fs::write(path, mutate(&bytes, &mut random)).unwrap();
        match Sequence::open(folder.path(), &OpenOptions::default()) {
            Ok(sequence) => {
                for frame in sequence.frames() {
                    let pose = frame.world_from_camera.to_homogeneous();
                    assert!(pose.iter().all(|v| v.is_finite()), "{name} {copy}");
                }
                if let Some(model) = sequence.sparse_model() {
                    for point in &model.points {
                        assert!(
                            point.point_in_world.iter().all(|v| v.is_finite()),
                            "{name} {copy}"
                        );
                        let views = model.views.len() as u32;
                        assert!(
                            point.observations.iter().all(|s| s.view < views),
                            "{name} {copy}"
                        );
                    }
                }
                if !sequence.frames().is_empty() {
                    let _ = sequence.load_gray(0);
                    let _ = sequence.load_depth(0);
                }
            }
            Err(error) => {
                refused += 1;
                let message = error.to_string();
                let place = folder.path().to_string_lossy();
                assert!(message.contains(&*place), "{name} {copy}: {message}");
            }
        }
        std::fs::write(path, bytes).unwrap();
    }
    assert!(refused > copies / 20, "{name}: only {refused} were refused");
    assert!(peak_memory_mb() < 1000.0, "{name}");
}

/// Peak memory of this process in MB; 0 if the system does not report it.
fn peak_memory_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|rest| rest.trim().trim_end_matches(" kB").parse::<f64>().ok())
        .map_or(0.0, |kilobytes| kilobytes / 1024.0)
}

#[test]
fn damaged_layouts_with_depth_are_read_or_refused() {
    for (seed, (name, write)) in (0_u64..).zip(LAYOUTS) {
        check(name, write, seed);
    }
}

#[test]
fn damaged_models_are_read_or_refused() {
    for (seed, (name, write, _)) in (10_u64..).zip(MODELS) {
        check(name, write, seed);
    }
}

/// Damages one file and calls `read` for each copy. Error messages must contain `named`.
fn check_file(path: &Path, named: &Path, seed: u64, read: impl Fn() -> Result<(), String>) {
    let whole = std::fs::read(path).unwrap();
    assert_eq!(read(), Ok(()), "{}", path.display());
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (copies, mut refused) = (copies(), 0);
    for copy in 0..copies {
        std::fs::write(path, mutate(&whole, &mut random)).unwrap();
        if let Err(message) = read() {
            refused += 1;
            let named = named.to_string_lossy();
            assert!(message.contains(&*named), "{copy}: {message}");
        }
    }
    std::fs::write(path, whole).unwrap();
    assert!(
        refused > copies / 20,
        "{}: only {refused} were refused",
        path.display()
    );
    assert!(peak_memory_mb() < 1000.0, "{}", path.display());
}

#[test]
fn damaged_trajectories_are_read_or_refused() {
    let folder = folder_with(write_pose_list);
    let images = posed_images(&open(folder.path()).unwrap());
    let path = folder.path().join("brought.txt");
    let read = || {
        let mut options = OpenOptions::default();
        options.poses = Some(path.clone());
        match Sequence::open(folder.path(), &options) {
            Ok(_) => Ok(()),
            Err(error) => Err(error.to_string()),
        }
    };
    for (seed, format) in (30..).zip([
        TrajectoryFormat::Tum,
        TrajectoryFormat::Euroc,
        TrajectoryFormat::Kitti,
        TrajectoryFormat::Open3dLog,
    ]) {
        write_trajectory(&path, format, &images).unwrap();
        check_file(&path, &path, seed, read);
    }
}

#[test]
fn damaged_sidecars_are_read_or_refused() {
    let folder = folder_with(LAYOUTS[0].1);
    let path = folder.path().join("linecarve.toml");
    let text = "[color]\nmodel = \"radial-tangential\"\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\ndistortion = [0.1, 0.0, 0.0, \
                0.0]\n[depth]\nscale = 1000.0\n[poses]\ndirection = \"inverse\"\naxes = \"y-and-z-flipped\"\n";
    std::fs::write(&path, text).unwrap();
    // Intrinsics that do not fit give an error about the image.
    check_file(&path, folder.path(), 40, || open(folder.path()).map(|_| ()));
}

#[test]
fn damaged_meshes_lines_and_clouds_are_read_or_refused() {
    let folder = folder_with(write_geometry_files);
    for (seed, path) in (50..).zip(data_files(folder.path())) {
        check_file(&path, &path, seed, || {
            read_geometry(&path)
                .map(|_| ())
                .map_err(|error| error.to_string())
        });
    }
}
