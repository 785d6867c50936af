//! Arguments of `diff`.

use std::path::PathBuf;

use clap::Args;

use super::CheckChoice;
use super::ranges::{MOST_SAMPLES, whole};
use linecarve_mesh::diff::Tolerance;

/// Arguments of `diff`.
#[derive(Debug, Args)]
pub struct DiffArgs {
    /// The mesh as it should be: GLB, glTF, OBJ, PLY or STL.
    pub expected: PathBuf,

    /// The mesh as it is, in any of those formats.
    pub actual: PathBuf,

    /// How far apart the same things may lie: a length in units of the meshes (0.01), or a share of the diagonal of the
    /// expected mesh (0.5%).
    #[arg(long, value_name = "LENGTH|N%", default_value = "0.01%")]
    pub tolerance: Tolerance,

    /// What makes a difference.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["distance", "bounds", "vertices", "orientation", "topology"])]
    pub check: Vec<CheckChoice>,

    /// Points drawn on each surface, besides vertices and centres of triangles.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_SAMPLES), default_value_t = 50_000)]
    pub samples: usize,

    /// Seed of those points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,

    /// A test report in JUnit XML, one test case a check.
    #[arg(long, value_name = "FILE.xml")]
    pub junit: Option<PathBuf>,

    /// Both meshes with their vertices coloured by the distance to the other one, from 0 (dark) to the largest (bright).
    #[arg(long, value_name = "FILE.glb")]
    pub heat_map: Option<PathBuf>,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}
