//! The flow against an independent implementation, from scratch and after random changes.

use petgraph::graph::DiGraph;
use petgraph::visit::EdgeRef;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Maximum flow and the nodes that the source reaches, by the oracle.
fn oracle(network: &Network) -> (u64, Vec<bool>) {
    let n = network.len();
    let mut graph: DiGraph<(), u64> = DiGraph::new();
    let nodes: Vec<_> = (0..n + 2).map(|_| graph.add_node(())).collect();
    let (source, sink) = (nodes[n], nodes[n + 1]);
    for i in 0..n {
        let terminal = network.terminal(NodeId(i as u32));
        if terminal > 0 {
            graph.add_edge(source, nodes[i], terminal.unsigned_abs());
        } else {
            graph.add_edge(nodes[i], sink, terminal.unsigned_abs());
        }
        for slot in 0..4 {
            if let Some((other, _)) = network.nodes[i].across(slot) {
                let capacity = network.capacity_of(i, slot);
                graph.add_edge(nodes[i], nodes[other], capacity.unsigned_abs());
            }
        }
    }
    let (value, flows) = petgraph::algo::ford_fulkerson(&graph, source, sink);
    let mut reached = vec![false; n + 2];
    let mut stack = vec![source];
    reached[source.index()] = true;
    while let Some(node) = stack.pop() {
        for edge in graph.edge_references() {
            let flow = flows[edge.id().index()];
            let mut visit = |next: petgraph::graph::NodeIndex| {
                if !std::mem::replace(&mut reached[next.index()], true) {
                    stack.push(next);
                }
            };
            if edge.source() == node && flow < *edge.weight() {
                visit(edge.target());
            }
            if edge.target() == node && flow > 0 {
                visit(edge.source());
            }
        }
    }
    reached.truncate(n);
    (value, reached)
}

fn assert_agrees(network: &Network, context: &str) {
    if let Err(violation) = network.check() {
        panic!("{context}: {violation}");
    }
    let (value, reached) = oracle(network);
    assert_eq!(network.cut_value().unsigned_abs(), value, "{context}");
    for (i, reached) in reached.into_iter().enumerate() {
        assert_eq!(
            network.is_source_side(NodeId(i as u32)),
            reached,
            "{context}, node {i}"
        );
    }
}

/// One change, in capacities of which many are zero or equal.
fn change(rng: &mut ChaCha8Rng, network: &mut Network) {
    let n = network.len() as u32;
    let node = NodeId(rng.random_range(0..n));
    let slot = rng.random_range(0..4);
    match rng.random_range(0..12) {
        0..4 => {
            let other = NodeId(rng.random_range(0..n));
            if other != node {
                network.join(node, slot, other, rng.random_range(0..4));
            }
        }
        4 => network.cut_joint(node, slot),
        5 if rng.random_range(0..4) == 0 => network.isolate(node),
        5..8 => network.set_terminal(node, rng.random_range(-12..=12)),
        _ => network.set_capacity(node, slot, rng.random_range(0..8)),
    }
}

#[test]
fn flow_and_cut_agree_with_the_oracle_after_any_change() {
    for seed in 0..120 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut network = Network::new();
        network.grow(rng.random_range(2..40));
        for step in 0..25 {
            // Few changes or many between two flows.
            let changes = if rng.random() {
                rng.random_range(1..4)
            } else {
                rng.random_range(20..120)
            };
            for _ in 0..changes {
                change(&mut rng, &mut network);
            }
            network.maximize();
            assert_agrees(&network, &format!("seed {seed} step {step}"));
        }
    }
}

/// A cube of cells joined to six neighbours at most has more than four; a brick pattern with four is as good.
#[test]
fn a_sheet_of_nodes_agrees_with_the_oracle() {
    const SIDE: u32 = 14;
    for seed in 0..6 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut network = Network::new();
        network.grow((SIDE * SIDE) as usize);
        for i in 0..SIDE * SIDE {
            let (x, y) = (i % SIDE, i / SIDE);
            if x + 1 < SIDE {
                network.join(NodeId(i), 0, NodeId(i + 1), 1);
            }
            if y + 1 < SIDE {
                network.join(NodeId(i), 2, NodeId(i + SIDE), 3);
            }
        }
        for _ in 0..8 {
            for i in 0..SIDE * SIDE {
                if rng.random_range(0..3) == 0 {
                    network.set_terminal(NodeId(i), rng.random_range(-900..=900));
                    for slot in 0..4 {
                        network.set_capacity(NodeId(i), slot, rng.random_range(0..500));
                    }
                }
            }
            network.maximize();
            assert_agrees(&network, &format!("seed {seed}"));
        }
    }
}

#[test]
fn the_cut_is_the_one_nearest_the_source() {
    // A chain whose arcs are all saturated: every one of them is a minimum cut.
    let mut network = Network::new();
    network.grow(5);
    for i in 0..4 {
        network.join(NodeId(i), 0, NodeId(i + 1), 1);
        network.set_capacity(NodeId(i), 0, 3);
    }
    network.set_terminal(NodeId(0), 7);
    network.set_terminal(NodeId(4), -7);
    network.maximize();
    let sides: Vec<bool> = (0..5).map(|i| network.is_source_side(NodeId(i))).collect();
    assert_eq!(sides, [true, false, false, false, false]);
    // Without a demand nothing is cut, and all is reached.
    network.set_terminal(NodeId(4), 0);
    network.maximize();
    assert!((0..5).all(|i| network.is_source_side(NodeId(i))));
    assert_eq!(network.cut_value(), 0);
    network.clear();
    network.maximize();
    assert!((0..5).all(|i| !network.is_source_side(NodeId(i))));
}
