#![doc = include_str!("../README.md")]

pub mod camera;
pub mod cluster;
pub mod depth;
pub mod edges;
mod extractor;
pub mod fit;
mod growth;
pub mod image;
mod inverse_depth;
mod median;
pub mod paper;
mod similarity;
pub mod triangulation;

pub use camera::{Camera, Distortion, UndistortionMap};
pub use cluster::{ClusterOptions, SegmentClusterer};
pub use depth::semi_dense::{MatchView, SemiDense, SemiDenseDepth, SemiDenseOptions};
pub use depth::{
    DepthSensor, EdgeDepthOptions, EdgeDepths, InverseDepth, InverseDepthMap, SensorNoise,
};
pub use edges::{EdgeChains, EdgeDetector, EdgeOptions};
pub use extractor::{ExtractError, ExtractOptions, Extraction, SegmentExtractor, StageDurations};
pub use fit::{FitOptions, Segment};
pub use image::{GrayImage, Plane};
pub use median::upper_median;
pub use paper::{PaperClusterer, PaperFitter, PaperOptions};
pub use similarity::fit_similarity;
pub use triangulation::{ImageTriangulation, SurfaceSamples};
