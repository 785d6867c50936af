//! `linecarve.delaunay_meshing`: the command `mesh`.

use clap::Parser;
use linecarve::cli::{Cli, Command};
use linecarve::commands::{self, Outcome};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::{EmptyMeshError, Error};

/// Runs `linecarve mesh` with these arguments.
#[pyfunction]
pub(crate) fn mesh(py: Python<'_>, arguments: Vec<String>) -> PyResult<()> {
    let start = ["linecarve", "--quiet", "mesh"].map(str::to_owned);
    let cli = Cli::try_parse_from(start.into_iter().chain(arguments)).map_err(|error| {
        let message = error.to_string();
        PyValueError::new_err(message.trim_start_matches("error: ").trim_end().to_owned())
    })?;
    if !matches!(cli.command, Command::Mesh(_)) {
        return Err(PyValueError::new_err("not the command mesh"));
    }
    match py.detach(|| commands::run(&cli)) {
        Ok(Outcome::Done) => Ok(()),
        Ok(Outcome::Negative(reason)) => Err(EmptyMeshError::new_err(reason)),
        Err(error) => Err(Error::new_err(linecarve::error_text(&error))),
    }
}
