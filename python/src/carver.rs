//! The carver, and transactions on arrays.

use std::num::NonZeroU64;

use linecarve_carving::{
    CarverOptions, CommitReport, CutOptions, ExportOptions, Hull, Labels, PointId,
    Transaction as Change, TransactionError, VertexId, ViewId, Votes,
};
use nalgebra::Point3;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::arrays::{Integers, Positions, Reals, check_count, points, rows};
use crate::mesh::Mesh;

/// Free space carved by rays, and the surface around it.
#[pyclass(module = "linecarve")]
pub(crate) struct Carver {
    inner: linecarve_carving::Carver,
}

#[pymethods]
impl Carver {
    #[new]
    #[pyo3(signature = (labels = "votes", hull = "drop", *, threshold = None, relative_sigma = None, behind_sigmas = None, matter_weight = None, quality_weight = None))]
    fn new(
        labels: &str,
        hull: &str,
        threshold: Option<u64>,
        relative_sigma: Option<f64>,
        behind_sigmas: Option<f64>,
        matter_weight: Option<f64>,
        quality_weight: Option<f64>,
    ) -> PyResult<Self> {
        let refused = |text: String| Err(PyValueError::new_err(text));
        let of_cut = [relative_sigma, behind_sigmas, matter_weight, quality_weight];
        let labels = match labels {
            "votes" if of_cut.iter().any(Option::is_some) => {
                return refused("sigmas and weights are options of labels=\"cut\"".to_owned());
            }
            "votes" => match NonZeroU64::new(threshold.unwrap_or(1)) {
                Some(threshold) => Labels::Votes(Votes { threshold }),
                None => return refused("threshold must be at least 1".to_owned()),
            },
            "cut" if threshold.is_some() => {
                return refused("threshold is an option of labels=\"votes\"".to_owned());
            }
            "cut" => {
                let default = CutOptions::default();
                let mut options = CutOptions::default();
                options.relative_sigma = relative_sigma.unwrap_or(default.relative_sigma);
                options.behind_sigmas = behind_sigmas.unwrap_or(default.behind_sigmas);
                options.matter_weight = matter_weight.unwrap_or(default.matter_weight);
                options.quality_weight = quality_weight.unwrap_or(default.quality_weight);
                options
                    .validate()
                    .map_err(|error| PyValueError::new_err(error.to_string()))?;
                Labels::Cut(options)
            }
            other => return refused(format!("labels={other:?}: give \"votes\" or \"cut\"")),
        };
        let hull = match hull {
            "drop" => Hull::Drop,
            "keep" => Hull::Keep,
            other => return refused(format!("hull={other:?}: give \"drop\" or \"keep\"")),
        };
        let inner = linecarve_carving::Carver::new(CarverOptions::new(labels, hull));
        Ok(Self { inner })
    }

    fn transaction(carver: Bound<'_, Self>) -> Transaction {
        let first = {
            let carver = carver.borrow();
            (carver.inner.next_point(), carver.inner.next_view())
        };
        Transaction {
            carver: carver.unbind(),
            first,
            points: 0,
            views: 0,
            operations: Some(Vec::new()),
        }
    }

    #[pyo3(signature = (longest_edge = None, minimum_component = 1, manifold = false))]
    fn surface(
        &self,
        py: Python<'_>,
        longest_edge: Option<f64>,
        minimum_component: usize,
        manifold: bool,
    ) -> PyResult<Mesh> {
        let mut options = ExportOptions::default();
        options.longest_edge = longest_edge;
        options.minimum_component = minimum_component;
        options.manifold = manifold;
        let carver = &self.inner;
        let mesh = py.detach(|| carver.mesh(&options));
        Mesh::new(py, &mesh.vertices, &mesh.triangles, None)
    }

    fn vertex_positions(
        &self,
        py: Python<'_>,
        vertices: Integers<'_>,
    ) -> PyResult<Py<PyArray2<f64>>> {
        let tetrahedra = self.inner.tetrahedra();
        let position = |number: u32| {
            let vertex = VertexId::from_index(number as usize);
            let is_vertex = (number as usize) < tetrahedra.vertex_capacity()
                && !vertex.is_ghost()
                && tetrahedra.is_vertex(vertex);
            if !is_vertex {
                let text = format!("there is no vertex {number} any more");
                return Err(PyValueError::new_err(text));
            }
            let position = tetrahedra.position(vertex);
            Ok([position.x, position.y, position.z])
        };
        let positions: PyResult<Vec<[f64; 3]>> = vertices
            .list("vertices")?
            .into_iter()
            .map(position)
            .collect();
        rows(py, positions?.into_iter())
    }

    #[getter]
    fn point_count(&self) -> usize {
        self.inner.point_count()
    }

    #[getter]
    fn view_count(&self) -> usize {
        self.inner.view_count()
    }

    #[getter]
    fn ray_count(&self) -> usize {
        self.inner.ray_count()
    }

    #[getter]
    fn cell_count(&self) -> usize {
        self.inner.tetrahedra().finite_cell_count()
    }

    #[getter]
    fn triangle_count(&self) -> usize {
        self.inner.triangle_count()
    }
}

/// A change that a transaction will make.
enum Operation {
    AddPoints(Vec<Point3<f64>>, Option<Vec<f64>>),
    AddViews(Vec<Point3<f64>>),
    AddObservations(Vec<u32>, Vec<u32>, Vec<u32>),
    SetSigma(Vec<u32>, Vec<f64>),
    MovePoints(Vec<u32>, Vec<Point3<f64>>),
    MoveViews(Vec<u32>, Vec<Point3<f64>>),
    RemovePoints(Vec<u32>),
    RemoveViews(Vec<u32>),
    RemoveObservations(Vec<u32>, Vec<u32>),
}

impl Operation {
    fn apply(&self, change: &mut Change<'_>) -> Result<(), TransactionError> {
        match self {
            Self::AddPoints(positions, sigmas) => {
                for (index, position) in positions.iter().enumerate() {
                    let point = change.add_point(*position)?;
                    if let Some(sigmas) = sigmas {
                        change.set_sigma(point, finite(sigmas[index]))?;
                    }
                }
            }
            Self::AddViews(centers) => {
                for center in centers {
                    change.add_view(*center)?;
                }
            }
            Self::AddObservations(views, points, weights) => {
                for ((&view, &point), &weight) in views.iter().zip(points).zip(weights) {
                    change.add_observation(ViewId(view), PointId(point), weight)?;
                }
            }
            Self::SetSigma(points, sigmas) => {
                for (&point, &sigma) in points.iter().zip(sigmas) {
                    change.set_sigma(PointId(point), finite(sigma))?;
                }
            }
            Self::MovePoints(points, positions) => {
                for (&point, position) in points.iter().zip(positions) {
                    change.move_point(PointId(point), *position)?;
                }
            }
            Self::MoveViews(views, centers) => {
                for (&view, center) in views.iter().zip(centers) {
                    change.move_view(ViewId(view), *center)?;
                }
            }
            Self::RemovePoints(points) => {
                for &point in points {
                    change.remove_point(PointId(point))?;
                }
            }
            Self::RemoveViews(views) => {
                for &view in views {
                    change.remove_view(ViewId(view))?;
                }
            }
            Self::RemoveObservations(views, points) => {
                for (&view, &point) in views.iter().zip(points) {
                    change.remove_observation(ViewId(view), PointId(point))?;
                }
            }
        }
        Ok(())
    }
}

/// NaN stands for no deviation of its own.
fn finite(sigma: f64) -> Option<f64> {
    (!sigma.is_nan()).then_some(sigma)
}

/// Changes that take effect together.
#[pyclass(module = "linecarve")]
pub(crate) struct Transaction {
    carver: Py<Carver>,
    /// Ids of the first new point and view.
    first: (PointId, ViewId),
    /// Number of new points.
    points: usize,
    /// Number of new views.
    views: usize,
    /// `None` after it ended.
    operations: Option<Vec<Operation>>,
}

impl Transaction {
    fn note(&mut self, operation: Operation) -> PyResult<()> {
        match &mut self.operations {
            Some(operations) => {
                operations.push(operation);
                Ok(())
            }
            None => Err(ended()),
        }
    }
}

fn ended() -> PyErr {
    PyRuntimeError::new_err("the transaction has ended: begin another with carver.transaction()")
}

/// So many ids, from one on.
fn ids(py: Python<'_>, first: u32, known: usize, count: usize) -> PyResult<Py<PyArray1<u32>>> {
    let range = || {
        let start = first.checked_add(u32::try_from(known).ok()?)?;
        Some(start..start.checked_add(u32::try_from(count).ok()?)?)
    };
    let range = range().ok_or_else(|| PyValueError::new_err("the carver is full"))?;
    Ok(range.collect::<Vec<u32>>().into_pyarray(py).unbind())
}

/// Numbers of the same length, of two lists of which one may be one number for all.
fn together(
    (one, one_name): (&Integers<'_>, &str),
    (other, other_name): (&Integers<'_>, &str),
) -> PyResult<(Vec<u32>, Vec<u32>)> {
    // As numpy does: one alone stands for all.
    let count = match one.count() {
        1 => other.count(),
        count => count,
    };
    Ok((
        one.spread(count, one_name)?,
        other.spread(count, other_name)?,
    ))
}

#[pymethods]
impl Transaction {
    #[pyo3(signature = (positions, sigma = None))]
    fn add_points(
        &mut self,
        py: Python<'_>,
        positions: Positions<'_>,
        sigma: Option<Reals<'_>>,
    ) -> PyResult<Py<PyArray1<u32>>> {
        let positions = points(&positions, "positions")?;
        let sigmas = sigma
            .map(|sigma| sigma.spread(positions.len(), "sigma"))
            .transpose()?;
        let count = positions.len();
        let new = ids(py, self.first.0.0, self.points, count)?;
        self.note(Operation::AddPoints(positions, sigmas))?;
        self.points += count;
        Ok(new)
    }

    fn add_views(&mut self, py: Python<'_>, centers: Positions<'_>) -> PyResult<Py<PyArray1<u32>>> {
        let centers = points(&centers, "centers")?;
        let count = centers.len();
        let new = ids(py, self.first.1.0, self.views, count)?;
        self.note(Operation::AddViews(centers))?;
        self.views += count;
        Ok(new)
    }

    #[pyo3(signature = (views, points, weights = Integers::One(1)))]
    fn add_observations(
        &mut self,
        views: Integers<'_>,
        points: Integers<'_>,
        weights: Integers<'_>,
    ) -> PyResult<()> {
        let (views, points) = together((&views, "views"), (&points, "points"))?;
        let weights = weights.spread(points.len(), "weights")?;
        self.note(Operation::AddObservations(views, points, weights))
    }

    fn set_sigma(&mut self, points: Integers<'_>, sigma: Reals<'_>) -> PyResult<()> {
        let points = points.list("points")?;
        let sigmas = sigma.spread(points.len(), "sigma")?;
        self.note(Operation::SetSigma(points, sigmas))
    }

    fn move_points(&mut self, points: Integers<'_>, positions: Positions<'_>) -> PyResult<()> {
        let (ids, to) = moves((&points, "points"), (&positions, "positions"))?;
        self.note(Operation::MovePoints(ids, to))
    }

    fn move_views(&mut self, views: Integers<'_>, centers: Positions<'_>) -> PyResult<()> {
        let (ids, to) = moves((&views, "views"), (&centers, "centers"))?;
        self.note(Operation::MoveViews(ids, to))
    }

    fn remove_points(&mut self, points: Integers<'_>) -> PyResult<()> {
        self.note(Operation::RemovePoints(points.list("points")?))
    }

    fn remove_views(&mut self, views: Integers<'_>) -> PyResult<()> {
        self.note(Operation::RemoveViews(views.list("views")?))
    }

    fn remove_observations(&mut self, views: Integers<'_>, points: Integers<'_>) -> PyResult<()> {
        let (views, points) = together((&views, "views"), (&points, "points"))?;
        self.note(Operation::RemoveObservations(views, points))
    }

    fn commit(&mut self, py: Python<'_>) -> PyResult<Commit> {
        let operations = self.operations.take().ok_or_else(ended)?;
        let mut carver = self.carver.borrow_mut(py);
        let inner = &mut carver.inner;
        if (inner.next_point(), inner.next_view()) != self.first {
            return Err(PyRuntimeError::new_err(
                "another transaction was committed since this one began: begin again",
            ));
        }
        let commit = move || -> Result<CommitReport, TransactionError> {
            let mut change = inner.transaction();
            for operation in &operations {
                operation.apply(&mut change)?;
            }
            change.commit()
        };
        let report = py
            .detach(commit)
            .map_err(|error| PyValueError::new_err(error.to_string()))?;
        Commit::new(py, &report)
    }

    fn __enter__(transaction: Bound<'_, Self>) -> Bound<'_, Self> {
        transaction
    }

    /// Commits, unless the block failed or has committed.
    #[pyo3(signature = (kind, _error, _trace))]
    fn __exit__(
        &mut self,
        py: Python<'_>,
        kind: Option<Bound<'_, PyAny>>,
        _error: Option<Bound<'_, PyAny>>,
        _trace: Option<Bound<'_, PyAny>>,
    ) -> PyResult<bool> {
        if kind.is_some() {
            self.operations = None;
        } else if self.operations.is_some() {
            self.commit(py)?;
        }
        Ok(false)
    }
}

/// Ids and where they go.
fn moves(
    (ids, ids_name): (&Integers<'_>, &str),
    (positions, name): (&Positions<'_>, &str),
) -> PyResult<(Vec<u32>, Vec<Point3<f64>>)> {
    let (ids, to) = (ids.list(ids_name)?, points(positions, name)?);
    check_count(ids.len(), to.len(), ids_name)?;
    Ok((ids, to))
}

/// What a transaction changed.
#[pyclass(module = "linecarve", frozen)]
pub(crate) struct Commit {
    #[pyo3(get)]
    added: Py<PyArray2<u32>>,
    #[pyo3(get)]
    removed: Py<PyArray2<u32>>,
    #[pyo3(get)]
    duplicates: usize,
    #[pyo3(get)]
    seconds: f64,
}

impl Commit {
    fn new(py: Python<'_>, report: &CommitReport) -> PyResult<Self> {
        let numbers = |triangle: &[VertexId; 3]| triangle.map(|vertex| vertex.index() as u32);
        let times = report.times;
        Ok(Self {
            added: rows(py, report.surface.added.iter().map(numbers))?,
            removed: rows(py, report.surface.removed.iter().map(numbers))?,
            duplicates: report.duplicates,
            seconds: (times.tetrahedra + times.carving + times.surface).as_secs_f64(),
        })
    }
}
