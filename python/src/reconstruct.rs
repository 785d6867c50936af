//! `linecarve.reconstruct`: the command with its options.

use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use clap::Parser;
use linecarve::Reconstruction as Run;
use linecarve::cli::{Cli, Command};
use linecarve::commands::{Outcome, reconstruct as run_command};
use linecarve::process::WatchError;
use linecarve::progress::Verbosity;
use linecarve::run::CancelToken;
use linecarve_mesh::TriangleMesh;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyList, PyTuple};

use crate::mesh::{Lines, Mesh};
use crate::{EmptyMeshError, Error};

/// How often a run that goes on looks for Ctrl-C.
const PAUSE: Duration = Duration::from_millis(50);

/// The surface of a sequence, and what it was made from.
#[pyclass(module = "linecarve", extends = Mesh, frozen)]
pub(crate) struct Reconstruction {
    #[pyo3(get)]
    segments: Py<Lines>,
    #[pyo3(get)]
    clusters: Py<Lines>,
    #[pyo3(get)]
    keyframes: Vec<String>,
    #[pyo3(get)]
    poses: Py<PyArray3<f64>>,
}

impl Reconstruction {
    fn new(py: Python<'_>, run: &Run, mesh: &TriangleMesh) -> PyResult<Py<Self>> {
        let recording = run.recording();
        let all = recording.keyframe_poses();
        let mut poses = Vec::with_capacity(16 * run.numbers().len());
        for &number in run.numbers() {
            let mut pose = all[number];
            pose.translation.vector += recording.origin;
            poses.extend(pose.to_homogeneous().transpose().iter());
        }
        let count = run.numbers().len();
        let names = run.numbers().iter();
        let this = Self {
            segments: Py::new(py, Lines::of(py, &run.segments())?)?,
            clusters: Py::new(py, Lines::of(py, &run.clusters())?)?,
            keyframes: names
                .map(|number| recording.keyframe_name(*number).to_owned())
                .collect(),
            poses: poses.into_pyarray(py).reshape([count, 4, 4])?.unbind(),
        };
        let initializer = PyClassInitializer::from(Mesh::of(py, mesh)?).add_subclass(this);
        Py::new(py, initializer)
    }
}

/// `max_keyframes=20` as `--max-keyframes 20`.
fn argument(name: &str, value: &Bound<'_, PyAny>, arguments: &mut Vec<String>) -> PyResult<()> {
    let option = format!("--{}", name.trim_end_matches('_').replace('_', "-"));
    if value.is_none() {
        return Ok(());
    }
    if let Ok(flag) = value.cast::<PyBool>() {
        if flag.is_true() {
            arguments.push(option);
        }
        return Ok(());
    }
    let is_list = value.cast::<PyList>().is_ok() || value.cast::<PyTuple>().is_ok();
    let text = match is_list {
        true => {
            let parts: PyResult<Vec<String>> = value
                .try_iter()?
                .map(|part| Ok(part?.str()?.to_string()))
                .collect();
            parts?.join(",")
        }
        false => value.str()?.to_string(),
    };
    arguments.push(format!("{option}={text}"));
    Ok(())
}

/// The surface of a sequence of images with poses.
#[pyfunction]
#[pyo3(signature = (path, out = None, **options))]
pub(crate) fn reconstruct(
    py: Python<'_>,
    path: PathBuf,
    out: Option<PathBuf>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Py<Reconstruction>> {
    let text = |path: &PathBuf| {
        let text = path.to_str().map(str::to_owned);
        text.ok_or_else(|| PyTypeError::new_err(format!("{}: not UTF-8", path.display())))
    };
    let folder = out.as_ref().map_or(Ok(".".to_owned()), text)?;
    let mut arguments = vec!["linecarve".to_owned(), "reconstruct".to_owned()];
    arguments.push(format!("--out={folder}"));
    for (name, value) in options.into_iter().flatten() {
        argument(&name.extract::<String>()?, &value, &mut arguments)?;
    }
    arguments.extend(["--".to_owned(), text(&path)?]);
    let cli = Cli::try_parse_from(arguments).map_err(|error| {
        let message = error.to_string();
        PyValueError::new_err(message.trim_start_matches("error: ").trim_end().to_owned())
    })?;
    let verbosity = match cli.verbose {
        0 => Verbosity::Quiet,
        _ => Verbosity::Verbose,
    };
    let Command::Reconstruct(args) = cli.command else {
        return Err(PyValueError::new_err("not the command reconstruct"));
    };
    let limit = args.memory_limit;
    let token = CancelToken::with_limit(limit)
        .map_err(|error| Error::new_err(WatchError::from(error).to_string()))?;
    let cancel = token.clone();
    let (sender, receiver) = channel();
    let worker = std::thread::spawn(move || {
        let watch = |is_model_at_once: bool| match is_model_at_once && limit.is_some() {
            true => Err(WatchError::AtOnce),
            false => Ok(token),
        };
        let done = run_command(&args, out.as_deref(), verbosity, watch);
        // The receiver is gone only when the interpreter is.
        let _ = sender.send(done);
    });
    let receiver = std::sync::Mutex::new(receiver);
    let mut interrupt = None;
    let done = loop {
        let waited = py.detach(|| match receiver.lock() {
            Ok(receiver) => receiver.recv_timeout(PAUSE),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        match waited {
            Ok(done) => break done,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::new_err("the reconstruction ended unexpectedly"));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(error) = py.check_signals() {
            cancel.cancel();
            interrupt = Some(error);
        }
    };
    let _ = worker.join();
    if let Some(error) = interrupt {
        return Err(error);
    }
    let (outcome, run, mesh) =
        done.map_err(|error| Error::new_err(linecarve::error_text(&error)))?;
    match outcome {
        Outcome::Negative(reason) if mesh.is_empty() => Err(EmptyMeshError::new_err(reason)),
        Outcome::Negative(reason) => Err(Error::new_err(reason)),
        Outcome::Done => Reconstruction::new(py, &run, &mesh),
    }
}
