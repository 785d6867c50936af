//! Nodes, arcs and changes of them.

use std::collections::VecDeque;

use crate::growth::resize;
use crate::large_numbers::LargeNumbers;

/// A node of a [`Network`].
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct NodeId(pub u32);

/// No joint.
pub(super) const NOWHERE: u32 = u32::MAX;

/// What connects a node to its tree.
pub(super) mod parent {
    /// An excess or a deficit of its own. Smaller values are the slot of the arc to the parent.
    pub(in super::super) const ROOT: u8 = 4;
    /// Nothing: in no tree, or an orphan.
    pub(in super::super) const NONE: u8 = 5;
}

/// The search tree that a node belongs to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Tree {
    /// Reached from no terminal.
    None,
    /// The source reaches it through arcs with a residual.
    Source,
    /// It reaches the sink through arcs with a residual.
    Sink,
}

/// A node with its outgoing arcs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// What the arc of each slot can still take; see [`Network::residual`].
    residual: [u32; 4],
    /// The slot at the other end, as `4 * node + slot`.
    pub(super) across: [u32; 4],
    /// What the terminal grants minus what leaves by the arcs. Positive: supply left; negative: demand left.
    pub(super) excess: i64,
    /// Steps to the root, as known at `stamp`.
    pub(super) distance: u32,
    pub(super) stamp: u32,
    pub(super) parent: u8,
    pub(super) tree: Tree,
    pub(super) is_active: bool,
    pub(super) is_touched: bool,
}

impl Node {
    const EMPTY: Node = Node {
        residual: [0; 4],
        across: [NOWHERE; 4],
        excess: 0,
        distance: 0,
        stamp: 0,
        parent: parent::NONE,
        tree: Tree::None,
        is_active: false,
        is_touched: false,
    };

    /// Whether the arc of a slot can take more.
    #[inline]
    pub(super) fn has_residual(&self, slot: usize) -> bool {
        self.residual[slot] > 0
    }

    /// The node across a slot and the slot by which that node looks back.
    #[inline]
    pub(super) fn across(&self, slot: usize) -> Option<(usize, usize)> {
        let packed = self.across[slot];
        (packed != NOWHERE).then_some(((packed >> 2) as usize, (packed & 3) as usize))
    }
}

/// A flow network of nodes with four slots each.
///
/// Capacities and terminals are at most 2^60 in size, and so must be the sum of all terminals of one sign. About 72
/// bytes a node, more where numbers of arcs do not fit into 32 bits.
#[derive(Clone, Debug, Default)]
pub struct Network {
    pub(super) nodes: Vec<Node>,
    capacities: Vec<[u32; 4]>,
    large_residuals: LargeNumbers,
    large_capacities: LargeNumbers,
    /// Whether nodes that change sides are not listed.
    pub(super) is_unlisted: bool,
    /// Number of the current repair of the trees, for `Node::stamp`.
    pub(super) time: u32,
    pub(super) touched: Vec<u32>,
    pub(super) active: VecDeque<u32>,
    pub(super) orphans: VecDeque<u32>,
    pub(super) flipped: Vec<NodeId>,
}

/// The key of a slot among large numbers.
#[inline]
fn key(node: usize, slot: usize) -> u64 {
    (node << 2 | slot) as u64
}

impl Network {
    /// No nodes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Nodes without arcs, 2^30 - 1 at most, for one [`maximize_once`](Self::maximize_once). Capacities are not kept, so that nothing but
    /// [`begin_capacity`](Self::begin_capacity) and [`begin_terminal`](Self::begin_terminal) may set them.
    pub(crate) fn once(nodes: usize) -> Self {
        Self {
            nodes: vec![Node::EMPTY; nodes],
            is_unlisted: true,
            ..Self::default()
        }
    }

    /// Sets a capacity for the first time, where capacities are not kept; as [`set_capacity`](Self::set_capacity), the flow follows.
    pub(crate) fn begin_capacity(&mut self, node: NodeId, slot: usize, capacity: i64) {
        let node = node.0 as usize;
        if let Some((other, back)) = self.nodes[node].across(slot) {
            self.change_residual(other, back, capacity);
            self.nodes[node].excess -= capacity;
            self.nodes[other].excess += capacity;
        }
    }

    /// Sets the terminal of a node for the first time, where capacities are not kept.
    pub(crate) fn begin_terminal(&mut self, node: NodeId, granted: i64) {
        self.nodes[node.0 as usize].excess += granted;
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Adds nodes without arcs until there are `nodes`, 2^30 - 1 at most.
    pub fn grow(&mut self, nodes: usize) {
        resize(&mut self.nodes, nodes, Node::EMPTY);
        resize(&mut self.capacities, nodes, [0; 4]);
    }

    /// Removes all joints, terminals and flow. Every node is then on the sink side.
    pub fn clear(&mut self) {
        for index in 0..self.nodes.len() {
            if self.nodes[index].tree == Tree::Source {
                self.flipped.push(NodeId(index as u32));
            }
        }
        self.nodes.fill(Node::EMPTY);
        self.capacities.fill([0; 4]);
        self.large_residuals.clear();
        self.large_capacities.clear();
        self.touched.clear();
        self.active.clear();
        self.orphans.clear();
        self.time = 0;
    }

    /// What the arc that leaves a node by a slot can still take.
    #[inline]
    pub(super) fn residual(&self, node: usize, slot: usize) -> i64 {
        let stored = self.nodes[node].residual[slot];
        self.large_residuals.get(stored, key(node, slot)) as i64
    }

    /// Sets what an arc can still take; not negative.
    #[inline]
    pub(super) fn set_residual(&mut self, node: usize, slot: usize, residual: i64) {
        debug_assert!(residual >= 0, "the flow is within the capacities");
        let stored = &mut self.nodes[node].residual[slot];
        self.large_residuals
            .set(stored, key(node, slot), residual as u64);
    }

    /// Lets an arc take more, or less for a negative amount.
    #[inline]
    pub(super) fn change_residual(&mut self, node: usize, slot: usize, by: i64) {
        self.set_residual(node, slot, self.residual(node, slot) + by);
    }

    #[inline]
    pub(super) fn capacity_of(&self, node: usize, slot: usize) -> i64 {
        let stored = self.capacities[node][slot];
        self.large_capacities.get(stored, key(node, slot)) as i64
    }

    #[inline]
    fn set_capacity_of(&mut self, node: usize, slot: usize, capacity: i64) {
        let stored = &mut self.capacities[node][slot];
        self.large_capacities
            .set(stored, key(node, slot), capacity as u64);
    }

    #[inline]
    pub(super) fn touch(&mut self, node: usize) {
        if !std::mem::replace(&mut self.nodes[node].is_touched, true) {
            self.touched.push(node as u32);
        }
    }

    /// Joins a slot of one node with a slot of another, after cutting what they were joined with. The arcs of a new joint
    /// have capacity zero. Nothing happens where the two are joined already.
    ///
    /// # Panics
    ///
    /// For nodes and slots that do not exist.
    pub fn join(&mut self, a: NodeId, a_slot: usize, b: NodeId, b_slot: usize) {
        let pack = |node: NodeId, slot: usize| node.0 << 2 | slot as u32;
        let (a_index, b_index) = (a.0 as usize, b.0 as usize);
        if self.nodes[a_index].across[a_slot] == pack(b, b_slot) {
            return;
        }
        self.cut_joint(a, a_slot);
        self.cut_joint(b, b_slot);
        self.nodes[a_index].across[a_slot] = pack(b, b_slot);
        self.nodes[b_index].across[b_slot] = pack(a, a_slot);
    }

    /// Removes a joint with its two arcs. Their flow becomes an excess before it and a deficit behind it.
    ///
    /// # Panics
    ///
    /// For nodes and slots that do not exist.
    #[inline]
    pub fn cut_joint(&mut self, node: NodeId, slot: usize) {
        let node = node.0 as usize;
        if let Some(across) = self.nodes[node].across(slot) {
            self.cut(node, slot, across);
        }
    }

    fn cut(&mut self, node: usize, slot: usize, (other, back): (usize, usize)) {
        let flow = self.capacity_of(node, slot) - self.residual(node, slot);
        self.nodes[node].excess += flow;
        self.nodes[other].excess -= flow;
        for (node, slot) in [(node, slot), (other, back)] {
            self.set_capacity_of(node, slot, 0);
            self.set_residual(node, slot, 0);
            let state = &mut self.nodes[node];
            state.across[slot] = NOWHERE;
            if usize::from(state.parent) == slot {
                state.parent = parent::NONE;
            }
            self.touch(node);
        }
    }

    /// Removes all joints and the terminal of a node.
    ///
    /// # Panics
    ///
    /// For nodes that do not exist.
    pub fn isolate(&mut self, node: NodeId) {
        for slot in 0..4 {
            self.cut_joint(node, slot);
        }
        self.set_terminal(node, 0);
    }

    /// Sets what a node may take from the source, minus what it may give to the sink.
    ///
    /// Of two arcs, one from the source and one to the sink, only the difference matters to the cut.
    ///
    /// # Panics
    ///
    /// For nodes that do not exist.
    pub fn set_terminal(&mut self, node: NodeId, granted: i64) {
        let before = self.terminal(node);
        let node = node.0 as usize;
        if before != granted {
            self.nodes[node].excess += granted - before;
            self.touch(node);
        }
    }

    /// Sets the capacity of the arc that leaves a node by a slot; without effect where the slot is not joined.
    ///
    /// The flow follows the capacity, up and down, as far as an excess behind the arc and a deficit before it allow. Supplies
    /// thus follow the capacities before any search.
    ///
    /// # Panics
    ///
    /// For nodes and slots that do not exist; with debug assertions for negative capacities.
    pub fn set_capacity(&mut self, node: NodeId, slot: usize, capacity: i64) {
        debug_assert!(capacity >= 0, "capacities are not negative");
        let node = node.0 as usize;
        let Some((other, back)) = self.nodes[node].across(slot) else {
            return;
        };
        let before = self.capacity_of(node, slot);
        if before == capacity {
            return;
        }
        self.set_capacity_of(node, slot, capacity);
        let residual_before = self.residual(node, slot);
        let flow_before = before - residual_before;
        // What is left ahead stays as it is, unless the way back has no room.
        let back_residual = self.residual(other, back) + (capacity - before);
        let residual = residual_before + back_residual.min(0);
        self.set_residual(node, slot, residual);
        self.set_residual(other, back, back_residual.max(0));
        let more = capacity - residual - flow_before;
        self.nodes[node].excess -= more;
        self.nodes[other].excess += more;
        self.touch(node);
        self.touch(other);
    }

    /// What a node may take from the source, minus what it may give to the sink: its excess, and what leaves it by its arcs.
    ///
    /// # Panics
    ///
    /// For nodes that do not exist.
    pub fn terminal(&self, node: NodeId) -> i64 {
        let node = node.0 as usize;
        let flow = |slot| self.capacity_of(node, slot) - self.residual(node, slot);
        self.nodes[node].excess + (0..4).map(flow).sum::<i64>()
    }

    /// Capacity of the arc that leaves a node by a slot.
    ///
    /// # Panics
    ///
    /// For nodes and slots that do not exist.
    pub fn capacity(&self, node: NodeId, slot: usize) -> i64 {
        self.capacity_of(node.0 as usize, slot)
    }

    /// Whether the source reaches the node in the residual graph, as of the latest [`maximize`](Self::maximize).
    ///
    /// # Panics
    ///
    /// For nodes that do not exist.
    #[inline]
    pub fn is_source_side(&self, node: NodeId) -> bool {
        self.nodes[node.0 as usize].tree == Tree::Source
    }

    /// Nodes that may have changed sides since the list was last emptied, in no particular order and possibly repeated.
    pub fn flipped(&mut self) -> &mut Vec<NodeId> {
        &mut self.flipped
    }

    /// Cost of the cut: the arcs from source side to sink side, demands on the source side and supplies on the sink side.
    /// After [`maximize`](Self::maximize) that is the maximum flow.
    ///
    /// # Complexity
    ///
    /// Linear in the number of nodes.
    pub fn cut_value(&self) -> i64 {
        let mut value = 0;
        for (index, node) in self.nodes.iter().enumerate() {
            let terminal = self.terminal(NodeId(index as u32));
            if node.tree != Tree::Source {
                value += terminal.max(0);
                continue;
            }
            value += (-terminal).max(0);
            for slot in 0..4 {
                if let Some((other, _)) = node.across(slot)
                    && self.nodes[other].tree != Tree::Source
                {
                    value += self.capacity_of(index, slot);
                }
            }
        }
        value
    }
}
