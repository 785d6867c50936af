//! Options of a picture.

/// What lies behind the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// One sRGB colour.
    Plain([u8; 3]),
    /// From the first sRGB colour at the top to the second at the bottom.
    Gradient([u8; 3], [u8; 3]),
}

/// Treatment of back faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BackFaces {
    /// Tinted, which shows holes and flipped triangles.
    Tinted,
    /// Drawn like front faces.
    Shown,
    /// Not drawn: the inside of a closed room is visible from outside, as in a doll's house.
    Hidden,
}

/// Options of a picture.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RenderOptions {
    /// Samples per pixel along each side, 1 to 8; 2 gives smooth outlines.
    pub supersampling: u32,
    /// Width of segments in pixels, above 0 and at most 100.
    pub line_width_px: f64,
    /// sRGB colour of segments without colours of their own.
    pub line_color: [u8; 3],
    /// Maximum depth of visible segments behind the surface, relative to its depth, 0 to 1. Segments lie on the
    /// surface up to noise.
    pub line_depth_tolerance: f64,
    /// sRGB colour of meshes without colours.
    pub clay: [u8; 3],
    /// What lies behind the mesh.
    pub background: Background,
    /// Treatment of back faces.
    pub back_faces: BackFaces,
    /// Ambient occlusion rays per pixel; 0 disables ambient occlusion.
    pub occlusion_rays: u32,
    /// Whether lamps light the surface. Without, the picture shows its colours alone: light is in photographs already.
    pub is_lit: bool,
    /// Darkness of the outlines at jumps of depth, 0 (none) to 1 (black).
    pub outline_darkness: f64,
    /// Darkness of the outlines at creases, 0 to 1.
    pub crease_darkness: f64,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            supersampling: 2,
            line_width_px: 1.4,
            line_color: [20, 70, 160],
            line_depth_tolerance: 0.01,
            clay: [216, 210, 200],
            background: Background::Gradient([255, 255, 255], [226, 231, 238]),
            back_faces: BackFaces::Tinted,
            occlusion_rays: 6,
            is_lit: true,
            outline_darkness: 0.75,
            crease_darkness: 0.25,
        }
    }
}

/// An option out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} = {value} must be {range}")]
pub struct RenderOptionsError {
    /// The option.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// The valid range.
    pub range: &'static str,
}

impl RenderOptions {
    /// Colours alone: without lamps, ambient occlusion and outlines.
    #[must_use]
    pub fn unlit(self) -> Self {
        Self {
            occlusion_rays: 0,
            is_lit: false,
            outline_darkness: 0.0,
            crease_darkness: 0.0,
            ..self
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option out of range.
    pub fn validate(&self) -> Result<(), RenderOptionsError> {
        let unit = 0.0..=1.0;
        let checks = [
            (
                "supersampling",
                f64::from(self.supersampling),
                (1..=8).contains(&self.supersampling),
                "1 to 8",
            ),
            (
                "line_width_px",
                self.line_width_px,
                self.line_width_px > 0.0 && self.line_width_px <= 100.0,
                "above 0 and at most 100",
            ),
            (
                "line_depth_tolerance",
                self.line_depth_tolerance,
                unit.contains(&self.line_depth_tolerance),
                "0 to 1",
            ),
            (
                "occlusion_rays",
                f64::from(self.occlusion_rays),
                self.occlusion_rays <= 4096,
                "at most 4096",
            ),
            (
                "outline_darkness",
                self.outline_darkness,
                unit.contains(&self.outline_darkness),
                "0 to 1",
            ),
            (
                "crease_darkness",
                self.crease_darkness,
                unit.contains(&self.crease_darkness),
                "0 to 1",
            ),
        ];
        match checks.into_iter().find(|(_, _, valid, _)| !valid) {
            Some((name, value, _, range)) => Err(RenderOptionsError { name, value, range }),
            None => Ok(()),
        }
    }
}
