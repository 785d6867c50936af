//! Changes as values, so that sequences of them can be generated.

use nalgebra::Point3;

use super::super::{
    Carver, CommitReport, PointId, SampleId, Transaction, TransactionError, ViewId,
};

/// One change of the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Event {
    AddView {
        center: Point3<f64>,
    },
    AddPoint {
        position: Point3<f64>,
    },
    SetSigma {
        point: PointId,
        sigma: Option<f64>,
    },
    AddObservation {
        view: ViewId,
        point: PointId,
        weight: u32,
    },
    RemoveView {
        view: ViewId,
    },
    RemovePoint {
        point: PointId,
    },
    RemoveObservation {
        view: ViewId,
        point: PointId,
    },
    MoveView {
        view: ViewId,
        center: Point3<f64>,
    },
    MovePoint {
        point: PointId,
        position: Point3<f64>,
    },
    AddSample {
        position: Point3<f64>,
        weight: i32,
    },
    ChangeSample {
        sample: SampleId,
        by: i32,
    },
    RemoveSample {
        sample: SampleId,
    },
}

impl Event {
    /// Adds the change to a transaction.
    pub(super) fn push(self, transaction: &mut Transaction<'_>) -> Result<(), TransactionError> {
        match self {
            Event::AddView { center } => transaction.add_view(center).map(|_| ()),
            Event::AddPoint { position } => transaction.add_point(position).map(|_| ()),
            Event::SetSigma { point, sigma } => transaction.set_sigma(point, sigma),
            Event::AddObservation {
                view,
                point,
                weight,
            } => transaction.add_observation(view, point, weight),
            Event::RemoveView { view } => transaction.remove_view(view),
            Event::RemovePoint { point } => transaction.remove_point(point),
            Event::RemoveObservation { view, point } => transaction.remove_observation(view, point),
            Event::MoveView { view, center } => transaction.move_view(view, center),
            Event::MovePoint { point, position } => transaction.move_point(point, position),
            Event::AddSample { position, weight } => {
                transaction.add_sample(position, weight).map(|_| ())
            }
            Event::ChangeSample { sample, by } => transaction.change_sample(sample, by),
            Event::RemoveSample { sample } => transaction.remove_sample(sample),
        }
    }
}

/// Makes changes in one transaction.
pub(super) fn apply(
    carver: &mut Carver,
    events: &[Event],
) -> Result<CommitReport, TransactionError> {
    let mut transaction = carver.transaction();
    for &event in events {
        event.push(&mut transaction)?;
    }
    transaction.commit()
}
