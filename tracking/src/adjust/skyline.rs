//! Symmetric positive definite systems whose blocks lie near the diagonal.

use std::ops::Range;

use nalgebra::{DVector, Matrix6, Matrix6x3, Vector6};
use rayon::prelude::*;

/// Rows and columns of a block.
const SIDE: usize = 6;

/// Columns of blocks that are factorised together: their rows stay in the cache while all rows below them are.
const PANEL: usize = 8;

/// Fewer rows of blocks are not worth a second thread.
const FEW: usize = 32;

/// Partial sums of a dot product.
type Lanes = [f64; 4];

/// The lower triangle of a symmetric matrix of 6x6 blocks. Each row of blocks is stored from its first block that is not zero.
///
/// # Complexity
/// The factorisation is linear in the number of rows and quadratic in their length. Rows are independent of each other within a panel of
/// columns and run on all threads; each value is computed by the same operations for any number of them.
///
/// # Reference
/// George and Liu, "Computer solution of large sparse positive definite systems", 1981, chapter 4: the envelope method.
#[derive(Debug, Clone)]
pub(crate) struct Skyline {
    rows: Vec<BlockRow>,
}

/// A row of blocks: six lines, each from the first block to the end of the diagonal block, whose upper triangle counts for nothing.
#[derive(Debug, Clone)]
pub(super) struct BlockRow {
    /// First column of blocks.
    first: usize,
    /// Values of a line.
    length: usize,
    /// Lines one after another, by six values.
    sixes: Vec<[f64; SIDE]>,
}

impl Skyline {
    /// A zero matrix; `first[i]` is the first block of row `i`, at most `i`.
    pub(crate) fn new(first: &[usize]) -> Self {
        let rows = first.iter().enumerate().map(|(row, &first)| {
            let length = SIDE * (row + 1 - first);
            BlockRow {
                first,
                length,
                sixes: vec![[0.0; SIDE]; length],
            }
        });
        Self {
            rows: rows.collect(),
        }
    }

    /// Number of unknowns.
    pub(crate) fn size(&self) -> usize {
        SIDE * self.rows.len()
    }

    /// Sets all values to zero.
    pub(crate) fn clear(&mut self) {
        for row in &mut self.rows {
            row.sixes.fill([0.0; SIDE]);
        }
    }

    /// Adds a block; blocks above the diagonal are ignored.
    pub(crate) fn add(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        if column > row {
            return;
        }
        let row = &mut self.rows[row];
        for k in 0..SIDE {
            for (value, j) in row.part(k, column).iter_mut().zip(0..) {
                *value += block[(k, j)];
            }
        }
    }

    /// The rows of blocks, to add to several of them at the same time.
    pub(super) fn rows_mut(&mut self) -> &mut [BlockRow] {
        &mut self.rows
    }

    /// Multiplies the diagonal by `1 + damping`.
    pub(crate) fn damp(&mut self, damping: f64) {
        for row in &mut self.rows {
            for k in 0..SIDE {
                let diagonal = row.diagonal(k);
                row.values_mut()[diagonal] *= 1.0 + damping;
            }
        }
    }

    /// Logarithm of the determinant, once the system was [solved](Self::solve).
    pub(crate) fn log_determinant(&self) -> f64 {
        let diagonal = (self.rows.iter())
            .flat_map(|row| (0..SIDE).map(move |k| row.values()[row.diagonal(k)]));
        2.0 * diagonal.map(|value| value.ln()).sum::<f64>()
    }

    /// Solves the system; `None` when the matrix is not positive definite. Destroys the matrix.
    pub(crate) fn solve(&mut self, right: &DVector<f64>) -> Option<DVector<f64>> {
        self.factorise()?;
        let mut x = right.clone();
        for (at, row) in self.rows.iter().enumerate() {
            for k in 0..SIDE {
                let (start, own) = (SIDE * row.first, SIDE * at + k);
                let (line, diagonal) = row.line(k);
                let sum = dot(line, &x.as_slice()[start..own]);
                x[own] = (x[own] - sum) / diagonal;
            }
        }
        for (at, row) in self.rows.iter().enumerate().rev() {
            for k in (0..SIDE).rev() {
                let (start, own) = (SIDE * row.first, SIDE * at + k);
                let (line, diagonal) = row.line(k);
                x[own] /= diagonal;
                let value = x[own];
                let targets = &mut x.as_mut_slice()[start..own];
                for (target, factor) in targets.iter_mut().zip(line) {
                    *target -= factor * value;
                }
            }
        }
        x.iter().all(|value| value.is_finite()).then_some(x)
    }

    /// Replaces the matrix `A` by the lower triangular `L` with `L L^T = A`; `None` when it is not positive definite.
    fn factorise(&mut self) -> Option<()> {
        let count = self.rows.len();
        for begin in (0..count).step_by(PANEL) {
            let end = count.min(begin + PANEL);
            for at in begin..end {
                let (above, rest) = self.rows.split_at_mut(at);
                rest[0].eliminate(above, begin..at);
                rest[0].factorise_diagonal()?;
            }
            let (above, below) = self.rows.split_at_mut(end);
            let eliminate = |row: &mut BlockRow| {
                if row.first < end {
                    row.eliminate(above, begin..end);
                }
            };
            match below.len() < FEW {
                true => below.iter_mut().for_each(eliminate),
                false => below.par_iter_mut().for_each(eliminate),
            }
        }
        Some(())
    }
}

impl BlockRow {
    fn values(&self) -> &[f64] {
        self.sixes.as_flattened()
    }

    fn values_mut(&mut self) -> &mut [f64] {
        self.sixes.as_flattened_mut()
    }

    /// Index of the diagonal value of a line.
    fn diagonal(&self, line: usize) -> usize {
        line * self.length + self.length - SIDE + line
    }

    /// The values of a line before the diagonal, and that on it.
    fn line(&self, line: usize) -> (&[f64], f64) {
        let (values, diagonal) = (self.values(), self.diagonal(line));
        (&values[line * self.length..diagonal], values[diagonal])
    }

    /// The six values of a line in a column of blocks.
    fn part(&mut self, line: usize, column: usize) -> &mut [f64; SIDE] {
        let at = line * (self.length / SIDE) + column - self.first;
        &mut self.sixes[at]
    }

    /// Subtracts the product of a block and the transpose of another from a column of blocks.
    pub(super) fn subtract_product(
        &mut self,
        column: usize,
        left: &Matrix6x3<f64>,
        right: &Matrix6x3<f64>,
    ) {
        let [x, y, z] = &right.data.0;
        for k in 0..SIDE {
            let by = [left[(k, 0)], left[(k, 1)], left[(k, 2)]];
            let values = self.part(k, column);
            for j in 0..SIDE {
                values[j] -= by[0] * x[j] + by[1] * y[j] + by[2] * z[j];
            }
        }
    }

    /// Computes the values of `L` in columns of blocks; those to the left of them and the rows of these columns are known.
    fn eliminate(&mut self, above: &[BlockRow], columns: Range<usize>) {
        let columns = columns.start.max(self.first)..columns.end;
        for (column, other) in columns.clone().zip(&above[columns]) {
            let from = self.first.max(other.first);
            let (own, others) = (SIDE * (from - self.first), SIDE * (from - other.first));
            let length = SIDE * (column - from);
            let sums = lanes_of_products([self, other], [own, others], length / 4);
            for (k, of_line) in sums.into_iter().enumerate() {
                for (j, lanes) in of_line.into_iter().enumerate() {
                    let start = k * self.length + own;
                    let line = &mut self.values_mut()[start..];
                    let other_line = &other.values()[j * other.length + others..];
                    let at = length + j;
                    let dot = complete(lanes, length / 4, &line[..at], &other_line[..at]);
                    line[at] = (line[at] - dot) / other_line[at];
                }
            }
        }
    }

    /// Computes the diagonal block of `L`, whose row is known to the left of it.
    fn factorise_diagonal(&mut self) -> Option<()> {
        let length = self.length - SIDE;
        let sums = lanes_of_products([self, self], [0, 0], length / 4);
        for (k, of_line) in sums.into_iter().enumerate() {
            for (j, lanes) in of_line.into_iter().enumerate().take(k + 1) {
                let line = &self.values()[k * self.length..];
                let other = &self.values()[j * self.length..];
                let at = length + j;
                let rest = line[at] - complete(lanes, length / 4, &line[..at], &other[..at]);
                let value = match j == k {
                    false => rest / other[at],
                    true if rest.is_nan() || rest <= 0.0 => return None,
                    true => rest.sqrt(),
                };
                let place = k * self.length + at;
                self.values_mut()[place] = value;
            }
        }
        Some(())
    }
}

/// Partial sums of the dot products of the six lines of one row with those of another, from an offset in either on, over so many chunks of
/// four values.
fn lanes_of_products(
    [a, b]: [&BlockRow; 2],
    [from_a, from_b]: [usize; 2],
    chunks: usize,
) -> [[Lanes; SIDE]; SIDE] {
    let line = |row: &BlockRow, k: usize, from: usize| {
        let start = k * row.length + from;
        start..start + 4 * chunks
    };
    let mut sums = [[Lanes::default(); SIDE]; SIDE];
    // Two lines of either: as many sums as there are registers.
    for k in (0..SIDE).step_by(2) {
        let [a0, a1] = [k, k + 1].map(|k| &a.values()[line(a, k, from_a)]);
        for j in (0..SIDE).step_by(2) {
            let [b0, b1] = [j, j + 1].map(|j| &b.values()[line(b, j, from_b)]);
            let mut found = [Lanes::default(); 4];
            let (a0, a1) = (a0.chunks_exact(4), a1.chunks_exact(4));
            let (b0, b1) = (b0.chunks_exact(4), b1.chunks_exact(4));
            for ((a0, a1), (b0, b1)) in a0.zip(a1).zip(b0.zip(b1)) {
                for lane in 0..4 {
                    found[0][lane] += a0[lane] * b0[lane];
                    found[1][lane] += a0[lane] * b1[lane];
                    found[2][lane] += a1[lane] * b0[lane];
                    found[3][lane] += a1[lane] * b1[lane];
                }
            }
            [
                [sums[k][j], sums[k][j + 1]],
                [sums[k + 1][j], sums[k + 1][j + 1]],
            ] = [[found[0], found[1]], [found[2], found[3]]];
        }
    }
    sums
}

/// The dot product of two lines, given the partial sums over the first chunks of four values.
fn complete(mut sums: Lanes, chunks: usize, a: &[f64], b: &[f64]) -> f64 {
    let (a4, b4) = (
        a[4 * chunks..].chunks_exact(4),
        b[4 * chunks..].chunks_exact(4),
    );
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

/// Sum of products, in a fixed order with four partial sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    complete(Lanes::default(), 0, a, b)
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

    /// Random values from the first block of each row on, and the same as a dense matrix.
    fn random_system(first: &[usize], seed: u64, diagonal: f64) -> (Skyline, DMatrix<f64>) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let size = SIDE * first.len();
        let (mut matrix, mut dense) = (Skyline::new(first), DMatrix::zeros(size, size));
        for (row, &start) in first.iter().enumerate() {
            for column in start..=row {
                let mut values = Matrix6::from_fn(|_, _| random.random_range(-1.0..1.0));
                if row == column {
                    values = values * values.transpose() + Matrix6::identity() * diagonal;
                }
                matrix.add(row, column, &values);
                let [row, column] = [row, column].map(|at| SIDE * at);
                let mut part = dense.view_mut((row, column), (SIDE, SIDE));
                part.copy_from(&values);
                let mut part = dense.view_mut((column, row), (SIDE, SIDE));
                part.copy_from(&values.transpose());
            }
        }
        (matrix, dense)
    }

    #[test]
    fn solutions_agree_with_dense_ones() {
        let (mut matrix, dense) = random_system(&[0, 0, 1, 0, 3], 5, 20.0);
        let right = DVector::from_fn(30, |row, _| row as f64 - 14.5);
        let determinant: f64 = dense.determinant();
        let expected = dense.cholesky().unwrap().solve(&right);
        let found = matrix.solve(&right).unwrap();
        assert!((found - expected).norm() < 1e-10);
        assert!((matrix.log_determinant() - determinant.ln()).abs() < 1e-8);
        let mut zero = Skyline::new(&[0]);
        assert!(zero.solve(&DVector::zeros(6)).is_none());
    }

    #[test]
    fn large_systems_have_the_same_bits_on_any_number_of_threads() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let count = 3 * FEW;
        let first: Vec<usize> = (0..count)
            .map(|row| random.random_range(0..=row.min(row / 2 + 5)))
            .collect();
        let (matrix, dense) = random_system(&first, 8, 400.0);
        let right = DVector::from_fn(SIDE * count, |row, _| (row % 11) as f64 - 5.0);
        let solutions = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().unwrap();
            pool.install(|| matrix.clone().solve(&right)).unwrap()
        });
        assert_eq!(solutions[0], solutions[1]);
        let expected = dense.cholesky().unwrap().solve(&right);
        assert!((&solutions[0] - expected).norm() < 1e-10);
    }
}
