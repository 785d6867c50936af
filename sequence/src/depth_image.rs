//! Decoding of depth images: 16-bit integers in any image format; floating-point values in TIFF, NPY, OpenEXR and PFM files, depth maps of
//! COLMAP, and arrays packed with LZFSE.

mod colmap_map;
mod exr_image;
mod lzfse_array;
mod pfm;

use std::io::Cursor;
use std::path::Path;

use half::f16;
use image::DynamicImage;
use tiff::decoder::{Decoder, DecodingResult};

use super::FrameError;
use super::calibration::ImageSize;
use super::container::Containers;
use super::image_file::{decode_bytes, describe_format, read, size, size_of, undecodable};
use super::npy::{self, NpyHeader, NpyType};

/// Values of a depth image as stored, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum RawDepth {
    /// 0 and 65535 are unknown.
    Integer(Vec<u16>),
    /// 0, negative, infinite and NaN are unknown.
    Float(Vec<f32>),
}

/// How a depth file is stored; its first bytes decide, not its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Container {
    Npy,
    Tiff,
    Exr,
    Pfm,
    ColmapMap,
    /// Has no size of its own.
    Lzfse,
    Other,
}

/// Size of a depth image, and whether it has floating-point values, from the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DepthHeader {
    pub(super) size: ImageSize,
    pub(super) is_float: bool,
}

impl Container {
    fn of(bytes: &[u8]) -> Self {
        if bytes.starts_with(npy::MAGIC) {
            Self::Npy
        } else if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") {
            Self::Tiff
        } else if bytes.starts_with(exr_image::MAGIC) {
            Self::Exr
        } else if pfm::is_one(bytes) {
            Self::Pfm
        } else if lzfse_array::is_one(bytes) {
            Self::Lzfse
        } else if colmap_map::is_one(bytes) {
            Self::ColmapMap
        } else {
            Self::Other
        }
    }
}

/// Reads the header of a depth image; `raw_size` is the size of images that have none.
pub(super) fn depth_header(
    containers: &Containers,
    path: &Path,
    raw_size: Option<ImageSize>,
) -> Result<DepthHeader, FrameError> {
    let bytes = read(containers, path)?;
    header_of(&bytes, raw_size).map_err(|reason| undecodable(path, reason))
}

fn header_of(bytes: &[u8], raw_size: Option<ImageSize>) -> Result<DepthHeader, String> {
    let (size, is_float) = match Container::of(bytes) {
        Container::Exr => (exr_image::size_of(bytes)?, true),
        Container::Pfm => (pfm::Header::read(bytes)?.size, true),
        Container::ColmapMap => (colmap_map::Header::read(bytes)?.size, true),
        Container::Lzfse => (raw_size.ok_or(lzfse_array::NO_SIZE)?, true),
        Container::Npy => {
            let header = NpyHeader::read(bytes)?;
            (npy_size(&header)?, header.npy_type() != Some(NpyType::U16))
        }
        Container::Tiff => {
            let (mut decoder, size) = open_tiff(bytes)?;
            let color = decoder.colortype().map_err(|error| error.to_string())?;
            (size, matches!(color, tiff::ColorType::Gray(32 | 64)))
        }
        Container::Other => (size_of(bytes)?, false),
    };
    Ok(DepthHeader { size, is_float })
}

/// Unpacks at most so many bytes of LZFSE; `None` for other files.
pub(super) fn unpack_bytes(bytes: &[u8], most: usize) -> Option<Result<Vec<u8>, String>> {
    lzfse_array::is_one(bytes).then(|| lzfse_array::unpack(bytes, most))
}

/// Number of values of a depth image packed with LZFSE, whose size is not known.
pub(super) fn packed_values(path: &Path) -> Result<usize, FrameError> {
    /// More than any sensor has.
    const MOST: usize = 1 << 26;
    let bytes = read(&Containers::default(), path)?;
    let bytes = lzfse_array::unpack(&bytes, MOST).map_err(|reason| undecodable(path, reason))?;
    Ok(bytes.len() / 4)
}

/// Decodes a depth image. The size is checked before memory is allocated, since corrupt headers can claim any size.
pub(super) fn decode_depth(
    containers: &Containers,
    path: &Path,
    raw_size: Option<ImageSize>,
    check: impl FnOnce(ImageSize) -> Result<(), FrameError>,
) -> Result<(ImageSize, RawDepth), FrameError> {
    let bytes = read(containers, path)?;
    let header = header_of(&bytes, raw_size).map_err(|reason| undecodable(path, reason))?;
    check(header.size)?;
    let raw = match Container::of(&bytes) {
        Container::Npy => npy_samples(&bytes),
        Container::Tiff => tiff_samples(&bytes),
        Container::Exr => floats(exr_image::samples(&bytes)),
        Container::Pfm => floats(pfm::samples(&bytes)),
        Container::ColmapMap => floats(colmap_map::samples(&bytes)),
        Container::Lzfse => floats(lzfse_array::samples(&bytes, header.size)),
        Container::Other => image_samples(&bytes),
    };
    let raw = raw.map_err(|problem| match problem {
        Problem::Damaged(reason) => undecodable(path, reason),
        Problem::Format(found) => FrameError::DepthFormat {
            path: path.to_owned(),
            found,
        },
    })?;
    let count = match &raw {
        RawDepth::Integer(samples) => samples.len(),
        RawDepth::Float(samples) => samples.len(),
    };
    let expected = u64::from(header.size.width) * u64::from(header.size.height);
    if count as u64 != expected {
        let reason = format!("it has {count} values in place of {expected}");
        return Err(undecodable(path, reason));
    }
    Ok((header.size, raw))
}

/// Why a file with a readable header is no depth image.
enum Problem {
    Damaged(String),
    /// The format that was found.
    Format(String),
}

impl Problem {
    fn damaged(error: impl std::fmt::Display) -> Self {
        Self::Damaged(error.to_string())
    }
}

fn floats(samples: Result<Vec<f32>, String>) -> Result<RawDepth, Problem> {
    samples.map(RawDepth::Float).map_err(Problem::Damaged)
}

fn image_samples(bytes: &[u8]) -> Result<RawDepth, Problem> {
    match decode_bytes(bytes).map_err(Problem::Damaged)? {
        DynamicImage::ImageLuma16(raw) => Ok(RawDepth::Integer(raw.into_raw())),
        other => Err(Problem::Format(describe_format(&other))),
    }
}

type TiffDecoder<'a> = Decoder<Cursor<&'a [u8]>>;

fn open_tiff(bytes: &[u8]) -> Result<(TiffDecoder<'_>, ImageSize), String> {
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions().map_err(|error| error.to_string())?;
    Ok((decoder, size(u64::from(width), u64::from(height))?))
}

fn tiff_samples(bytes: &[u8]) -> Result<RawDepth, Problem> {
    let (mut decoder, _) = open_tiff(bytes).map_err(Problem::Damaged)?;
    let color = decoder.colortype().map_err(Problem::damaged)?;
    let tiff::ColorType::Gray(_) = color else {
        return Err(Problem::Format(format!("the TIFF format {color:?}")));
    };
    match decoder.read_image().map_err(Problem::damaged)? {
        DecodingResult::U16(samples) => Ok(RawDepth::Integer(samples)),
        DecodingResult::F32(samples) => Ok(RawDepth::Float(samples)),
        DecodingResult::F64(samples) => Ok(RawDepth::Float(narrowed(&samples))),
        _ => Err(Problem::Format(format!("integers as {color:?}"))),
    }
}

fn narrowed(samples: &[f64]) -> Vec<f32> {
    samples.iter().map(|&value| value as f32).collect()
}

fn npy_samples(bytes: &[u8]) -> Result<RawDepth, Problem> {
    let header = NpyHeader::read(bytes).map_err(Problem::Damaged)?;
    if header.is_fortran {
        let found = "columns one after the other (numpy.ascontiguousarray gives rows)";
        return Err(Problem::Format(found.to_owned()));
    }
    Ok(match header.npy_type() {
        Some(NpyType::F32) => RawDepth::Float(header.values(bytes, f32::from_le_bytes)),
        Some(NpyType::F64) => {
            let narrowed = |bytes| f64::from_le_bytes(bytes) as f32;
            RawDepth::Float(header.values(bytes, narrowed))
        }
        Some(NpyType::F16) => {
            let widened = |bytes| f16::from_le_bytes(bytes).to_f32();
            RawDepth::Float(header.values(bytes, widened))
        }
        Some(NpyType::U16) => RawDepth::Integer(header.values(bytes, u16::from_le_bytes)),
        Some(NpyType::U8) | None => {
            let found = format!("values of type {}", header.descr);
            return Err(Problem::Format(found));
        }
    })
}

/// Size of an array of rows; a first or last axis of length 1, as of a batch or of channels, is none.
pub(super) fn npy_size(header: &NpyHeader) -> Result<ImageSize, String> {
    match header.shape[..] {
        [height, width] | [1, height, width] | [height, width, 1] | [1, height, width, 1] => {
            size(width, height)
        }
        ref other => Err(format!(
            "an array of shape {other:?}, not of rows and columns"
        )),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tiff::encoder::{TiffEncoder, colortype};

    use super::*;

    const SIZE: ImageSize = ImageSize {
        width: 5,
        height: 3,
    };

    fn values() -> Vec<f32> {
        (0..15).map(|i| 0.25 * i as f32 - 0.5).collect()
    }

    fn tiff_of(values: &[f32]) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        TiffEncoder::new(&mut bytes)
            .unwrap()
            .write_image::<colortype::Gray32Float>(SIZE.width, SIZE.height, values)
            .unwrap();
        bytes.into_inner()
    }

    fn npy_of(descr: &str, shape: &str, is_fortran: bool, data: &[u8]) -> Vec<u8> {
        let order = if is_fortran { "True" } else { "False" };
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let length = (header.len() as u16).to_le_bytes();
        [npy::MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    fn npy_of_floats(shape: &str, is_fortran: bool) -> Vec<u8> {
        let data: Vec<u8> = values()
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        npy_of("<f4", shape, is_fortran, &data)
    }

    fn decode(bytes: &[u8]) -> Result<(ImageSize, RawDepth), FrameError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.any");
        std::fs::write(&path, bytes).unwrap();
        decode_depth(&Containers::default(), &path, None, |_| Ok(()))
    }

    #[test]
    fn floating_point_depth_is_read_exactly() {
        let wide = values().into_iter().map(f64::from);
        let wide: Vec<u8> = wide.flat_map(f64::to_le_bytes).collect();
        for bytes in [
            tiff_of(&values()),
            npy_of_floats("(3, 5)", false),
            npy_of("<f8", "(3, 5)", false, &wide),
        ] {
            assert_eq!(decode(&bytes).unwrap(), (SIZE, RawDepth::Float(values())));
            let header = DepthHeader {
                size: SIZE,
                is_float: true,
            };
            assert_eq!(header_of(&bytes, None), Ok(header));
        }
        let integers: Vec<u16> = (0..15).map(|i| 4000 + i).collect();
        let data: Vec<u8> = integers
            .iter()
            .flat_map(|value| value.to_be_bytes())
            .collect();
        let bytes = npy_of(">u2", "(3, 5)", false, &data);
        assert_eq!(decode(&bytes).unwrap(), (SIZE, RawDepth::Integer(integers)));
        assert!(!header_of(&bytes, None).unwrap().is_float);
    }

    #[test]
    fn what_is_no_depth_image_is_refused_with_a_reason() {
        for (bytes, reason) in [
            (npy_of_floats("(15,)", false), "rows and columns"),
            (npy_of_floats("(3, 5)", true), "ascontiguousarray"),
            (npy_of("<i4", "(3, 5)", false, &[0; 60]), "i4"),
            (npy_of("<f4", "(0, 5)", false, &[]), "5 x 0"),
        ] {
            let error = decode(&bytes).unwrap_err().to_string();
            assert!(
                error.contains(reason) && error.contains("depth.any"),
                "{error}"
            );
        }
        // A header that claims more than memory holds.
        let mut bytes = npy_of_floats("(3, 5)", false);
        let at = bytes
            .windows(4)
            .position(|window| window == b"3, 5")
            .unwrap();
        for claim in [b"9,99", b"9, 5", b"3,5e", b"0, 5"] {
            bytes[at..at + 4].copy_from_slice(claim);
            assert!(decode(&bytes).is_err());
        }
    }

    #[test]
    fn truncated_files_are_refused() {
        for bytes in [tiff_of(&values()), npy_of_floats("(3, 5)", false)] {
            assert!(decode(&bytes).is_ok());
            let cuts = [0, 1, 5, 7, 9, 40, bytes.len() / 2, bytes.len() - 1];
            for cut in cuts {
                let Err(error) = decode(&bytes[..cut]) else {
                    panic!("cut to {cut} of {}", bytes.len());
                };
                assert!(error.to_string().contains("depth.any"), "{error}");
            }
        }
    }

    proptest! {
        #[test]
        fn damaged_files_are_decoded_or_refused(
            is_npy in any::<bool>(),
            flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        ) {
            let mut bytes = match is_npy {
                true => npy_of_floats("(3, 5)", false),
                false => tiff_of(&values()),
            };
            for (at, value) in flips {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            // As a sequence does, which knows the size of its images.
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("depth.any");
            std::fs::write(&path, &bytes).unwrap();
            let check = |size: ImageSize| match size == SIZE {
                true => Ok(()),
                false => Err(undecodable(&path, "another size".to_owned())),
            };
            if let Ok((size, _)) = decode_depth(&Containers::default(), &path, None, check) {
                prop_assert_eq!(size, SIZE);
            }
        }
    }
}
