//! HTTP on the loopback address, for the page of a run and for the folder that `view` serves.
//!
//! A client decides nothing without a bound: [limits](connection) hold for the number of connections, the head of a request, the time
//! until it is complete, and the time without progress. No request has a body, and each connection takes one request. One thread serves
//! all clients, so that a run never waits for one.

mod body;
mod connection;
mod folder;
mod refusal;

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, watch};

pub(crate) use body::Body;
pub(crate) use folder::{Folder, PAGE};
pub(crate) use refusal::Refusal;

/// Time before the next attempt when the system refuses a connection: it has no more files, or the client has gone away.
const PAUSE: Duration = Duration::from_millis(50);

/// Why nothing can be served.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ServerError {
    /// Another program listens on the port.
    #[error("port {0} is in use: give another, or none for a free one")]
    PortInUse(u16),
    /// The port cannot be used.
    #[error("cannot listen on port {0}: {1} (without a port a free one is taken)")]
    Port(u16, String),
    /// No port can be used.
    #[error("cannot listen on the loopback address: {0}")]
    Loopback(String),
    /// The thread of the server panicked.
    #[error("the server ended unexpectedly")]
    Ended,
}

/// What is served.
pub(crate) trait Site: Send + Sync + 'static {
    /// What a path stands for. Called on the thread of the server, inside its runtime.
    ///
    /// # Errors
    /// When there is nothing of that path.
    fn answer(&self, path: &str) -> Result<Answer, Refusal>;
}

/// What a request gets.
pub(crate) struct Answer {
    /// The media type.
    pub(crate) content_type: &'static str,
    /// The content.
    pub(crate) body: Body,
}

/// A server on the loopback address, with a thread of its own.
pub(crate) struct Server {
    address: SocketAddr,
    /// Dropped at the end, which ends the thread.
    stop: watch::Sender<()>,
    thread: JoinHandle<()>,
}

impl Server {
    /// Listens on a port of the loopback address, by default a free one. When it ends, answers that have begun get the time of
    /// `farewell`.
    ///
    /// # Errors
    /// When the port is in use, or cannot be listened on.
    pub(crate) fn start(
        port: Option<u16>,
        farewell: Duration,
        site: Arc<dyn Site>,
    ) -> Result<Self, ServerError> {
        let listener = listen(port)?;
        let address = listener.local_addr().map_err(unusable)?;
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(unusable)?;
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener).map_err(unusable)?
        };
        let (stop, stopped) = watch::channel(());
        let service = Service {
            site,
            port: address.port(),
            stopped,
            room: Arc::new(Semaphore::new(connection::MOST)),
        };
        let thread = std::thread::Builder::new()
            .name("server".to_owned())
            .spawn(move || service.run(&runtime, listener, farewell))
            .map_err(unusable)?;
        Ok(Self {
            address,
            stop,
            thread,
        })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until the program ends.
    ///
    /// # Errors
    /// When the thread of the server panicked.
    pub(crate) fn serve(self) -> Result<(), ServerError> {
        self.thread.join().map_err(|_| ServerError::Ended)
    }

    /// Ends it: at once for clients that have not asked for anything, after the farewell for the others.
    pub(crate) fn end(self) {
        drop(self.stop);
        // It has told of its panic itself.
        let _ = self.thread.join();
    }
}

/// A listener that does not block.
fn listen(port: Option<u16>) -> Result<TcpListener, ServerError> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port.unwrap_or(0)));
    let listener = TcpListener::bind(address).map_err(|error| match port {
        Some(port) if error.kind() == std::io::ErrorKind::AddrInUse => ServerError::PortInUse(port),
        Some(port) => ServerError::Port(port, error.to_string()),
        None => unusable(error),
    })?;
    listener.set_nonblocking(true).map_err(unusable)?;
    Ok(listener)
}

fn unusable(error: std::io::Error) -> ServerError {
    ServerError::Loopback(error.to_string())
}

/// What all connections share.
#[derive(Clone)]
struct Service {
    site: Arc<dyn Site>,
    port: u16,
    /// Closed at the end.
    stopped: watch::Receiver<()>,
    /// One permit for each connection that is possible.
    room: Arc<Semaphore>,
}

impl Service {
    fn run(mut self, runtime: &Runtime, listener: tokio::net::TcpListener, farewell: Duration) {
        runtime.block_on(async {
            let accepting = tokio::spawn(self.clone().accept(listener));
            // An error is what it waits for: nothing is ever sent.
            while self.stopped.changed().await.is_ok() {}
            accepting.abort();
            let all = self.room.acquire_many(connection::MOST as u32);
            let _ = tokio::time::timeout(farewell, all).await;
        });
    }

    /// Takes connections. Those beyond the bound are closed.
    async fn accept(self, listener: tokio::net::TcpListener) {
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(PAUSE).await;
                continue;
            };
            let Ok(permit) = Arc::clone(&self.room).try_acquire_owned() else {
                continue;
            };
            let service = self.clone();
            tokio::spawn(async move {
                connection::serve(stream, service).await;
                drop(permit);
            });
        }
    }
}
