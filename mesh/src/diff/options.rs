//! Options of a comparison.

use std::str::FromStr;

use serde::Serialize;

/// Maximum distance between corresponding parts of two meshes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// A length in units of the meshes.
    Length(f64),
    /// A share of the bounding box diagonal of the expected mesh.
    ShareOfDiagonal(f64),
}

impl Tolerance {
    /// A length in units of the meshes.
    pub fn length(&self, diagonal: f64) -> f64 {
        match self {
            Self::Length(length) => *length,
            Self::ShareOfDiagonal(share) => share * diagonal,
        }
    }
}

/// Largest number of a tolerance.
const MOST: f64 = 1e9;

impl FromStr for Tolerance {
    type Err = String;

    /// `0.01` is a length, `0.5%` a share of the diagonal.
    fn from_str(text: &str) -> Result<Self, String> {
        let (number, is_share) = match text.trim().strip_suffix('%') {
            Some(number) => (number.trim_end(), true),
            None => (text.trim(), false),
        };
        match number.parse::<f64>() {
            Ok(value) if (0.0..=MOST).contains(&value) => Ok(if is_share {
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

/// A property that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Check {
    /// The Hausdorff distance between the surfaces.
    Distance,
    /// The corners of the bounding boxes.
    Bounds,
    /// The largest distance from a vertex to the nearest vertex of the other mesh, in both directions, if the
    /// counts of vertices and triangles are equal. It finds vertices that move within their surface. Meshes of
    /// different counts pass.
    Vertices,
    /// Triangles must have the same orientation.
    Orientation,
    /// The numbers of components, boundary edges and loops, handles, and non-manifold or inconsistently oriented
    /// edges must be equal.
    Topology,
    /// The numbers of vertices and triangles must be equal.
    Counts,
}

impl Check {
    /// Default: all checks except the counts.
    pub const DEFAULT: [Self; 5] = [
        Self::Distance,
        Self::Bounds,
        Self::Vertices,
        Self::Orientation,
        Self::Topology,
    ];

    /// Name on the command line and in reports.
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

/// Options of a comparison.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DiffOptions {
    /// Maximum distance. Rounding is always tolerated.
    pub tolerance: Tolerance,
    /// Properties to compare.
    pub checks: Vec<Check>,
    /// Samples on each surface, in addition to vertices and triangle centres.
    pub samples: usize,
    /// Seed of the samples.
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
