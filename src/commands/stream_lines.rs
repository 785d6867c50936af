//! Lines of JSON in and out, for `linecarve stream`.

use std::io::{BufRead, ErrorKind, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use anyhow::Context;

use crate::process::{is_signalled, on_signal};
use crate::progress::Verbosity;
use crate::standard_error::say;
use linecarve_engine::stream::Reply;

/// Longest message, in bytes: two images of 8 megapixels without compression, in base 64, have room.
const LONGEST_MESSAGE: u64 = 1 << 28;

/// A line of the input.
pub(super) enum Line {
    Text(String),
    /// It was read to its end, and cannot be a message for this reason.
    Unusable(String),
    /// None came for a while.
    Idle,
    End,
}

/// The lines of standard input, up to its end or to a signal.
pub(super) struct Lines(Receiver<anyhow::Result<Line>>);

impl Lines {
    /// Begins to read. A thread does, so that a signal is noticed while no line comes.
    ///
    /// # Errors
    /// When signals cannot be handled.
    pub(super) fn begin() -> anyhow::Result<Self> {
        let (sender, receiver) = sync_channel(1);
        let on_end = sender.clone();
        on_signal(move || {
            say!("stopping after this message; press Ctrl-C again to stop at once");
            // Wakes who waits. When there is no room, a line is there that does.
            let _ = on_end.try_send(Ok(Line::End));
        })
        .context("cannot install the handler for Ctrl-C")?;
        std::thread::spawn(move || {
            let mut input = std::io::stdin().lock();
            loop {
                let line = next(&mut input);
                let is_last = matches!(line, Ok(Line::End) | Err(_));
                if sender.send(line).is_err() || is_last {
                    return;
                }
            }
        });
        Ok(Self(receiver))
    }

    /// The next line; the end after a signal. [`Line::Idle`] when none comes within `patience`, if there is one.
    ///
    /// # Errors
    /// When standard input cannot be read.
    pub(super) fn next(&self, patience: Option<Duration>) -> anyhow::Result<Line> {
        let line = match patience {
            None => self.0.recv().unwrap_or(Ok(Line::End)),
            Some(patience) => match self.0.recv_timeout(patience) {
                Ok(line) => line,
                Err(RecvTimeoutError::Timeout) => Ok(Line::Idle),
                Err(RecvTimeoutError::Disconnected) => Ok(Line::End),
            },
        }?;
        Ok(if is_signalled() { Line::End } else { line })
    }
}

/// The next line of the input.
fn next(input: &mut impl BufRead) -> anyhow::Result<Line> {
    let mut bytes = Vec::new();
    let context = "cannot read standard input";
    let mut limited = std::io::Read::take(&mut *input, LONGEST_MESSAGE);
    limited.read_until(b'\n', &mut bytes).context(context)?;
    if bytes.is_empty() {
        return Ok(Line::End);
    }
    if bytes.len() as u64 == LONGEST_MESSAGE && bytes.last() != Some(&b'\n') {
        input.skip_until(b'\n').context(context)?;
        return Ok(Line::Unusable(format!(
            "longer than {LONGEST_MESSAGE} bytes: give images as files, or compressed"
        )));
    }
    Ok(match String::from_utf8(bytes) {
        Ok(text) => Line::Text(text),
        Err(_) => Line::Unusable("not UTF-8".to_owned()),
    })
}

/// Standard output, a reply a line.
#[derive(Default)]
pub(super) struct Replies {
    /// The reader has gone away, so that more messages have no use.
    pub(super) nobody_listens: bool,
}

impl Replies {
    /// Says what is wrong with a line, to the sender and on standard error.
    pub(super) fn refuse(
        &mut self,
        line: u64,
        message: String,
        verbosity: Verbosity,
    ) -> anyhow::Result<()> {
        if verbosity > Verbosity::Quiet {
            say!("warning: line {line}: {message}");
        }
        self.send(&Reply::Error { line, message })
    }

    /// Sends a reply. When nobody reads any more, that is no error.
    pub(super) fn send(&mut self, reply: &Reply) -> anyhow::Result<()> {
        let mut line = serde_json::to_vec(reply)?;
        line.push(b'\n');
        let mut output = std::io::stdout().lock();
        match output.write_all(&line).and_then(|()| output.flush()) {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {
                self.nobody_listens = true;
                Ok(())
            }
            outcome => outcome.context("cannot write to standard output"),
        }
    }
}
