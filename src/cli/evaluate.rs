//! Arguments of `evaluate`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use nalgebra::Point3;

use super::KeyframeArgs;
use super::ranges::{MOST_SAMPLES, coordinate, length, whole};
use linecarve_mesh::evaluate::Region;

/// Options of shapes, which trajectories do not have.
const OF_SHAPES: [&str; 20] = [
    "shape",
    "ground_truth",
    "trajectories",
    "thresholds",
    "roi",
    "roi_margin",
    "samples",
    "seed",
    "step",
    "observed",
    "calibration",
    "behind",
    "far",
    "heat_map",
    "every",
    "keyframes",
    "min_translation",
    "min_rotation",
    "sharpness_window",
    "max_keyframes",
];

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Mesh, lines or cloud: GLB, glTF, OBJ, PLY, STL, or text with rows `x y z`.
    #[arg(required_unless_present = "trajectory")]
    pub shape: Option<PathBuf>,

    /// Mesh or cloud to measure against, in any of those formats. Distances are in its unit.
    #[arg(long, value_name = "FILE", required_unless_present = "trajectory")]
    pub ground_truth: Option<PathBuf>,

    /// A trajectory to measure in place of a shape: rows `seconds tx ty tz qx qy qz qw`.
    #[arg(long, value_name = "FILE", requires = "reference", conflicts_with_all = OF_SHAPES)]
    pub trajectory: Option<PathBuf>,

    /// The true trajectory: a file of such rows, or the folder of a sequence with poses.
    #[arg(long, value_name = "PATH", requires = "trajectory")]
    pub reference: Option<PathBuf>,

    /// How the two are brought into one frame; default: none for shapes, se3 for trajectories. Alignments of shapes are fitted
    /// to samples of their own, drawn apart from those that are scored; none uses the region of interest.
    #[arg(long, value_enum)]
    pub align: Option<AlignBy>,

    /// Camera poses of the reconstruction and of the ground truth, as rows `seconds tx ty tz qx qy qz qw` or the folder of a sequence:
    /// what `--align trajectories` uses, and where `icp` and `sim3` begin.
    #[arg(long, num_args = 2, value_names = ["ESTIMATED", "TRUE"])]
    pub trajectories: Option<Vec<PathBuf>>,

    /// Distances for precision, recall and F.
    #[arg(long, value_name = "LENGTH", value_parser = length(), value_delimiter = ',', default_values_t = [0.02, 0.05, 0.10])]
    pub thresholds: Vec<f64>,

    /// Where points count: `gt`, the bounding box of the ground truth; `none`, everywhere; or a box X0,Y0,Z0,X1,Y1,Z1.
    #[arg(long, value_name = "gt|none|BOX", value_parser = parse_region, allow_hyphen_values = true, default_value = "gt")]
    pub roi: Region,

    /// The region reaches this much further on every side.
    #[arg(
        long,
        value_name = "LENGTH",
        value_parser = coordinate(),
        allow_hyphen_values = true,
        default_value_t = 0.0
    )]
    pub roi_margin: f64,

    /// Points drawn on each surface.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_SAMPLES), default_value_t = 200_000)]
    pub samples: usize,

    /// Seed of everything random.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,

    /// Points along lines are at most this far apart; default: half the smallest threshold.
    #[arg(long, value_name = "LENGTH", value_parser = length())]
    pub step: Option<f64>,

    /// Leave out what no keyframe of this sequence looked at: its depth images decide, its poses are in the frame of the
    /// reconstruction.
    #[arg(long, value_name = "SEQUENCE")]
    pub observed: Option<PathBuf>,

    /// Calibration of that sequence in place of what its layout says.
    #[arg(long, value_name = "FILE", requires = "observed")]
    pub calibration: Option<PathBuf>,

    /// How far behind the depth that a keyframe measured the surface may lie; default: a tenth of the median depth.
    #[arg(long, value_name = "LENGTH", value_parser = length(), requires = "observed")]
    pub behind: Option<f64>,

    /// Depth up to which keyframes are believed; default: 2.5 times the median depth.
    #[arg(long, value_name = "LENGTH", value_parser = length(), requires = "observed")]
    pub far: Option<f64>,

    /// Keyframes of that sequence.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// The shape with its vertices coloured by their distance, from 0 (dark) to the largest threshold (bright).
    #[arg(long, value_name = "FILE.glb")]
    pub heat_map: Option<PathBuf>,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}

/// How two shapes are brought into one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AlignBy {
    /// They are in one frame.
    None,
    /// A rigid motion of positions, for trajectories.
    Se3,
    /// A rigid motion, by trimmed ICP from where they stand or from where the trajectories put them.
    Icp,
    /// A similarity: of shapes by trimmed ICP with a scale, of trajectories by their positions.
    Sim3,
    /// The similarity between two trajectories.
    Trajectories,
}

/// `gt`, `none` or two corners.
fn parse_region(text: &str) -> Result<Region, String> {
    match text {
        "gt" => return Ok(Region::GroundTruth),
        "none" => return Ok(Region::Everywhere),
        _ => {}
    }
    let numbers: Vec<f64> = text
        .split(',')
        .map(coordinate())
        .collect::<Result<_, _>>()
        .unwrap_or_default();
    match <[f64; 6]>::try_from(numbers) {
        Ok(box_) => Ok(Region::Box {
            low: Point3::new(box_[0], box_[1], box_[2]),
            high: Point3::new(box_[3], box_[4], box_[5]),
        }),
        _ => Err("write gt, none, or a box as X0,Y0,Z0,X1,Y1,Z1".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_words_or_boxes() {
        assert_eq!(parse_region("gt"), Ok(Region::GroundTruth));
        assert_eq!(parse_region("none"), Ok(Region::Everywhere));
        assert_eq!(
            parse_region("0,-1,0,1, 2,3.5"),
            Ok(Region::Box {
                low: Point3::new(0.0, -1.0, 0.0),
                high: Point3::new(1.0, 2.0, 3.5)
            })
        );
        for bad in ["", "all", "1,2,3", "0,0,0,1,1,nan"] {
            assert!(parse_region(bad).is_err(), "{bad}");
        }
    }
}
