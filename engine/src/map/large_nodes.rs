//! Parameters of R-trees that are asked often.

use rstar::{RStarInsertionStrategy, RTreeParams};

/// Nodes of an R-tree twice as large as usual: most of a query is waiting for the memory of nodes. Tuned on the kitchen of 7-Scenes.
#[derive(Debug, Clone)]
pub(super) struct LargeNodes;

impl RTreeParams for LargeNodes {
    const MIN_SIZE: usize = 5;
    const MAX_SIZE: usize = 12;
    const REINSERTION_COUNT: usize = 3;
    type DefaultInsertionStrategy = RStarInsertionStrategy;
}
