//! Generated input for several tests.

pub(crate) mod carvings;
pub(crate) mod points;
pub(crate) mod rooms;
