//! Samples that fragments (`moof`) list, behind the index: files whose recording may end at any time.

use super::part::Part;
use super::sample::{Sample, TimeScale};
use crate::video::VideoError;

/// Most samples of all fragments: three days at 60 pictures a second.
const MAX_SAMPLES: usize = 1 << 24;

/// What a sample has unless its fragment says otherwise.
#[derive(Debug, Clone, Copy, Default)]
struct Defaults {
    track: u32,
    duration: u32,
    size: u32,
}

/// Reads the fragments of a file one after another.
#[derive(Debug)]
pub(super) struct Fragments {
    track: u32,
    scale: TimeScale,
    defaults: Vec<Defaults>,
    /// When the next sample is decoded, unless its fragment says so.
    time: i64,
    /// Samples so far, those of other tracks included.
    count: usize,
}

impl Fragments {
    /// For a track whose samples in the index end at a time; `extends` is the box `mvex`.
    pub(super) fn new(
        extends: &Part<'_>,
        track: u32,
        scale: TimeScale,
        time: i64,
    ) -> Result<Self, VideoError> {
        let boxes = extends.boxes()?.into_iter();
        let defaults = boxes
            .filter(|(name, _)| name == b"trex")
            .map(|(_, part)| {
                Ok(Defaults {
                    track: part.u32(4)?,
                    duration: part.u32(12)?,
                    size: part.u32(16)?,
                })
            })
            .collect::<Result<_, VideoError>>()?;
        Ok(Self {
            track,
            scale,
            defaults,
            time,
            count: 0,
        })
    }

    /// Appends the samples of a fragment, the contents of a box `moof` that starts at a byte of the file.
    pub(super) fn read(
        &mut self,
        fragment: &Part<'_>,
        start: u64,
        samples: &mut Vec<Sample>,
    ) -> Result<(), VideoError> {
        // Where the data of the last track of this fragment ends.
        let mut data_end = start;
        for (_, part) in fragment
            .boxes()?
            .into_iter()
            .filter(|(name, _)| name == b"traf")
        {
            self.read_track(&part, start, &mut data_end, samples)?;
        }
        Ok(())
    }

    fn read_track(
        &mut self,
        part: &Part<'_>,
        start: u64,
        data_end: &mut u64,
        samples: &mut Vec<Sample>,
    ) -> Result<(), VideoError> {
        let head = part.need(b"tfhd")?;
        let track = head.u32(4)?;
        let known = self.defaults.iter().find(|one| one.track == track);
        let mut defaults = known.copied().unwrap_or_default();
        let mut fields = Fields::behind_flags(head, 8)?;
        let base = fields.u64(0x1)?;
        fields.u32(0x2)?;
        defaults.duration = fields.u32(0x8)?.unwrap_or(defaults.duration);
        defaults.size = fields.u32(0x10)?.unwrap_or(defaults.size);
        let is_from_fragment = fields.flags & 0x2_0000 != 0;
        let base = base.unwrap_or(if is_from_fragment { start } else { *data_end });
        *data_end = base;
        let is_ours = track == self.track;
        if is_ours && let Some(time) = part.find(b"tfdt")? {
            self.time = match time.is_long()? {
                true => i64::try_from(time.u64(4)?).unwrap_or(i64::MAX),
                false => i64::from(time.u32(4)?),
            };
        }
        for (_, run) in part
            .boxes()?
            .into_iter()
            .filter(|(name, _)| name == b"trun")
        {
            let mut fields = Fields::behind_flags(run, 8)?;
            if let Some(offset) = fields.u32(0x1)? {
                *data_end = base.saturating_add_signed(i64::from(offset as i32));
            }
            fields.u32(0x4)?;
            let count = run.u32(4)?;
            self.count = self.count.saturating_add(count as usize);
            if self.count > MAX_SAMPLES {
                return Err(run.error(4, "more pictures than a file has (damaged file?)"));
            }
            for _ in 0..count {
                let duration = fields.u32(0x100)?.unwrap_or(defaults.duration);
                let size = fields.u32(0x200)?.unwrap_or(defaults.size);
                fields.u32(0x400)?;
                // Unsigned in version 0, but nobody writes offsets beyond 2^31.
                let offset = fields.u32(0x800)?.unwrap_or(0) as i32;
                if is_ours {
                    samples.push(Sample {
                        offset: *data_end,
                        size,
                        time_ns: self
                            .scale
                            .nanoseconds(self.time.saturating_add(offset.into())),
                    });
                    self.time = self.time.saturating_add(duration.into());
                }
                *data_end = data_end.saturating_add(size.into());
            }
        }
        Ok(())
    }
}

/// Fields of a box that are there when their flags are set, one after another.
struct Fields<'a> {
    part: Part<'a>,
    flags: u32,
    at: usize,
}

impl<'a> Fields<'a> {
    /// From byte `at` on.
    fn behind_flags(part: Part<'a>, at: usize) -> Result<Self, VideoError> {
        let flags = part.u32(0)? & 0xff_ffff;
        Ok(Self { part, flags, at })
    }

    fn u32(&mut self, flag: u32) -> Result<Option<u32>, VideoError> {
        if self.flags & flag == 0 {
            return Ok(None);
        }
        self.at += 4;
        self.part.u32(self.at - 4).map(Some)
    }

    fn u64(&mut self, flag: u32) -> Result<Option<u64>, VideoError> {
        if self.flags & flag == 0 {
            return Ok(None);
        }
        self.at += 8;
        self.part.u64(self.at - 8).map(Some)
    }
}
