//! `linecarve diff`: whether two meshes are the same.

use std::path::Path;

use anyhow::Context;

use crate::cli::DiffArgs;
use crate::commands::Outcome;
use crate::commands::heat_map::{Colored, write_heat_map};
use crate::sinks::{check_ending, check_outputs, print_object, print_text};
use crate::text::error_text;
use linecarve_mesh::diff::{DiffOptions, Difference, compare, write_junit, write_junit_failure};
use linecarve_mesh::evaluate::{NearestPointIndex, ShapeSummary};
use linecarve_mesh::{Shape, read_geometry};

pub(super) fn run(args: &DiffArgs) -> anyhow::Result<Outcome> {
    let junit = args.junit.as_deref().map(|path| ("--junit", path));
    let heat_map = args.heat_map.as_deref().map(|path| ("--heat-map", path));
    let outputs: Vec<_> = junit.into_iter().chain(heat_map).collect();
    check_outputs(&outputs, &[&args.expected, &args.actual])?;
    if let Some(output) = heat_map {
        check_ending(output, "glb")?;
    }
    let subject = format!("{} {}", name(&args.expected), name(&args.actual));
    let compared = compared(args);
    if let (Err(error), Some(path)) = (&compared, &args.junit) {
        write_junit_failure(path, &subject, &error_text(error))?;
    }
    let (expected, actual, difference) = compared?;
    if let Some(path) = &args.junit {
        write_junit(path, &subject, &difference)?;
    }
    if let Some(path) = &args.heat_map {
        let largest = difference.worst.map_or(0.0, |worst| worst.distance);
        let (to_expected, to_actual) = (
            NearestPointIndex::new(&expected),
            NearestPointIndex::new(&actual),
        );
        let parts = [
            Colored {
                name: "actual",
                distances: to_expected.distances(&actual.positions),
                shape: actual,
            },
            Colored {
                name: "expected",
                distances: to_actual.distances(&expected.positions),
                shape: expected,
            },
        ];
        write_heat_map(path, parts, largest)?;
    }
    if args.json {
        print_object(&difference)?;
    } else {
        print_text(&in_words(&difference))?;
    }
    if difference.is_same {
        return Ok(Outcome::Done);
    }
    let failed: Vec<&str> = difference
        .checks
        .iter()
        .filter(|outcome| !outcome.passed)
        .map(|outcome| outcome.check.name())
        .collect();
    Ok(Outcome::Negative(format!(
        "{} differs from {}: {}",
        args.actual.display(),
        args.expected.display(),
        failed.join(", ")
    )))
}

fn compared(args: &DiffArgs) -> anyhow::Result<(Shape, Shape, Difference)> {
    let expected = read_geometry(&args.expected)?;
    let actual = read_geometry(&args.actual)?;
    let mut options = DiffOptions::default();
    options.tolerance = args.tolerance;
    options.checks = args.check.iter().map(|&check| check.into()).collect();
    options.samples = args.samples;
    options.seed = args.seed;
    let difference = compare(&expected, &actual, &options).with_context(|| {
        format!(
            "{} and {} cannot be compared",
            args.expected.display(),
            args.actual.display()
        )
    })?;
    Ok((expected, actual, difference))
}

fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

fn in_words(difference: &Difference) -> String {
    let size = |facts: &ShapeSummary| {
        format!(
            "{} vertices, {} triangles, {:.4} from corner to corner",
            facts.vertices, facts.triangles, facts.diagonal
        )
    };
    let mut text = format!(
        "expected     {}\nactual       {}\ntolerance    {:.6}\n\n",
        size(&difference.expected),
        size(&difference.actual),
        difference.tolerance
    );
    for outcome in &difference.checks {
        text += &format!(
            "{:<12} {:<9} {}\n",
            outcome.check.name(),
            if outcome.passed { "same" } else { "DIFFERENT" },
            outcome.message
        );
    }
    text
}
