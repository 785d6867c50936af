//! `linecarve tiles stages` and `check`: what is done, and whether it is whole.

use std::io::Write;
use std::path::Path;

use crate::commands::Outcome;
use linecarve_engine::tiles::Project;

/// Prints every task with its state.
pub(super) fn stages(project: &Project, is_json: bool) -> anyhow::Result<Outcome> {
    let all = project.stages().into_iter();
    let mut items = Vec::new();
    let mut lines = String::new();
    for task in all.flat_map(|stage| project.tasks(stage)) {
        let manifest = project.done(task);
        let state = if manifest.is_some() { "done" } else { "to do" };
        lines += &format!("{task}: {state}\n");
        items.push(serde_json::json!({
            "stage": task.stage.name(), "item": task.number, "done": manifest.is_some(), "manifest": manifest,
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
pub(super) fn check(folder: &Path) -> anyhow::Result<Outcome> {
    let opened = Project::open(folder).and_then(|project| {
        project.verify_plan()?;
        Ok(project)
    });
    let project = match opened {
        Err(fault) if fault.is_damaged_plan() => return Ok(Outcome::Negative(fault.to_string())),
        opened => opened?,
    };
    let mut damaged = Vec::new();
    let all = project.stages().into_iter();
    for task in all.flat_map(|stage| project.tasks(stage)) {
        if project.verify(task)? {
            damaged.push(task.to_string());
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
