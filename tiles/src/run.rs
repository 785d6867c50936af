//! All stages on one machine.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::error::TilesError;
use crate::stage::Item;
use crate::work::Work;

/// Carries out what is left of a plan, stage by stage, with `jobs` calls of `execute` at a time. Files of items that are done are
/// verified first; damaged ones are made again. Returns the number of items carried out.
///
/// # Errors
/// The first error of an item; others of its stage that had begun are waited for.
pub fn run<E: From<TilesError> + Send>(
    work: &Work,
    jobs: usize,
    execute: impl Fn(Item) -> Result<(), E> + Sync,
) -> Result<usize, E> {
    work.verify_plan()?;
    work.remove_unfinished();
    let mut carried_out = 0;
    for stage in work.stages() {
        let mut pending: Vec<Item> = Vec::new();
        for item in work.items(stage) {
            let was_damaged = work.verify(item)?;
            if was_damaged || work.done(item).is_none() {
                pending.push(item);
            }
        }
        carried_out += pending.len();
        run_pending(&pending, jobs, &execute)?;
    }
    Ok(carried_out)
}

/// Carries out tasks that do not depend on each other, with `jobs` calls of `execute` at a time.
///
/// # Errors
/// The first error of a task; others that had begun are waited for.
pub fn run_pending<T: Copy + Sync, E: Send>(
    pending: &[T],
    jobs: usize,
    execute: impl Fn(T) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let failed: Mutex<Option<E>> = Mutex::new(None);
    let first_error = || failed.lock().unwrap_or_else(PoisonError::into_inner);
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, pending.len().max(1)) {
            scope.spawn(|| {
                while let Some(&task) = pending.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if first_error().is_some() {
                        break;
                    }
                    if let Err(error) = execute(task) {
                        first_error().get_or_insert(error);
                    }
                }
            });
        }
    });
    match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}
