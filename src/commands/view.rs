//! `linecarve view`: the page of an output folder on a loopback address.

use std::fs::File;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use anyhow::{Context, bail};
use tiny_http::{Header, Method, Request, Response, Server, StatusCode};

use crate::cli::ViewArgs;
use crate::commands::Outcome;
use crate::run::Verbosity;
use crate::sinks::print_text;

/// The file that `/` stands for.
const PAGE: &str = "report.html";
/// Requests answered at a time: a browser asks for a few files at once.
const WORKERS: usize = 4;

pub(super) fn run(args: &ViewArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let folder = &args.folder;
    let root = folder
        .canonicalize()
        .with_context(|| format!("cannot open the folder {}", folder.display()))?;
    if !root.join(PAGE).is_file() {
        bail!(
            "{} holds no {PAGE}: give the output folder of `linecarve reconstruct` or `linecarve compare`",
            folder.display()
        );
    }
    let server = Arc::new(listen(args.port)?);
    let address = server
        .server_addr()
        .to_ip()
        .context("the server has no network address")?;
    let url = format!("http://{address}/");
    print_text(&format!("{url}\n"))?;
    if verbosity > Verbosity::Quiet {
        eprintln!(
            "serving {} on this machine alone; Ctrl-C ends it",
            folder.display()
        );
    }
    if args.open
        && let Err(reason) = open_browser(&url)
    {
        eprintln!("warning: no browser was opened ({reason}): open {url} by hand");
    }
    let site = Arc::new(Site { root, address });
    let workers: Vec<_> = (0..WORKERS)
        .map(|_| {
            let (server, site) = (Arc::clone(&server), Arc::clone(&site));
            std::thread::spawn(move || {
                for request in server.incoming_requests() {
                    site.answer(request);
                }
            })
        })
        .collect();
    for worker in workers {
        if worker.join().is_err() {
            bail!("a worker of the server ended unexpectedly");
        }
    }
    Ok(Outcome::Done)
}

/// A server on the loopback address.
fn listen(port: Option<u16>) -> anyhow::Result<Server> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port.unwrap_or(0)));
    Server::http(address).map_err(|error| {
        let in_use = error
            .downcast_ref::<std::io::Error>()
            .is_some_and(|error| error.kind() == std::io::ErrorKind::AddrInUse);
        match port {
            Some(port) if in_use => anyhow::anyhow!(
                "port {port} is in use: give another with --port, or leave the option out for a free one"
            ),
            Some(port) => anyhow::anyhow!(
                "cannot listen on port {port}: {error} (leave --port out for a free one)"
            ),
            None => anyhow::anyhow!("cannot listen on the loopback address: {error}"),
        }
    })
}

/// Asks the desktop for a browser.
fn open_browser(url: &str) -> Result<(), String> {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        let has_display = ["DISPLAY", "WAYLAND_DISPLAY"]
            .iter()
            .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
        if !has_display {
            return Err("there is no display".to_owned());
        }
        "xdg-open"
    };
    Command::new(program)
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map(|_| ())
        .map_err(|error| format!("{program}: {error}"))
}

/// A folder and the address that it is served on.
struct Site {
    root: PathBuf,
    address: SocketAddr,
}

impl Site {
    /// Answers one request; a client that has gone away is no fault.
    fn answer(&self, request: Request) {
        let is_read = matches!(request.method(), Method::Get | Method::Head);
        let status = if !is_read {
            405
        } else if !self.is_own_name(&request) {
            403
        } else {
            match self.file(request.url()) {
                Some((file, path)) => {
                    let response = Response::from_file(file)
                        .with_header(header("Content-Type", content_type(&path)))
                        .with_header(header("X-Content-Type-Options", "nosniff"))
                        .with_header(header("Cache-Control", "no-store"));
                    let _ = request.respond(response);
                    return;
                }
                None => 404,
            }
        };
        let text = match status {
            403 => "this address answers on the loopback name only\n",
            405 => "only GET and HEAD\n",
            _ => "no such file\n",
        };
        let response = Response::from_string(text).with_status_code(StatusCode(status));
        let _ = request.respond(response);
    }

    /// Whether the request names the loopback address: a page elsewhere whose name was made to point here does not.
    fn is_own_name(&self, request: &Request) -> bool {
        let host = request
            .headers()
            .iter()
            .find(|header| header.field.equiv("Host"))
            .map(|header| header.value.as_str());
        let port = self.address.port();
        host.is_none_or(|host| {
            host == format!("127.0.0.1:{port}") || host == format!("localhost:{port}")
        })
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

fn header(field: &'static str, value: &'static str) -> Header {
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
