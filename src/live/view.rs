//! The live view: state and clients, and the server in front of them.

use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hyper::body::Bytes;
use tokio::sync::{mpsc, watch};

use super::clients::{Clients, Next};
use super::state::{LiveState, LiveUpdate};
use crate::progress::Verbosity;
use crate::report::page::live_page;
use crate::server::{Answer, Body, Refusal, Server, ServerError, Site};
use crate::standard_error::say;

/// A line is sent after this long without another, so that a connection that has broken is noticed.
const HEARTBEAT: Duration = Duration::from_secs(10);
/// How long the end of a run waits for clients to take the last state.
const FAREWELL: Duration = Duration::from_secs(2);
/// Before the events: after how many milliseconds a browser connects again.
const HEAD: &[u8] = b"retry: 1000\n\n";
/// A line that browsers pass over.
const SIGN_OF_LIFE: &[u8] = b":\n\n";

/// Serves the page of a run while it goes on; dropping it ends that, after the last state was taken.
pub(crate) struct LiveView {
    shared: Arc<Shared>,
    server: Option<Server>,
}

struct Shared {
    page: Bytes,
    content: Mutex<Content>,
    /// Signals a change of the content.
    changed: watch::Sender<()>,
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
            page: page.into(),
            content: Mutex::default(),
            changed: watch::Sender::new(()),
        });
        let site = Live(Arc::clone(&shared));
        let server = Server::start(port, FAREWELL, Arc::new(site))?;
        if verbosity > Verbosity::Quiet {
            say!(
                "live view on this machine, until the run ends: http://{}/",
                server.address()
            );
        }
        Ok(Self {
            shared,
            server: Some(server),
        })
    }

    /// Takes what is new, and sends it to all clients. Never waits for one.
    pub(crate) fn publish(&self, update: &LiveUpdate<'_>) {
        let mut content = self.shared.lock();
        let wants_message = content.clients.want_messages();
        if let Some(message) = content.state.update(update, wants_message) {
            content.clients.push(&event(&message));
        }
        content.has_ended |= update.has_ended;
        drop(content);
        self.shared.changed.send_replace(());
    }
}

impl Drop for LiveView {
    /// Says that the run has ended, and gives clients a moment to take the last state.
    fn drop(&mut self) {
        self.publish(&LiveUpdate {
            has_ended: true,
            ..LiveUpdate::default()
        });
        if let Some(server) = self.server.take() {
            server.end();
        }
    }
}

impl Shared {
    /// The content. It is whole even after a thread panicked: each change ends before anything that can.
    fn lock(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a client is to be sent next; `None` at the end.
    async fn next(&self, client: u64, changed: &mut watch::Receiver<()>) -> Option<Bytes> {
        loop {
            changed.mark_unchanged();
            if let ControlFlow::Break(next) = self.take(client) {
                return next;
            }
            let waited = tokio::time::timeout(HEARTBEAT, changed.changed()).await;
            if waited.is_err() {
                return Some(Bytes::from_static(SIGN_OF_LIFE));
            }
        }
    }

    /// What a client is to be sent now; nothing at the end. It goes on where nothing is to be sent so far.
    fn take(&self, client: u64) -> ControlFlow<Option<Bytes>> {
        let mut content = self.lock();
        match content.clients.take(client) {
            Next::Message(message) => ControlFlow::Break(Some(message)),
            Next::Whole => {
                let snapshot = content.state.snapshot();
                drop(content);
                ControlFlow::Break(snapshot.message().map(|message| event(&message)))
            }
            Next::Nothing if content.has_ended => ControlFlow::Break(None),
            Next::Nothing => ControlFlow::Continue(()),
        }
    }
}

/// A message as an event. JSON has no line breaks of its own.
fn event(message: &str) -> Bytes {
    format!("data: {message}\n\n").into()
}

/// The page and its events.
struct Live(Arc<Shared>);

impl Site for Live {
    fn answer(&self, path: &str) -> Result<Answer, Refusal> {
        let Self(shared) = self;
        match path {
            "/" => Ok(Answer {
                content_type: "text/html; charset=utf-8",
                body: Body::whole(shared.page.clone()),
            }),
            "/events" => {
                let client = shared.lock().clients.connect().ok_or(Refusal::Busy)?;
                let (sender, body) = Body::messages();
                tokio::spawn(send(Arc::clone(shared), client, sender));
                Ok(Answer {
                    content_type: "text/event-stream",
                    body,
                })
            }
            _ => Err(Refusal::Missing),
        }
    }
}

/// Sends messages to a client until the run ends or the client goes away.
async fn send(shared: Arc<Shared>, client: u64, sender: mpsc::Sender<Bytes>) {
    let mut changed = shared.changed.subscribe();
    let mut message = Some(Bytes::from_static(HEAD));
    while let Some(bytes) = message {
        if sender.send(bytes).await.is_err() {
            break;
        }
        message = tokio::select! {
            message = shared.next(client, &mut changed) => message,
            () = sender.closed() => None,
        };
    }
    shared.lock().clients.disconnect(client);
}
