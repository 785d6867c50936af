//! The configuration file of `--config`: the few parameters that users set.
//!
//! [`Configuration`] holds them, with a range and a description each. All other parameters are fields of
//! [`Options`]; they are tuned, and programs set them in Rust. `docs/configuration.md` is made from the descriptions.
//!
//! - `keys`: the tables and their keys.
//! - `table`: the macro that declares a table, and what it needs to know of a key.
//! - `read`: reads a file, and finds the line of a fault.
//! - `error`: why a file is refused.
//! - `nearest`: the key that was probably meant.
//! - `tolerance`: how a tolerance is written.

#[cfg(test)]
mod document;
mod error;
mod keys;
mod nearest;
mod read;
mod table;
#[cfg(test)]
mod tests;
mod tolerance;

pub use error::ConfigurationError;
pub use keys::{
    CarvingTable, Configuration, CutTable, ImagesTable, KeyframesTable, MapPointsTable, MatchTable,
    PoseCorrectionTable, SemiDenseTable, SensorTable, SimplifyTable, SurfaceTable,
};
pub use table::{Key, Table, Values};

use crate::options::Options;

impl Configuration {
    /// The part of `options` that users set.
    pub fn of(options: &Options) -> Self {
        Self::from_options(options)
    }

    /// The parameters of every stage: these, and the defaults of all others.
    pub fn options(&self) -> Options {
        let mut options = Options::default();
        self.set(&mut options);
        options
    }

    /// Every table with its keys, in the order of `docs/configuration.md`.
    pub fn tables() -> Vec<Table> {
        let mut tables = Vec::new();
        Self::describe(&mut tables);
        tables
    }
}
