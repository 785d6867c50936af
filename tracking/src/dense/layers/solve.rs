//! Sparse normal equations of all layers.

use nalgebra::{Cholesky, SMatrix, SVector};

use super::pair::{PairEquations, UNKNOWNS};
use super::pairs::LayerPair;

type Block = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Part = SVector<f64, UNKNOWNS>;

/// Steps of conjugate gradients at most, and the share of the right side that ends them.
const STEPS: usize = 400;
const SMALLEST: f64 = 1e-7;

/// Normal equations with a block for each layer and each pair.
pub(super) struct LayerSystem {
    diagonal: Vec<Block>,
    right: Vec<Part>,
    off_diagonal: Vec<(LayerPair, Block)>,
}

impl LayerSystem {
    pub(super) fn new(layers: usize) -> Self {
        Self {
            diagonal: vec![Block::zeros(); layers],
            right: vec![Part::zeros(); layers],
            off_diagonal: Vec::new(),
        }
    }

    /// Adds the equations of a pair.
    pub(super) fn add(&mut self, pair: LayerPair, equations: &PairEquations) {
        let normal = &equations.normal;
        let block = |row: usize, column: usize| -> Block {
            normal
                .fixed_view::<UNKNOWNS, UNKNOWNS>(row, column)
                .into_owned()
        };
        self.diagonal[pair.from] += block(0, 0);
        self.diagonal[pair.to] += block(UNKNOWNS, UNKNOWNS);
        let gradient = &equations.gradient;
        self.right[pair.from] -= gradient.fixed_rows::<UNKNOWNS>(0);
        self.right[pair.to] -= gradient.fixed_rows::<UNKNOWNS>(UNKNOWNS);
        self.off_diagonal.push((pair, block(0, UNKNOWNS)));
    }

    /// Adds that a layer is expected to have the `values` 0, with these standard deviations. An infinite one is no expectation.
    pub(super) fn add_prior(&mut self, layer: usize, values: &Part, sigmas: &Part) {
        for k in 0..UNKNOWNS {
            let weight = 1.0 / (sigmas[k] * sigmas[k]);
            self.diagonal[layer][(k, k)] += weight;
            self.right[layer][k] -= weight * values[k];
        }
    }

    /// Takes unknowns of all layers out: their steps become zero.
    pub(super) fn fix(&mut self, is_free: &[bool; UNKNOWNS]) {
        let mask = Block::from_diagonal(&Part::from_fn(|k, _| f64::from(u8::from(is_free[k]))));
        let fixed = Block::identity() - mask;
        for (block, right) in self.diagonal.iter_mut().zip(&mut self.right) {
            *block = mask * *block * mask + fixed;
            *right = mask * *right;
        }
        for (_, block) in &mut self.off_diagonal {
            *block = mask * *block * mask;
        }
    }

    /// The steps of all layers, by conjugate gradients with the inverse blocks of the diagonal; `None` when a block is not positive definite.
    ///
    /// # Complexity
    /// Linear in the pairs, for at most 400 steps.
    pub(super) fn solve(&self) -> Option<Vec<Part>> {
        let inverse: Vec<Cholesky<f64, nalgebra::Const<UNKNOWNS>>> = self
            .diagonal
            .iter()
            .map(|block| Cholesky::new(*block))
            .collect::<Option<_>>()?;
        let precondition = |r: &[Part]| -> Vec<Part> {
            let parts = r.iter().zip(&inverse);
            parts.map(|(part, inverse)| inverse.solve(part)).collect()
        };
        let mut x = vec![Part::zeros(); self.right.len()];
        let mut r = self.right.clone();
        let mut z = precondition(&r);
        let mut direction = z.clone();
        let mut energy = dot(&r, &z);
        let last = SMALLEST * SMALLEST * energy;
        for _ in 0..STEPS {
            if energy <= last {
                break;
            }
            let product = self.multiply(&direction);
            let length = energy / dot(&direction, &product);
            for (((x, r), direction), product) in
                x.iter_mut().zip(&mut r).zip(&direction).zip(&product)
            {
                *x += length * direction;
                *r -= length * product;
            }
            z = precondition(&r);
            let next = dot(&r, &z);
            for (direction, z) in direction.iter_mut().zip(&z) {
                *direction = z + *direction * (next / energy);
            }
            energy = next;
        }
        let is_finite = |part: &Part| part.iter().all(|value| value.is_finite());
        x.iter().all(is_finite).then_some(x)
    }

    fn multiply(&self, x: &[Part]) -> Vec<Part> {
        let blocks = self.diagonal.iter().zip(x);
        let mut product: Vec<Part> = blocks.map(|(block, x)| block * x).collect();
        for (pair, block) in &self.off_diagonal {
            product[pair.from] += block * x[pair.to];
            product[pair.to] += block.tr_mul(&x[pair.from]);
        }
        product
    }
}

fn dot(a: &[Part], b: &[Part]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
