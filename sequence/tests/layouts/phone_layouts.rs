//! Recordings of phones and results of models: written, and read again.
//!
//! All files are written by this project, after descriptions; none is of a real app.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use image::{DynamicImage, imageops};
use linecarve_lines::depth::DepthCorrection;
use linecarve_sequence::ClassNoise;
use linecarve_sequence::export::{
    Disturbance, RecordingLayout, WrongDepth, write_disturbed_recording, write_recording,
};
use linecarve_sequence::{OpenOptions, Sequence, check_images};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use crate::folder_writers::intrinsics_text;
use crate::support::{FOCAL, SIZE, write_tum};
use crate::{folder_with, open, replace, warnings};

const FRAMES: usize = 4;

/// A layout, its name, and how much its depth may be off.
pub(crate) const RECORDINGS: [(RecordingLayout, &str, f32); 11] = [
    (RecordingLayout::StrayScanner, "stray-scanner", 0.0006),
    (RecordingLayout::Record3d, "record3d", 0.0),
    (RecordingLayout::Polycam, "polycam", 0.0006),
    (RecordingLayout::Scannet, "scannet", 0.0006),
    (RecordingLayout::ArkitScenes, "arkit-scenes", 0.0006),
    (RecordingLayout::Replica, "replica", 0.0),
    (RecordingLayout::DepthAnything3, "depth-anything-3", 0.0),
    (RecordingLayout::ColmapDense, "colmap", 0.0),
    (RecordingLayout::MvsNet, "mvsnet", 0.0),
    (RecordingLayout::Exr, "images-and-poses", 0.0),
    (RecordingLayout::Pfm, "images-and-poses", 0.0),
];

fn written(layout: RecordingLayout) -> tempfile::TempDir {
    let source = folder_with(|folder| write_tum(folder, FRAMES));
    let sequence = open(source.path()).unwrap();
    folder_with(|folder| write_recording(folder, &sequence, layout).unwrap())
}

fn error_of(folder: &Path) -> String {
    let sequence = match open(folder) {
        Err(error) => return error,
        Ok(sequence) => sequence,
    };
    let loaded = (0..sequence.frames().len()).find_map(|at| sequence.load_depth(at).err());
    loaded.expect("an error").to_string()
}

#[test]
fn each_layout_restores_what_was_written() {
    let source = folder_with(|folder| write_tum(folder, FRAMES));
    let source = open(source.path()).unwrap();
    for (layout, name, tolerance) in RECORDINGS {
        let folder = folder_with(|folder| write_recording(folder, &source, layout).unwrap());
        let read = open(folder.path()).unwrap_or_else(|error| panic!("{layout:?}: {error}"));
        assert_eq!(read.layout(), name);
        assert_eq!(read.frames().len(), FRAMES, "{layout:?}");
        assert!((read.color_camera().cx() - source.color_camera().cx()).abs() < 1e-12);
        assert_eq!(read.color_camera().fx(), source.color_camera().fx());
        assert!(read.depth_calibration().unwrap().registered, "{layout:?}");
        for at in 0..FRAMES {
            let [ours, theirs] = [&read, &source].map(|one| one.frames()[at].world_from_camera);
            let off = ours.inverse() * theirs;
            assert!(off.translation.vector.norm() < 1e-9, "{layout:?}");
            assert!(off.rotation.angle() < 1e-7, "{layout:?}");
            assert_eq!(read.load_color(at).unwrap(), source.load_color(at).unwrap());
            let [ours, theirs] = [&read, &source].map(|one| one.load_depth(at).unwrap().unwrap());
            for (ours, theirs) in ours.samples().iter().zip(theirs.samples()) {
                assert!(
                    (ours - theirs).abs() <= tolerance,
                    "{layout:?}: {ours} {theirs}"
                );
            }
        }
        assert_eq!(
            check_images(&read).unwrap().contradiction,
            None,
            "{layout:?}"
        );
        let missed = read.unread_files().iter().any(|file| file.is_missed);
        assert!(!missed, "{layout:?}: {:?}", read.unread_files());
        let said = read.conventions().join("\n");
        assert!(said.contains("poses: "), "{layout:?}: {said}");
        let unread = warnings(&read).contains("not read");
        assert!(!unread, "{layout:?}: {}", warnings(&read));
    }
}

#[test]
fn the_same_recording_gives_the_same_bytes() {
    for layout in [RecordingLayout::Record3d, RecordingLayout::DepthAnything3] {
        let [a, b] = [written(layout), written(layout)].map(|folder| {
            let mut files = std::fs::read_dir(folder.path()).unwrap();
            std::fs::read(files.next().unwrap().unwrap().path()).unwrap()
        });
        assert!(a == b, "{layout:?}");
    }
}

#[test]
fn an_archive_is_opened_by_its_name() {
    for (layout, file) in [
        (RecordingLayout::Record3d, "recording.r3d"),
        (RecordingLayout::DepthAnything3, "results.npz"),
    ] {
        let folder = written(layout);
        let sequence = open(&folder.path().join(file)).unwrap();
        assert_eq!(sequence.frames().len(), FRAMES);
        assert_eq!(sequence.files(0), [folder.path().join(file)]);
    }
}

/// The same arrays as the demo of VGGT saves them.
fn as_vggt(results: &Path, predictions: &Path) {
    let mut archive = ZipArchive::new(File::open(results).unwrap()).unwrap();
    let mut writer = ZipWriter::new(File::create(predictions).unwrap());
    let (count, width, height) = (FRAMES, SIZE.0 as usize, SIZE.1 as usize);
    let mut add = |name: &str, shape: String, values: &[u8]| {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n");
        let length = (header.len() as u16).to_le_bytes();
        let options = SimpleFileOptions::default();
        writer.start_file(format!("{name}.npy"), options).unwrap();
        for part in [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), values] {
            writer.write_all(part).unwrap();
        }
    };
    let mut values = |name: &str| {
        let mut bytes = Vec::new();
        let mut member = archive.by_name(&format!("{name}.npy")).unwrap();
        member.read_to_end(&mut bytes).unwrap();
        bytes.split_off(10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]])))
    };
    let narrowed = |doubles: Vec<u8>| -> Vec<u8> {
        let value = |bytes: &[u8; 8]| (f64::from_le_bytes(*bytes) as f32).to_le_bytes();
        doubles.as_chunks::<8>().0.iter().flat_map(value).collect()
    };
    let depth = values("depth");
    let ones = 1.0_f32.to_le_bytes().repeat(depth.len() / 4);
    add("depth_conf", format!("{count}, {height}, {width}"), &ones);
    add("depth", format!("{count}, {height}, {width}, 1"), &depth);
    add(
        "extrinsic",
        format!("{count}, 3, 4"),
        &narrowed(values("extrinsics")),
    );
    add(
        "intrinsic",
        format!("{count}, 3, 3"),
        &narrowed(values("intrinsics")),
    );
    let pixels = values("image");
    let mut channels = Vec::new();
    for image in pixels.chunks_exact(3 * width * height) {
        for channel in 0..3 {
            let samples = image.iter().skip(channel).step_by(3);
            channels.extend(samples.flat_map(|byte| (f32::from(*byte) / 255.0).to_le_bytes()));
        }
    }
    add(
        "images",
        format!("{count}, 3, {height}, {width}"),
        &channels,
    );
    writer.finish().unwrap();
}

#[test]
fn predictions_of_vggt_are_read() {
    let results = written(RecordingLayout::DepthAnything3);
    let folder = folder_with(|folder| {
        as_vggt(
            &results.path().join("results.npz"),
            &folder.join("predictions.npz"),
        );
    });
    let [read, source] = [folder.path(), results.path()].map(|folder| open(folder).unwrap());
    let said = read.conventions().join("\n");
    assert!(
        said.contains("depth_conf.npy") && said.contains("extrinsic in"),
        "{said}"
    );
    for (at, (one, other)) in read.frames().iter().zip(source.frames()).enumerate() {
        let off = one.world_from_camera.inverse() * other.world_from_camera;
        assert!(off.translation.vector.norm() < 1e-5 && off.rotation.angle() < 1e-5);
        assert_eq!(read.load_depth(at).unwrap(), source.load_depth(at).unwrap());
        assert_eq!(read.load_gray(at).unwrap(), source.load_gray(at).unwrap());
    }
    assert_eq!(read.frames().len(), FRAMES);
}

/// Doubles the size of the images of a folder.
fn enlarge(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let image = image::open(&path).unwrap();
        let filter = imageops::FilterType::Nearest;
        image
            .resize_exact(2 * SIZE.0, 2 * SIZE.1, filter)
            .save(path)
            .unwrap();
    }
}

#[test]
fn depth_of_the_view_of_colour_has_a_size_of_its_own() {
    let stray = written(RecordingLayout::StrayScanner);
    enlarge(&stray.path().join("rgb"));
    std::fs::write(stray.path().join("camera_matrix.csv"), intrinsics_text(2.0)).unwrap();
    let loose = written(RecordingLayout::Pfm);
    enlarge(&loose.path().join("images"));
    assert!(error_of(loose.path()).contains("view = \"color\""));
    let sidecar = format!(
        "[color]\nfx = {f}\nfy = {f}\ncx = 63.5\ncy = 47.5\n[depth]\nview = \"color\"\n",
        f = 2.0 * FOCAL
    );
    std::fs::write(loose.path().join("linecarve.toml"), sidecar).unwrap();
    for folder in [stray, loose] {
        let sequence = open(folder.path()).unwrap();
        let depth = sequence.depth_calibration().unwrap();
        assert!(!depth.registered);
        assert_eq!(depth.camera.fx(), FOCAL);
        assert_eq!(depth.camera.cx(), 31.5);
        assert_eq!(sequence.color_camera().fx(), 2.0 * FOCAL);
        assert_eq!(check_images(&sequence).unwrap().contradiction, None);
        let said = sequence.conventions().join("\n");
        assert!(
            said.contains("view of colour at a size of its own"),
            "{said}"
        );
        // Written again, with depth of that size.
        for layout in [
            RecordingLayout::Record3d,
            RecordingLayout::DepthAnything3,
            RecordingLayout::MvsNet,
        ] {
            let folder = folder_with(|folder| write_recording(folder, &sequence, layout).unwrap());
            let again = open(folder.path()).unwrap();
            assert!(
                (again.color_camera().fx() - 2.0 * FOCAL).abs() < 1e-9,
                "{layout:?}"
            );
            assert_eq!(
                again.load_depth(1).unwrap(),
                sequence.load_depth(1).unwrap(),
                "{layout:?}"
            );
        }
    }
}

#[test]
fn intrinsics_of_each_frame_are_used_for_images_and_depth() {
    /// Pixels by which the second frame is moved to the right.
    const MOVED: u32 = 4;
    let folder = written(RecordingLayout::Polycam);
    let before = open(folder.path()).unwrap();
    let color = before.load_gray(1).unwrap();
    let depth = before.load_depth(1).unwrap().unwrap();
    let stem = &before.frames()[1].name;
    for part in ["images", "depth"] {
        let path = folder.path().join(format!("keyframes/{part}/{stem}.png"));
        let image = image::open(&path).unwrap();
        let mut moved = image.clone();
        imageops::replace(&mut moved, &image, i64::from(MOVED), 0);
        let moved = match image {
            DynamicImage::ImageLuma16(raw) => {
                DynamicImage::ImageLuma16(image::ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
                    *raw.get_pixel(x.saturating_sub(MOVED), y)
                }))
            }
            _ => moved,
        };
        moved.save(path).unwrap();
    }
    let camera = folder.path().join(format!("keyframes/cameras/{stem}.json"));
    replace(&camera, "\"cx\":31.5", "\"cx\":35.5");
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES);
    let said = sequence.conventions().join("\n");
    assert!(said.contains("3 cameras"), "{said}");
    let inside = (SIZE.0 - MOVED - 1) as usize;
    let again = sequence.load_gray(1).unwrap();
    let depth_again = sequence.load_depth(1).unwrap().unwrap();
    for row in 0..SIZE.1 as usize {
        assert_eq!(again.row(row)[..inside], color.row(row)[..inside]);
        assert_eq!(depth_again.row(row)[..inside], depth.row(row)[..inside]);
    }
}

/// Classes of confidence in which the first row of pixels has the lowest.
fn classes(lowest: u8, others: u8) -> Vec<u8> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let mut classes = vec![others; width * height];
    classes[..width].fill(lowest);
    classes
}

#[test]
fn depth_of_the_lowest_confidence_is_left_out() {
    for (layout, folder_name, others) in [
        (RecordingLayout::StrayScanner, "confidence", 1),
        (RecordingLayout::Polycam, "keyframes/confidence", 127),
        (RecordingLayout::ArkitScenes, "confidence", 2),
    ] {
        let folder = written(layout);
        let before = open(folder.path()).unwrap();
        let depth = before.frames()[1].depth.clone().unwrap();
        let path = folder
            .path()
            .join(folder_name)
            .join(depth.file_name().unwrap());
        std::fs::create_dir(path.parent().unwrap()).unwrap();
        let write = |width, height, classes| {
            let image = image::GrayImage::from_raw(width, height, classes).unwrap();
            image.save(&path).unwrap();
        };
        write(SIZE.0, SIZE.1, classes(0, others));
        let sequence = open(folder.path()).unwrap();
        let said = sequence.conventions().join("\n");
        assert!(
            said.contains("confidence: ") && said.contains("(else the lowest, 0)"),
            "{said}"
        );
        assert_eq!(
            sequence.load_depth(0).unwrap(),
            before.load_depth(0).unwrap()
        );
        assert!(sequence.files(1).contains(&path));
        let [with, without] = [&sequence, &before].map(|one| one.load_depth(1).unwrap().unwrap());
        assert!(with.row(0).iter().all(|depth| *depth == 0.0), "{layout:?}");
        assert_eq!(with.row(1), without.row(1), "{layout:?}");
        // What was measured decides.
        let mut sequence = sequence;
        let [best, worst] = [others, 0].map(|class| ClassNoise {
            class,
            excess: Some(if class == 0 { 0.25 } else { 0.0 }),
        });
        sequence.set_class_noise(&[best, worst]);
        assert_eq!(sequence.load_depth(1).unwrap().as_ref(), Some(&without));
        let excess_of = |sequence: &Sequence, frame| {
            let loaded = sequence.load_depth_with_excess(frame).unwrap();
            loaded.unwrap().excess
        };
        let excess = excess_of(&sequence, 1).unwrap();
        assert!(excess.row(0).iter().all(|excess| *excess == 0.25));
        assert!(excess.row(1).iter().all(|excess| *excess == 0.0));
        assert!(excess_of(&sequence, 0).is_none());
        let (all, classes) = sequence.load_depth_classes(1).unwrap().unwrap();
        assert_eq!((all, classes.unwrap().row(1)[0]), (without.clone(), others));
        let worst = ClassNoise {
            class: others,
            excess: None,
        };
        sequence.set_class_noise(&[worst]);
        let nothing = sequence.load_depth(1).unwrap().unwrap();
        assert!(nothing.samples().iter().all(|depth| *depth == 0.0));
        assert!(excess_of(&sequence, 1).is_none());
        write(2, 1, vec![0, 1]);
        let error = sequence.load_depth(1).unwrap_err().to_string();
        assert!(error.contains("2 x 1, and depth is 64 x 48"), "{error}");
    }
}

#[test]
fn confidence_without_classes_is_taken_in_ranks() {
    let undisturbed = written(RecordingLayout::Exr);
    let source = open(undisturbed.path()).unwrap();
    let disturbance = Disturbance {
        wrong: 0.3,
        wrong_depth: WrongDepth::Marked,
        ..Disturbance::default()
    };
    let folder = folder_with(|folder| {
        let layout = RecordingLayout::DepthAnything3;
        write_disturbed_recording(folder, &source, layout, &disturbance).unwrap();
    });
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.has_confidence());
    assert!(sequence.conventions().join("\n").contains("conf.npy"));
    // Nothing is left out before it is measured.
    let (depth, classes) = sequence.load_depth_classes(1).unwrap().unwrap();
    assert_eq!(sequence.load_depth(1).unwrap(), Some(depth.clone()));
    let classes = classes.unwrap();
    let truth = source.load_depth(1).unwrap().unwrap();
    let pixels = depth.samples().iter().zip(truth.samples());
    for ((depth, truth), class) in pixels.zip(classes.samples()) {
        assert_eq!(*class == 0, depth != truth);
    }
}

#[test]
fn corrected_depth_is_loaded_corrected() {
    let folder = written(RecordingLayout::Exr);
    let mut sequence = open(folder.path()).unwrap();
    let given = sequence.load_depth(1).unwrap().unwrap();
    let correction = DepthCorrection {
        scale: 1.1,
        inverse_shift: 0.0,
        shift: 0.05,
    };
    sequence.set_depth_corrections([(1, correction)]);
    let corrected = sequence.load_depth(1).unwrap().unwrap();
    for (given, corrected) in given.samples().iter().zip(corrected.samples()) {
        let expected = if *given > 0.0 {
            1.1 * given + 0.05
        } else {
            0.0
        };
        assert!((corrected - expected).abs() < 1e-5);
    }
    assert_eq!(sequence.depth_correction(0), DepthCorrection::IDENTITY);
    sequence.retain_frames(&[1]);
    assert_eq!(sequence.depth_correction(0), correction);
}

/// Pictures as a decoder writes them by default, and one more than frames: the recording ends while a picture is stored.
#[test]
fn pictures_of_stray_scanner_that_count_from_one_belong_to_the_frame_before() {
    let folder = written(RecordingLayout::StrayScanner);
    let right = open(folder.path()).unwrap();
    let colors: Vec<_> = (0..FRAMES)
        .map(|at| right.load_color(at).unwrap())
        .collect();
    let first = right.frames()[0].color.clone();
    let numbered = |number: usize| {
        let end = first.extension().unwrap().to_str().unwrap();
        first.with_file_name(format!("{number:06}.{end}"))
    };
    for number in (0..FRAMES).rev() {
        std::fs::rename(numbered(number), numbered(number + 1)).unwrap();
    }
    std::fs::copy(numbered(FRAMES), numbered(FRAMES + 1)).unwrap();
    std::fs::remove_file(numbered(3)).unwrap();
    let sequence = open(folder.path()).unwrap();
    let said = warnings(&sequence);
    assert!(said.contains("count from 1"), "{said}");
    let words = format!("1 of {FRAMES} frames of odometry.csv have no picture: 2");
    assert!(said.contains(&words), "{said}");
    let frames = (0..FRAMES).filter(|frame| *frame != 2);
    assert_eq!(sequence.frames().len(), FRAMES - 1);
    for (at, frame) in frames.enumerate() {
        assert_eq!(sequence.load_color(at).unwrap(), colors[frame]);
    }
}

#[test]
fn a_video_of_stray_scanner_is_named_until_its_pictures_are_given() {
    let folder = written(RecordingLayout::StrayScanner);
    let pictures = tempfile::tempdir().unwrap();
    let images = pictures.path().join("images");
    std::fs::rename(folder.path().join("rgb"), &images).unwrap();
    std::fs::write(folder.path().join("rgb.mp4"), "a video").unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("rgb.mp4") && error.contains("ffmpeg"),
        "{error}"
    );
    let mut options = OpenOptions::default();
    let video = linecarve_sequence::video_to_unpack(folder.path(), &options);
    assert_eq!(video, Some(folder.path().join("rgb.mp4")));
    options.video_images = Some(images);
    assert_eq!(
        linecarve_sequence::video_to_unpack(folder.path(), &options),
        None
    );
    let sequence = Sequence::open(folder.path(), &options).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES);
    assert!(sequence.has_time());
    assert!(sequence.depth_calibration().is_some());
}

#[test]
fn lines_of_the_odometry_may_be_missing_and_not_damaged() {
    let folder = written(RecordingLayout::StrayScanner);
    let path = folder.path().join("odometry.csv");
    let whole = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    let with =
        |changed: [&str; 2]| std::fs::write(&path, whole.replace(changed[0], changed[1])).unwrap();
    with([lines[2], ""]);
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES - 1);
    assert!(warnings(&sequence).contains("no pose in odometry.csv"));
    let first = lines[2].split(", ").nth(2).unwrap();
    with([&format!(", 000001, {first}"), ", 000001, NaN"]);
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES - 1);
    assert!(
        warnings(&sequence).contains("not finite"),
        "{}",
        warnings(&sequence)
    );
    with([lines[2], "1.1, 000001, 0, 0"]);
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("odometry.csv, line 3"), "{error}");
    // Newer recordings have intrinsics in each line.
    let longer: String = lines
        .iter()
        .enumerate()
        .map(|(at, line)| match at {
            0 => format!("{line}, fx, fy, cx, cy\n"),
            _ => format!("{line}, {FOCAL}, {FOCAL}, 31.5, 23.5\n"),
        })
        .collect();
    std::fs::write(&path, longer).unwrap();
    assert_eq!(open(folder.path()).unwrap().color_camera().fx(), FOCAL);
}
