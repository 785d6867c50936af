//! The live view: state and clients, and the server in front of them.

use std::io::Write;
use std::net::SocketAddr;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tiny_http::{Request, Response};

use super::clients::{Clients, Next};
use super::state::{LiveState, LiveUpdate};
use crate::progress::Verbosity;
use crate::report::page::live_page;
use crate::server::{Loopback, Refusal, ServerError, header};

/// A line is sent after this long without another, so that a client that has gone away is noticed.
const HEARTBEAT: Duration = Duration::from_secs(10);
/// How long the end of a run waits for clients to take the last state.
const FAREWELL: Duration = Duration::from_secs(2);
/// Before the events: their kind, and after how many milliseconds a browser connects again.
const HEAD: &[u8] =
    b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\nretry: 1000\n\n";

/// Serves the page of a run while it goes on; dropping it ends that, after the last state was taken.
pub(crate) struct LiveView {
    shared: Arc<Shared>,
    server: Option<JoinHandle<()>>,
}

struct Shared {
    loopback: Loopback,
    page: Vec<u8>,
    content: Mutex<Content>,
    changed: Condvar,
}

#[derive(Default)]
struct Content {
    state: LiveState,
    clients: Clients,
    has_ended: bool,
}

impl LiveView {
    /// Listens on a port of the loopback address, by default a free one, and says where on standard error.
    ///
    /// # Errors
    /// When the port is in use, or cannot be listened on.
    pub(crate) fn start(port: Option<u16>, verbosity: Verbosity) -> Result<Self, ServerError> {
        let page = live_page().map_err(|error| ServerError::Loopback(error.to_string()))?;
        let shared = Arc::new(Shared {
            loopback: Loopback::new(port)?,
            page,
            content: Mutex::default(),
            changed: Condvar::new(),
        });
        let worker = Arc::clone(&shared);
        let server = std::thread::spawn(move || {
            for request in worker.loopback.requests() {
                answer(&worker, request);
            }
        });
        let view = Self {
            shared,
            server: Some(server),
        };
        if verbosity > Verbosity::Quiet {
            eprintln!(
                "live view on this machine, until the run ends: http://{}/",
                view.address()
            );
        }
        Ok(view)
    }

    /// Where it is served.
    pub(crate) fn address(&self) -> SocketAddr {
        self.shared.loopback.address()
    }

    /// Takes what is new, and sends it to all clients. Never waits for one.
    pub(crate) fn publish(&self, update: &LiveUpdate<'_>) {
        let mut content = self.shared.lock();
        let wants_message = content.clients.want_messages();
        if let Some(message) = content.state.update(update, wants_message) {
            content.clients.push(&Arc::from(message));
        }
        drop(content);
        self.shared.changed.notify_all();
    }
}

impl Drop for LiveView {
    /// Says that the run has ended, and waits a moment for clients to take the last state.
    fn drop(&mut self) {
        self.publish(&LiveUpdate {
            has_ended: true,
            ..LiveUpdate::default()
        });
        let until = Instant::now() + FAREWELL;
        let mut content = self.shared.lock();
        content.has_ended = true;
        self.shared.changed.notify_all();
        while !content.clients.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            content = self.shared.wait(content, left);
        }
        drop(content);
        self.shared.loopback.stop();
        if let Some(server) = self.server.take() {
            let _ = server.join();
        }
    }
}

impl Shared {
    /// The content. It is whole even after a thread panicked: each change ends before anything that can.
    fn lock(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(
        &self,
        content: MutexGuard<'a, Content>,
        time: Duration,
    ) -> MutexGuard<'a, Content> {
        let waited = self.changed.wait_timeout(content, time);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// What a client is to be sent next; `None` at the end, and an empty text as a sign of life.
    fn next(&self, client: u64) -> Option<Arc<str>> {
        let mut content = self.lock();
        let until = Instant::now() + HEARTBEAT;
        loop {
            match content.clients.take(client) {
                Next::Message(message) => return Some(message),
                Next::Whole => {
                    let snapshot = content.state.snapshot();
                    drop(content);
                    return snapshot.message().map(Arc::from);
                }
                Next::Nothing if content.has_ended => return None,
                Next::Nothing => {}
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Some(Arc::from(""));
            }
            content = self.wait(content, left);
        }
    }
}

/// Answers a request; a client that has gone away is no fault.
fn answer(shared: &Arc<Shared>, request: Request) {
    if let Some(refusal) = shared.loopback.refusal(&request) {
        return refusal.answer(request);
    }
    match request.url().split('?').next() {
        Some("/") => {
            let response = Response::from_data(shared.page.clone())
                .with_header(header("Content-Type", "text/html; charset=utf-8"))
                .with_header(header("X-Content-Type-Options", "nosniff"))
                .with_header(header("Cache-Control", "no-store"));
            let _ = request.respond(response);
        }
        Some("/events") => {
            let Some(client) = shared.lock().clients.connect() else {
                return Refusal::Busy.answer(request);
            };
            let shared = Arc::clone(shared);
            std::thread::spawn(move || {
                let mut out = request.into_writer();
                // The client has gone away when this fails.
                let _ = send(&shared, client, &mut *out);
                drop(out);
                shared.lock().clients.disconnect(client);
                shared.changed.notify_all();
            });
        }
        _ => Refusal::Missing.answer(request),
    }
}

/// Sends messages to a client until the run ends.
fn send(shared: &Shared, client: u64, out: &mut dyn Write) -> std::io::Result<()> {
    out.write_all(HEAD)?;
    out.flush()?;
    while let Some(message) = shared.next(client) {
        match message.is_empty() {
            // A line that browsers pass over.
            true => out.write_all(b":\n\n")?,
            false => {
                out.write_all(b"data: ")?;
                // JSON has no line breaks of its own.
                out.write_all(message.as_bytes())?;
                out.write_all(b"\n\n")?;
            }
        }
        out.flush()?;
    }
    Ok(())
}
