//! The chunks of a binary glTF file (GLB).

use std::borrow::Cow;

use gltf::binary::Glb;

/// Length of the file header and of the header of the first chunk.
const MIN_LENGTH: usize = 12 + 8;

/// The JSON document and the binary chunk, if any.
type Chunks<'a> = (Cow<'a, [u8]>, Option<Cow<'a, [u8]>>);

/// The chunks of a file. One without the GLB signature is a JSON document.
pub(super) fn split(bytes: &[u8]) -> Result<Chunks<'_>, String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.into(), None));
    }
    // The crate subtracts its header from the stated length unseen.
    let stated = bytes.get(8..).and_then(|rest| rest.first_chunk());
    let stated = stated.ok_or("a header of the binary file is cut short")?;
    let stated = u32::from_le_bytes(*stated) as usize;
    if stated < MIN_LENGTH {
        return Err(format!(
            "its header states a length of {stated} bytes; a binary file has at least {MIN_LENGTH}"
        ));
    }
    if stated > bytes.len() {
        return Err(format!(
            "it has {} of its {stated} bytes: the file is cut short",
            bytes.len()
        ));
    }
    let chunks = Glb::from_slice(bytes)
        .map_err(|error| format!("{error}: the file is cut short or damaged"))?;
    Ok((chunks.json, chunks.bin))
}
