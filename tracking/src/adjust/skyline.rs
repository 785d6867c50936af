//! Symmetric positive definite systems whose blocks lie near the diagonal.

use nalgebra::{DVector, Matrix6, Vector6};

/// The lower triangle of a symmetric matrix of 6x6 blocks. Each row of blocks is stored from its first block that is not zero.
///
/// # Complexity
/// The factorisation is linear in the number of rows and quadratic in their length.
///
/// # Reference
/// George and Liu, "Computer solution of large sparse positive definite systems", 1981, chapter 4: the envelope method.
#[derive(Debug, Clone)]
pub(crate) struct Skyline {
    /// First column of blocks of each row of blocks.
    first: Vec<usize>,
    /// Scalar rows, each from column `6 * first` to its diagonal.
    rows: Vec<Vec<f64>>,
}

impl Skyline {
    /// A zero matrix; `first[i]` is the first block of row `i`, at most `i`.
    pub(crate) fn new(first: Vec<usize>) -> Self {
        let rows = first
            .iter()
            .enumerate()
            .flat_map(|(row, &first)| (0..6).map(move |k| vec![0.0; 6 * (row - first) + k + 1]))
            .collect();
        Self { first, rows }
    }

    /// Number of unknowns.
    pub(crate) fn size(&self) -> usize {
        self.rows.len()
    }

    /// Sets all values to zero.
    pub(crate) fn clear(&mut self) {
        for row in &mut self.rows {
            row.fill(0.0);
        }
    }

    /// Adds a block; blocks above the diagonal are ignored.
    pub(crate) fn add(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        if column > row {
            return;
        }
        let start = 6 * (column - self.first[row]);
        for k in 0..6 {
            let line = &mut self.rows[6 * row + k];
            let end = (start + 6).min(line.len());
            for (value, j) in line[start..end].iter_mut().zip(0..) {
                *value += block[(k, j)];
            }
        }
    }

    /// Multiplies the diagonal by `1 + damping`.
    pub(crate) fn damp(&mut self, damping: f64) {
        for row in &mut self.rows {
            if let Some(last) = row.last_mut() {
                *last *= 1.0 + damping;
            }
        }
    }

    /// Logarithm of the determinant, once the system was [solved](Self::solve).
    pub(crate) fn log_determinant(&self) -> f64 {
        let diagonal = self.rows.iter().filter_map(|row| row.last());
        2.0 * diagonal.map(|value| value.ln()).sum::<f64>()
    }

    /// Solves the system; `None` when the matrix is not positive definite. Destroys the matrix.
    pub(crate) fn solve(&mut self, right: &DVector<f64>) -> Option<DVector<f64>> {
        for row in 0..self.rows.len() {
            let start = 6 * self.first[row / 6];
            let (above, rest) = self.rows.split_at_mut(row);
            let line = &mut rest[0];
            for column in start..row {
                let other_start = 6 * self.first[column / 6];
                let from = start.max(other_start);
                let other = &above[column];
                let dot: f64 = dot(
                    &line[from - start..column - start],
                    &other[from - other_start..column - other_start],
                );
                let diagonal = other[column - other_start];
                line[column - start] = (line[column - start] - dot) / diagonal;
            }
            let last = line.len() - 1;
            let pivot = line[last] - dot(&line[..last], &line[..last]);
            if pivot.is_nan() || pivot <= 0.0 {
                return None;
            }
            line[last] = pivot.sqrt();
        }
        let mut x = right.clone();
        for row in 0..self.rows.len() {
            let start = 6 * self.first[row / 6];
            let line = &self.rows[row];
            let last = line.len() - 1;
            let sum = dot(&line[..last], &x.as_slice()[start..row]);
            x[row] = (x[row] - sum) / line[last];
        }
        for row in (0..self.rows.len()).rev() {
            let start = 6 * self.first[row / 6];
            let line = &self.rows[row];
            let last = line.len() - 1;
            x[row] /= line[last];
            let value = x[row];
            for (target, factor) in x.as_mut_slice()[start..row].iter_mut().zip(&line[..last]) {
                *target -= factor * value;
            }
        }
        x.iter().all(|value| value.is_finite()).then_some(x)
    }
}

/// Sum of products, in a fixed order with four partial sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4
        .remainder()
        .iter()
        .zip(b4.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Six values of a vector of blocks.
pub(crate) fn block(vector: &DVector<f64>, at: usize) -> Vector6<f64> {
    vector.fixed_rows::<6>(6 * at).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn solutions_agree_with_dense_ones() {
        let first = vec![0, 0, 1, 0, 3];
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let mut matrix = Skyline::new(first.clone());
        let mut dense = DMatrix::<f64>::zeros(30, 30);
        for (row, &start) in first.iter().enumerate() {
            for column in start..=row {
                let mut values = Matrix6::from_fn(|_, _| random.random_range(-1.0..1.0));
                if row == column {
                    values = values * values.transpose() + Matrix6::identity() * 20.0;
                }
                matrix.add(row, column, &values);
                dense
                    .view_mut((6 * row, 6 * column), (6, 6))
                    .copy_from(&values);
                dense
                    .view_mut((6 * column, 6 * row), (6, 6))
                    .copy_from(&values.transpose());
            }
        }
        let right = DVector::from_fn(30, |row, _| row as f64 - 14.5);
        let determinant: f64 = dense.determinant();
        let expected = dense.cholesky().unwrap().solve(&right);
        let found = matrix.solve(&right).unwrap();
        assert!((found - expected).norm() < 1e-10);
        assert!((matrix.log_determinant() - determinant.ln()).abs() < 1e-8);
        let mut zero = Skyline::new(vec![0]);
        assert!(zero.solve(&DVector::zeros(6)).is_none());
    }
}
