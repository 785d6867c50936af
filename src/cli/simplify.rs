//! Arguments of `simplify`.

use std::path::PathBuf;

use clap::Args;

use crate::diff::Tolerance;

/// Arguments of `simplify`.
#[derive(Debug, Args)]
pub struct SimplifyArgs {
    /// The mesh: GLB, glTF, OBJ, PLY or STL.
    pub mesh: PathBuf,

    /// The simplified mesh; the name says the format: .glb, .obj or .ply.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,

    /// How far the surfaces may lie apart: a length in units of the mesh (0.002), or a share of its diagonal (0.05%).
    #[arg(long, value_name = "LENGTH|N%", default_value = "0.02%")]
    pub tolerance: Tolerance,

    /// A triangle joins a flat part when its normal is within this angle of it.
    #[arg(long, value_name = "DEGREES", default_value_t = 20.0)]
    pub most_turn: f64,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}
