//! The Python module `linecarve._linecarve`; `linecarve/_linecarve.pyi` documents it for users.

mod arrays;
mod carver;
mod mesh;
mod meshing;
mod reconstruct;

use clap::Parser;
use linecarve::cli::Cli;
use linecarve::commands::{self, Outcome};
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    linecarve,
    Error,
    PyException,
    "The program cannot do what is asked for."
);
create_exception!(
    linecarve,
    EmptyMeshError,
    Error,
    "A reconstruction ended without a triangle."
);

/// Runs the program; returns its exit status.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<String>) -> u8 {
    let run = move || match Cli::try_parse_from(arguments) {
        Err(error) => {
            // Nothing can be said when this fails.
            let _ = error.print();
            u8::try_from(error.exit_code()).unwrap_or(2)
        }
        Ok(cli) => match commands::run(&cli) {
            Ok(Outcome::Done) => 0,
            Ok(Outcome::Negative(reason)) => {
                eprintln!("linecarve: {reason}");
                1
            }
            Err(error) => {
                eprintln!("linecarve: {}", linecarve::error_text(&error));
                2
            }
        },
    };
    py.detach(run)
}

#[pymodule]
fn _linecarve(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", py.get_type::<Error>())?;
    module.add("EmptyMeshError", py.get_type::<EmptyMeshError>())?;
    module.add_class::<mesh::Mesh>()?;
    module.add_class::<mesh::Lines>()?;
    module.add_class::<reconstruct::Reconstruction>()?;
    module.add_class::<carver::Carver>()?;
    module.add_class::<carver::Transaction>()?;
    module.add_class::<carver::Commit>()?;
    module.add_function(wrap_pyfunction!(reconstruct::reconstruct, module)?)?;
    module.add_function(wrap_pyfunction!(meshing::mesh, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}
