//! HTTP on the loopback address, and a folder served there.

use std::fs::File;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use tiny_http::{Header, Method, Request, Response, Server, StatusCode};

/// The file that `/` stands for.
pub(crate) const PAGE: &str = "report.html";
/// Requests answered at a time: a browser asks for a few files at once.
const WORKERS: usize = 4;

/// Why a folder cannot be served.
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
    /// A thread of the server panicked.
    #[error("a worker of the server ended unexpectedly")]
    Worker,
}

/// A server on the loopback address.
pub(crate) struct Loopback {
    server: Server,
    address: SocketAddr,
}

impl Loopback {
    /// Listens on a port, by default a free one.
    ///
    /// # Errors
    /// When the port is in use, or cannot be listened on.
    pub(crate) fn new(port: Option<u16>) -> Result<Self, ServerError> {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port.unwrap_or(0)));
        let server = Server::http(address).map_err(|error| {
            let in_use = error
                .downcast_ref::<std::io::Error>()
                .is_some_and(|error| error.kind() == std::io::ErrorKind::AddrInUse);
            match port {
                Some(port) if in_use => ServerError::PortInUse(port),
                Some(port) => ServerError::Port(port, error.to_string()),
                None => ServerError::Loopback(error.to_string()),
            }
        })?;
        let address = server
            .server_addr()
            .to_ip()
            .ok_or_else(|| ServerError::Loopback("it has no network address".to_owned()))?;
        Ok(Self { server, address })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// The requests, one after another, until [`stop`](Self::stop).
    pub(crate) fn requests(&self) -> impl Iterator<Item = Request> + '_ {
        self.server.incoming_requests()
    }

    /// Ends one loop over requests.
    pub(crate) fn stop(&self) {
        self.server.unblock();
    }

    /// Why a request is not answered: its method, or the name by which it calls this address. A page elsewhere whose name was
    /// made to point here gives that name.
    pub(crate) fn refusal(&self, request: &Request) -> Option<Refusal> {
        if !matches!(request.method(), Method::Get | Method::Head) {
            return Some(Refusal::Method);
        }
        let host = request
            .headers()
            .iter()
            .find(|header| header.field.equiv("Host"))
            .map(|header| header.value.as_str());
        let port = self.address.port();
        let is_own_name = host.is_none_or(|host| {
            host == format!("127.0.0.1:{port}") || host == format!("localhost:{port}")
        });
        (!is_own_name).then_some(Refusal::Name)
    }
}

/// Why a request is not answered with what it asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// It names another host.
    Name,
    /// It is neither GET nor HEAD.
    Method,
    /// There is no such file.
    Missing,
    /// There are too many clients.
    Busy,
}

impl Refusal {
    /// Sends the refusal. A client that has gone away is no fault.
    pub(crate) fn answer(self, request: Request) {
        let (status, text) = match self {
            Self::Name => (403, "this address answers on the loopback name only\n"),
            Self::Missing => (404, "no such file\n"),
            Self::Method => (405, "only GET and HEAD\n"),
            Self::Busy => (503, "too many pages are open\n"),
        };
        let response = Response::from_string(text).with_status_code(StatusCode(status));
        let _ = request.respond(response);
    }
}

/// A folder, and the address that it is served on.
pub(crate) struct FolderServer {
    loopback: Loopback,
    root: PathBuf,
}

impl FolderServer {
    /// Serves a folder on a port of the loopback address, by default a free one.
    ///
    /// # Errors
    /// When the port is in use, or cannot be listened on.
    pub(crate) fn new(root: PathBuf, port: Option<u16>) -> Result<Self, ServerError> {
        let loopback = Loopback::new(port)?;
        Ok(Self { loopback, root })
    }

    /// Where the folder is served.
    pub(crate) fn address(&self) -> SocketAddr {
        self.loopback.address()
    }

    /// Answers requests until the program ends.
    ///
    /// # Errors
    /// When a thread of the server panicked.
    pub(crate) fn run(&self) -> Result<(), ServerError> {
        std::thread::scope(|scope| {
            let work = || {
                for request in self.loopback.requests() {
                    self.answer(request);
                }
            };
            let workers: Vec<_> = (0..WORKERS).map(|_| scope.spawn(work)).collect();
            let ended: Vec<_> = workers.into_iter().map(|worker| worker.join()).collect();
            match ended.iter().any(Result::is_err) {
                true => Err(ServerError::Worker),
                false => Ok(()),
            }
        })
    }
}

impl FolderServer {
    /// Answers one request; a client that has gone away is no fault.
    fn answer(&self, request: Request) {
        if let Some(refusal) = self.loopback.refusal(&request) {
            return refusal.answer(request);
        }
        let Some((file, path)) = self.file(request.url()) else {
            return Refusal::Missing.answer(request);
        };
        let response = Response::from_file(file)
            .with_header(header("Content-Type", content_type(&path)))
            .with_header(header("X-Content-Type-Options", "nosniff"))
            .with_header(header("Cache-Control", "no-store"));
        let _ = request.respond(response);
    }

    /// The file that a request means; `None` when there is none, or when it lies outside the folder.
    fn file(&self, url: &str) -> Option<(File, PathBuf)> {
        let path = self.root.join(relative_path(url)?);
        // Symbolic links are followed by this, so that none leads outside.
        let real = path.canonicalize().ok()?;
        if !real.starts_with(&self.root) || !real.is_file() {
            return None;
        }
        Some((File::open(&real).ok()?, real))
    }
}

/// The path below the root that a request names; `None` for what would leave it or cannot be a name.
fn relative_path(url: &str) -> Option<PathBuf> {
    let path = url.split(['?', '#']).next()?;
    let decoded = percent_decoded(path.strip_prefix('/')?)?;
    if decoded.is_empty() {
        return Some(PathBuf::from(PAGE));
    }
    let mut relative = PathBuf::new();
    for part in decoded.split('/') {
        let is_name = !matches!(part, "" | "." | "..")
            && !part.contains(['\\', ':'])
            && !part.contains(char::is_control);
        if !is_name {
            return None;
        }
        relative.push(part);
    }
    Some(relative)
}

/// Text with its `%41` replaced; `None` when that is malformed or not UTF-8.
fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || char::from(rest.next()?).to_digit(16);
        bytes.push((digit()? * 16 + digit()?) as u8);
    }
    String::from_utf8(bytes).ok()
}

fn content_type(path: &Path) -> &'static str {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("json") => "application/json",
        Some("png") => "image/png",
        Some("glb") => "model/gltf-binary",
        Some("obj") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

/// A header line.
pub(crate) fn header(field: &'static str, value: &'static str) -> Header {
    Header::from_bytes(field, value).expect("field and value are plain ASCII")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_name_files_below_the_root() {
        let path = |url: &str| relative_path(url);
        assert_eq!(path("/"), Some(PathBuf::from("report.html")));
        assert_eq!(path("/?a=1"), Some(PathBuf::from("report.html")));
        assert_eq!(
            path("/keyframes/000001.glb"),
            Some(PathBuf::from("keyframes/000001.glb"))
        );
        assert_eq!(path("/a%20b.png#x"), Some(PathBuf::from("a b.png")));
    }

    #[test]
    fn nothing_leads_outside() {
        for url in [
            "/../secret",
            "/a/../../secret",
            "/%2e%2e/secret",
            "/%2e%2e%2fsecret",
            "/..%5csecret",
            "/a//b",
            "//etc/passwd",
            "/%2fetc/passwd",
            "/C:/secret",
            "/./a",
            "/a%00b",
            "/%zz",
            "/%f",
            "/%ff",
            "report.html",
            "http://elsewhere/",
        ] {
            assert_eq!(relative_path(url), None, "{url}");
        }
    }
}
