//! Why a transaction is refused.

use thiserror::Error;

use super::ids::{PointId, SampleId, ViewId};
use crate::tetrahedralization::PointError;

/// Why a transaction, or a change that was to be part of it, is refused. The carver is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum TransactionError {
    /// The point was removed or never added.
    #[error("there is no point {}; it was removed or never added", point.0)]
    UnknownPoint {
        /// The id given.
        point: PointId,
    },
    /// The view was removed or never added.
    #[error("there is no view {}; it was removed or never added", view.0)]
    UnknownView {
        /// The id given.
        view: ViewId,
    },
    /// The sample was removed or never added.
    #[error("there is no sample {}; it was removed or never added", sample.0)]
    UnknownSample {
        /// The id given.
        sample: SampleId,
    },
    /// The view does not see the point.
    #[error("view {} does not see point {}; it never did or the observation was removed", view.0, point.0)]
    UnknownObservation {
        /// The view given.
        view: ViewId,
        /// The point given.
        point: PointId,
    },
    /// A position or centre is NaN, infinite or out of range.
    #[error("position refused: {0}")]
    Position(#[from] PointError),
    /// A standard deviation is negative, NaN or infinite.
    #[error("the standard deviation {sigma} of point {} is refused; it must be finite and not negative", point.0)]
    Sigma {
        /// The point.
        point: PointId,
        /// The value given.
        sigma: f64,
    },
    /// A weight of zero.
    #[error("the observation of point {} by view {} has weight 0; expected at least 1", point.0, view.0)]
    ZeroWeight {
        /// The view.
        view: ViewId,
        /// The point.
        point: PointId,
    },
    /// Weights of one observation add up to more than 32 bits hold.
    #[error("the weight of the observation of point {} by view {} exceeds {}", point.0, view.0, u32::MAX)]
    WeightOverflow {
        /// The view.
        view: ViewId,
        /// The point.
        point: PointId,
    },
    /// After the transaction a point would be at the centre of a view that sees it: a ray of length zero.
    #[error("point {} is at the centre of view {}, which sees it; drop the observation or the point", point.0, view.0)]
    ZeroLengthRay {
        /// The view.
        view: ViewId,
        /// The point.
        point: PointId,
    },
    /// Ids are 32 bits wide and none is left.
    #[error("no room for more points, views, observations or samples")]
    Full,
}
