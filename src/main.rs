//! The `linecarve` program.

fn main() {}
