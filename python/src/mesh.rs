//! Meshes and lines as arrays.

use linecarve_mesh::{LineSet, TriangleMesh};
use nalgebra::Point3;
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::rows;

/// A triangle mesh.
#[pyclass(module = "linecarve", frozen, subclass)]
pub(crate) struct Mesh {
    #[pyo3(get)]
    vertices: Py<PyArray2<f64>>,
    #[pyo3(get)]
    triangles: Py<PyArray2<u32>>,
    #[pyo3(get)]
    colors: Option<Py<PyArray2<u8>>>,
}

impl Mesh {
    pub(crate) fn new(
        py: Python<'_>,
        positions: &[Point3<f64>],
        triangles: &[[u32; 3]],
        colors: Option<&[[u8; 3]]>,
    ) -> PyResult<Self> {
        Ok(Self {
            vertices: rows(py, positions.iter().map(|p| [p.x, p.y, p.z]))?,
            triangles: rows(py, triangles.iter().copied())?,
            colors: colors
                .map(|colors| rows(py, colors.iter().copied()))
                .transpose()?,
        })
    }

    pub(crate) fn of(py: Python<'_>, mesh: &TriangleMesh) -> PyResult<Self> {
        Self::new(py, &mesh.positions, &mesh.triangles, mesh.colors.as_deref())
    }
}

#[pymethods]
impl Mesh {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let count = |array: Bound<'_, PyAny>| array.len();
        Ok(format!(
            "<linecarve.Mesh of {} vertices and {} triangles>",
            count(self.vertices.bind(py).as_any().clone())?,
            count(self.triangles.bind(py).as_any().clone())?,
        ))
    }
}

/// 3D line segments.
#[pyclass(module = "linecarve", frozen)]
pub(crate) struct Lines {
    #[pyo3(get)]
    points: Py<PyArray2<f64>>,
    #[pyo3(get)]
    lines: Py<PyArray2<u32>>,
}

impl Lines {
    pub(crate) fn of(py: Python<'_>, lines: &LineSet) -> PyResult<Self> {
        Ok(Self {
            points: rows(py, lines.points.iter().map(|p| [p.x, p.y, p.z]))?,
            lines: rows(py, lines.lines.iter().copied())?,
        })
    }
}
