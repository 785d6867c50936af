//! The chunks of a binary glTF file (GLB).

/// Length of the file header and of the header of the first chunk.
const MIN_LENGTH: usize = 12 + 8;

/// The JSON document and the binary chunk, if any. A file without the GLB signature is a JSON document.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let Some(header) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes, None));
    };
    let (version, rest) = number(header)?;
    let (stated, rest) = number(rest)?;
    if stated < MIN_LENGTH {
        return Err(format!(
            "its header states a length of {stated} bytes; a binary file has at least {MIN_LENGTH}"
        ));
    }
    if version != 2 {
        return Err(format!("version {version} of binary glTF is not supported"));
    }
    if stated > bytes.len() {
        return Err(format!(
            "it has {} of its {stated} bytes: the file is cut short",
            bytes.len()
        ));
    }
    let (json, rest) = chunk(rest, *b"JSON")?;
    if rest.is_empty() {
        return Ok((json, None));
    }
    let (binary, _) = chunk(rest, *b"BIN\0")?;
    Ok((json, Some(binary)))
}

/// Content of the chunk at the start of `bytes`, which must be of the given kind, and what follows.
fn chunk(bytes: &[u8], expected: [u8; 4]) -> Result<(&[u8], &[u8]), String> {
    let name = String::from_utf8_lossy(&expected)
        .trim_end_matches(char::from(0))
        .to_owned();
    let (length, rest) = number(bytes)?;
    let rest = rest
        .strip_prefix(&expected)
        .ok_or_else(|| format!("a chunk is not of the expected kind {name}"))?;
    rest.split_at_checked(length)
        .ok_or_else(|| format!("the chunk {name} has {} of its {length} bytes", rest.len()))
}

/// A little-endian 32-bit number, and what follows.
fn number(bytes: &[u8]) -> Result<(usize, &[u8]), String> {
    let (number, rest) = bytes
        .split_first_chunk()
        .ok_or("a header of the binary file is cut short")?;
    Ok((u32::from_le_bytes(*number) as usize, rest))
}
