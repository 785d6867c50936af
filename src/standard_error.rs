//! Lines on standard error. Where they cannot be written (a full disk, a reader that has gone away), a run goes on without them.

/// A line on standard error, as `eprintln!` writes it, which panics when it cannot be written.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr().lock(), $($text)*);
    }};
}

pub(crate) use say;
