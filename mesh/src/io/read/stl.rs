//! STL, ASCII and binary.

use std::collections::HashMap;
use std::io::Cursor;

use nalgebra::Point3;

use crate::shape::Shape;

/// Header length of a binary file, and length of a triangle.
const HEAD: usize = 84;
const TRIANGLE: usize = 50;

/// Parses a file. Corners with equal coordinates become one vertex, ordered by first use.
pub(super) fn parse(bytes: &[u8]) -> Result<Shape, String> {
    let mut welder = Welder::default();
    if bytes.is_empty() {
        return Ok(welder.shape);
    }
    if is_text(bytes) {
        for (start, solid) in solids(bytes) {
            // The parser needs a blank after the first word, which files without a name lack.
            let body = &solid[5.min(solid.len())..];
            let mut text = b"solid ".to_vec();
            text.extend_from_slice(body);
            welder
                .read(text)
                .map_err(|error| format!("solid from line {start}: {error}"))?;
        }
        return Ok(welder.shape);
    }
    if bytes.len() < HEAD {
        return Err(format!(
            "{} bytes are fewer than the {HEAD} of its header",
            bytes.len()
        ));
    }
    let count = u32::from_le_bytes([bytes[80], bytes[81], bytes[82], bytes[83]]) as usize;
    let present = (bytes.len() - HEAD) / TRIANGLE;
    if count > present {
        return Err(format!(
            "the header declares {count} triangles, but the file has room for {present}: it is cut short"
        ));
    }
    // The header of a binary file may begin with `solid`, which marks text. It has no meaning, so it is blanked.
    let mut binary = vec![0; 80];
    binary.extend_from_slice(&bytes[80..]);
    welder.read(binary).map_err(|error| error.to_string())?;
    Ok(welder.shape)
}

/// Whether a file is text: it begins with `solid`, and its length is not that of a binary file.
fn is_text(bytes: &[u8]) -> bool {
    if !bytes.starts_with(b"solid") {
        return false;
    }
    match bytes.get(80..HEAD) {
        Some(&[a, b, c, d]) => {
            let promised = u32::from_le_bytes([a, b, c, d]) as usize;
            bytes.len() != HEAD + promised.saturating_mul(TRIANGLE)
        }
        _ => true,
    }
}

/// The solids of a text file, each with its first line number.
fn solids(bytes: &[u8]) -> Vec<(usize, &[u8])> {
    let mut starts = Vec::new();
    let mut offset = 0;
    for (number, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        if line.starts_with(b"solid") {
            starts.push((number + 1, offset));
        }
        offset += line.len();
    }
    let ends: Vec<usize> = starts
        .iter()
        .skip(1)
        .map(|(_, start)| *start)
        .chain([bytes.len()])
        .collect();
    starts
        .into_iter()
        .zip(ends)
        .map(|((line, start), end)| (line, &bytes[start..end]))
        .collect()
}

/// Merges equal corners.
#[derive(Default)]
struct Welder {
    shape: Shape,
    /// Keyed by the bits of the coordinates. Never iterated: hash order cannot reach the output.
    known: HashMap<[u32; 3], u32>,
}

impl Welder {
    fn read(&mut self, bytes: Vec<u8>) -> std::io::Result<()> {
        let mut cursor = Cursor::new(bytes);
        for triangle in stl_io::create_stl_reader(&mut cursor)? {
            let corners = triangle?.vertices.map(|corner| self.vertex(corner.0));
            self.shape.triangles.push(corners);
        }
        Ok(())
    }

    fn vertex(&mut self, position: [f32; 3]) -> u32 {
        // Adding zero turns -0 into 0.
        let key = position.map(|value| (value + 0.0).to_bits());
        let next = self.shape.positions.len() as u32;
        let index = *self.known.entry(key).or_insert(next);
        if index == next {
            self.shape
                .positions
                .push(Point3::from(position.map(f64::from)));
        }
        index
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n \
                        endloop\nendfacet\nfacet normal 0 0 1\n outer loop\n  vertex 1 0 0\n  vertex 1 1 0\n  vertex 0 1 \
                        -0\n endloop\nendfacet\nendsolid\n";

    fn binary(head: &[u8], triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = head.to_vec();
        bytes.resize(80, b' ');
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in triangles {
            bytes.extend([0; 12]);
            bytes.extend(triangle.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn corners_are_joined_in_text_and_binary() {
        let shape = parse(TEXT.as_bytes()).unwrap();
        assert_eq!(shape.positions.len(), 4);
        assert_eq!(shape.triangles, [[0, 1, 2], [1, 3, 2]]);
        let given = [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, -0.0]],
        ];
        for head in [&b"made by hand"[..], b"solid lies"] {
            assert_eq!(parse(&binary(head, &given)).unwrap(), shape);
        }
    }

    #[test]
    fn several_solids_become_one_shape() {
        let twice = format!("{TEXT}{}", TEXT.replace("solid\nf", "solid named\nf"));
        let shape = parse(twice.as_bytes()).unwrap();
        assert_eq!((shape.positions.len(), shape.triangles.len()), (4, 4));
    }

    #[test]
    fn damage_is_told() {
        let whole = binary(b"", &[[[0.0; 3]; 3]]);
        assert!(parse(&whole[..100]).unwrap_err().contains("cut short"));
        assert!(parse(&whole[..40]).is_err());
        assert!(
            parse(&TEXT.as_bytes()[..90])
                .unwrap_err()
                .contains("line 1")
        );
        let broken = TEXT.replace("vertex 1 1 0", "vertex 1 NaN 0");
        assert!(parse(broken.as_bytes()).is_err());
        assert!(parse(b"").unwrap().positions.is_empty());
    }
}
