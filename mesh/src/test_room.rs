//! A furnished room for tests: the ground truth of the sample.

use std::path::Path;

use crate::{Shape, read_geometry};

/// The surface of the sample's room.
pub(crate) fn room() -> Shape {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../assets/room/ground-truth.ply"
    );
    read_geometry(Path::new(path)).expect("the sample lies in the repository")
}
