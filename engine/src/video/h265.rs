//! Pictures of H.265 samples.

use rust_h265::{
    DecodeLimits, Decoder, Frame, NalUnit, NalUnitType, PixelData, parse_hvcc, parse_nal,
};

use super::codec::{Codec, Decoded, MAX_PIXELS};
use super::picture::Picture;

/// A unit that says that the next picture begins, by which the decoder knows that the one before has ended.
const DELIMITER: [u8; 3] = [35 << 1, 1, 0x50];

/// A decoder of samples as they lie in a file.
pub(super) struct Samples {
    decoder: Decoder,
    length_size: u8,
    group: u32,
}

impl Samples {
    /// From the contents of the `hvcC` box.
    ///
    /// # Reference
    /// ISO/IEC 14496-15, section 8.3.3.1.2.
    pub(super) fn new(configuration: &[u8]) -> Result<Self, String> {
        let ends_early = || "the configuration of H.265 ends too early".to_owned();
        let (head, mut arrays) = configuration.split_at_checked(23).ok_or_else(ends_early)?;
        let limits = DecodeLimits {
            max_picture_pixels: MAX_PIXELS,
            ..DecodeLimits::default()
        };
        let mut decoder = Decoder::with_limits(limits);
        let mut next = |count: usize| {
            let (part, rest) = arrays.split_at_checked(count).ok_or_else(ends_early)?;
            arrays = rest;
            Ok::<&[u8], String>(part)
        };
        let number = |bytes: &[u8]| usize::from(bytes[0]) << 8 | usize::from(bytes[1]);
        for _ in 0..head[22] {
            let units = number(&next(3)?[1..]);
            for _ in 0..units {
                let length = number(next(2)?);
                if let Some(unit) = parse_nal(next(length)?) {
                    decode(&mut decoder, &unit)?;
                }
            }
        }
        Ok(Self {
            decoder,
            length_size: (head[21] & 3) + 1,
            group: 0,
        })
    }
}

impl Codec for Samples {
    fn decode(
        &mut self,
        sample: &[u8],
        time_ns: i64,
        decoded: &mut Vec<Decoded>,
    ) -> Result<(), String> {
        let mut units = parse_hvcc(sample, self.length_size);
        units.extend(parse_nal(&DELIMITER));
        let (mut ended, mut failure) = (None, None);
        for unit in &units {
            match decode(&mut self.decoder, unit) {
                Ok(frame) => ended = frame.or(ended),
                Err(problem) => failure = failure.or(Some(problem)),
            }
        }
        // The counters of pictures begin anew.
        let begins_group = |kind| {
            use NalUnitType::{BlaNLp, BlaWLp, BlaWRadl, IdrNLp, IdrWRadl};
            matches!(kind, IdrWRadl | IdrNLp | BlaWLp | BlaWRadl | BlaNLp)
        };
        let begins_group = units.iter().any(|unit| begins_group(unit.nal_unit_type));
        self.group += u32::from(begins_group);
        match failure {
            // What was not decoded is grey.
            Some(problem) => Err(problem),
            None => {
                decoded.extend(ended.map(|frame| Decoded {
                    group: self.group,
                    count: frame.pic_order_cnt,
                    picture: picture_of(frame, time_ns),
                }));
                Ok(())
            }
        }
    }

    fn finish(&mut self) -> Option<Decoded> {
        None
    }
}

fn decode(decoder: &mut Decoder, unit: &NalUnit<'_>) -> Result<Option<Frame>, String> {
    decoder.decode_nal(unit).map_err(|error| error.to_string())
}

fn picture_of(frame: Frame, time_ns: i64) -> Option<Picture> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let chroma_step = match frame.chroma_format_idc {
        1 => [2, 2],
        2 => [2, 1],
        _ => [1, 1],
    };
    let shift = u32::from(frame.bit_depth).checked_sub(8)?;
    let plane = |samples: PixelData| match samples {
        PixelData::U8(samples) => samples,
        PixelData::U16(samples) => samples.iter().map(|it| (it >> shift) as u8).collect(),
    };
    let luma = plane(frame.y);
    (width > 0 && height > 0 && luma.len() >= width * height).then(|| Picture {
        time_ns,
        width,
        height,
        luma,
        chroma: [plane(frame.u), plane(frame.v)],
        chroma_step,
        is_full_range: false,
    })
}
