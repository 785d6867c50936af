//! Keyframe selection.
