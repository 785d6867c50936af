//! Why a plan or one of its stages fails.

use std::io;
use std::path::{Path, PathBuf};

use linecarve_carving::PointError;

use crate::stage::Item;

/// Why a plan cannot be made or carried out. Texts name the file and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum TilesError {
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file is not what was written.
    #[error("{}: damaged ({what}); delete it and run `linecarve tiles run` again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A file of the plan is not what was written, or missing.
    #[error("{}: {what}; run `linecarve tiles plan` again with the same arguments, which makes it anew", path.display())]
    DamagedPlan {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A folder holds no plan.
    #[error("{0}: it holds no plan; make one with `linecarve tiles plan INPUT {0}`", path.display())]
    NoPlan {
        /// The folder.
        path: PathBuf,
    },
    /// A file belongs to another plan.
    #[error("{}: made for another plan; delete the folder's contents and plan again", path.display())]
    OtherPlan {
        /// The file.
        path: PathBuf,
    },
    /// The folder holds another plan.
    #[error(
        "{} holds the plan of another input or of other options: give another folder, or delete this one", path.display()
    )]
    Planned {
        /// The folder.
        path: PathBuf,
    },
    /// Vertices of a mesh have 32 bits.
    #[error("the mesh has 4 294 967 295 vertices or more: reconstruct parts of the scene")]
    TooLarge,
    /// The plan was made by another version.
    #[error(
        "{}: planned by version {found} of the program, this is {expected}: use that version, or plan again into another folder",
        path.display()
    )]
    OtherProgram {
        /// The plan.
        path: PathBuf,
        /// The version that made it.
        found: String,
        /// This version.
        expected: String,
    },
    /// What an item needs has not been made.
    #[error(
        "{item} needs {needed}, which has not been made: run the stages in order (`linecarve tiles run`)"
    )]
    NotReady {
        /// The item.
        item: Item,
        /// What it needs.
        needed: Item,
    },
    /// There is no such item.
    #[error("there is no item {item}: the plan has {tiles} tiles")]
    NoItem {
        /// The item.
        item: Item,
        /// Number of tiles.
        tiles: usize,
    },
    /// The points do not span space, so there are no cells.
    #[error("the {points} points of the input lie in a plane or are too few: there is no surface")]
    Flat {
        /// Number of distinct positions.
        points: usize,
    },
    /// The centre of a view cannot be computed with.
    #[error("view {view}: {source}")]
    View {
        /// Number of the view.
        view: usize,
        /// Why.
        source: PointError,
    },
    /// A point cannot be computed with.
    #[error("point {point}: {source}")]
    Point {
        /// Number of the point.
        point: u64,
        /// Why.
        source: PointError,
    },
    /// A point is seen by a view that there is not.
    #[error("point {point} is seen by view {view}, but there are {views} views")]
    UnknownView {
        /// Number of the point.
        point: u64,
        /// The view.
        view: u32,
        /// Number of views.
        views: usize,
    },
    /// Points are in doubt for too many cells.
    #[error(
        "thousands of the {points} points lie exactly on one plane or sphere, and tiles would take hours: carve them in one process \
         (`linecarve reconstruct --final-only`), or plan fewer tiles"
    )]
    Cospherical {
        /// Number of points.
        points: usize,
    },
    /// More than ids can number.
    #[error("{what}: {count} are too many for one plan")]
    TooMany {
        /// What there are too many of.
        what: &'static str,
        /// How many.
        count: usize,
    },
}

impl TilesError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self::Io {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn damaged_plan(path: &Path, what: impl Into<String>) -> Self {
        Self::DamagedPlan {
            path: path.to_owned(),
            what: what.into(),
        }
    }

    pub(crate) fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::Damaged {
            path: path.to_owned(),
            what: what.into(),
        }
    }
}
