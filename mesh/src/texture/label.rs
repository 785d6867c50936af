//! One view for each triangle.

use rayon::prelude::*;

use super::observe::{MAX_VIEWS, Observation};

/// Triangles across the three edges of each triangle; an edge of more than two triangles joins pairs of them.
pub(super) fn neighbours(triangles: &[[u32; 3]]) -> Vec<[Option<u32>; 3]> {
    let mut edges: Vec<([u32; 2], u32, usize)> = Vec::with_capacity(3 * triangles.len());
    for (triangle, corners) in triangles.iter().enumerate() {
        for edge in 0..3 {
            let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
            edges.push(([a.min(b), a.max(b)], triangle as u32, edge));
        }
    }
    edges.par_sort_unstable();
    let mut neighbours = vec![[None; 3]; triangles.len()];
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        for pair in same.chunks_exact(2) {
            let [(_, one, at_one), (_, other, at_other)] = [pair[0], pair[1]];
            neighbours[one as usize][at_one] = Some(other);
            neighbours[other as usize][at_other] = Some(one);
        }
    }
    neighbours
}

/// Iterations of belief propagation.
const ITERATIONS: usize = 40;
/// Largest number of passes that improve single triangles afterwards.
const PASSES: usize = 20;
/// Largest cost of a view.
const MAX_COST: f32 = 3.0;

/// Chooses among the observations of each triangle; `None` for triangles without any.
///
/// Minimises the sum over triangles of `ln(best quality / quality)` and over neighbouring triangles with different views of
/// `seam_cost`, approximately: min-sum belief propagation in rounds, then passes over single triangles.
///
/// # Reference
/// P. Felzenszwalb, D. Huttenlocher, "Efficient Belief Propagation for Early Vision", IJCV 2006, section 3.1: messages for
/// the Potts model in linear time.
pub(super) fn choose(
    of_triangle: &[Vec<Observation>],
    neighbours: &[[Option<u32>; 3]],
    seam_cost: f32,
) -> Vec<Option<usize>> {
    let costs: Vec<Costs> = of_triangle.par_iter().map(|o| costs(o)).collect();
    let mut problem = Problem {
        of_triangle,
        neighbours,
        costs: &costs,
        seam_cost,
    };
    problem.improved(problem.propagated())
}

/// A cost for each observation of a triangle; 0 beyond the last.
type Costs = [f32; MAX_VIEWS];

fn costs(observations: &[Observation]) -> Costs {
    let best = observations
        .iter()
        .fold(0.0, |best: f32, o| best.max(o.quality));
    let cost = |o: &Observation| (best / o.quality).ln().clamp(0.0, MAX_COST);
    let mut costs = [0.0; MAX_VIEWS];
    for (target, observation) in costs.iter_mut().zip(observations) {
        *target = cost(observation);
    }
    costs
}

struct Problem<'a> {
    of_triangle: &'a [Vec<Observation>],
    neighbours: &'a [[Option<u32>; 3]],
    costs: &'a [Costs],
    seam_cost: f32,
}

/// Messages that a triangle gets across its three edges.
type Messages = [Costs; 3];

impl Problem<'_> {
    /// Cost of each observation of a triangle, with the messages across all edges but one.
    fn belief(&self, triangle: usize, messages: &Messages, without: Option<usize>) -> Costs {
        let mut belief = self.costs[triangle];
        for (edge, message) in messages.iter().enumerate() {
            if Some(edge) != without {
                for (sum, cost) in belief.iter_mut().zip(message) {
                    *sum += cost;
                }
            }
        }
        belief
    }

    fn propagated(&self) -> Vec<Option<usize>> {
        let mut messages: Vec<Messages> = vec![[[0.0; MAX_VIEWS]; 3]; self.costs.len()];
        let mut next = messages.clone();
        for _ in 0..ITERATIONS {
            next.par_iter_mut()
                .enumerate()
                .for_each(|(triangle, target)| {
                    for (edge, target) in target.iter_mut().enumerate() {
                        self.receive(triangle, edge, &messages, target);
                    }
                });
            std::mem::swap(&mut messages, &mut next);
        }
        (0..self.costs.len())
            .map(|triangle| {
                self.smallest(triangle, &self.belief(triangle, &messages[triangle], None))
            })
            .collect()
    }

    /// The message that a triangle gets across an edge, mixed with the one before, which keeps rounds from oscillating.
    fn receive(&self, triangle: usize, edge: usize, messages: &[Messages], target: &mut Costs) {
        let Some(sender) = self.neighbours[triangle][edge].map(|sender| sender as usize) else {
            return;
        };
        let back = self.neighbours[sender]
            .iter()
            .position(|n| *n == Some(triangle as u32));
        let belief = self.belief(sender, &messages[sender], back);
        let Some(least) = self.smallest(sender, &belief).map(|at| belief[at]) else {
            return;
        };
        let known = &self.of_triangle[sender];
        let own = self.of_triangle[triangle].iter();
        for ((cost, before), observation) in
            target.iter_mut().zip(&messages[triangle][edge]).zip(own)
        {
            // Observations are in the order of views.
            let same = known.binary_search_by_key(&observation.view, |o| o.view);
            let agreed = same.map_or(f32::INFINITY, |at| belief[at] - least);
            *cost = 0.5 * before + 0.5 * agreed.min(self.seam_cost);
        }
    }

    /// Changes single triangles as long as that lowers the sum.
    fn improved(&mut self, mut labels: Vec<Option<usize>>) -> Vec<Option<usize>> {
        for _ in 0..PASSES {
            let mut has_changed = false;
            for triangle in 0..labels.len() {
                let mut costs = self.costs[triangle];
                for neighbour in self.neighbours[triangle].iter().flatten() {
                    let other = *neighbour as usize;
                    let Some(view) = labels[other].map(|at| self.of_triangle[other][at].view)
                    else {
                        continue;
                    };
                    for (cost, observation) in costs.iter_mut().zip(&self.of_triangle[triangle]) {
                        *cost += if observation.view == view {
                            0.0
                        } else {
                            self.seam_cost
                        };
                    }
                }
                let best = self.smallest(triangle, &costs);
                if let (Some(best), Some(before)) = (best, labels[triangle])
                    && costs[best] < costs[before]
                {
                    labels[triangle] = Some(best);
                    has_changed = true;
                }
            }
            if !has_changed {
                break;
            }
        }
        labels
    }

    /// The first observation of a triangle with the smallest cost.
    fn smallest(&self, triangle: usize, costs: &Costs) -> Option<usize> {
        let count = self.of_triangle[triangle].len();
        (0..count).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))
    }
}
