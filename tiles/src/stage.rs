//! The stages of a plan and their items.

use std::fmt;
use std::str::FromStr;

/// A stage; all items of the stages before it must be done.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Stage {
    /// Points of other tiles that a tile needs.
    Frame,
    /// What rays say about the cells of a tile.
    Carve,
    /// What the rays of all tiles say about giant cells.
    Giants,
    /// The network of the cells of a tile (cut).
    Network,
    /// The labels of a tile that its surroundings cannot change (cut).
    Label,
    /// The other labels (cut).
    Settle,
    /// The surface triangles of a tile.
    Surface,
    /// The mesh.
    Merge,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Stage; 8] = [
        Stage::Frame,
        Stage::Carve,
        Stage::Giants,
        Stage::Network,
        Stage::Label,
        Stage::Settle,
        Stage::Surface,
        Stage::Merge,
    ];

    /// Name on the command line, and of the folder with its files.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Frame => "frame",
            Stage::Carve => "carve",
            Stage::Giants => "giants",
            Stage::Network => "network",
            Stage::Label => "label",
            Stage::Settle => "settle",
            Stage::Surface => "surface",
            Stage::Merge => "merge",
        }
    }

    /// The stages of plans whose labels are those of a minimum cut, or not.
    pub fn of_labels(is_cut: bool) -> Vec<Stage> {
        let needs = |stage: &Stage| {
            is_cut || !matches!(stage, Stage::Network | Stage::Label | Stage::Settle)
        };
        Stage::ALL.into_iter().filter(needs).collect()
    }

    /// The items of the stage in plans of so many tiles.
    pub fn items_of(self, tiles: usize) -> impl Iterator<Item = Item> + use<> {
        let count = match self {
            Stage::Giants | Stage::Settle | Stage::Merge => 1,
            _ => tiles,
        };
        (0..count).map(move |number| Item {
            stage: self,
            number,
        })
    }
}

impl FromStr for Stage {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let names = || Self::ALL.map(Stage::name).join(", ");
        (Self::ALL.into_iter())
            .find(|stage| stage.name() == text)
            .ok_or_else(|| format!("no stage of this name; stages are {}", names()))
    }
}

/// One task: a pure function of files.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Item {
    /// The stage.
    pub stage: Stage,
    /// Number within the stage: that of the tile.
    pub number: usize,
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.stage.name(), self.number)
    }
}

/// What an item counted.
pub(crate) type Counts = Vec<(String, u64)>;

/// Names and numbers of what an item counted.
pub(crate) fn counts<const N: usize>(counted: [(&str, usize); N]) -> Counts {
    let counted = counted.map(|(name, count)| (name.to_owned(), count as u64));
    counted.to_vec()
}
