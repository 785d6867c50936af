//! Arguments of `simplify`.

use std::path::PathBuf;

use clap::Args;

use super::ranges::number;
use crate::sinks::DEFAULT_TOLERANCE_TEXT;
use linecarve_mesh::diff::Tolerance;

/// Arguments of `simplify`.
#[derive(Debug, Args)]
pub struct SimplifyArgs {
    /// The mesh: GLB, glTF, OBJ, PLY or STL.
    pub mesh: PathBuf,

    /// The simplified mesh; the name says the format: .glb, .obj or .ply.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,

    /// How far the surfaces may lie apart: a length in units of the mesh (0.002), or a share of its diagonal (0.05%).
    #[arg(long, value_name = "LENGTH|N%", default_value = DEFAULT_TOLERANCE_TEXT)]
    pub tolerance: Tolerance,

    /// How far rims may move within their surface, which keeps the tolerance: they are where evidence ends, and jagged. A length or
    /// a share of the diagonal; 0 holds them to the tolerance. Default: half the median length of a rim's edges, at most 20 tolerances.
    #[arg(long, value_name = "LENGTH|N%")]
    pub rim_tolerance: Option<Tolerance>,

    /// Edges of the surface that turn by more than this, and stand out by more than the tolerance, remain edges.
    #[arg(long, value_name = "DEGREES", value_parser = number(0.0..=180.0), default_value_t = 50.0)]
    pub crease: f64,

    /// Lines that are known, such as clusters.ply of a run: edges along them remain edges.
    #[arg(long, value_name = "FILE")]
    pub lines: Option<PathBuf>,

    /// Write the edges that remained edges as lines over the simplified mesh, coloured by what they are: creases red, edges along known
    /// lines green, rims grey. The name says the format: .glb, .obj or .ply.
    #[arg(long, value_name = "FILE")]
    pub feature_edges: Option<PathBuf>,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}
