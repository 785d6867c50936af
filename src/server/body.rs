//! The content of an answer.

use std::fs::File;
use std::io::Read;
use std::pin::Pin;
use std::task::{Context, Poll};

use hyper::body::{Bytes, Frame, SizeHint};
use tokio::sync::mpsc;

/// Bytes of a file that are read at a time.
const BLOCK: u64 = 64 << 10;

/// The content of an answer.
pub(crate) enum Body {
    /// Bytes in memory.
    Whole(Option<Bytes>),
    /// A file of which so many bytes are left.
    File(File, u64),
    /// What is sent, one message after another.
    Messages(mpsc::Receiver<Bytes>),
}

impl Body {
    /// Bytes in memory.
    pub(crate) fn whole(bytes: impl Into<Bytes>) -> Self {
        let bytes = bytes.into();
        Self::Whole((!bytes.is_empty()).then_some(bytes))
    }

    /// Messages that come later. The sender waits for the client; it fails when the client has gone away.
    pub(crate) fn messages() -> (mpsc::Sender<Bytes>, Self) {
        let (sender, receiver) = mpsc::channel(1);
        (sender, Self::Messages(receiver))
    }
}

impl hyper::body::Body for Body {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<std::io::Result<Frame<Bytes>>>> {
        let bytes = match &mut *self {
            Self::Whole(bytes) => Poll::Ready(bytes.take().map(Ok)),
            Self::File(file, left) => Poll::Ready(next_block(file, left).transpose()),
            Self::Messages(receiver) => receiver.poll_recv(context).map(|it| it.map(Ok)),
        };
        bytes.map(|it| it.map(|it| it.map(Frame::data)))
    }

    fn is_end_stream(&self) -> bool {
        matches!(self, Self::Whole(None) | Self::File(_, 0))
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Whole(bytes) => SizeHint::with_exact(bytes.as_ref().map_or(0, Bytes::len) as u64),
            Self::File(_, left) => SizeHint::with_exact(*left),
            Self::Messages(_) => SizeHint::default(),
        }
    }
}

/// The next bytes of a file. It fails when the file has become shorter.
fn next_block(file: &mut File, left: &mut u64) -> std::io::Result<Option<Bytes>> {
    if *left == 0 {
        return Ok(None);
    }
    let mut block = vec![0; BLOCK.min(*left) as usize];
    file.read_exact(&mut block)?;
    *left -= block.len() as u64;
    Ok(Some(block.into()))
}
