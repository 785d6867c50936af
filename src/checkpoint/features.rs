//! Keyframes with features.

use super::codec::{Damaged, Reader, Writer};
use crate::map_points::{Descriptor, Features};
use crate::pipeline::PointKeyframe;
use crate::report::StageTimes;

/// Bytes of a feature.
const FEATURE: usize = 2 * 4 + 1 + 4 + 32 + 1;

/// A keyframe with features as bytes; durations are left out.
pub fn write_point_keyframe(keyframe: &PointKeyframe) -> Vec<u8> {
    let mut out = Writer::default();
    out.u64(keyframe.frame as u64);
    out.pose(&keyframe.world_from_camera);
    let features = &keyframe.features;
    out.u32(features.len() as u32);
    for index in 0..features.len() {
        let [x, y] = features.pixels[index];
        out.f32(x);
        out.f32(y);
        out.u8(features.octaves[index]);
        out.f32(features.angles_rad[index]);
        for word in features.descriptors[index].0 {
            out.u64(word);
        }
        out.u8(features.grey[index]);
    }
    out.finish()
}

/// The keyframe that [`write_point_keyframe`] wrote.
///
/// # Errors
/// When the bytes are not what it writes.
pub fn read_point_keyframe(bytes: &[u8]) -> Result<PointKeyframe, Damaged> {
    let mut from = Reader::new(bytes);
    let frame = from.u64()? as usize;
    let world_from_camera = from.pose()?;
    let count = from.count(FEATURE)?;
    let mut features = Features::default();
    for _ in 0..count {
        features.pixels.push([from.f32()?, from.f32()?]);
        features.octaves.push(from.u8()?);
        features.angles_rad.push(from.f32()?);
        let words = [from.u64()?, from.u64()?, from.u64()?, from.u64()?];
        features.descriptors.push(Descriptor(words));
        features.grey.push(from.u8()?);
    }
    from.finish()?;
    Ok(PointKeyframe {
        frame,
        world_from_camera,
        features,
        times: StageTimes::default(),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    fn keyframe() -> PointKeyframe {
        PointKeyframe {
            frame: 7,
            world_from_camera: Isometry3::new(
                Vector3::new(0.1, -2.0, f64::MIN_POSITIVE),
                Vector3::new(0.3, 0.2, 0.1),
            ),
            features: Features {
                pixels: vec![[1.5, 2.25], [0.1, 479.0]],
                octaves: vec![0, 7],
                angles_rad: vec![0.5, -3.0],
                descriptors: vec![Descriptor([1, 2, 3, u64::MAX]), Descriptor([0; 4])],
                grey: vec![9, 255],
            },
            times: StageTimes::default(),
        }
    }

    #[test]
    fn nothing_is_lost() {
        let bytes = write_point_keyframe(&keyframe());
        let back = read_point_keyframe(&bytes).unwrap();
        assert_eq!(write_point_keyframe(&back), bytes);
        assert_eq!(back.world_from_camera, keyframe().world_from_camera);
        assert_eq!(back.features.pixels, keyframe().features.pixels);
    }

    #[test]
    fn any_other_length_is_refused() {
        let mut bytes = write_point_keyframe(&keyframe());
        for cut in 0..bytes.len() {
            assert!(read_point_keyframe(&bytes[..cut]).is_err(), "{cut}");
        }
        bytes.push(0);
        assert!(read_point_keyframe(&bytes).is_err());
        // A count that would need 2^32 features.
        bytes[64..68].fill(0xff);
        assert!(read_point_keyframe(&bytes).is_err());
    }
}
