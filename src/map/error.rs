//! Why a keyframe cannot be added to the map.

use linecarve_carving::TransactionError;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_points::PointOptionsError;

/// Why a keyframe cannot be added to the map. The map is then not to be used any further.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// A clustering option is out of range.
    #[error(transparent)]
    Cluster(#[from] ClusterOptionsError),
    /// An option of the map points is out of range.
    #[error(transparent)]
    Points(#[from] PointOptionsError),
    /// The carver refuses a camera centre or a point.
    #[error("the map refuses keyframe {keyframe}: {source} (check its pose)")]
    Keyframe {
        /// Number of the keyframe.
        keyframe: usize,
        /// Why.
        source: TransactionError,
    },
    /// A point of a model names a view that does not exist.
    #[error("point {point} of the model is seen by view {view}, but there are {views} views")]
    UnknownView {
        /// Index of the point.
        point: usize,
        /// The view named.
        view: u32,
        /// Number of views.
        views: usize,
    },
    /// The carver refuses a view of a model.
    #[error("view {name} of the model cannot be used: {source} (check its pose)")]
    View {
        /// Its name.
        name: String,
        /// Why.
        source: TransactionError,
    },
    /// The carver refuses a point of a model.
    #[error("point {point} of the model cannot be used: {source}")]
    Point {
        /// Index of the point.
        point: usize,
        /// Why.
        source: TransactionError,
    },
    /// The keyframe comes from another kind of front end than the map is made for.
    #[error("the keyframe is not of the kind that this map is made of")]
    WrongKeyframe,
}
