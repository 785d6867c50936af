//! Axis-aligned boxes, and trees of them.

use crate::record::Record;

/// A closed box; empty when `low` exceeds `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
}

impl Bounds {
    pub(crate) const EMPTY: Bounds = Bounds {
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
    };

    pub(crate) fn of<'a>(points: impl IntoIterator<Item = &'a [f64; 3]>) -> Self {
        let mut bounds = Self::EMPTY;
        points.into_iter().for_each(|point| bounds.add(point));
        bounds
    }

    pub(crate) fn add(&mut self, point: &[f64; 3]) {
        *self = self.join(&Self {
            low: *point,
            high: *point,
        });
    }

    pub(crate) fn join(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    /// The longest side; 0 of an empty box.
    pub(crate) fn extent(&self) -> f64 {
        (0..3).fold(0.0, |longest: f64, k| {
            longest.max(self.high[k] - self.low[k])
        })
    }

    pub(crate) fn meets(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    /// Whether the closed segment between two points may meet the box. Never false when it does: the box is taken larger by far
    /// more than any rounding.
    pub(crate) fn may_meet(&self, [from, to]: [&[f64; 3]; 2]) -> bool {
        /// A share of the largest coordinate.
        const MARGIN: f64 = 1.0 / (1u64 << 40) as f64;
        if self.is_empty() {
            return false;
        }
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for k in 0..3 {
            let ends = [from[k], to[k], self.low[k], self.high[k]];
            let margin = MARGIN * ends.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let (low, high) = (self.low[k] - margin, self.high[k] + margin);
            let way = to[k] - from[k];
            if way == 0.0 {
                if from[k] < low || from[k] > high {
                    return false;
                }
                continue;
            }
            let (a, b) = ((low - from[k]) / way, (high - from[k]) / way);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}

impl Record for Bounds {
    const BYTES: usize = 48;
    fn put(&self, out: &mut Vec<u8>) {
        [self.low, self.high].put(out);
    }
    fn get(bytes: &[u8]) -> Self {
        let [low, high] = <[[f64; 3]; 2]>::get(bytes);
        Self { low, high }
    }
}

/// A binary tree over a list of boxes in which neighbours are near each other.
#[derive(Clone, Debug, Default)]
pub(crate) struct BoxTree {
    /// `2 * n - 1` nodes; see [`children`](Self::children).
    nodes: Vec<Bounds>,
    leaves: usize,
}

/// A node of a [`BoxTree`] and the leaves below it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    index: usize,
    first: usize,
    count: usize,
}

impl Node {
    /// The leaf, if it is one.
    pub(crate) fn leaf(self) -> Option<usize> {
        (self.count == 1).then_some(self.first)
    }
}

impl BoxTree {
    pub(crate) fn new(leaves: &[Bounds]) -> Self {
        let count = leaves.len();
        let mut tree = Self {
            nodes: vec![Bounds::EMPTY; (2 * count).saturating_sub(1)],
            leaves: count,
        };
        if let Some(root) = tree.root() {
            tree.fill(root, leaves);
        }
        tree
    }

    fn fill(&mut self, node: Node, leaves: &[Bounds]) -> Bounds {
        let bounds = match node.leaf() {
            Some(leaf) => leaves[leaf],
            None => {
                let [a, b] = self.children(node);
                self.fill(a, leaves).join(&self.fill(b, leaves))
            }
        };
        self.nodes[node.index] = bounds;
        bounds
    }

    pub(crate) fn root(&self) -> Option<Node> {
        (self.leaves > 0).then_some(Node {
            index: 0,
            first: 0,
            count: self.leaves,
        })
    }

    /// The two halves of a node that is no leaf: depth-first order, so the left child follows its parent.
    pub(crate) fn children(&self, node: Node) -> [Node; 2] {
        let half = node.count / 2;
        let left = Node {
            index: node.index + 1,
            first: node.first,
            count: half,
        };
        let right = Node {
            index: node.index + 2 * half,
            first: node.first + half,
            count: node.count - half,
        };
        [left, right]
    }

    pub(crate) fn bounds(&self, node: Node) -> &Bounds {
        &self.nodes[node.index]
    }

    /// Whether the segment may meet one of the boxes.
    pub(crate) fn may_meet(&self, segment: [&[f64; 3]; 2], stack: &mut Vec<Node>) -> bool {
        stack.clear();
        stack.extend(self.root());
        while let Some(node) = stack.pop() {
            if self.bounds(node).may_meet(segment) {
                if node.leaf().is_some() {
                    return true;
                }
                stack.extend(self.children(node));
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_finds_every_box_that_a_segment_meets() {
        for count in 1..40usize {
            let boxes: Vec<Bounds> = (0..count)
                .map(|i| {
                    let x = 2.0 * i as f64;
                    Bounds::of(&[[x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]])
                })
                .collect();
            let tree = BoxTree::new(&boxes);
            let mut stack = Vec::new();
            for i in 0..count {
                let x = 2.0 * i as f64;
                let hit = [[x + 0.5, -1.0, 0.5], [x + 0.5, 2.0, 0.5]];
                let miss = [[x + 1.5, -1.0, 0.5], [x + 1.5, 2.0, 0.5]];
                assert!(tree.may_meet([&hit[0], &hit[1]], &mut stack));
                assert!(!tree.may_meet([&miss[0], &miss[1]], &mut stack));
            }
        }
        assert_eq!(Bounds::of(&[[0.0; 3], [1.0, 5.0, 2.0]]).extent(), 5.0);
        assert_eq!(Bounds::EMPTY.extent(), 0.0);
    }
}
