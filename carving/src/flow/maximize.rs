//! Growing two search trees, pushing flow where they meet, and repairing them.
//!
//! Nodes with an excess are the roots of the source tree, nodes with a deficit those of the sink tree. When no active node
//! is left the source tree is what the source reaches.

use std::collections::VecDeque;

use super::network::{Network, NodeId, Tree, parent};

impl Network {
    /// Finds a maximum flow, from the present one on, and the minimum cut nearest the source.
    ///
    /// # Complexity
    ///
    /// Follows the nodes whose arcs changed, the paths to be augmented and the parts of the trees to be repaired. As for
    /// all algorithms of its family no useful bound is known for the worst case.
    pub fn maximize(&mut self) {
        self.tick();
        let touched = std::mem::take(&mut self.touched);
        for &node in &touched {
            self.nodes[node as usize].is_touched = false;
            self.settle(node as usize);
        }
        self.touched = touched;
        self.touched.clear();
        self.grow_trees();
    }

    /// The same in a network whose nodes are all new.
    pub(crate) fn maximize_once(&mut self) {
        self.tick();
        self.active.reserve_exact(self.nodes.len());
        for node in 0..self.nodes.len() {
            self.settle(node);
        }
        self.grow_trees();
        self.active = VecDeque::new();
        self.orphans = VecDeque::new();
    }

    fn grow_trees(&mut self) {
        self.adopt_orphans();
        while let Some(node) = self.active.pop_front() {
            let node = node as usize;
            self.nodes[node].is_active = false;
            while let Some((from, slot)) = self.grow_from(node) {
                self.augment(from, slot);
                self.tick();
                self.adopt_orphans();
            }
        }
    }

    fn tick(&mut self) {
        self.time = self.time.wrapping_add(1);
        if self.time == 0 {
            for node in &mut self.nodes {
                node.stamp = 0;
            }
            self.time = 1;
        }
    }

    #[inline]
    fn activate(&mut self, node: usize) {
        if !std::mem::replace(&mut self.nodes[node].is_active, true) {
            self.active.push_back(node as u32);
        }
    }

    #[inline]
    fn make_orphan(&mut self, node: usize) {
        self.nodes[node].parent = parent::NONE;
        self.orphans.push_back(node as u32);
    }

    fn set_tree(&mut self, node: usize, tree: Tree) {
        let before = std::mem::replace(&mut self.nodes[node].tree, tree);
        let has_flipped = (before == Tree::Source) != (tree == Tree::Source);
        if has_flipped && !self.is_unlisted {
            self.flipped.push(NodeId(node as u32));
        }
    }

    /// Whether the arc at `slot` of `node` can take more in the direction in which a tree grows over it to `node`.
    #[inline]
    fn feeds(&self, tree: Tree, node: usize, slot: usize, other: usize, back: usize) -> bool {
        if tree == Tree::Source {
            self.nodes[other].has_residual(back)
        } else {
            self.nodes[node].has_residual(slot)
        }
    }

    /// Updates tree and root of a node after its excess or its arcs have changed.
    fn settle(&mut self, node: usize) {
        let state = &self.nodes[node];
        if state.excess != 0 {
            let wanted = if state.excess > 0 {
                Tree::Source
            } else {
                Tree::Sink
            };
            let before = state.tree;
            if before != wanted {
                for slot in 0..4 {
                    let Some((other, back)) = self.nodes[node].across(slot) else {
                        continue;
                    };
                    if usize::from(self.nodes[other].parent) == back {
                        self.make_orphan(other);
                    }
                    // Once this node is in no tree, its old one has to grow here again.
                    if before != Tree::None
                        && self.nodes[other].tree == before
                        && self.feeds(before, node, slot, other, back)
                    {
                        self.activate(other);
                    }
                }
                self.set_tree(node, wanted);
            }
            let state = &mut self.nodes[node];
            state.parent = parent::ROOT;
            state.distance = 1;
            state.stamp = self.time;
        } else if state.tree == Tree::None {
            return;
        } else {
            let slot = usize::from(state.parent);
            let is_held = slot < 4
                && state.across(slot).is_some_and(|(other, back)| {
                    self.nodes[other].tree == state.tree
                        && self.feeds(state.tree, node, slot, other, back)
                });
            if !is_held {
                self.make_orphan(node);
            }
        }
        self.activate(node);
    }

    /// Grows a tree from an active node over its arcs. Returns an arc, given by its start and slot, from the source tree
    /// to the sink tree, or with `None` when there is none (or the node is in no tree any more).
    fn grow_from(&mut self, node: usize) -> Option<(usize, usize)> {
        let here = self.nodes[node];
        if here.tree == Tree::None || here.parent == parent::NONE {
            return None;
        }
        for slot in 0..4 {
            let Some((other, back)) = here.across(slot) else {
                continue;
            };
            let can_take = if here.tree == Tree::Source {
                here.has_residual(slot)
            } else {
                self.nodes[other].has_residual(back)
            };
            if !can_take {
                continue;
            }
            let there = self.nodes[other].tree;
            if there == Tree::None {
                self.set_tree(other, here.tree);
                self.attach(other, back, here.distance + 1, here.stamp);
                self.activate(other);
            } else if there != here.tree {
                return Some(if here.tree == Tree::Source {
                    (node, slot)
                } else {
                    (other, back)
                });
            } else {
                // A shorter way to the root, as far as both are known.
                let known = &self.nodes[other];
                if known.stamp <= here.stamp && known.distance > here.distance {
                    self.attach(other, back, here.distance + 1, here.stamp);
                }
            }
        }
        None
    }

    fn attach(&mut self, node: usize, slot: usize, distance: u32, stamp: u32) {
        let state = &mut self.nodes[node];
        state.parent = slot as u8;
        state.distance = distance;
        state.stamp = stamp;
    }

    /// Pushes as much as fits along the tree paths that meet in an arc.
    fn augment(&mut self, from: usize, slot: usize) {
        let Some((to, back)) = self.nodes[from].across(slot) else {
            return;
        };
        let mut amount = self.residual(from, slot);
        let mut node = from;
        while let Some((up, down)) = self.up(node) {
            amount = amount.min(self.residual(up, down));
            node = up;
        }
        amount = amount.min(self.nodes[node].excess);
        node = to;
        while let Some((up, _)) = self.up(node) {
            let slot = usize::from(self.nodes[node].parent);
            amount = amount.min(self.residual(node, slot));
            node = up;
        }
        amount = amount.min(-self.nodes[node].excess);

        self.change_residual(from, slot, -amount);
        self.change_residual(to, back, amount);
        node = from;
        while let Some((up, down)) = self.up(node) {
            let slot = usize::from(self.nodes[node].parent);
            self.change_residual(node, slot, amount);
            self.change_residual(up, down, -amount);
            if !self.nodes[up].has_residual(down) {
                self.make_orphan(node);
            }
            node = up;
        }
        self.nodes[node].excess -= amount;
        if self.nodes[node].excess == 0 {
            self.make_orphan(node);
        }
        node = to;
        while let Some((up, down)) = self.up(node) {
            let slot = usize::from(self.nodes[node].parent);
            self.change_residual(node, slot, -amount);
            self.change_residual(up, down, amount);
            if !self.nodes[node].has_residual(slot) {
                self.make_orphan(node);
            }
            node = up;
        }
        self.nodes[node].excess += amount;
        if self.nodes[node].excess == 0 {
            self.make_orphan(node);
        }
    }

    /// The parent of a node, and its slot towards the node; `None` for roots.
    #[inline]
    fn up(&self, node: usize) -> Option<(usize, usize)> {
        let state = &self.nodes[node];
        if state.parent < parent::ROOT {
            state.across(usize::from(state.parent))
        } else {
            None
        }
    }

    fn adopt_orphans(&mut self) {
        while let Some(node) = self.orphans.pop_front() {
            let node = node as usize;
            let state = &self.nodes[node];
            if state.tree != Tree::None && state.parent == parent::NONE {
                self.adopt(node);
            }
        }
    }

    /// Finds a new parent for an orphan in its tree, the one nearest to a root, or removes it from the tree and orphans its children.
    fn adopt(&mut self, node: usize) {
        let tree = self.nodes[node].tree;
        let mut best: Option<(u32, usize)> = None;
        for slot in 0..4 {
            if let Some((other, back)) = self.nodes[node].across(slot)
                && self.nodes[other].tree == tree
                && self.feeds(tree, node, slot, other, back)
                && let Some(distance) = self.distance_to_root(other)
                && best.is_none_or(|(least, _)| distance < least)
            {
                best = Some((distance, slot));
            }
        }
        if let Some((distance, slot)) = best {
            self.attach(node, slot, distance + 1, self.time);
            return;
        }
        for slot in 0..4 {
            if let Some((other, back)) = self.nodes[node].across(slot)
                && self.nodes[other].tree == tree
            {
                if self.feeds(tree, node, slot, other, back) {
                    self.activate(other);
                }
                if usize::from(self.nodes[other].parent) == back {
                    self.make_orphan(other);
                }
            }
        }
        self.set_tree(node, Tree::None);
    }

    /// Steps from a node to the root of its tree; `None` when the way ends at an orphan.
    fn distance_to_root(&mut self, start: usize) -> Option<u32> {
        let (mut node, mut steps) = (start, 0);
        loop {
            let state = &mut self.nodes[node];
            if state.stamp == self.time && state.parent != parent::NONE {
                steps += state.distance;
                break;
            }
            match state.parent {
                parent::NONE => return None,
                parent::ROOT => {
                    state.stamp = self.time;
                    state.distance = 1;
                    steps += 1;
                    break;
                }
                slot => {
                    let (up, _) = state.across(usize::from(slot))?;
                    node = up;
                    steps += 1;
                }
            }
        }
        // What has been learnt on the way is kept.
        let (mut node, mut distance) = (start, steps);
        while self.nodes[node].stamp != self.time {
            self.nodes[node].stamp = self.time;
            self.nodes[node].distance = distance;
            distance -= 1;
            match self.up(node) {
                Some((up, _)) => node = up,
                None => break,
            }
        }
        Some(steps)
    }
}
