//! Images, floating-point depth in a file format of choice, a trajectory, and `linecarve.toml`.

use std::io::Cursor;

use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};

use super::RecordingError;
use super::source::{Source, intrinsics, joined, seconds};
use crate::load::DepthImage;
use crate::sidecar::SIDECAR_FILE;

/// File formats of depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DepthFormat {
    Exr,
    Pfm,
}

pub(super) fn write(source: &Source<'_>, format: DepthFormat) -> Result<(), RecordingError> {
    source.make_folder("images")?;
    source.make_folder("depth")?;
    let (mut trajectory, mut times) = (String::new(), String::new());
    for index in 0..source.count() {
        source.write_picture(index, &format!("images/{index:06}"))?;
        let depth = source.depth(index)?;
        let (bytes, extension) = match format {
            DepthFormat::Exr => {
                let bytes = exr_image(&depth).map_err(|error| source.encode_error(index, error))?;
                (bytes, "exr")
            }
            DepthFormat::Pfm => (float_map(&depth), "pfm"),
        };
        source.write(&format!("depth/{index:06}.{extension}"), &bytes)?;
        let pose = source.pose(index);
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let time = seconds(source.time_ns(index));
        times += &format!("{time}\n");
        trajectory += &format!("{time} {}\n", joined(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]));
    }
    source.write("poses.txt", trajectory.as_bytes())?;
    source.write("times.txt", times.as_bytes())?;
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let mut sidecar = format!("[color]\nfx = {fx:?}\nfy = {fy:?}\ncx = {cx:?}\ncy = {cy:?}\n");
    if source.depth_size() != source.size() {
        sidecar += "\n[depth]\nview = \"color\"\n";
    }
    source.write(SIDECAR_FILE, sidecar.as_bytes())
}

/// A float map, little-endian, rows from the bottom up.
pub(super) fn float_map(depth: &DepthImage) -> Vec<u8> {
    let mut bytes = format!("Pf\n{} {}\n-1.0\n", depth.width(), depth.height()).into_bytes();
    for row in (0..depth.height()).rev() {
        bytes.extend(depth.row(row).iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// An OpenEXR file with the one channel `Z`, without loss.
fn exr_image(depth: &DepthImage) -> Result<Vec<u8>, String> {
    let channels = SpecificChannels::build()
        .with_channel::<f32>("Z")
        .with_pixel_fn(|Vec2(x, y)| (depth.get(x, y).copied().unwrap_or(0.0),));
    let image = Image::from_channels((depth.width(), depth.height()), channels);
    let mut bytes = Cursor::new(Vec::new());
    image
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|error| error.to_string())?;
    Ok(bytes.into_inner())
}
