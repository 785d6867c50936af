#![doc = include_str!("../README.md")]

mod blocks;
mod bounds;
mod carve;
mod conflict;
mod error;
mod file;
mod frame;
mod giants;
mod label;
mod merge;
mod network;
mod plan;
mod plan_carver;
mod planner;
mod record;
mod run;
mod run_item;
mod settle;
mod split;
mod stage;
mod surface;
mod surface_file;
mod tile;
mod work;

pub use error::TilesError;
pub use merge::{MergedMesh, merged_mesh, merged_surface};
pub use plan::{Plan, PlanOptions, TileSummary};
pub use plan_carver::plan;
pub use planner::{Planner, SeenPoint};
pub use run::{run, run_pending};
pub use run_item::run_item;
pub use stage::{Item, Stage};
pub use work::{Manifest, Work};
