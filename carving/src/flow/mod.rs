//! Maximum flow and minimum cut on graphs whose nodes have at most four neighbours, kept up to date under change.
//!
//! [`Network`] is made for the cells of a tetrahedralisation: a node has four slots, each joined to a slot of another
//! node or to none, so there are no adjacency lists, and the reverse of an arc is found by its slot. Capacities are
//! integers. After any change of capacities, nodes and joints, [`Network::maximize`] goes on from the flow it has.
//!
//! Of all minimum cuts the one nearest the source is kept: the nodes that the source can reach in the residual graph. It
//! is the same for every maximum flow, so it is a function of the capacities alone, whatever led to them.
//!
//! # Example
//!
//! ```
//! use linecarve_carving::internals::flow::{Network, NodeId};
//!
//! let mut network = Network::new();
//! network.grow(2);
//! let [a, b] = [NodeId(0), NodeId(1)];
//! network.join(a, 0, b, 3);
//! network.set_terminal(a, 5); // from the source
//! network.set_terminal(b, -4); // to the sink
//! network.set_capacity(a, 0, 2);
//! network.maximize();
//! assert!(network.is_source_side(a) && !network.is_source_side(b));
//! assert_eq!(network.cut_value(), 2);
//!
//! network.set_capacity(a, 0, 9);
//! network.maximize();
//! assert_eq!(network.cut_value(), 4);
//! assert!(network.is_source_side(b)); // the arc to the sink is what is cut now
//! ```
//!
//! # Reference
//!
//! Y. Boykov, V. Kolmogorov, "An experimental comparison of min-cut/max-flow algorithms for energy minimization in
//! vision", PAMI 26(9), 2004: two search trees that are repaired instead of rebuilt. P. Kohli, P. Torr, "Dynamic graph
//! cuts for efficient inference in Markov random fields", PAMI 29(12), 2007: flow and trees survive changes.
//! A. Goldberg, S. Hed, H. Kaplan, P. Kohli, R. Tarjan, R. Werneck, "Faster and more dynamic maximum flow by incremental
//! breadth-first search", ESA 2015: pseudoflows, whose excesses and deficits are the roots of the trees.
//! *Differs from the papers:* joints come and go as cells do. The terminals hold no flow of their own; a node's excess is
//! what its terminal grants minus what leaves it, so that any flow within capacities is a valid start, and cutting a joint
//! needs no search: what flowed there becomes an excess on one side and a deficit on the other.

mod check;
mod maximize;
mod network;

pub use check::FlowViolation;
pub use network::{Network, NodeId};

#[cfg(test)]
mod tests;
