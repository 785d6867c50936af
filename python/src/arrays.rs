//! Arrays of Python to numbers, and back.

use nalgebra::Point3;
use numpy::{AllowTypeChange, IntoPyArray, PyArray2, PyArrayLike1, PyArrayLike2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// An array of positions, or what numpy makes one from.
pub(crate) type Positions<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// Ids or weights: an array, or one number for all.
#[derive(FromPyObject)]
pub(crate) enum Integers<'py> {
    /// One for each.
    Each(PyArrayLike1<'py, i64, AllowTypeChange>),
    /// One for all.
    One(i64),
}

/// Numbers: an array, or one for all.
#[derive(FromPyObject)]
pub(crate) enum Reals<'py> {
    /// One for each.
    Each(PyArrayLike1<'py, f64, AllowTypeChange>),
    /// One for all.
    One(f64),
}

/// The rows of an array of shape (n, 3).
pub(crate) fn points(array: &Positions<'_>, name: &str) -> PyResult<Vec<Point3<f64>>> {
    let view = array.as_array();
    let (rows, columns) = view.dim();
    if columns != 3 {
        return Err(PyValueError::new_err(format!(
            "{name} has shape ({rows}, {columns}): it must be (n, 3)"
        )));
    }
    let rows = view.rows().into_iter();
    Ok(rows
        .map(|row| Point3::new(row[0], row[1], row[2]))
        .collect())
}

fn id(number: i64, name: &str) -> PyResult<u32> {
    u32::try_from(number).map_err(|_| {
        PyValueError::new_err(format!(
            "{name} has {number}: numbers go from 0 to 2^32 - 1"
        ))
    })
}

impl Integers<'_> {
    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Each(array) => array.as_array().len(),
        }
    }

    /// One for each of `count`.
    pub(crate) fn spread(&self, count: usize, name: &str) -> PyResult<Vec<u32>> {
        match self {
            Self::One(one) => Ok(vec![id(*one, name)?; count]),
            Self::Each(array) => {
                let view = array.as_array();
                if let Some(one) = view.first().filter(|_| view.len() == 1) {
                    return Ok(vec![id(*one, name)?; count]);
                }
                check_count(view.len(), count, name)?;
                view.iter().map(|number| id(*number, name)).collect()
            }
        }
    }

    /// All of them; one alone is a list of one.
    pub(crate) fn list(&self, name: &str) -> PyResult<Vec<u32>> {
        self.spread(self.count(), name)
    }
}

impl Reals<'_> {
    /// One for each of `count`.
    pub(crate) fn spread(&self, count: usize, name: &str) -> PyResult<Vec<f64>> {
        match self {
            Self::One(one) => Ok(vec![*one; count]),
            Self::Each(array) => {
                let view = array.as_array();
                check_count(view.len(), count, name)?;
                Ok(view.to_vec())
            }
        }
    }
}

pub(crate) fn check_count(given: usize, wanted: usize, name: &str) -> PyResult<()> {
    match given == wanted {
        true => Ok(()),
        false => Err(PyValueError::new_err(format!(
            "{name} has {given} elements: it must have {wanted}, or be one number for all"
        ))),
    }
}

/// An array with a row for each element; it owns its memory.
pub(crate) fn rows<const N: usize, T: numpy::Element + Copy>(
    py: Python<'_>,
    elements: impl ExactSizeIterator<Item = [T; N]>,
) -> PyResult<Py<PyArray2<T>>> {
    let count = elements.len();
    let mut flat = Vec::with_capacity(N * count);
    for element in elements {
        flat.extend_from_slice(&element);
    }
    Ok(flat.into_pyarray(py).reshape([count, N])?.unbind())
}
