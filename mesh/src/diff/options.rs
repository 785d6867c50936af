//! What counts as a difference.

use std::str::FromStr;

use serde::Serialize;

/// How far apart the same things may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// In units of the meshes.
    Length(f64),
    /// As a share of the diagonal of the expected mesh's bounding box.
    ShareOfDiagonal(f64),
}

impl Tolerance {
    /// In units of the meshes.
    pub fn length(&self, diagonal: f64) -> f64 {
        match self {
            Self::Length(length) => *length,
            Self::ShareOfDiagonal(share) => share * diagonal,
        }
    }
}

impl FromStr for Tolerance {
    type Err = String;

    /// `0.01` is a length, `0.5%` a share of the diagonal.
    fn from_str(text: &str) -> Result<Self, String> {
        let (number, is_share) = match text.trim().strip_suffix('%') {
            Some(number) => (number.trim_end(), true),
            None => (text.trim(), false),
        };
        match number.parse::<f64>() {
            Ok(value) if value >= 0.0 && value.is_finite() => Ok(if is_share {
                Self::ShareOfDiagonal(value / 100.0)
            } else {
                Self::Length(value)
            }),
            _ => Err(
                "write a length such as 0.01, or a share of the diagonal such as 0.5%".to_owned(),
            ),
        }
    }
}

/// What is held against the tolerance, or must be equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Check {
    /// The largest distance between the surfaces, both ways.
    Distance,
    /// The corners of the bounding boxes.
    Bounds,
    /// The largest distance from a vertex to the nearest vertex, both ways, where both have as many vertices and
    /// triangles: it finds vertices that slide within their surface. Meshes of other counts pass.
    Vertices,
    /// Triangles must face the same side.
    Orientation,
    /// Pieces, boundary edges and loops, handles, and edges that are not manifold or turn against each other must be as
    /// many.
    Topology,
    /// Vertices and triangles must be as many.
    Counts,
}

impl Check {
    /// What is checked unless asked otherwise: all but the counts.
    pub const DEFAULT: [Self; 5] = [
        Self::Distance,
        Self::Bounds,
        Self::Vertices,
        Self::Orientation,
        Self::Topology,
    ];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Distance => "distance",
            Self::Bounds => "bounds",
            Self::Vertices => "vertices",
            Self::Orientation => "orientation",
            Self::Topology => "topology",
            Self::Counts => "counts",
        }
    }
}

/// How to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct DiffOptions {
    /// How far apart the same things may lie; what rounding makes of nothing is always put up with.
    pub tolerance: Tolerance,
    /// What is checked.
    pub checks: Vec<Check>,
    /// Points drawn on each surface, besides vertices and centres of triangles.
    pub samples: usize,
    /// Seed of those points.
    pub seed: u64,
}

impl Default for DiffOptions {
    fn default() -> Self {
        Self {
            tolerance: Tolerance::ShareOfDiagonal(0.0001),
            checks: Check::DEFAULT.to_vec(),
            samples: 50_000,
            seed: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_are_lengths_or_shares() {
        assert_eq!("0.01".parse(), Ok(Tolerance::Length(0.01)));
        assert_eq!("2 %".parse(), Ok(Tolerance::ShareOfDiagonal(0.02)));
        assert_eq!(Tolerance::ShareOfDiagonal(0.02).length(5.0), 0.1);
        for bad in ["", "-1", "x%", "inf", "NaN", "%"] {
            assert!(bad.parse::<Tolerance>().is_err(), "{bad}");
        }
    }
}
