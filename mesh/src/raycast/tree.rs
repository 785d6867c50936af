//! A bounding volume hierarchy, searched by whatever can be said of a box.

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::{Bvh, BvhNode};
use nalgebra::Point3;

/// Marks an inner node.
const INNER: u32 = u32::MAX;

/// A box from its lowest to its highest corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: Point3<f64>,
    pub(super) high: Point3<f64>,
}

/// Boxes in a hierarchy. They are numbered in their order.
#[derive(Clone)]
pub(super) struct BoxTree {
    /// The first child of an inner node follows it.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// The second child of an inner node.
    second: u32,
    /// Number of the box, or [`INNER`].
    leaf: u32,
}

/// A box, as the hierarchy is built.
struct Leaf(Bounds, usize);

impl Bounded<f64, 3> for Leaf {
    fn aabb(&self) -> Aabb<f64, 3> {
        Aabb::with_bounds(self.0.low, self.0.high)
    }
}

impl BHShape<f64, 3> for Leaf {
    fn set_bh_node_index(&mut self, index: usize) {
        self.1 = index;
    }

    fn bh_node_index(&self) -> usize {
        self.1
    }
}

impl BoxTree {
    /// # Complexity
    /// O(n log n) for n boxes.
    pub(super) fn new(boxes: impl IntoIterator<Item = Bounds>) -> Self {
        let mut leaves: Vec<Leaf> = boxes.into_iter().map(|bounds| Leaf(bounds, 0)).collect();
        let built = Bvh::build(&mut leaves);
        let mut nodes: Vec<Node> = built
            .nodes
            .iter()
            .map(|node| match node {
                BvhNode::Leaf { shape_index, .. } => Node {
                    bounds: leaves[*shape_index].0,
                    second: 0,
                    leaf: *shape_index as u32,
                },
                BvhNode::Node {
                    child_l_aabb,
                    child_r_aabb,
                    child_r_index,
                    ..
                } => Node {
                    bounds: Bounds {
                        low: child_l_aabb.min.inf(&child_r_aabb.min),
                        high: child_l_aabb.max.sup(&child_r_aabb.max),
                    },
                    second: *child_r_index as u32,
                    leaf: INNER,
                },
            })
            .collect();
        nodes.shrink_to_fit();
        Self { nodes }
    }

    /// The box whose contents cost least, and what they are. `cost_of` gives a lower bound of the cost of all that is in a box, `None` when that
    /// is not below the given one; `look` gives the cost of the contents of the box of a number.
    pub(super) fn find_best<T>(
        &self,
        below: f64,
        cost_of: impl Fn(&Bounds, f64) -> Option<f64>,
        mut look: impl FnMut(u32, f64) -> Option<(f64, T)>,
    ) -> Option<(u32, T)> {
        let mut best = Best {
            cost: below,
            found: None,
        };
        if let Some(root) = self.nodes.first()
            && let Some(cost) = cost_of(&root.bounds, below)
        {
            self.search(0, cost, &mut best, &cost_of, &mut look);
        }
        best.found
    }

    fn search<T>(
        &self,
        at: u32,
        cost: f64,
        best: &mut Best<T>,
        cost_of: &impl Fn(&Bounds, f64) -> Option<f64>,
        look: &mut impl FnMut(u32, f64) -> Option<(f64, T)>,
    ) {
        if cost >= best.cost {
            return;
        }
        let node = &self.nodes[at as usize];
        if node.leaf != INNER {
            if let Some((cost, found)) = look(node.leaf, best.cost)
                && cost < best.cost
            {
                best.cost = cost;
                best.found = Some((node.leaf, found));
            }
            return;
        }
        let (mut near, mut far) = (at + 1, node.second);
        let cost_at = |child: u32| cost_of(&self.nodes[child as usize].bounds, best.cost);
        let (mut first, mut second) = (cost_at(near), cost_at(far));
        if second.is_some_and(|second| first.is_none_or(|first| second < first)) {
            std::mem::swap(&mut near, &mut far);
            std::mem::swap(&mut first, &mut second);
        }
        if let Some(cost) = first {
            self.search(near, cost, best, cost_of, look);
        }
        if let Some(cost) = second {
            self.search(far, cost, best, cost_of, look);
        }
    }

    /// Visits the boxes that are inside, as are all boxes around them, until `visit` returns `true`; whether it did.
    pub(super) fn any(
        &self,
        is_inside: impl Fn(&Bounds) -> bool,
        mut visit: impl FnMut(u32) -> bool,
    ) -> bool {
        !self.nodes.is_empty() && self.any_below(0, &is_inside, &mut visit)
    }

    fn any_below(
        &self,
        at: u32,
        is_inside: &impl Fn(&Bounds) -> bool,
        visit: &mut impl FnMut(u32) -> bool,
    ) -> bool {
        let node = &self.nodes[at as usize];
        is_inside(&node.bounds)
            && match node.leaf {
                INNER => {
                    self.any_below(at + 1, is_inside, visit)
                        || self.any_below(node.second, is_inside, visit)
                }
                leaf => visit(leaf),
            }
    }
}

/// The least cost so far, and its box.
struct Best<T> {
    cost: f64,
    found: Option<(u32, T)>,
}
