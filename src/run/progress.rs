//! Progress of long work on standard error: a bar with the time left on a terminal, plain lines otherwise.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Plain lines come at most this often.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// How much is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Progress, warnings and results.
    Normal,
    /// Also what was assumed and left out.
    Verbose,
}

/// The progress of one piece of work with a known number of steps.
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
    /// Starts a piece of work of `total` steps, named by a word such as `keyframes`.
    pub fn start(label: &'static str, total: usize, verbosity: Verbosity) -> Self {
        let visible = verbosity > Verbosity::Quiet;
        let bar = (visible && std::io::stderr().is_terminal()).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            // A malformed template is a programming error that the test below would show.
            if let Ok(style) = ProgressStyle::with_template(
                "{prefix:>12} {bar:32} {pos}/{len} [{elapsed}<{eta}] {msg}",
            ) {
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

    /// One step is done; `message` says in a few words what stands now.
    pub fn step(&mut self, message: impl FnOnce() -> String) {
        self.set(self.done + 1, message);
    }

    /// `done` steps are done.
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
            eprintln!("{line}{gap}{message}");
        }
    }

    /// Says something without tearing the bar; `Verbosity::Verbose` lines appear only when asked for.
    pub fn say(&self, at: Verbosity, line: &str) {
        if self.verbosity < at {
            return;
        }
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    /// The work is over; the bar is taken away.
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
    fn a_plain_line_tells_share_and_time_left() {
        let line = plain_line("keyframes", 12, 48, Duration::from_secs(3));
        assert_eq!(line, "keyframes 12/48 (25 %), 3 s, 9 s left");
    }

    #[test]
    fn work_without_steps_is_whole() {
        let line = plain_line("frames", 0, 0, Duration::ZERO);
        assert_eq!(line, "frames 0/0 (100 %), 0 s");
    }

    #[test]
    fn the_bar_template_is_well_formed() {
        assert!(
            ProgressStyle::with_template(
                "{prefix:>12} {bar:32} {pos}/{len} [{elapsed}<{eta}] {msg}"
            )
            .is_ok()
        );
    }
}
