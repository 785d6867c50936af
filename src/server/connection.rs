//! One connection, within bounds: one request, a head of limited size and time, and no time without progress.

use std::convert::Infallible;
use std::pin::{Pin, pin};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use hyper::body::Incoming;
use hyper::header::HeaderValue;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Request, Response, header};
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

use super::refusal::refusal;
use super::{Answer, Body, Service};

/// Largest number of connections: a browser opens six, and a few browsers may look on.
pub(super) const MOST: usize = 64;
/// Largest head of a request, in bytes: browsers send one or two thousand.
const MOST_HEAD: usize = 16 << 10;
/// Largest number of header lines: browsers send about twenty.
const MOST_HEADERS: usize = 64;
/// Longest time from the connection to the end of the head.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Longest time in which no byte of an answer is taken.
const STALL: Duration = Duration::from_secs(30);
/// How often both are looked at.
const LOOK: Duration = Duration::from_secs(1);

/// What a page may do: run and style itself, show images, and listen to this server. It cannot be shown inside another page.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
    img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Serves a connection to its end. A client that has gone away is no fault.
pub(super) async fn serve(stream: TcpStream, service: Service) {
    let progress = Arc::new(Progress::default());
    let mut stopped = service.stopped.clone();
    let answering = service_fn({
        let progress = Arc::clone(&progress);
        move |request: Request<Incoming>| {
            progress.is_asked.store(true, Ordering::Relaxed);
            progress.moved();
            let response = respond(&service, &request);
            let has_end = !matches!(response.body(), Body::Messages(_));
            progress.has_end.store(has_end, Ordering::Relaxed);
            std::future::ready(Ok::<_, Infallible>(response))
        }
    });
    let watched = Watched {
        stream,
        progress: Arc::clone(&progress),
    };
    let mut connection = pin!(
        http1::Builder::new()
            .keep_alive(false)
            .max_headers(MOST_HEADERS)
            .max_buf_size(MOST_HEAD)
            .serve_connection(TokioIo::new(watched), answering)
    );
    let mut is_stopped = false;
    loop {
        tokio::select! {
            // Whether it failed or not, it has ended.
            _ = &mut connection => return,
            () = tokio::time::sleep(LOOK) => {
                if progress.is_overdue() {
                    return;
                }
            }
            _ = stopped.changed(), if !is_stopped => {
                is_stopped = true;
                if !progress.is_asked.load(Ordering::Relaxed) {
                    return;
                }
            }
        }
    }
}

/// The answer to a request, with the headers that all answers have.
fn respond<B: hyper::body::Body>(service: &Service, request: &Request<B>) -> Response<Body> {
    let answer = match refusal(request, service.port) {
        Some(refusal) => Err(refusal),
        None => service.site.answer(request.uri().path()),
    };
    let (status, answer) = match answer {
        Ok(answer) => (hyper::StatusCode::OK, answer),
        Err(refusal) => (refusal.status(), refusal.answer()),
    };
    let Answer { content_type, body } = answer;
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_TYPE, content_type),
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (
            header::HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// How far a connection is.
#[derive(Default)]
struct Progress {
    is_asked: AtomicBool,
    /// Whether the answer is known to end.
    has_end: AtomicBool,
    /// Milliseconds since the beginning, when the last byte moved.
    last: AtomicU64,
    begun: OnceLock<Instant>,
}

impl Progress {
    fn elapsed(&self) -> Duration {
        self.begun.get_or_init(Instant::now).elapsed()
    }

    fn moved(&self) {
        let now = self.elapsed().as_millis() as u64;
        self.last.store(now, Ordering::Relaxed);
    }

    fn is_overdue(&self) -> bool {
        let elapsed = self.elapsed();
        if self.is_asked.load(Ordering::Relaxed) {
            let last = Duration::from_millis(self.last.load(Ordering::Relaxed));
            elapsed.saturating_sub(last) > STALL
        } else {
            elapsed > HEAD_TIME
        }
    }
}

/// A stream that tells when bytes of the answer moved.
///
/// A client that closes its sending side still gets an answer that ends: hyper would close the connection, so it does not see that end.
/// With its `half_close` it would also keep clients of live pages that have gone away.
struct Watched {
    stream: TcpStream,
    progress: Arc<Progress>,
}

impl Watched {
    fn wrote(&self, result: Poll<std::io::Result<usize>>) -> Poll<std::io::Result<usize>> {
        if matches!(result, Poll::Ready(Ok(1..))) {
            self.progress.moved();
        }
        result
    }
}

impl AsyncRead for Watched {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        let is_end = matches!(read, Poll::Ready(Ok(()))) && buffer.filled().len() == before;
        match is_end && self.progress.has_end.load(Ordering::Relaxed) {
            true => Poll::Pending,
            false => read,
        }
    }
}

impl AsyncWrite for Watched {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.wrote(result)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[std::io::IoSlice<'_>],
    ) -> Poll<std::io::Result<usize>> {
        let result = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.wrote(result)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn since(elapsed: Duration, last: Duration, is_asked: bool) -> Progress {
        let progress = Progress::default();
        let begun = Instant::now().checked_sub(elapsed).unwrap();
        progress.begun.set(begun).unwrap();
        let last = last.as_millis() as u64;
        progress.last.store(last, Ordering::Relaxed);
        progress.is_asked.store(is_asked, Ordering::Relaxed);
        progress
    }

    #[test]
    fn a_head_has_ten_seconds_and_an_answer_thirty_without_progress() {
        let seconds = Duration::from_secs;
        assert!(!since(seconds(9), seconds(0), false).is_overdue());
        assert!(since(seconds(11), seconds(0), false).is_overdue());
        assert!(!since(seconds(100), seconds(75), true).is_overdue());
        assert!(since(seconds(100), seconds(65), true).is_overdue());
    }
}
