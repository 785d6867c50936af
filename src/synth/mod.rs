//! Procedural scenes rendered to sequences with exact ground truth.
