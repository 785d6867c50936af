//! Videos that are whole, damaged and cut off.

use std::path::Path;

use super::*;

fn images_in(folder: &Path) -> usize {
    std::fs::read_dir(folder.join(IMAGES)).map_or(0, Iterator::count)
}

/// Two uncompressed pictures.
fn y4m() -> Vec<u8> {
    let mut bytes = b"YUV4MPEG2 W16 H16 F10:1 Cmono\n".to_vec();
    for grey in [40, 200] {
        bytes.extend(b"FRAME\n");
        bytes.extend([grey; 256]);
    }
    bytes
}

#[test]
fn uncompressed_video_becomes_images_with_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("video.y4m");
    std::fs::write(&path, y4m()).unwrap();
    assert!(is_video(&path));
    let warnings = unpack(&path, folder.path(), &ProgressHook::default()).unwrap();
    assert!(warnings.is_empty());
    assert_eq!(images_in(folder.path()), 2);
    let times = std::fs::read_to_string(folder.path().join("times.txt")).unwrap();
    assert_eq!(times, "# seconds\n0.000000000\n0.100000000\n");
    // A video that is cut off has the pictures before.
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = y4m();
    bytes.truncate(bytes.len() - 100);
    std::fs::write(&path, bytes).unwrap();
    let warnings = unpack(&path, folder.path(), &ProgressHook::default()).unwrap();
    assert!(warnings[0].contains("picture 1 is cut off"), "{warnings:?}");
    assert_eq!(images_in(folder.path()), 1);
}

#[test]
fn what_is_no_video_is_not_taken_for_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.txt");
    std::fs::write(&path, "nothing to see, but more than twelve bytes").unwrap();
    assert!(!is_video(&path) && !is_video(folder.path()));
}

fn number(value: u32) -> [u8; 4] {
    value.to_be_bytes()
}

/// A box of an MP4 file.
fn boxed(name: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let inside = parts.concat();
    [&number(inside.len() as u32 + 8)[..], name, &inside].concat()
}

/// Rows of a display matrix that turns pictures to the right.
const TURNED: [i32; 5] = [0, 0x1_0000, 0, -0x1_0000, 0];

/// An MP4 file with an index of three samples in two chunks, and a codec.
fn mp4(codec: &[u8; 4]) -> Vec<u8> {
    mp4_shown(codec, TURNED)
}

/// The same with the first numbers of a display matrix.
fn mp4_shown(codec: &[u8; 4], matrix: [i32; 5]) -> Vec<u8> {
    let table = |rows: &[u32]| {
        rows.iter()
            .flat_map(|row| number(*row))
            .collect::<Vec<u8>>()
    };
    let entry = boxed(
        codec,
        &[&[0; 78], &boxed(b"avcC", &[&[1, 66, 0, 30, 255, 224, 0]])],
    );
    let stbl = boxed(
        b"stbl",
        &[
            &boxed(b"stsd", &[&table(&[0, 1]), &entry]),
            &boxed(b"stts", &[&table(&[0, 1, 3, 100])]),
            &boxed(b"ctts", &[&table(&[0, 3, 1, 100, 1, 300, 1, 100])]),
            &boxed(b"stsc", &[&table(&[0, 2, 1, 2, 1, 2, 1, 1])]),
            &boxed(b"stsz", &[&table(&[0, 0, 3, 10, 20, 30])]),
            &boxed(b"stco", &[&table(&[0, 2, 1000, 2000])]),
        ],
    );
    let mut head = vec![0; 84];
    head[40..60].copy_from_slice(&table(&matrix.map(|number| number as u32)));
    let mdhd = boxed(b"mdhd", &[&table(&[0, 0, 0, 1000, 300, 0])]);
    let hdlr = boxed(b"hdlr", &[&table(&[0, 0]), b"vide", &[0; 13]]);
    let minf = boxed(b"minf", &[&stbl]);
    let mdia = boxed(b"mdia", &[&mdhd, &hdlr, &minf]);
    let trak = boxed(b"trak", &[&boxed(b"tkhd", &[&head]), &mdia]);
    [boxed(b"ftyp", &[b"isom"]), boxed(b"moov", &[&trak])].concat()
}

fn track_of(bytes: &[u8]) -> Result<mp4::VideoTrack, VideoError> {
    mp4::read_track(Path::new("video.mp4"), &mut Cursor::new(bytes))
}

#[test]
fn the_index_says_where_samples_lie_and_when_they_are_shown() {
    let track = track_of(&mp4(b"avc1")).unwrap();
    let samples: Vec<(u64, u32, i64)> = track
        .samples
        .iter()
        .map(|one| (one.offset, one.size, one.time_ns / 1_000_000))
        .collect();
    assert_eq!(samples, [(1000, 10, 0), (1010, 20, 300), (2000, 30, 200)]);
    assert_eq!(track.quarter_turns, 1);
    let error = track_of(&mp4(b"av01")).unwrap_err().to_string();
    assert!(
        error.contains("av01") && error.contains("ffmpeg"),
        "{error}"
    );
}

#[test]
fn pictures_that_are_shown_mirrored_or_aslant_are_refused_with_the_way_in() {
    const ONE: i32 = 0x1_0000;
    for (matrix, turns) in [
        ([ONE, 0, 0, 0, ONE], 0),
        ([0; 5], 0),
        (TURNED, 1),
        ([-ONE, 0, 0, 0, -ONE], 2),
        ([0, -ONE, 0, ONE, 0], 3),
    ] {
        let track = track_of(&mp4_shown(b"avc1", matrix)).unwrap();
        assert_eq!(track.quarter_turns, turns, "{matrix:?}");
    }
    for (matrix, words) in [
        ([-ONE, 0, 0, 0, ONE], "mirror image"),
        ([ONE, 0, 0, 0, -ONE], "mirror image"),
        ([0, ONE, 0, ONE, 0], "mirror image"),
        ([46_341, 46_341, 0, -46_341, 46_341], "no quarter turn"),
        ([0, ONE, 0, 0, 0], "no quarter turn"),
    ] {
        let error = track_of(&mp4_shown(b"avc1", matrix)).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(words) && error.contains("ffmpeg") && error.contains("video.mp4, byte"),
            "{matrix:?}: {error}"
        );
    }
}

#[test]
fn damaged_indices_are_refused_or_read() {
    let whole = mp4(b"avc1");
    for cut in 0..whole.len() {
        let error = track_of(&whole[..cut]).unwrap_err().to_string();
        assert!(error.contains("video.mp4, byte"), "{error}");
    }
    for at in 0..whole.len() {
        for bit in 0..8 {
            let mut damaged = whole.clone();
            damaged[at] ^= 1 << bit;
            if let Err(error) = track_of(&damaged) {
                assert!(error.to_string().contains("video.mp4, byte"), "{error}");
            }
        }
    }
}

/// A parameter set of H.264 that announces pictures of so many blocks of 16 pixels along either side.
fn parameter_set(blocks: u32) -> Vec<u8> {
    let unsigned = |value: u32| {
        let digits = format!("{:b}", value + 1);
        "0".repeat(digits.len() - 1) + &digits
    };
    let side = unsigned(blocks - 1);
    // Number, counters of frames and their order, reference frames, gaps, size, whole frames, no cropping, no display properties.
    let mut bits = [
        "1", "1", "011", "1", "0", &side, &side, "1", "1", "0", "0", "1",
    ]
    .concat();
    bits.push_str(&"0".repeat(bits.len().next_multiple_of(8) - bits.len()));
    let bytes = (0..bits.len() / 8).map(|at| u8::from_str_radix(&bits[8 * at..8 * at + 8], 2));
    [0x67, 66, 0, 51]
        .into_iter()
        .chain(bytes.map(Result::unwrap))
        .collect()
}

#[test]
fn pictures_of_implausible_size_are_refused() {
    let error = |blocks: u32| {
        let set = parameter_set(blocks);
        let head = [1, 66, 0, 51, 255, 225, 0, set.len() as u8];
        let track = mp4::VideoTrack {
            configuration: mp4::Configuration::H264([&head[..], &set, &[0]].concat()),
            samples: vec![mp4::Sample {
                offset: 0,
                size: 4,
                time_ns: 0,
            }],
            size: [64, 48],
            quarter_turns: 0,
            is_full_range: false,
            damage: None,
        };
        let mut file = Cursor::new(vec![0; 4]);
        let read = samples::read(Path::new("video.mp4"), &mut file, &track, &mut |_| Ok(()));
        read.unwrap_err().to_string()
    };
    assert!(
        error(2000).contains("32000 x 32000 is implausible"),
        "{}",
        error(2000)
    );
    assert!(
        error(20).contains("none of the 1 pictures"),
        "{}",
        error(20)
    );
}

/// The recorded video of the data, cut after some pictures by its index.
fn recorded() -> Vec<u8> {
    let root = std::env::var("LINECARVE_DATA").unwrap();
    std::fs::read(Path::new(&root).join("video/desk.mp4")).unwrap()
}

fn decoded(bytes: &[u8], most: usize) -> Result<(usize, Vec<String>), VideoError> {
    let mut file = Cursor::new(bytes);
    let path = Path::new("video.mp4");
    let mut track = mp4::read_track(path, &mut file)?;
    track.samples.truncate(most);
    let mut count = 0;
    let mut last = -1;
    let warnings = samples::read(path, &mut file, &track, &mut |picture| {
        assert!(picture.time_ns > last || count == 0);
        last = picture.time_ns;
        count += 1;
        Ok(())
    })?;
    Ok((count, warnings))
}

/// Videos of the pattern; of those with fragments the first has all pictures in them, and places relative to them.
const VIDEOS: [&str; 7] = [
    "h264.mp4",
    "h265.mp4",
    "h265-10-bit.mov",
    "h264-fragments.mp4",
    "h265-fragments.mov",
    "h264-full-range.mp4",
    "h265-full-range.mp4",
];

/// A video of the pattern that `tests/videos/README.md` describes.
fn pattern(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/videos");
    std::fs::read(folder.join(name)).unwrap()
}

/// Luma and chroma of a picture of the pattern.
fn expected(number: usize) -> [Vec<u8>; 3] {
    let n = number as f64;
    let plane = |width: usize, height: usize, value: &dyn Fn(f64, f64) -> f64| {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x as f64, y as f64)));
        places.map(|(x, y)| value(x, y).round() as u8).collect()
    };
    [
        plane(96, 64, &|x, y| {
            128.0 + 60.0 * ((x + 5.0 * n) / 9.0).sin() + 40.0 * ((y - 3.0 * n) / 7.0).cos()
        }),
        plane(48, 32, &|x, _| 128.0 + 40.0 * (x / 10.0 + n / 5.0).sin()),
        plane(48, 32, &|_, y| 128.0 + 40.0 * (y / 8.0).cos()),
    ]
}

#[test]
fn pictures_come_out_in_order_and_as_they_were_encoded() {
    for name in VIDEOS {
        let mut file = Cursor::new(pattern(name));
        let path = Path::new(name);
        let track = mp4::read_track(path, &mut file).unwrap();
        let mut number = 0;
        let warnings = samples::read(path, &mut file, &track, &mut |picture| {
            assert_eq!(picture.time_ns, number as i64 * 100_000_000, "{name}");
            assert_eq!((picture.width, picture.height), (96, 64));
            assert_eq!(picture.is_full_range, name.contains("full-range"), "{name}");
            let [u, v] = picture.chroma;
            for (found, expected) in [picture.luma, u, v].iter().zip(expected(number)) {
                assert_eq!(found.len(), expected.len());
                let square = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
                let sum: f64 = found.iter().zip(&expected).map(square).sum();
                let rms = (sum / found.len() as f64).sqrt();
                assert!(rms < 3.0, "{name}, picture {number}: {rms}");
            }
            number += 1;
            Ok(())
        })
        .unwrap();
        assert_eq!((number, warnings.len()), (20, 0), "{name} {warnings:?}");
    }
}

#[test]
fn damaged_videos_are_decoded_in_part_or_refused() {
    for name in VIDEOS {
        decode_damaged(&pattern(name), usize::MAX, 100);
    }
}

#[test]
fn a_recording_that_was_interrupted_has_the_pictures_before() {
    let whole = pattern("h264-fragments.mp4");
    let starts = whole.windows(4).enumerate();
    let starts = starts.filter(|(_, name)| *name == b"moof");
    let starts: Vec<usize> = starts.map(|(at, _)| at - 4).collect();
    assert_eq!(starts.len(), 3);
    // In an index, in its head, and in pictures.
    for (cut, count) in [(starts[1] + 40, 8), (starts[2] + 11, 16)] {
        let (found, warnings) = decoded(&whole[..cut], usize::MAX).unwrap();
        assert_eq!((found, warnings.len()), (count, 1), "{warnings:?}");
        let place = format!(
            "video.mp4, byte {}",
            if count == 8 { starts[1] } else { starts[2] }
        );
        assert!(
            warnings[0].contains(&place) && warnings[0].contains("left out"),
            "{warnings:?}"
        );
    }
    let (found, warnings) = decoded(&whole[..starts[2] - 1000], usize::MAX).unwrap();
    assert!((8..16).contains(&found), "{found}");
    assert!(warnings[0].contains("cut off"), "{warnings:?}");
    // A recording without a fragment.
    let error = decoded(&whole[..starts[0]], usize::MAX).unwrap_err();
    assert!(error.to_string().contains("no pictures"), "{error}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn a_recorded_video_is_decoded_whole_cut_and_damaged() {
    let whole = recorded();
    let (count, warnings) = decoded(&whole, usize::MAX).unwrap();
    assert_eq!((count, warnings.len()), (1400, 0));
    let (cut, warnings) = decoded(&whole[..whole.len() / 3], usize::MAX).unwrap();
    assert!(
        cut > 300 && cut < 1000 && warnings[0].contains("cut off"),
        "{cut} {warnings:?}"
    );
    decode_damaged(&whole, 30, 80);
}

/// Decodes as many copies of a video with damaged bytes in the first quarter or anywhere.
fn decode_damaged(whole: &[u8], most: usize, copies: usize) {
    use rand::{RngExt, SeedableRng};
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    for copy in 0..copies {
        let mut damaged = whole.to_vec();
        let end = damaged.len() / (1 + 3 * (copy % 2));
        for _ in 0..random.random_range(1..200) {
            let at = random.random_range(0..end);
            damaged[at] ^= 1 << random.random_range(0..8);
        }
        match decoded(&damaged, most) {
            Ok((count, _)) => assert!(count > 0),
            Err(error) => assert!(error.to_string().contains("video.mp4"), "{error}"),
        }
    }
}
