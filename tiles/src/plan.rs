//! The plan: which tile owns which points, the options, and the files that all tasks read.

use linecarve_carving::{CarverOptions, ExportOptions, Labels};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::file::program;

/// How a plan is made; nothing of it changes the mesh.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct PlanOptions {
    /// Number of tiles.
    pub tiles: usize,
    /// Another number splits the points in another way.
    pub seed: u64,
    /// How many cells beyond its own a tile looks at for a cut, counted across facets.
    pub halo: u32,
    /// Most positions that decide where tiles end; with fewer points all do.
    pub sample: usize,
    /// Keep which triangles meet at each edge, for [`merged_surface`](crate::merged_surface). All triangles are then merged as they are,
    /// without the filters and the repair of the export options.
    pub keeps_neighbors: bool,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            tiles: 1,
            seed: 0,
            halo: 8,
            sample: 1 << 20,
            keeps_neighbors: false,
        }
    }
}

/// A tile of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileSummary {
    /// Number of its points.
    pub points: usize,
    /// Number of rays to them.
    pub rays: usize,
}

/// What all tasks know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of the program that made it.
    program: String,
    /// Digest of points, views, observations and split.
    input: String,
    /// How the carver labels.
    pub(crate) carver: CarverOptions,
    /// How the mesh is exported.
    pub(crate) export: ExportOptions,
    pub(crate) halo: u32,
    /// See [`PlanOptions::keeps_neighbors`].
    pub(crate) keeps_neighbors: bool,
    /// Cells with a longer side of their bounding box are giants; without it none are.
    giant_extent: Option<f64>,
    /// The tiles.
    pub tiles: Vec<TileSummary>,
    /// What the caller wants to know again when the mesh is there.
    pub caller: String,
    /// Digest of all the rest.
    pub(crate) sealed: String,
}

impl Plan {
    /// Whether labels are those of a minimum cut.
    pub fn is_cut(&self) -> bool {
        matches!(self.carver.labels, Labels::Cut(_))
    }

    /// Whether a cell with this longest side of its bounding box is a giant.
    pub(crate) fn is_giant(&self, extent: f64) -> bool {
        self.giant_extent.is_some_and(|giant| extent > giant)
    }

    /// Number of sums that a cell has.
    pub(crate) fn sums(&self) -> usize {
        if self.is_cut() { 6 } else { 1 }
    }

    pub(crate) fn seal(&self) -> String {
        let unsealed = Self {
            sealed: String::new(),
            ..self.clone()
        };
        let text = serde_json::to_vec(&unsealed).unwrap_or_default();
        format!("{:016x}", xxh3_64(&text))
    }
}

impl Plan {
    /// `extents` are the longest sides of the tiles that have points.
    pub(crate) fn new(
        input: String,
        carver: CarverOptions,
        export: ExportOptions,
        (halo, keeps_neighbors): (u32, bool),
        extents: Vec<f64>,
        tiles: Vec<TileSummary>,
        caller: String,
    ) -> Self {
        let mut plan = Self {
            program: program(),
            input,
            carver,
            export: match keeps_neighbors {
                true => ExportOptions::default(),
                false => export,
            },
            halo,
            keeps_neighbors,
            giant_extent: giant_extent(extents, tiles.len()),
            tiles,
            caller,
            sealed: String::new(),
        };
        plan.sealed = plan.seal();
        plan
    }
}

/// Wider cells are giants, as a share of the median of the tiles' longest sides. A larger share has tiles walk more rays of others, a
/// smaller one gives every tile more vertices of giants. Chosen on a generated city in 8 tiles.
const GIANT_SHARE: f64 = 0.125;

/// From which extent on cells are giants; none are in a single tile.
fn giant_extent(mut extents: Vec<f64>, tiles: usize) -> Option<f64> {
    if tiles == 1 {
        return None;
    }
    extents.sort_unstable_by(f64::total_cmp);
    let middle = extents.get(extents.len() / 2).copied();
    Some(GIANT_SHARE * middle.unwrap_or(0.0))
}
