//! Progress on standard error: a bar on a terminal, plain lines otherwise.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use linecarve_engine::run::ProgressHook;

use crate::standard_error::say;

/// Least time between plain lines.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// Template of the progress bar.
const BAR_TEMPLATE: &str = "{prefix:>12} {bar:32} {pos}/{len} [{elapsed}<{eta}] {msg}";

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

impl Verbosity {
    /// Shows how far tasks of the library are.
    pub fn hook(self) -> ProgressHook {
        if self == Self::Quiet {
            return ProgressHook::default();
        }
        let shown = Mutex::new(None::<Progress>);
        ProgressHook::new(move |state| {
            // What another thread left when it panicked is a bar all the same.
            let mut shown = shown.lock().unwrap_or_else(PoisonError::into_inner);
            if state.has_ended {
                return shown.take().map_or((), Progress::finish);
            }
            let progress =
                shown.get_or_insert_with(|| Progress::start(state.unit, state.total, self));
            if state.done > 0 {
                progress.set(state.done, || state.action.to_owned());
            }
        })
    }
}

/// Progress of a task with a known number of steps.
pub struct Progress {
    label: &'static str,
    verbosity: Verbosity,
    bar: Option<ProgressBar>,
    total: usize,
    done: usize,
    started: Instant,
    last_line: Option<Instant>,
}

impl Progress {
    /// Starts a task of `total` steps, with a label such as `keyframes`.
    pub fn start(label: &'static str, total: usize, verbosity: Verbosity) -> Self {
        let visible = verbosity > Verbosity::Quiet;
        let bar = (visible && std::io::stderr().is_terminal()).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            // A malformed template is a programming error that the test below would show.
            if let Ok(style) = ProgressStyle::with_template(BAR_TEMPLATE) {
                bar.set_style(style);
            }
            bar.set_prefix(label);
            bar
        });
        Self {
            label,
            verbosity,
            bar,
            total,
            done: 0,
            started: Instant::now(),
            last_line: None,
        }
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
        if let Some(bar) = &self.bar {
            bar.set_position(done as u64);
            bar.set_message(message());
            return;
        }
        let due = self
            .last_line
            .is_none_or(|last| last.elapsed() >= PLAIN_INTERVAL);
        if due || done == self.total {
            self.last_line = Some(Instant::now());
            let line = plain_line(self.label, done, self.total, self.started.elapsed());
            let message = message();
            let gap = if message.is_empty() { "" } else { "  " };
            say!("{line}{gap}{message}");
        }
    }

    /// Prints a line without breaking the bar, at verbosity `at` or higher.
    pub fn print(&self, at: Verbosity, line: &str) {
        if self.verbosity < at {
            return;
        }
        match &self.bar {
            Some(bar) => bar.suspend(|| say!("{line}")),
            None => say!("{line}"),
        }
    }

    /// Ends the task and removes the bar.
    pub fn finish(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

/// `keyframes 12/48 (25 %), 3 s, 9 s left`
fn plain_line(label: &str, done: usize, total: usize, elapsed: Duration) -> String {
    let percent = (100 * done).checked_div(total).unwrap_or(100);
    let spent = elapsed.as_secs_f64();
    let left = if done > 0 && done < total {
        format!(
            ", {:.0} s left",
            spent / done as f64 * (total - done) as f64
        )
    } else {
        String::new()
    };
    format!("{label} {done}/{total} ({percent} %), {spent:.0} s{left}")
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
    fn the_bar_template_is_well_formed() {
        assert!(ProgressStyle::with_template(BAR_TEMPLATE).is_ok());
    }
}
