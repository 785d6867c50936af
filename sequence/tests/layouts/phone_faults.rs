//! Damaged recordings of phones and models: each error names its file and the remedy, and nothing panics.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use linecarve_sequence::export::{RecordingLayout, write_recording};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use crate::phone_layouts::RECORDINGS;
use crate::support::{SIZE, write_tum};
use crate::{folder_with, open, replace};

fn written(layout: RecordingLayout) -> tempfile::TempDir {
    let source = folder_with(|folder| write_tum(folder, 3));
    let sequence = open(source.path()).unwrap();
    folder_with(|folder| write_recording(folder, &sequence, layout).unwrap())
}

/// The error of opening the folder, or of the first image that cannot be loaded.
fn error_of(folder: &Path) -> Option<String> {
    let sequence = match open(folder) {
        Err(error) => return Some(error),
        Ok(sequence) => sequence,
    };
    (0..sequence.frames().len()).find_map(|at| {
        let color = sequence.load_color(at).err();
        let error = color.or_else(|| sequence.load_depth(at).err());
        error.map(|error| error.to_string())
    })
}

fn assert_named(folder: &Path, parts: &[&str]) {
    let error = error_of(folder).unwrap_or_else(|| panic!("no error that names {parts:?}"));
    for part in parts {
        assert!(error.contains(part), "{part}: {error}");
    }
}

/// Replaces the bytes of a member of an archive, or removes it.
fn change(path: &Path, name: &str, change: impl Fn(Vec<u8>) -> Option<Vec<u8>>) {
    let mut archive = ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut members = Vec::new();
    for at in 0..archive.len() {
        let mut member = archive.by_index(at).unwrap();
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes).unwrap();
        let name = member.name().unwrap().into_owned();
        members.push((name, bytes));
    }
    let mut writer = ZipWriter::new(std::fs::File::create(path).unwrap());
    for (member, bytes) in members {
        let bytes = if member == name {
            change(bytes)
        } else {
            Some(bytes)
        };
        if let Some(bytes) = bytes {
            writer
                .start_file(member, SimpleFileOptions::default())
                .unwrap();
            writer.write_all(&bytes).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn with_text(bytes: &[u8], from: &str, to: &str) -> Option<Vec<u8>> {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    assert!(text.contains(from), "{from}: {text}");
    Some(text.replacen(from, to, 1).into_bytes())
}

#[test]
fn damaged_recordings_of_record3d_are_named() {
    type Change = fn(Vec<u8>) -> Option<Vec<u8>>;
    let cases: [(&str, Change, &[&str]); 8] = [
        (
            "rgbd/1.depth",
            |bytes| Some(bytes[..bytes.len() / 2].to_vec()),
            &["rgbd/1.depth", "LZFSE"],
        ),
        ("rgbd/1.depth", |_| Some(Vec::new()), &["rgbd/1.depth"]),
        (
            "rgbd/1.png",
            |bytes| Some(bytes[..bytes.len() / 2].to_vec()),
            &["rgbd/1.png", "cannot be decoded"],
        ),
        ("metadata", |_| None, &["recording.r3d", "metadata"]),
        (
            "metadata",
            |bytes| with_text(&bytes, "\"K\":[60.0,", "\"K\":["),
            &["metadata", "8 numbers"],
        ),
        (
            "metadata",
            |bytes| with_text(&bytes, "\"h\":48,", ""),
            &["metadata, line 1", "missing field"],
        ),
        (
            "metadata",
            |bytes| with_text(&bytes, "\"poses\":[[", "\"poses\":[[NaN,"),
            &["metadata, line 1"],
        ),
        (
            "metadata",
            |bytes| with_text(&bytes, "\"dh\":48,\"dw\":64", "\"x\":1"),
            &["0.depth", "3072 values", "\"dw\""],
        ),
    ];
    for (member, damage, parts) in cases {
        let folder = written(RecordingLayout::Record3d);
        change(&folder.path().join("recording.r3d"), member, damage);
        assert_named(folder.path(), parts);
    }
    let folder = written(RecordingLayout::Record3d);
    let path = folder.path().join("recording.r3d");
    let whole = std::fs::read(&path).unwrap();
    for cut in [0, 2, 30, whole.len() / 2, whole.len() - 3] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        assert_named(folder.path(), &["recording.r3d", "copy it again"]);
    }
}

/// The same depth in more values than the sensor has.
#[test]
fn depth_that_unpacks_to_too_much_is_refused() {
    let folder = written(RecordingLayout::Record3d);
    change(&folder.path().join("recording.r3d"), "rgbd/2.depth", |_| {
        let mut packed = Vec::new();
        lzfse_rust::encode_bytes(&vec![0; 1 << 26], &mut packed).unwrap();
        Some(packed)
    });
    assert_named(
        folder.path(),
        &["rgbd/2.depth", "more than the 12288 bytes"],
    );
}

#[test]
fn damaged_results_of_depth_anything_are_named() {
    type Change = fn(Vec<u8>) -> Option<Vec<u8>>;
    let cases: [(&str, Change, &[&str]); 8] = [
        (
            "depth.npy",
            |bytes| patched(bytes, "'<f4'", "'|O' "),
            &["depth.npy", "Python objects"],
        ),
        (
            "depth.npy",
            |bytes| patched(bytes, "False", "True "),
            &["depth.npy", "ascontiguousarray"],
        ),
        (
            "depth.npy",
            |bytes| patched(bytes, "(3, 48, 64,)", "(3, 3072,)  "),
            &["depth.npy", "[3, 3072]"],
        ),
        (
            "depth.npy",
            |bytes| Some(bytes[..bytes.len() - 9].to_vec()),
            &["depth.npy/2", "truncated"],
        ),
        ("depth.npy", |_| None, &["depth.npy"]),
        (
            "extrinsics.npy",
            |bytes| Some(bytes[..bytes.len() - 9].to_vec()),
            &["extrinsics.npy", "truncated"],
        ),
        (
            "intrinsics.npy",
            |bytes| patched(bytes, "(3, 3, 3,)", "(1, 3, 9,)"),
            &["intrinsics.npy", "[3, 3, 3]"],
        ),
        ("image.npy", |_| None, &["results.npz", "images/"]),
    ];
    for (member, damage, parts) in cases {
        let folder = written(RecordingLayout::DepthAnything3);
        let path = folder.path().join("results.npz");
        change(&path, member, damage);
        assert_named(&path, parts);
    }
    let folder = written(RecordingLayout::DepthAnything3);
    change(
        &folder.path().join("results.npz"),
        "extrinsics.npy",
        |mut bytes| {
            let at = bytes.len() - 8;
            bytes[at..].copy_from_slice(&f64::NAN.to_le_bytes());
            Some(bytes)
        },
    );
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 2);
    assert!(crate::warnings(&sequence).contains("not finite"));
}

fn patched(mut bytes: Vec<u8>, from: &str, to: &str) -> Option<Vec<u8>> {
    assert_eq!(from.len(), to.len());
    let mut parts = bytes.windows(from.len());
    let at = parts.position(|part| part == from.as_bytes()).unwrap();
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    Some(bytes)
}

#[test]
fn damaged_depth_files_are_named() {
    let exr = written(RecordingLayout::Exr);
    let path = exr.path().join("depth/000001.exr");
    let whole = std::fs::read(&path).unwrap();
    // The data window of the header, in which the last two numbers are the largest column and row.
    let name = b"dataWindow\0box2i\0";
    let at = whole
        .windows(name.len())
        .position(|part| part == name)
        .unwrap()
        + name.len()
        + 4;
    let mut huge = whole.clone();
    huge[at + 8..at + 16].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0x1F, 0xFF, 0xFF, 0xFF, 0x1F]);
    // An attribute that claims two gigabytes.
    let mut long = whole.clone();
    long[at - 4..at].copy_from_slice(&0x7FFF_FFFF_u32.to_le_bytes());
    for bytes in [&huge, &long, &whole[..whole.len() / 2], &whole[..20], &[]] {
        std::fs::write(&path, bytes).unwrap();
        assert_named(exr.path(), &["000001.exr"]);
    }
    let pfm = written(RecordingLayout::Pfm);
    let path = pfm.path().join("depth/000002.pfm");
    let whole = std::fs::read(&path).unwrap();
    let header = |text: &str| [text.as_bytes(), &whole[16..]].concat();
    for (bytes, part) in [
        (whole[..whole.len() - 1].to_vec(), "values"),
        (whole[..9].to_vec(), "ends too early"),
        (header("PF\n64 48\n-1.0\n"), "three channels"),
        (header("Pf\n64 48\n0.0\n"), "byte order"),
        (header("Pf\n64 x\n-1.0\n"), "'x'"),
        (header("Pf\n0 48\n-1.0\n"), "0 x 48"),
        (header("Pf\n640000 480000\n-1.0\n"), "640000"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        assert_named(pfm.path(), &["000002.pfm", part]);
    }
    let colmap = written(RecordingLayout::ColmapDense);
    let path = colmap
        .path()
        .join("stereo/depth_maps/000001.png.geometric.bin");
    let whole = std::fs::read(&path).unwrap();
    for (bytes, part) in [
        (
            patched(whole.clone(), "64&48&1&", "46&84&1&").unwrap(),
            "46 x 84",
        ),
        (
            patched(whole.clone(), "64&48&1&", "64&48&3&").unwrap(),
            "3 channels",
        ),
        (whole[..whole.len() - 1].to_vec(), "values"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        assert_named(colmap.path(), &["000001.png.geometric.bin", part]);
    }
}

#[test]
fn damaged_cameras_are_named() {
    let polycam = written(RecordingLayout::Polycam);
    let cameras = polycam.path().join("keyframes/cameras");
    let first = first_file(&cameras);
    let whole = std::fs::read_to_string(&first).unwrap();
    let name = first.file_name().unwrap().to_str().unwrap();
    replace(&first, "\"t_12\"", "\"t_21\"");
    assert_named(polycam.path(), &[name, "line 1", "t_"]);
    std::fs::write(&first, whole.replace("\"fx\":60.0", "\"fx\":-1.0")).unwrap();
    assert_named(polycam.path(), &[name, "focal length"]);
    std::fs::write(&first, whole.replace("\"t_03\":", "\"t_03\":1e999, \"x\":")).unwrap();
    assert_named(polycam.path(), &[name, "line 1"]);

    let arkit = written(RecordingLayout::ArkitScenes);
    let first = first_file(&arkit.path().join("lowres_wide_intrinsics"));
    std::fs::write(&first, "64 48 60 60 31.5\n").unwrap();
    assert_named(arkit.path(), &[".pincam, line 1", "expected 6 numbers"]);
    std::fs::write(&first, "").unwrap();
    assert_named(arkit.path(), &[".pincam", "empty"]);

    let mvsnet = written(RecordingLayout::MvsNet);
    let path = mvsnet.path().join("cams/00000001_cam.txt");
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &whole[..whole.find("intrinsic\n").unwrap()]).unwrap();
    assert_named(mvsnet.path(), &["00000001_cam.txt", "16 numbers"]);
    std::fs::write(&path, whole.replace("60 0 31.5", "60 0 x")).unwrap();
    assert_named(mvsnet.path(), &["00000001_cam.txt, line", "'x'"]);
    std::fs::write(&path, whole.replacen("extrinsic\n", "extrinsic\nnan ", 1)).unwrap();
    let sequence = open(mvsnet.path()).unwrap();
    assert!(crate::warnings(&sequence).contains("not finite"));
}

fn first_file(folder: &Path) -> PathBuf {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().path()).min().unwrap()
}

#[test]
fn damage_anywhere_is_read_or_refused() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for (layout, _, _) in RECORDINGS {
        let folder = written(layout);
        let files = files_in(folder.path());
        for _ in 0..30 {
            let path = &files[random.random_range(0..files.len())];
            let whole = std::fs::read(path).unwrap();
            let mut bytes = whole.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..bytes.len());
                // Headers are where damage counts.
                let at = if random.random_bool(0.5) {
                    at % 200.min(bytes.len())
                } else {
                    at
                };
                bytes[at] = random.next_u32() as u8;
            }
            std::fs::write(path, bytes).unwrap();
            let _ = error_of(folder.path());
            std::fs::write(path, whole).unwrap();
        }
    }
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files.extend(files_in(&path)),
            false => files.push(path),
        }
    }
    files.sort();
    files
}

#[test]
fn depth_that_is_turned_against_the_images_is_refused() {
    let folder = written(RecordingLayout::Record3d);
    let path = folder.path().join("recording.r3d");
    let [width, height] = [SIZE.0, SIZE.1];
    change(&path, "metadata", |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        let dw = text.replace(&format!("\"dw\":{width}"), &format!("\"dw\":{height}"));
        let turned = dw.replace(&format!("\"dh\":{height}"), &format!("\"dh\":{width}"));
        assert_ne!(turned, text);
        Some(turned.into_bytes())
    });
    assert_named(folder.path(), &["0.depth", "48 x 64", "exchanged"]);
}

#[test]
fn a_folder_in_an_archive_is_named() {
    let folder = written(RecordingLayout::Record3d);
    let path = folder.path().join("recording.r3d");
    let mut archive = ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
    let packed = folder.path().join("packed.r3d");
    let mut writer = ZipWriter::new(std::fs::File::create(&packed).unwrap());
    for at in 0..archive.len() {
        let mut member = archive.by_index(at).unwrap();
        let name = format!("scan/{}", member.name().unwrap());
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes).unwrap();
        writer
            .start_file(name, SimpleFileOptions::default())
            .unwrap();
        writer.write_all(&bytes).unwrap();
    }
    writer.finish().unwrap();
    assert_named(&packed, &["packed.r3d", "scan/", "unpack"]);
}

#[test]
fn pictures_that_count_from_one_are_those_of_the_frames_from_zero() {
    let folder = written(RecordingLayout::StrayScanner);
    let right = open(folder.path()).unwrap();
    let count = right.frames().len();
    for at in (0..count).rev() {
        let [from, to] = [format!("rgb/{at:06}.png"), format!("rgb/{:05}.png", at + 1)]
            .map(|name| folder.path().join(name));
        std::fs::rename(from, to).unwrap();
    }
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), count);
    for (found, right) in sequence.frames().iter().zip(right.frames()) {
        assert_eq!(found.world_from_camera, right.world_from_camera);
        assert_eq!((&found.depth, &found.name), (&right.depth, &right.name));
    }
    assert!(sequence.frames()[0].color.ends_with("00001.png"));
    let said = crate::warnings(&sequence);
    assert!(
        said.contains("count from 1") && !said.contains("no depth"),
        "{said}"
    );
}

#[test]
fn images_without_a_corrected_camera_are_counted() {
    let folder = written(RecordingLayout::Polycam);
    let keyframes = folder.path().join("keyframes");
    for name in ["cameras", "images"] {
        let corrected = keyframes.join(format!("corrected_{name}"));
        std::fs::create_dir(&corrected).unwrap();
        let mut files = files_in(&keyframes.join(name));
        files.sort();
        for path in &files[..2] {
            std::fs::copy(path, corrected.join(path.file_name().unwrap())).unwrap();
        }
    }
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 2);
    let said = crate::warnings(&sequence);
    assert!(
        said.contains("2 of 3 images have a corrected camera"),
        "{said}"
    );
}
