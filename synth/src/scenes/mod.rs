//! The scenes themselves.

mod boxes;
mod corner;
mod furniture;
mod room;
mod walk;
