//! What the images of the first keyframes say about the poses, depth scale and calibration of a session.

use linecarve_sequence::{Sequence, check_images};

/// Keyframes after which a session asks its images; a shorter one asks at its end.
const KEYFRAMES: usize = 10;

/// Fewest keyframes that can contradict each other.
const FEWEST: usize = 2;

/// Asks the first keyframes of a session what a run over a recording asks first.
#[derive(Debug, Default)]
pub(super) struct FirstKeyframes {
    added: usize,
    is_asked: bool,
    contradiction: Option<String>,
    /// The contradiction, or what is doubtful, until a reply said it.
    unreported: Option<String>,
}

impl FirstKeyframes {
    /// A keyframe was added.
    pub(super) fn add(&mut self, sequence: Option<&Sequence>) {
        self.added += 1;
        if self.added >= KEYFRAMES {
            self.ask(sequence);
        }
    }

    /// Asks, unless the images were asked before.
    pub(super) fn ask(&mut self, sequence: Option<&Sequence>) {
        if !self.is_asked && self.added >= FEWEST {
            // The session has accepted the images: what cannot be compared contradicts nothing.
            let check = sequence.and_then(|sequence| check_images(sequence).ok());
            let check = check.unwrap_or_default();
            self.unreported = check.contradiction.clone().or(check.warning);
            self.contradiction = check.contradiction;
        }
        self.is_asked = true;
    }

    /// Whether the images were asked, so that those of removed keyframes are not needed any more.
    pub(super) fn is_asked(&self) -> bool {
        self.is_asked
    }

    /// What contradicts the images, and the remedy.
    pub(super) fn contradiction(&self) -> Option<&String> {
        self.contradiction.as_ref()
    }

    /// The contradiction, or what is doubtful, once.
    pub(super) fn take_unreported(&mut self) -> Option<String> {
        self.unreported.take()
    }
}
