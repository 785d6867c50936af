//! What the images of the first keyframes say about the poses, depth scale and calibration of a session.

use std::path::PathBuf;

use linecarve_sequence::{Sequence, contradiction};

/// Keyframes after which a session asks its images; a shorter one asks at its end.
const KEYFRAMES: usize = 10;

/// Fewest keyframes that can contradict each other.
const FEWEST: usize = 2;

/// Asks the first keyframes of a session what a run over a recording asks first.
#[derive(Debug, Default)]
pub(super) struct FirstKeyframes {
    /// Images of messages, which are kept until the question was asked.
    held: Vec<PathBuf>,
    added: usize,
    is_asked: bool,
    contradiction: Option<String>,
    /// The contradiction, until a reply said it.
    unreported: Option<String>,
}

impl FirstKeyframes {
    /// A keyframe was added. Takes files of its images that nothing else needs, and returns those that may be deleted.
    pub(super) fn add(
        &mut self,
        sequence: Option<&Sequence>,
        images: Vec<PathBuf>,
    ) -> Vec<PathBuf> {
        if self.is_asked {
            return images;
        }
        self.held.extend(images);
        self.added += 1;
        if self.added < KEYFRAMES {
            return Vec::new();
        }
        self.ask(sequence)
    }

    /// Asks what was not asked yet, and returns the files that may be deleted.
    pub(super) fn ask(&mut self, sequence: Option<&Sequence>) -> Vec<PathBuf> {
        if !self.is_asked && self.added >= FEWEST {
            // The session has accepted the images: what cannot be compared contradicts nothing.
            self.contradiction =
                sequence.and_then(|sequence| contradiction(sequence).ok().flatten());
            self.unreported.clone_from(&self.contradiction);
        }
        self.is_asked = true;
        std::mem::take(&mut self.held)
    }

    /// What contradicts the images, and the remedy.
    pub(super) fn contradiction(&self) -> Option<&String> {
        self.contradiction.as_ref()
    }

    /// The contradiction, once.
    pub(super) fn take_unreported(&mut self) -> Option<String> {
        self.unreported.take()
    }
}
