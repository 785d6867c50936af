//! Arguments of `mesh`.

use std::path::PathBuf;

use clap::Args;

use super::ranges::number;
use super::{LabelChoice, parse_up};

/// Arguments of `mesh`.
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// A dense workspace of COLMAP (`fused.ply`, `fused.ply.vis` and `sparse/`), its `fused.ply`, a sparse model, or a scene of OpenMVS
    /// (`.mvs`). Images are not needed. With --cameras any PLY file of points with normals.
    pub input: PathBuf,

    /// Cameras of a PLY file with normals: the folder of a COLMAP model, or a text file with a line for each camera,
    /// `x y z qx qy qz qw width height fx fy cx cy`, world from camera. A point is seen by the cameras that its normal faces.
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,

    /// The mesh: a name that ends with .glb, .obj or .ply.
    #[arg(long, short = 'o', value_name = "FILE")]
    pub out: PathBuf,

    /// Up in the frame of the poses, for GLB files, which have y up; default: the mean up direction of the cameras, or the axis of the
    /// poses that is within 25 degrees of it. OBJ and PLY files stay in the frame of the poses.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,

    /// Make a watertight mesh: nothing is left out because no view saw it.
    #[arg(long)]
    pub closed: bool,

    /// How tetrahedra are labelled; default: what the configuration says, a minimum cut when it says nothing.
    #[arg(long, value_enum)]
    pub labels: Option<LabelChoice>,

    /// TOML file with parameters (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Options of COLMAP's and OpenMVS's meshers.
    #[command(flatten)]
    pub known: KnownOptions,
}

/// Options by the names that other meshers give them. docs/dense-clouds.md says what each becomes.
#[derive(Debug, Default, Args)]
pub struct KnownOptions {
    /// COLMAP: weight of the shape of triangles; 1 is the default of both programs.
    #[arg(long = "DelaunayMeshing.quality_regularization", value_name = "FACTOR", hide = true, value_parser = number(0.0..=1000.0))]
    pub quality_regularization: Option<f64>,
    /// COLMAP: factor on the standard deviation of points.
    #[arg(long = "DelaunayMeshing.distance_sigma_factor", value_name = "FACTOR", hide = true, value_parser = number(1e-3..=1000.0))]
    pub distance_sigma_factor: Option<f64>,
    /// COLMAP: distance in pixels within which points are joined.
    #[arg(long = "DelaunayMeshing.max_proj_dist", value_name = "PIXELS", hide = true, value_parser = number(0.0..=1e6))]
    pub max_proj_dist: Option<f64>,
    /// COLMAP: difference in depth within which points are joined.
    #[arg(long = "DelaunayMeshing.max_depth_dist", value_name = "SHARE", hide = true, value_parser = number(0.0..=1e6))]
    pub max_depth_dist: Option<f64>,
    /// COLMAP: number of images from which on a point is certain.
    #[arg(long = "DelaunayMeshing.visibility_sigma", value_name = "IMAGES", hide = true, value_parser = number(0.0..=1e6))]
    pub visibility_sigma: Option<f64>,
    /// COLMAP: longest edges, as a factor on most edges.
    #[arg(long = "DelaunayMeshing.max_side_length_factor", value_name = "FACTOR", hide = true, value_parser = number(0.0..=1e6))]
    pub max_side_length_factor: Option<f64>,
    /// OpenMVS: distance in pixels within which points are joined.
    #[arg(long, value_name = "PIXELS", hide = true, value_parser = number(0.0..=1e6))]
    pub min_point_distance: Option<f64>,
    /// OpenMVS: factor on the standard deviation of points.
    #[arg(long, value_name = "FACTOR", hide = true, value_parser = number(1e-3..=1000.0))]
    pub thickness_factor: Option<f64>,
    /// OpenMVS: factor on the weight of the shape of triangles.
    #[arg(long, value_name = "FACTOR", hide = true, value_parser = number(0.0..=1000.0))]
    pub quality_factor: Option<f64>,
}
