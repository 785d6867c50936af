//! Options of a synthetic sequence.

use linecarve_lines::camera::{Camera, CameraError};

/// The scenes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SceneKind {
    /// A furnished room with a doorway to a corridor, seen all around.
    #[default]
    Room,
    /// The same room without its furniture.
    BareRoom,
    /// A table with a few boxes that stands in the void, seen from one side.
    Boxes,
    /// Three white walls that meet in a corner.
    Corner,
    /// Five furnished rooms in a row, seen on a walk through all of them and back.
    Walk,
}

/// Layouts of the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SequenceLayout {
    /// TUM RGB-D: rgb/, depth/ and lists with time stamps; depth 5000 a metre.
    #[default]
    Tum,
    /// 7-Scenes: frame-NNNNNN.color, .depth, .pose; depth 1000 a metre.
    SevenScenes,
    /// Open3D: image/, depth/ and trajectory.log; depth 1000 a metre.
    Open3d,
}

impl SceneKind {
    /// Every scene.
    pub const ALL: [Self; 5] = [
        Self::Room,
        Self::BareRoom,
        Self::Boxes,
        Self::Corner,
        Self::Walk,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Room => "room",
            Self::BareRoom => "bare-room",
            Self::Boxes => "boxes",
            Self::Corner => "corner",
            Self::Walk => "walk",
        }
    }
}

impl SequenceLayout {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tum => "tum",
            Self::SevenScenes => "7-scenes",
            Self::Open3d => "open3d",
        }
    }

    /// Raw units of depth a metre.
    pub fn depth_scale(self) -> f64 {
        match self {
            Self::Tum => 5000.0,
            Self::SevenScenes | Self::Open3d => 1000.0,
        }
    }
}

/// File format of the colour images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorFormat {
    /// Without loss.
    Png,
    /// With a quality of 1 to 100.
    Jpeg {
        /// 100 is best.
        quality: u8,
    },
}

/// How depth is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DepthNoise {
    /// Exactly, up to the raw unit of the layout.
    Exact,
    /// Like a structured-light sensor: see the noise model of this module for what happens. A strength of 1 is that of
    /// the first Kinect.
    Kinect {
        /// Factor of the standard deviations, above 0 and at most 10.
        strength: f64,
    },
}

/// Options of a synthetic sequence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SynthOptions {
    /// The scene.
    pub scene: SceneKind,
    /// Number of frames, 1 to 100 000, spread evenly over the path: more frames are nearer to each other.
    pub frames: u32,
    /// Image width in pixels, 16 to 8192.
    pub width: u32,
    /// Image height in pixels, 16 to 8192.
    pub height: u32,
    /// Focal length in pixels; by default that of a 640 pixel wide image with 525.
    pub focal_px: Option<f64>,
    /// Layout of the folder.
    pub layout: SequenceLayout,
    /// File format of the colour images.
    pub color: ColorFormat,
    /// How depth is measured.
    pub noise: DepthNoise,
    /// Standard deviation of the noise of colour images in 8-bit steps, 0 to 64.
    pub color_noise: f64,
    /// Largest relative change of the exposure along the path, 0 to 0.9.
    pub exposure_change: f64,
    /// Exposure time as a share of the time between frames, 0 to 1: motion blur. Poses are those of its middle.
    pub blur: f64,
    /// Time from the first to the last row as a share of the time between frames, 0 to 1: a rolling shutter, of depth as well. Poses are
    /// those of the middle row.
    pub rolling_shutter: f64,
    /// Distance of a right camera in metres, above 0 and at most 10: rectified pairs in the layout of KITTI odometry, without depth;
    /// `layout` and `noise` are not used then.
    pub stereo_baseline: Option<f64>,
    /// Seed of the path's unsteadiness and of all noise.
    pub seed: u64,
}

impl Default for SynthOptions {
    fn default() -> Self {
        Self {
            scene: SceneKind::Room,
            frames: 36,
            width: 640,
            height: 480,
            focal_px: None,
            layout: SequenceLayout::Tum,
            color: ColorFormat::Jpeg { quality: 85 },
            noise: DepthNoise::Exact,
            color_noise: 0.0,
            exposure_change: 0.0,
            blur: 0.0,
            rolling_shutter: 0.0,
            stereo_baseline: None,
            seed: 1,
        }
    }
}

/// Why options are not valid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SynthOptionsError {
    /// A value is out of its range.
    #[error("{name} = {value} must be {range}")]
    Range {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The valid range.
        range: &'static str,
    },
    /// The focal length makes no camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

impl SynthOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option out of range.
    pub fn validate(&self) -> Result<(), SynthOptionsError> {
        let quality = match self.color {
            ColorFormat::Png => 100,
            ColorFormat::Jpeg { quality } => quality,
        };
        let strength = match self.noise {
            DepthNoise::Exact => 1.0,
            DepthNoise::Kinect { strength } => strength,
        };
        let size = 16..=8192;
        let checks = [
            (
                "frames",
                f64::from(self.frames),
                (1..=100_000).contains(&self.frames),
                "1 to 100000",
            ),
            (
                "width",
                f64::from(self.width),
                size.contains(&self.width),
                "16 to 8192",
            ),
            (
                "height",
                f64::from(self.height),
                size.contains(&self.height),
                "16 to 8192",
            ),
            (
                "JPEG quality",
                f64::from(quality),
                (1..=100).contains(&quality),
                "1 to 100",
            ),
            (
                "noise strength",
                strength,
                strength > 0.0 && strength <= 10.0,
                "above 0 and at most 10",
            ),
            (
                "color noise",
                self.color_noise,
                (0.0..=64.0).contains(&self.color_noise),
                "0 to 64",
            ),
            (
                "exposure change",
                self.exposure_change,
                (0.0..=0.9).contains(&self.exposure_change),
                "0 to 0.9",
            ),
            (
                "blur",
                self.blur,
                (0.0..=1.0).contains(&self.blur),
                "0 to 1",
            ),
            (
                "rolling shutter",
                self.rolling_shutter,
                (0.0..=1.0).contains(&self.rolling_shutter),
                "0 to 1",
            ),
            (
                "stereo baseline",
                self.stereo_baseline.unwrap_or(1.0),
                self.stereo_baseline
                    .is_none_or(|baseline| baseline > 0.0 && baseline <= 10.0),
                "above 0 and at most 10",
            ),
        ];
        if let Some((name, value, _, range)) = checks.into_iter().find(|(_, _, valid, _)| !valid) {
            return Err(SynthOptionsError::Range { name, value, range });
        }
        self.camera().map(|_| ())
    }

    /// The command line that renders the same bytes into a folder DIR, with the options that differ from the
    /// defaults.
    pub fn command_line(&self) -> String {
        let default = Self::default();
        let mut line = format!(
            "linecarve synth {} --frames {} --seed {}",
            self.scene.name(),
            self.frames,
            self.seed
        );
        let mut add = |differs: bool, text: String| {
            if differs {
                line.push(' ');
                line += &text;
            }
        };
        add(
            (self.width, self.height) != (default.width, default.height),
            format!("--size {}x{}", self.width, self.height),
        );
        if let Some(focal) = self.focal_px {
            add(true, format!("--focal {focal:?}"));
        }
        add(
            self.layout != default.layout,
            format!("--layout {}", self.layout.name()),
        );
        match self.color {
            ColorFormat::Png => add(true, "--png".to_owned()),
            ColorFormat::Jpeg { quality } => {
                add(
                    self.color != default.color,
                    format!("--jpeg-quality {quality}"),
                );
            }
        }
        if let DepthNoise::Kinect { strength } = self.noise {
            add(true, "--noise kinect".to_owned());
            add(strength != 1.0, format!("--noise-strength {strength:?}"));
        }
        add(
            self.color_noise != default.color_noise,
            format!("--color-noise {:?}", self.color_noise),
        );
        add(
            self.exposure_change != default.exposure_change,
            format!("--exposure-change {:?}", self.exposure_change),
        );
        add(self.blur != default.blur, format!("--blur {:?}", self.blur));
        add(
            self.rolling_shutter != default.rolling_shutter,
            format!("--rolling-shutter {:?}", self.rolling_shutter),
        );
        if let Some(baseline) = self.stereo_baseline {
            add(true, format!("--stereo {baseline:?}"));
        }
        line + " --out DIR"
    }

    /// The camera of the images; its principal point is their centre.
    ///
    /// # Errors
    /// When the focal length is not positive and finite.
    pub fn camera(&self) -> Result<Camera, SynthOptionsError> {
        let focal = self
            .focal_px
            .unwrap_or(525.0 * f64::from(self.width) / 640.0);
        Ok(Camera::pinhole(
            focal,
            focal,
            0.5 * (f64::from(self.width) - 1.0),
            0.5 * (f64::from(self.height) - 1.0),
        )?)
    }
}
