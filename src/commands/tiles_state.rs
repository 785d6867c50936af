//! `linecarve tiles stages` and `check`: what is done, and whether it is whole.

use std::io::Write;

use linecarve_tiles::{Stage, Work};

use crate::commands::Outcome;

/// Prints every task with its state.
pub(super) fn stages(work: &Work, is_json: bool) -> anyhow::Result<Outcome> {
    let all = Stage::of(work).into_iter();
    let mut items = Vec::new();
    let mut lines = String::new();
    for item in all.flat_map(|stage| stage.items(work)) {
        let manifest = work.done(item);
        let state = if manifest.is_some() { "done" } else { "to do" };
        lines += &format!("{item}: {state}\n");
        items.push(serde_json::json!({
            "stage": item.stage.name(), "item": item.number, "done": manifest.is_some(), "manifest": manifest,
        }));
    }
    let mut stdout = std::io::stdout().lock();
    match is_json {
        true => writeln!(stdout, "{}", serde_json::json!({ "items": items }))?,
        false => write!(stdout, "{lines}")?,
    }
    Ok(Outcome::Done)
}

/// Verifies the plan and all results; damaged results are taken back.
pub(super) fn check(work: &Work) -> anyhow::Result<Outcome> {
    work.verify_plan()?;
    let mut damaged = Vec::new();
    let all = Stage::of(work).into_iter();
    for item in all.flat_map(|stage| stage.items(work)) {
        if work.verify(item)? {
            damaged.push(item.to_string());
        }
    }
    let damaged = damaged.join(", ");
    Ok(match damaged.as_str() {
        "" => Outcome::Done,
        _ => Outcome::Negative(format!(
            "damaged, to be made again by the next run: {damaged}"
        )),
    })
}
