//! Verifies that the flow is a flow, and that it proves the cut.

use thiserror::Error;

use super::network::{Network, NodeId, Tree, parent};

/// The first property of the flow network found broken, with its witness. Any occurrence is a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FlowViolation {
    /// The slot at the other end is not joined to this one.
    #[error("slot {slot} of {node:?} is joined in one direction only")]
    Joint {
        /// The node.
        node: NodeId,
        /// Its slot.
        slot: usize,
    },
    /// The flow exceeds the capacity, or the two residuals do not add up to the two capacities.
    #[error("the residual of slot {slot} of {node:?} is {residual}, its capacity {capacity}")]
    Residual {
        /// The node.
        node: NodeId,
        /// Its slot.
        slot: usize,
        /// The residual on record.
        residual: i64,
        /// The capacity.
        capacity: i64,
    },
    /// A node is on the source side without a path from a supply.
    #[error("{node:?} is on the source side, and no supply reaches it")]
    Unreached {
        /// The node.
        node: NodeId,
    },
    /// A supply, or an arc with a residual from the source side, leads to a node that is not on it; or a node on the source
    /// side has a demand left.
    #[error("{node:?} has an augmenting path to the sink")]
    Augmentable {
        /// The node.
        node: NodeId,
    },
}

impl Network {
    /// Verifies joints and residuals, that no more flow is possible, and that the source side is what the
    /// source reaches; meant for tests, after [`maximize`](Self::maximize).
    ///
    /// # Errors
    ///
    /// The first [`FlowViolation`].
    ///
    /// # Complexity
    ///
    /// Linear in the number of nodes times the depth of the trees.
    pub fn check(&self) -> Result<(), FlowViolation> {
        for (index, node) in self.nodes.iter().enumerate() {
            let id = NodeId(index as u32);
            for slot in 0..4 {
                let (residual, capacity) =
                    (self.residual(index, slot), self.capacity_of(index, slot));
                let broken = FlowViolation::Residual {
                    node: id,
                    slot,
                    residual,
                    capacity,
                };
                let Some((other, back)) = node.across(slot) else {
                    if residual != 0 || capacity != 0 {
                        return Err(broken);
                    }
                    continue;
                };
                let reverse = &self.nodes[other];
                if reverse.across(back) != Some((index, slot)) {
                    return Err(FlowViolation::Joint { node: id, slot });
                }
                let both = capacity + self.capacity_of(other, back);
                if residual + self.residual(other, back) != both {
                    return Err(broken);
                }
                let leaks = node.tree == Tree::Source && reverse.tree != Tree::Source;
                if leaks && residual > 0 {
                    return Err(FlowViolation::Augmentable { node: id });
                }
            }
            let is_source = node.tree == Tree::Source;
            if is_source && node.excess < 0 || !is_source && node.excess > 0 {
                return Err(FlowViolation::Augmentable { node: id });
            }
            if is_source && !self.is_reached(index) {
                return Err(FlowViolation::Unreached { node: id });
            }
        }
        Ok(())
    }

    fn is_reached(&self, start: usize) -> bool {
        let mut node = start;
        for _ in 0..=self.nodes.len() {
            let state = &self.nodes[node];
            if state.tree != Tree::Source {
                return false;
            }
            if state.parent == parent::ROOT {
                return state.excess > 0;
            }
            if state.parent == parent::NONE {
                return false;
            }
            let Some((up, down)) = state.across(usize::from(state.parent)) else {
                return false;
            };
            if !self.nodes[up].has_residual(down) {
                return false;
            }
            node = up;
        }
        false
    }
}
