//! Progress on standard error: a bar on a terminal, plain lines otherwise.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Least time between plain lines.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// Least time between drawings of the bar.
const BAR_INTERVAL: Duration = Duration::from_millis(50);

/// Width of the bar in characters.
const BAR_WIDTH: usize = 32;

/// Clears the line of the cursor, and moves the cursor to its start.
const CLEAR_LINE: &str = "\r\x1b[2K";

/// Amount of output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Progress, warnings and results.
    Normal,
    /// Also assumptions and omissions.
    Verbose,
}

/// Progress of a task with a known number of steps.
pub struct Progress {
    label: &'static str,
    verbosity: Verbosity,
    is_bar: bool,
    total: usize,
    done: usize,
    message: String,
    started: Instant,
    /// When the last line or bar was printed.
    printed: Option<Instant>,
}

impl Progress {
    /// Starts a task of `total` steps, with a label such as `keyframes`.
    pub fn start(label: &'static str, total: usize, verbosity: Verbosity) -> Self {
        let progress = Self {
            label,
            verbosity,
            is_bar: verbosity > Verbosity::Quiet && std::io::stderr().is_terminal(),
            total,
            done: 0,
            message: String::new(),
            started: Instant::now(),
            printed: None,
        };
        if progress.is_bar {
            progress.draw();
        }
        progress
    }

    /// Advances by one step; `message` is a short status.
    pub fn step(&mut self, message: impl FnOnce() -> String) {
        self.set(self.done + 1, message);
    }

    /// Sets the number of completed steps.
    pub fn set(&mut self, done: usize, message: impl FnOnce() -> String) {
        self.done = done;
        if self.verbosity == Verbosity::Quiet {
            return;
        }
        let interval = if self.is_bar {
            BAR_INTERVAL
        } else {
            PLAIN_INTERVAL
        };
        let is_due = self.printed.is_none_or(|last| last.elapsed() >= interval);
        if !is_due && done != self.total {
            return;
        }
        self.printed = Some(Instant::now());
        self.message = message();
        if self.is_bar {
            return self.draw();
        }
        let line = plain_line(self.label, done, self.total, self.started.elapsed());
        let gap = if self.message.is_empty() { "" } else { "  " };
        eprintln!("{line}{gap}{}", self.message);
    }

    /// Prints a line without breaking the bar, at verbosity `at` or higher.
    pub fn print(&self, at: Verbosity, line: &str) {
        if self.verbosity < at {
            return;
        }
        self.clear();
        eprintln!("{line}");
        if self.is_bar {
            self.draw();
        }
    }

    /// Ends the task and removes the bar.
    pub fn finish(self) {
        self.clear();
    }

    fn draw(&self) {
        let bar = bar(self.label, self.done, self.total, self.started.elapsed());
        // The terminal cuts what is too long: its automatic line break is off while the bar is printed.
        eprint!("{CLEAR_LINE}\x1b[?7l{bar} {}\x1b[?7h", self.message);
        // Nothing can be done when this fails.
        let _ = std::io::stderr().flush();
    }

    fn clear(&self) {
        if self.is_bar {
            eprint!("{CLEAR_LINE}");
        }
    }
}

/// `   keyframes ████████------------------------ 12/48 [3 s, 9 s left]`
fn bar(label: &str, done: usize, total: usize, elapsed: Duration) -> String {
    let filled = (BAR_WIDTH * done)
        .checked_div(total)
        .unwrap_or(BAR_WIDTH)
        .min(BAR_WIDTH);
    let (filled, rest) = ("█".repeat(filled), "-".repeat(BAR_WIDTH - filled));
    let times = times(done, total, elapsed);
    format!("{label:>12} {filled}{rest} {done}/{total} [{times}]")
}

/// `keyframes 12/48 (25 %), 3 s, 9 s left`
fn plain_line(label: &str, done: usize, total: usize, elapsed: Duration) -> String {
    let percent = (100 * done).checked_div(total).unwrap_or(100);
    let times = times(done, total, elapsed);
    format!("{label} {done}/{total} ({percent} %), {times}")
}

/// Time spent and time left: `3 s, 9 s left`.
fn times(done: usize, total: usize, elapsed: Duration) -> String {
    let spent = elapsed.as_secs_f64();
    if done > 0 && done < total {
        let left = spent / done as f64 * (total - done) as f64;
        format!("{spent:.0} s, {left:.0} s left")
    } else {
        format!("{spent:.0} s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_line_has_share_and_time_left() {
        let line = plain_line("keyframes", 12, 48, Duration::from_secs(3));
        assert_eq!(line, "keyframes 12/48 (25 %), 3 s, 9 s left");
    }

    #[test]
    fn a_task_without_steps_is_complete() {
        let line = plain_line("frames", 0, 0, Duration::ZERO);
        assert_eq!(line, "frames 0/0 (100 %), 0 s");
    }

    #[test]
    fn a_bar_is_as_full_as_its_task() {
        let quarter = bar("keyframes", 12, 48, Duration::from_secs(3));
        let filled = "████████------------------------";
        assert_eq!(
            quarter,
            format!("   keyframes {filled} 12/48 [3 s, 9 s left]")
        );
        for done_of_total in [(0, 0), (3, 2)] {
            let (done, total) = done_of_total;
            assert!(!bar("frames", done, total, Duration::ZERO).contains('-'));
        }
    }
}
