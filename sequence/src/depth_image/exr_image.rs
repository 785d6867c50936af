//! OpenEXR files with depth in one channel.

use std::io::Cursor;

use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers};

use super::{ImageSize, size};

/// Begins every file.
pub(super) const MAGIC: &[u8] = &[0x76, 0x2F, 0x31, 0x01];

/// Names of the channel with depth, in order of preference. Programs that write depth as colour repeat it in three channels.
const CHANNELS: [&str; 6] = ["Z", "depth.Z", "depth", "Y", "R", "V"];

/// Size of the first layer, from the header.
pub(super) fn size_of(bytes: &[u8]) -> Result<ImageSize, String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|error| error.to_string())?;
    MetaData::validate(&meta.headers, false).map_err(|error| error.to_string())?;
    let header = meta.headers.first().ok_or("a file without layers")?;
    size(header.layer_size.0 as u64, header.layer_size.1 as u64)
}

/// The values of the first layer. Memory follows the size in the header, which the caller checks.
pub(super) fn samples(bytes: &[u8]) -> Result<Vec<f32>, String> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| error.to_string())?;
    let channels = &image.layer_data.channel_data.list;
    let named = CHANNELS.iter().find_map(|name| {
        let mut all = channels.iter();
        all.find(|channel| channel.name.to_string() == *name)
    });
    let only = match &channels[..] {
        [channel] => Some(channel),
        _ => None,
    };
    let Some(channel) = only.or(named) else {
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        return Err(format!(
            "the channels {}, and none of {}: write depth as the only channel",
            names.join(", "),
            CHANNELS.join(", ")
        ));
    };
    Ok(channel.sample_data.values_as_f32().collect())
}
