//! The tasks of a plan: those of the images of a sequence, then those of its tiles.

use std::fmt;
use std::str::FromStr;

use linecarve_tiles::Stage;

/// A stage; all tasks of the stages before it must be done.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum TaskStage {
    /// What the front end finds in the images of some keyframes.
    Keyframes,
    /// Points, views and rays of all keyframes.
    Intake,
    /// A stage of the tiles.
    Tiles(Stage),
}

/// A task: a pure function of files.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Task {
    /// Its stage.
    pub stage: TaskStage,
    /// Its number among those of the stage.
    pub number: usize,
}

impl TaskStage {
    /// Name on the command line, and of the folder with its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Keyframes => "keyframes",
            Self::Intake => "intake",
            Self::Tiles(stage) => stage.name(),
        }
    }
}

impl FromStr for TaskStage {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let of_images = [Self::Keyframes, Self::Intake].into_iter();
        let all = of_images.chain(Stage::ALL.map(Self::Tiles));
        let names: Vec<&str> = all.clone().map(Self::name).collect();
        (all.into_iter())
            .find(|stage| stage.name() == text)
            .ok_or_else(|| format!("no stage of this name; stages are {}", names.join(", ")))
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.stage.name(), self.number)
    }
}
