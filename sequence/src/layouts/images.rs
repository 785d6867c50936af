//! Image folders: lists images with times or numbers, without poses. Shared by layouts with a separate trajectory file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::super::calibration::ImageSize;
use super::super::container::Containers;
use super::super::depth_image::depth_header;
use super::super::image_file::image_size;
use super::super::layout::{Folder, RecordedFrame, Recording, image_stem};
use super::super::model::compare_names;
use super::super::text::{TextFile, parse_stamp, parse_stamp_ns, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, associate, poses};
use super::tum;

/// Folders of colour images, in order of preference.
pub(super) const COLOR_FOLDERS: [&str; 11] = [
    "rgb",
    "color",
    "image",
    "images",
    "colour",
    "cam0/data",
    "mav0/cam0/data",
    "image_0",
    "image_2",
    "left",
    "data",
];

/// Folders of depth images.
const DEPTH_FOLDERS: [&str; 3] = ["depth", "depths", "depth_images"];

/// Lists of pairs of colour and depth images.
const ASSOCIATIONS: [&str; 4] = [
    "associations.txt",
    "associate.txt",
    "association.txt",
    "associated.txt",
];

/// Lists of image times.
const TIMES: [&str; 3] = ["times.txt", "timestamps.txt", "timestamp.txt"];

/// Images of a folder, ordered by time or number.
pub(super) struct Listing {
    pub(super) frames: Vec<RecordedFrame>,
    /// Whether time stamps are times rather than image numbers.
    pub(super) has_time: bool,
    /// Source of the times, for the conventions.
    pub(super) source: String,
}

/// The folder of colour images, if any.
pub(in super::super) fn color_folder(folder: &Folder) -> Option<PathBuf> {
    COLOR_FOLDERS
        .iter()
        .map(|name| folder.path().join(name))
        .find(|path| path.is_dir())
        .or_else(|| has_images(folder).then(|| folder.path().to_owned()))
        .or_else(|| only_folder_with_images(folder))
}

fn has_images(folder: &Folder) -> bool {
    folder.names().iter().any(|name| image_stem(name).is_some())
}

/// Part of the names of depth images and their folders.
const DEPTH: &str = "depth";

/// Parts of the names of images, and of their folders, that are not of the colour camera.
const NOT_COLOR: [&str; 9] = [
    DEPTH, "conf", "mask", "normal", "semantic", "label", "instance", "sigma", "segment",
];

/// The sub-folder of any name that has images, if there is exactly one beside folders of depth, confidence, masks and the like.
fn only_folder_with_images(folder: &Folder) -> Option<PathBuf> {
    only_folder(folder, is_of_color)
}

/// Whether a name is none of depth, confidence, masks and the like.
fn is_of_color(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    !NOT_COLOR.iter().any(|part| name.contains(part))
}

/// The sub-folder with images and a name that is wanted, if there is exactly one.
fn only_folder(folder: &Folder, is_wanted: impl Fn(&str) -> bool) -> Option<PathBuf> {
    let mut found = folder
        .names()
        .iter()
        .filter(|name| is_wanted(name))
        .map(|name| folder.path().join(name))
        .filter(|path| path.is_dir())
        .filter(|path| Folder::list(path).is_ok_and(|inside| has_images(&inside)));
    let first = found.next()?;
    found.next().is_none().then_some(first)
}

/// Lists the images of a folder from an association list, from `rgb.txt`, or from the files of its image folder.
pub(super) fn list(folder: &Folder, warnings: &mut Vec<Warning>) -> Result<Listing, SequenceError> {
    if let Some(path) = folder.first_entry(&ASSOCIATIONS) {
        let frames = read_associations(&path, folder, warnings)?;
        return Ok(Listing {
            frames,
            has_time: true,
            source: path.display().to_string(),
        });
    }
    if folder.entry(tum::IMAGES).is_some() {
        return Ok(Listing {
            frames: tum::list_frames(folder, warnings)?,
            has_time: true,
            source: tum::IMAGES.to_owned(),
        });
    }
    let path = color_folder(folder).ok_or_else(|| SequenceError::Content {
        path: folder.path().to_owned(),
        problem: format!(
            "has no images: put them into this folder or into one of {}",
            COLOR_FOLDERS.join("/, ")
        ),
    })?;
    from_files(folder, &path, warnings)
}

/// Reads lines `time color time depth`, or depth first.
fn read_associations(
    path: &Path,
    folder: &Folder,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut rows = Vec::new();
    let (mut missing, mut total) = (WarningCounter::default(), 0);
    for row in file.rows() {
        total += 1;
        let fields: Vec<&str> = row.fields().collect();
        let [first_time, first, second_time, second] = fields[..] else {
            return Err(row.error(format!(
                "expected 'time image time image', found {} fields",
                fields.len()
            )));
        };
        let is_depth_first = first.contains("depth") && !second.contains("depth");
        let (time, color, depth) = if is_depth_first {
            (second_time, second, first)
        } else {
            (first_time, first, second)
        };
        let timestamp_ns = parse_stamp_ns(time)
            .ok_or_else(|| row.error(format!("'{}' is not a time stamp", shorten(time))))?;
        let (color, depth) = (folder.path().join(color), folder.path().join(depth));
        if !color.is_file() {
            missing.add(shorten(&color.display().to_string()));
            continue;
        }
        rows.push((
            timestamp_ns,
            RecordedFrame {
                name: time.to_owned(),
                timestamp_ns,
                pose: None,
                color,
                depth: Some(depth).filter(|path| path.is_file()),
                right: None,
                camera: None,
            },
        ));
    }
    warnings.extend(missing.into_warning(
        total,
        "images in the association list do not exist and were skipped",
    ));
    let rows = poses::sort_and_dedup(rows, "associations", warnings);
    Ok(rows.into_iter().map(|(_, frame)| frame).collect())
}

/// An image file and its name without extension.
struct NamedImage {
    stem: String,
    path: PathBuf,
}

fn images_in(path: &Path) -> Result<Vec<NamedImage>, SequenceError> {
    let folder = Folder::list(path)?;
    let mut images: Vec<NamedImage> = folder
        .names()
        .iter()
        .filter_map(|name| {
            Some(NamedImage {
                stem: image_stem(name)?.to_owned(),
                path: path.join(name),
            })
        })
        .collect();
    images.sort_by(|a, b| compare_names(&a.stem, &b.stem));
    images.dedup_by(|later, earlier| later.stem == earlier.stem);
    Ok(images)
}

/// The images of a folder in the order of their names: name without extension, and path.
pub(super) fn files_in(path: &Path) -> Result<Vec<(String, PathBuf)>, SequenceError> {
    let images = images_in(path)?;
    Ok(images
        .into_iter()
        .map(|image| (image.stem, image.path))
        .collect())
}

/// The number of an image: at the end of its name, else the last in it (`NNNNN-color`), or before the time in `NNNNNNN-TIME`, as in
/// Redwood's scans.
pub(super) fn number_of(stem: &str) -> Option<u64> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    if let Some((number, time)) = stem.split_once('-')
        && is_number(number)
        && is_number(time)
    {
        return number.parse().ok();
    }
    let end = stem.trim_end_matches(|c: char| !c.is_ascii_digit());
    let start = end.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    end[start..].parse().ok()
}

/// Size of the first image whose header can be read.
pub(super) fn first_size<'a>(mut images: impl Iterator<Item = &'a PathBuf>) -> Option<ImageSize> {
    images.find_map(|path| image_size(path).ok())
}

/// The time in nanoseconds that a name encodes as decimal seconds or nanoseconds.
fn stamp_of(stem: &str) -> Option<i64> {
    let stamp = parse_stamp(stem)?;
    let is_time = stamp.is_nanoseconds || (stem.contains('.') && stem.len() > 6);
    is_time.then(|| stamp.as_written_ns()).flatten()
}

/// The folder of depth images: one of a usual name, else the only folder with images and "depth" in its name.
fn depth_folder(folder: &Folder) -> Option<PathBuf> {
    let usual = DEPTH_FOLDERS
        .iter()
        .map(|name| folder.path().join(name))
        .find(|path| path.is_dir());
    usual.or_else(|| only_folder(folder, is_of_depth))
}

/// Gives the frames of a model, which have no depth, that of a folder of depth images beside their images.
pub(super) fn add_depth_beside(
    folder: &Folder,
    recording: &mut Recording,
) -> Result<(), SequenceError> {
    let has_depth = recording.frames.iter().any(|frame| frame.depth.is_some());
    let Some(path) = depth_folder(folder).filter(|_| !has_depth) else {
        return Ok(());
    };
    let depths = images_in(&path)?;
    let containers = Containers::default();
    let is_depth = |image: &NamedImage| depth_header(&containers, &image.path, None).is_ok();
    if !depths.first().is_some_and(is_depth) {
        return Ok(());
    }
    let named = |frame: &RecordedFrame| NamedImage {
        stem: frame
            .color
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        path: frame.color.clone(),
    };
    let images: Vec<NamedImage> = recording.frames.iter().map(named).collect();
    let mut without = WarningCounter::default();
    for (frame, depth) in recording
        .frames
        .iter_mut()
        .zip(depths_of(&images, &[], &depths, false))
    {
        if depth.is_none() {
            without.add(frame.name.clone());
        }
        frame.depth = depth;
    }
    if without.count() == recording.frames.len() {
        return Ok(());
    }
    recording.calibration.depth_has_color_view = true;
    recording.conventions.push(format!(
        "depth: {}, of the images with the same names or numbers",
        path.display()
    ));
    let warning = without.into_warning(recording.frames.len(), "images have no depth image");
    recording.warnings.extend(warning);
    Ok(())
}

/// Whether a name is that of depth, and of nothing that comes with it, such as its confidence.
fn is_of_depth(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let mut parts = NOT_COLOR.iter().filter(|part| name.contains(**part));
    parts.next() == Some(&DEPTH) && parts.next().is_none() && !name.contains("sparse")
}

/// Colour and depth images of one folder, by their names (`00001-color`, `00001-depth`). Images of which all or none are named so are of
/// colour.
fn color_and_depth(
    images: Vec<NamedImage>,
    warnings: &mut Vec<Warning>,
) -> (Vec<NamedImage>, Vec<NamedImage>) {
    let total = images.len();
    let (others, color): (Vec<_>, Vec<_>) = images
        .into_iter()
        .partition(|image| !is_of_color(&image.stem));
    if color.is_empty() {
        return (others, Vec::new());
    }
    let (depth, left_out): (Vec<_>, Vec<_>) = others
        .into_iter()
        .partition(|image| is_of_depth(&image.stem));
    let mut counter = WarningCounter::default();
    for image in left_out {
        counter.add(image.stem);
    }
    warnings.extend(counter.into_warning(
        total,
        "images have names of confidence, masks and the like and were skipped",
    ));
    (color, depth)
}

/// Lists the images of the folder `path` of a sequence, with times and depth images found beside it.
pub(super) fn from_files(
    folder: &Folder,
    path: &Path,
    warnings: &mut Vec<Warning>,
) -> Result<Listing, SequenceError> {
    let (images, depths_beside) = color_and_depth(images_in(path)?, warnings);
    let depths = match depth_folder(folder) {
        Some(path) => images_in(&path)?,
        None => depths_beside,
    };
    let times = folder.first_entry(&TIMES);
    let by_list = match &times {
        Some(path) => Some(read_times(path, &images)?),
        None => None,
    };
    let by_name = || {
        images
            .iter()
            .map(|image| stamp_of(&image.stem))
            .collect::<Option<Vec<_>>>()
    };
    let (stamps, source) = match (by_list, by_name()) {
        (Some(stamps), _) => (Some(stamps), "a list of times"),
        (None, Some(stamps)) => (Some(stamps), "the names of the images"),
        (None, None) => (None, "none, time stamps are image numbers"),
    };
    let has_time = stamps.is_some();
    let stamps = stamps.unwrap_or_else(|| {
        let numbers: Option<Vec<i64>> = images
            .iter()
            .map(|image| number_of(&image.stem).and_then(|number| i64::try_from(number).ok()))
            .collect();
        let are_distinct = |numbers: &Vec<i64>| {
            let mut sorted = numbers.clone();
            sorted.sort_unstable();
            sorted.windows(2).all(|pair| pair[0] != pair[1])
        };
        numbers
            .filter(are_distinct)
            .unwrap_or_else(|| (0..images.len() as i64).collect())
    });
    let depth_of = depths_of(&images, &stamps, &depths, has_time);
    let mut without_depth = WarningCounter::default();
    let mut frames: Vec<RecordedFrame> = images
        .into_iter()
        .zip(stamps)
        .zip(depth_of)
        .map(|((image, timestamp_ns), depth)| {
            if depth.is_none() {
                without_depth.add(image.stem.clone());
            }
            RecordedFrame {
                name: image.stem,
                timestamp_ns,
                pose: None,
                color: image.path,
                depth,
                right: None,
                camera: None,
            }
        })
        .collect();
    frames.sort_by_key(|frame| frame.timestamp_ns);
    if !depths.is_empty() {
        warnings.extend(without_depth.into_warning(frames.len(), "frames have no depth image"));
    }
    Ok(Listing {
        frames,
        has_time,
        source: source.to_owned(),
    })
}

/// Reads one time a line (its first field), in the order of the images.
fn read_times(path: &Path, images: &[NamedImage]) -> Result<Vec<i64>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut stamps = Vec::new();
    for row in file.rows() {
        let field = row.fields().next().unwrap_or_default();
        stamps.push(
            parse_stamp_ns(field)
                .ok_or_else(|| row.error(format!("'{}' is not a time stamp", shorten(field))))?,
        );
    }
    if stamps.len() != images.len() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "has {} times for {} images: give one for each image, in the same order",
                stamps.len(),
                images.len()
            ),
        });
    }
    Ok(stamps)
}

/// All numbers in a name.
fn numbers_of(stem: &str) -> Vec<u64> {
    stem.split(|c: char| !c.is_ascii_digit())
        .filter_map(|digits| digits.parse().ok())
        .collect()
}

/// The depth image with the key of each colour image; none at all if the key does not tell images apart.
fn joined_by<K: Ord>(
    images: &[NamedImage],
    depths: &[NamedImage],
    key: impl Fn(&str) -> Option<K>,
) -> Vec<Option<PathBuf>> {
    let keys = |named: &[NamedImage]| -> Option<BTreeMap<K, usize>> {
        let mut all = BTreeMap::new();
        let keyed = named
            .iter()
            .enumerate()
            .filter_map(|(at, image)| Some((key(&image.stem)?, at)));
        for (key, at) in keyed {
            if all.insert(key, at).is_some() {
                return None;
            }
        }
        Some(all)
    };
    let (Some(_), Some(of_depths)) = (keys(images), keys(depths)) else {
        return vec![None; images.len()];
    };
    images
        .iter()
        .map(|image| {
            let at = of_depths.get(&key(&image.stem)?)?;
            Some(depths[*at].path.clone())
        })
        .collect()
}

/// The depth image of each colour image: by name, by number, or nearest in time.
fn depths_of(
    images: &[NamedImage],
    stamps: &[i64],
    depths: &[NamedImage],
    has_time: bool,
) -> Vec<Option<PathBuf>> {
    let mut by_name = joined_by(images, depths, |stem| Some(stem.to_owned()));
    if !has_time && by_name.iter().any(Option::is_none) {
        let by_number = joined_by(images, depths, number_of);
        let by_numbers = || joined_by(images, depths, |stem| Some(numbers_of(stem)));
        let others = match by_number.iter().any(Option::is_some) {
            true => by_number,
            false => by_numbers(),
        };
        for (found, other) in by_name.iter_mut().zip(others) {
            *found = found.take().or(other);
        }
    }
    if by_name.iter().any(Option::is_some) || !has_time {
        return by_name;
    }
    let mut timed: Vec<(i64, &PathBuf)> = depths
        .iter()
        .filter_map(|depth| Some((stamp_of(&depth.stem)?, &depth.path)))
        .collect();
    timed.sort();
    timed.dedup_by_key(|row| row.0);
    let mut order: Vec<usize> = (0..stamps.len()).collect();
    order.sort_by_key(|&at| stamps[at]);
    order.dedup_by_key(|&mut at| stamps[at]);
    let left: Vec<i64> = order.iter().map(|&at| stamps[at]).collect();
    let right: Vec<i64> = timed.iter().map(|row| row.0).collect();
    let partners = associate::nearest_unique(&left, &right, tum::MAX_DIFFERENCE_NS);
    let mut found = vec![None; images.len()];
    for (&at, partner) in order.iter().zip(partners) {
        found[at] = partner.map(|partner| timed[partner].1.clone());
    }
    found
}
