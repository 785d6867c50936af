//! Errors of the map.

use linecarve_carving::TransactionError;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_points::PointOptionsError;

/// A keyframe cannot be added to the map. The map must not be used afterwards.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// A clustering option is out of range.
    #[error(transparent)]
    Cluster(#[from] ClusterOptionsError),
    /// An option of the map points is out of range.
    #[error(transparent)]
    Points(#[from] PointOptionsError),
    /// The carver rejects a camera centre or a point.
    #[error("the map rejects keyframe {keyframe}: {source} (check its pose)")]
    Keyframe {
        /// Number of the keyframe.
        keyframe: usize,
        /// The cause.
        source: TransactionError,
    },
    /// The carver rejects a camera centre or a point of observations.
    #[error("the map rejects the observations: {source} (check poses and points)")]
    Observations {
        /// The cause.
        source: TransactionError,
    },
    /// A point of a model names a view that does not exist.
    #[error("point {point} of the model is seen by view {view}, but there are {views} views")]
    UnknownView {
        /// Index of the point.
        point: usize,
        /// Index of the view.
        view: u32,
        /// Number of views.
        views: usize,
    },
    /// The carver rejects a view of a model.
    #[error("view {name} of the model cannot be used: {source} (check its pose)")]
    View {
        /// Its name.
        name: String,
        /// The cause.
        source: TransactionError,
    },
    /// The keyframe comes from a front end of another kind than the map.
    #[error("the keyframe does not match the kind of this map")]
    WrongKeyframe,
}
