//! Any bytes as a request to the server of `linecarve view`: an answer of HTTP or a closed connection, and nothing but the files of the
//! folder. The server must take the next request.
//!
//! In the folder above:
//!
//! ```text
//! export RUSTC_BOOTSTRAP=1
//! mkdir -p fuzz/corpus/requests && printf 'GET /report.html HTTP/1.1\r\nHost: localhost:46171\r\n\r\n' > fuzz/corpus/requests/page
//! cargo fuzz run requests -- -rss_limit_mb=512 -timeout=60
//! ```

#![no_main]

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpStream};
use std::path::Path;
use std::sync::OnceLock;
use std::time::Duration;

use clap::Parser;
use libfuzzer_sys::fuzz_target;
use linecarve::cli::Cli;
use tempfile::TempDir;

/// Port of the server.
const PORT: u16 = 46171;

/// What no answer may hold: it stands in a hidden file, and in one beside the folder.
const SECRET: &[u8] = b"not to be served";

/// Longest time without a byte. A request that is not complete waits for ten seconds, unless its end is known.
const PATIENCE: Duration = Duration::from_secs(20);

fn write_folder(parent: &Path) {
    let folder = parent.join("out");
    std::fs::create_dir(&folder).expect("a folder");
    for (name, content) in [
        ("report.html", b"<!doctype html>".as_slice()),
        ("mesh.ply", b"ply"),
        (".hidden", SECRET),
        ("../beside", SECRET),
    ] {
        std::fs::write(folder.join(name), content).expect("a file in a temporary folder");
    }
}

/// Starts the server, once.
fn serve() -> &'static TempDir {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let parent = tempfile::tempdir().expect("a temporary folder");
        write_folder(parent.path());
        let folder = parent.path().join("out");
        let folder = folder.to_str().expect("a name of text");
        let port = PORT.to_string();
        let cli = Cli::try_parse_from(["linecarve", "--quiet", "view", folder, "--port", &port]);
        let cli = cli.expect("arguments of the program");
        std::thread::spawn(move || linecarve::commands::run(&cli).map(|_| ()));
        for _ in 0..200 {
            if TcpStream::connect((Ipv4Addr::LOCALHOST, PORT)).is_ok() {
                return parent;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("the server does not start: is port {PORT} in use?");
    })
}

/// Sends bytes, and reads until the connection is closed.
fn ask(bytes: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, PORT)).expect("the server listens");
    stream
        .set_read_timeout(Some(PATIENCE))
        .expect("a time that is not zero");
    // The server may close the connection before the end of the request.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    if let Err(error) = stream.read_to_end(&mut answer) {
        let is_slow = matches!(
            error.kind(),
            std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
        );
        assert!(!is_slow, "a connection is held open");
    }
    answer
}

fuzz_target!(|data: &[u8]| {
    serve();
    let answer = ask(data);
    assert!(
        answer.is_empty() || answer.starts_with(b"HTTP/1."),
        "{}",
        String::from_utf8_lossy(&answer)
    );
    assert!(!answer.windows(SECRET.len()).any(|part| part == SECRET));
    let request = format!("GET /report.html HTTP/1.1\r\nHost: localhost:{PORT}\r\n\r\n");
    let page = ask(request.as_bytes());
    assert!(
        page.ends_with(b"<!doctype html>"),
        "{:?}",
        String::from_utf8_lossy(&page)
    );
});
