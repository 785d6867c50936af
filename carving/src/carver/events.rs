//! What may happen to a carver, and why it may be refused.

use nalgebra::Point3;
use thiserror::Error;

use super::ids::{PointId, ViewId};
use crate::tetrahedralization::PointError;

/// One change of the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A view with its centre; it is given the next view id.
    AddView {
        /// The centre.
        center: Point3<f64>,
    },
    /// A point; it is given the next point id. Any number of points may have the same position.
    AddPoint {
        /// The position.
        position: Point3<f64>,
    },
    /// A point is known this well; see [`Transaction::set_sigma`](super::Transaction::set_sigma).
    SetSigma {
        /// The point.
        point: PointId,
        /// Standard deviation in units of the coordinates; `None`: unknown.
        sigma: Option<f64>,
    },
    /// A view sees a point. Seen again, the weights add up.
    AddObservation {
        /// Who sees.
        view: ViewId,
        /// What is seen.
        point: PointId,
        /// At least 1.
        weight: u32,
    },
    /// A view ceases to exist with all its observations.
    RemoveView {
        /// The view.
        view: ViewId,
    },
    /// A point ceases to exist with all its observations.
    RemovePoint {
        /// The point.
        point: PointId,
    },
    /// An observation ceases to exist, whatever its weight.
    RemoveObservation {
        /// Who saw.
        view: ViewId,
        /// What was seen.
        point: PointId,
    },
    /// A view is elsewhere; its observations stay.
    MoveView {
        /// The view.
        view: ViewId,
        /// The new centre.
        center: Point3<f64>,
    },
    /// A point is elsewhere; its observations stay.
    MovePoint {
        /// The point.
        point: PointId,
        /// The new position.
        position: Point3<f64>,
    },
    /// A view sees the whole segment between two points: the triangle between its centre and the segment is free of
    /// matter. Seen again, the weights add up. The rays to the end points are events of their own.
    AddSegment {
        /// Who sees.
        view: ViewId,
        /// The points at the ends of the segment, in any order.
        ends: [PointId; 2],
        /// At least 1.
        weight: u32,
    },
    /// A view does not see a segment any more, whatever its weight.
    RemoveSegment {
        /// Who saw.
        view: ViewId,
        /// The points at the ends of the segment, in any order.
        ends: [PointId; 2],
    },
}

/// Why an event, or the transaction it belongs to, was refused. The state is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum EventError {
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
    /// The view does not see the point.
    #[error("view {} does not see point {}; it never did or the observation was removed", view.0, point.0)]
    UnknownObservation {
        /// The view given.
        view: ViewId,
        /// The point given.
        point: PointId,
    },
    /// The view does not see the segment.
    #[error(
        "view {} does not see the segment of points {} and {}; it never did or it was removed",
        view.0, ends[0].0, ends[1].0
    )]
    UnknownSegment {
        /// The view given.
        view: ViewId,
        /// The points given.
        ends: [PointId; 2],
    },
    /// A segment with a weight of zero, or with a sum of weights that 32 bits do not hold.
    #[error(
        "the segment of points {} and {} seen by view {} has a weight of 0, or of more than {} in sum",
        ends[0].0, ends[1].0, view.0, u32::MAX
    )]
    SegmentWeight {
        /// The view given.
        view: ViewId,
        /// The points given.
        ends: [PointId; 2],
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
    #[error("the observation of point {} by view {} has weight 0; leave it out", point.0, view.0)]
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
    /// After all events of the transaction a view sees a point that is at its very centre: a ray of no length.
    #[error("point {} is at the centre of view {}, which sees it; drop the observation or the point", point.0, view.0)]
    ZeroLengthRay {
        /// The view.
        view: ViewId,
        /// The point.
        point: PointId,
    },
    /// Ids are 32 bits wide and none is left.
    #[error("no room for more points, views or observations")]
    Full,
}
