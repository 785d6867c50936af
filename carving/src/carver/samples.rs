//! Samples: positions that were measured to be free or occupied.

use std::collections::hash_map::Entry;

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::Carver;
use super::error::TransactionError;
use super::ids::SampleId;
use super::transaction::{Plan, Transaction};
use crate::tetrahedralization::{Changes, accept_position};
use crate::visibility::Samples;

/// The net effect of a transaction on samples.
#[derive(Clone, Debug, Default)]
pub(super) struct PlannedSamples {
    /// New samples in order of their ids; `None` if removed again.
    new: Vec<Option<([f64; 3], i32)>>,
    /// Final weights of others; `None` if removed.
    weights: FxHashMap<u32, Option<i32>>,
}

impl Carver {
    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.samples.len()
    }

    /// Position and weight of a sample; `None` if it was removed or never added.
    pub fn sample(&self, sample: SampleId) -> Option<(Point3<f64>, i32)> {
        let (position, weight) = self.samples.get(sample.0)?;
        Some((position.into(), weight))
    }

    /// Ids of all samples, increasing.
    pub fn samples(&self) -> impl Iterator<Item = SampleId> + '_ {
        self.samples.ids().map(SampleId)
    }

    /// Changes samples, and makes cells and evidence follow; `changes` are those of the cells, whose sums have been reset, as
    /// those of all cells if `are_reset`.
    pub(super) fn update_samples(&mut self, plan: &Plan, changes: &Changes, are_reset: bool) {
        self.samples.orphan(changes);
        self.enter_samples(plan, are_reset);
        self.samples
            .locate(&self.tetrahedra, &mut self.cells.evidence, are_reset);
    }

    /// Changes samples and, unless they have been reset, the sums that they add to.
    pub(super) fn enter_samples(&mut self, plan: &Plan, are_reset: bool) {
        let (samples, tetrahedra) = (&mut self.samples, &self.tetrahedra);
        let evidence = &mut self.cells.evidence;
        let mut removed = Vec::new();
        for (&id, &weight) in &plan.samples.weights {
            let sums = (!are_reset).then_some(&mut *evidence);
            match weight {
                Some(weight) => samples.set_weight(tetrahedra, id, weight, sums),
                None => removed.push(id),
            }
        }
        samples.reserve(plan.samples.new.len());
        for sample in &plan.samples.new {
            // The id is used even if the sample was removed again.
            let (position, weight) = sample.unwrap_or_default();
            let id = samples.insert(position, weight);
            if sample.is_none() {
                removed.push(id);
            }
        }
        // In this order they are given out again.
        removed.sort_unstable();
        for id in removed {
            let sums = (!are_reset).then_some(&mut *evidence);
            samples.remove(tetrahedra, id, sums);
        }
    }
}

impl Transaction<'_> {
    /// Current weight of a sample, to be changed.
    fn sample_mut(&mut self, sample: SampleId) -> Result<Change<'_>, TransactionError> {
        let unknown = TransactionError::UnknownSample { sample };
        let PlannedSamples { new, weights } = &mut self.plan.samples;
        let samples = &self.carver.samples;
        if let Some(number) = samples.new_number(sample.0) {
            let new = new.get_mut(number).filter(|new| new.is_some());
            return new.map(Change::New).ok_or(unknown);
        }
        match (weights.entry(sample.0), samples.get(sample.0)) {
            (Entry::Occupied(planned), _) if planned.get().is_none() => Err(unknown),
            (planned, Some((_, weight))) => Ok(Change::Old(planned.or_insert(Some(weight)))),
            (_, None) => Err(unknown),
        }
    }

    /// Adds a sample: a position that was measured to be free, if its weight is positive, or to be occupied, if it is negative.
    /// 256 is the weight of a ray of weight 1.
    ///
    /// Each sample is evidence about the one cell that holds it; outside the hull of the points it counts nothing. On the
    /// boundary of cells, the one in direction (1, e, e²) counts, e infinitely small. [`Labels::Votes`](crate::Labels::Votes)
    /// ignores samples.
    ///
    /// Ids of samples that were removed by an earlier transaction are given out again.
    ///
    /// # Errors
    ///
    /// [`TransactionError::Position`] when the position is NaN or out of range; [`TransactionError::Full`].
    pub fn add_sample(
        &mut self,
        position: Point3<f64>,
        weight: i32,
    ) -> Result<SampleId, TransactionError> {
        let position = accept_position(&position)?;
        let new = &mut self.plan.samples.new;
        let id = self.carver.samples.new_id(new.len());
        if id >= Samples::MAX_SAMPLES {
            return Err(TransactionError::Full);
        }
        new.push(Some((position, weight)));
        Ok(SampleId(id as u32))
    }

    /// Adds to the weight of a sample, which stays within 32 bits. A sample of weight zero is kept.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownSample`].
    pub fn change_sample(&mut self, sample: SampleId, by: i32) -> Result<(), TransactionError> {
        match self.sample_mut(sample)? {
            Change::New(Some((_, weight))) | Change::Old(Some(weight)) => {
                *weight = weight.saturating_add(by);
                Ok(())
            }
            _ => Err(TransactionError::UnknownSample { sample }),
        }
    }

    /// Removes a sample.
    ///
    /// # Errors
    ///
    /// [`TransactionError::UnknownSample`].
    pub fn remove_sample(&mut self, sample: SampleId) -> Result<(), TransactionError> {
        match self.sample_mut(sample)? {
            Change::New(new) => *new = None,
            Change::Old(weight) => *weight = None,
        }
        Ok(())
    }
}

/// The pending state of a sample that exists.
enum Change<'a> {
    New(&'a mut Option<([f64; 3], i32)>),
    Old(&'a mut Option<i32>),
}
