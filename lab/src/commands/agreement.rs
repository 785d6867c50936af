//! `linecarve-lab agreement`: how much of one set of lines another has.

use std::path::Path;

use anyhow::ensure;
use linecarve::commands::Outcome;
use linecarve_lab::tables::agreement::agreement;
use linecarve_mesh::{Shape, read_geometry};

use super::{print_json, print_text};
use crate::cli::AgreementArgs;

pub(super) fn run(args: &AgreementArgs) -> anyhow::Result<Outcome> {
    let within = args.within;
    ensure!(
        within.is_finite() && within > 0.0,
        "--within {within}: a length above 0 is needed"
    );
    let found = agreement(&lines(&args.lines)?, &lines(&args.reference)?, within);
    if args.json {
        print_json(&found)?;
    } else {
        print_text(&format!(
            "{:.1} % of the length of the reference ({:.2}) has a line within {within}\n\
             {:.1} % of the length of the lines ({:.2}) has a reference line within {within}\n",
            100.0 * found.recall,
            found.reference_length,
            100.0 * found.precision,
            found.length,
        ))?;
    }
    Ok(Outcome::Done)
}

fn lines(path: &Path) -> anyhow::Result<Shape> {
    let shape = read_geometry(path)?;
    ensure!(
        !shape.lines.is_empty(),
        "{}: it holds no lines",
        path.display()
    );
    Ok(shape)
}
