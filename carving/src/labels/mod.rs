//! Labels: which cells are free.
//!
//! [`Votes`] labels each cell by its own weight. With [`CutOptions`] all cells are labelled together, by the surface of least
//! cost.

mod cut;
mod cut_options;
mod quality;
mod votes;

pub(crate) use cut::Cut;
pub use cut_options::{CutOptions, CutOptionsError};
#[cfg(feature = "internals")]
pub use quality::{FacetShape, cosines};
pub use votes::Votes;

#[cfg(feature = "internals")]
use crate::visibility::rays::RayTracer;

/// How cells are labelled.
#[derive(Clone, Copy, PartialEq, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "snake_case")
)]
pub enum Labels {
    /// Each cell by the weight of the rays across it.
    Votes(Votes),
    /// All cells together, by a minimum cut.
    Cut(CutOptions),
}

#[cfg(feature = "internals")]
impl Labels {
    /// A tracer of rays for these labels.
    pub fn tracer(&self) -> RayTracer {
        RayTracer::new(match self {
            Self::Votes(_) => None,
            Self::Cut(options) => Some(options.softness()),
        })
    }
}

impl Default for Labels {
    /// The minimum cut, which weighs wrong points against right ones.
    fn default() -> Self {
        Labels::Cut(CutOptions::default())
    }
}
