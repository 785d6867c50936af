//! Pictures of H.264 samples.

use rust_h264::decoder::{ChromaFormat, Decoder, Frame};
use rust_h264::nal::{NalUnit, NalUnitType, parse_avcc, parse_avcc_config, parse_sps_info};

use super::codec::{Codec, Decoded, MAX_PIXELS};
use super::picture::Picture;

/// A decoder of samples as they lie in a file.
pub(super) struct Samples {
    decoder: Decoder,
    length_size: usize,
    group: u32,
    /// As the newest parameters say.
    is_full_range: bool,
    /// Group and time of the picture that is being decoded: the decoder returns it with the next.
    current: Option<(u32, i64)>,
}

impl Samples {
    /// From the contents of the `avcC` box.
    pub(super) fn new(configuration: &[u8]) -> Result<Self, String> {
        let configuration = parse_avcc_config(configuration).map_err(str::to_owned)?;
        let mut samples = Self {
            decoder: Decoder::new(),
            length_size: configuration.length_size,
            group: 0,
            is_full_range: false,
            current: None,
        };
        for nal in configuration.sps_nals.iter().chain(&configuration.pps_nals) {
            samples.decode_unit(nal)?;
        }
        Ok(samples)
    }

    fn take(&mut self, frame: Frame) -> Option<Decoded> {
        let (group, time_ns) = self.current.take()?;
        Some(Decoded {
            group,
            count: frame.pic_order_cnt,
            picture: picture_of(frame, time_ns, self.is_full_range),
        })
    }

    /// Decodes a unit, unless it announces a picture of implausible size.
    fn decode_unit(&mut self, nal: &NalUnit<'_>) -> Result<Option<Frame>, String> {
        if nal.nal_unit_type == NalUnitType::Sps {
            let announced = parse_sps_info(nal).map_err(|error| error.to_string())?;
            let (width, height) = (announced.coded_width, announced.coded_height);
            if u64::from(width) * u64::from(height) > MAX_PIXELS {
                return Err(format!("its size of {width} x {height} is implausible"));
            }
            self.is_full_range = announced.full_range;
        }
        self.decoder
            .decode_nal(nal)
            .map_err(|error| error.to_string())
    }
}

impl Codec for Samples {
    fn decode(
        &mut self,
        sample: &[u8],
        time_ns: i64,
        decoded: &mut Vec<Decoded>,
    ) -> Result<(), String> {
        for nal in parse_avcc(sample, self.length_size) {
            if let Some(frame) = self.decode_unit(&nal)? {
                decoded.extend(self.take(frame));
            }
            // The counters of pictures begin anew.
            let begins_group = nal.nal_unit_type == NalUnitType::SliceIdr && self.current.is_none();
            self.group += u32::from(begins_group);
            if matches!(
                nal.nal_unit_type,
                NalUnitType::Slice | NalUnitType::SliceIdr
            ) {
                self.current = Some((self.group, time_ns));
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Option<Decoded> {
        let frame = self.decoder.flush()?;
        self.take(frame)
    }
}

fn picture_of(frame: Frame, time_ns: i64, is_full_range: bool) -> Option<Picture> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let down = match frame.chroma_format {
        ChromaFormat::Yuv420 => 2,
        ChromaFormat::Yuv422 => 1,
    };
    let shift = u32::from(frame.bit_depth).checked_sub(8)?;
    let plane = |bytes: Vec<u8>| match shift {
        0 => bytes,
        _ => bytes
            .chunks_exact(2)
            .map(|pair| (u16::from_le_bytes([pair[0], pair[1]]) >> shift) as u8)
            .collect(),
    };
    let luma = plane(frame.y);
    (width > 0 && height > 0 && luma.len() >= width * height).then(|| Picture {
        time_ns,
        width,
        height,
        luma,
        chroma: [plane(frame.u), plane(frame.v)],
        chroma_step: [2, down],
        is_full_range,
    })
}
