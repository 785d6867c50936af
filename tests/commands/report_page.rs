//! The page of a run in a browser, and its server.
//!
//! Browser tests are ignored by default. They need Chromium: `LINECARVE_CHROMIUM`, or one of the usual names on the path.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::program::{
    colmap_relief, expect_status, linecarve, small_sequence, stderr, text, with_open_holes,
};
use serde_json::Value;

/// A headless browser.
pub(crate) fn chromium() -> PathBuf {
    if let Some(path) = std::env::var_os("LINECARVE_CHROMIUM") {
        return PathBuf::from(path);
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    ["chromium", "chromium-browser", "google-chrome"]
        .iter()
        .flat_map(|name| std::env::split_paths(&path).map(move |folder| folder.join(name)))
        .find(|candidate| candidate.is_file())
        .expect("chromium must be on the path, or LINECARVE_CHROMIUM must name it")
}

/// Runs the browser on an address to its end; its standard output.
fn browse(chromium: &Path, arguments: &[&str], address: &str) -> String {
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(chromium)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--disable-dev-shm-usage",
            "--window-size=1280,1000",
            "--virtual-time-budget=4000",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(arguments)
        .arg(address)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .expect("the browser starts");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// What the page found out about itself.
pub(crate) fn self_test(chromium: &Path, address: &str) -> Value {
    let dom = browse(chromium, &["--dump-dom"], &format!("{address}#selftest"));
    let marker = "<pre id=\"selftest\">";
    let (_, rest) = dom.split_once(marker).expect("the page has tested itself");
    let (json, _) = rest.split_once("</pre>").unwrap();
    serde_json::from_str(json).unwrap()
}

/// What `assets/report/build.mjs` computes from the files of the viewer.
fn hash_of_viewer_sources(folder: &Path) -> u64 {
    let mut modules: Vec<String> = std::fs::read_dir(folder.join("viewer"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    modules.sort();
    let others = ["build.mjs", "package.json", "package-lock.json"].map(str::to_owned);
    let modules = modules.iter().map(|name| format!("viewer/{name}"));
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for name in others.into_iter().chain(modules) {
        let content = std::fs::read(folder.join(&name)).unwrap();
        for part in [name.as_bytes(), content.as_slice()] {
            for &byte in part.iter().chain(&[0]) {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
            }
        }
    }
    hash
}

#[test]
fn the_bundled_viewer_is_that_of_its_sources() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/report");
    let bundle = std::fs::read_to_string(folder.join("viewer.min.js")).unwrap();
    let expected = format!("/* sources {:016x} */", hash_of_viewer_sources(&folder));
    assert_eq!(
        bundle.lines().next(),
        Some(expected.as_str()),
        "viewer.min.js is older than its sources: npm ci && npm run build in assets/report"
    );
}

fn reconstructed(frames: usize) -> tempfile::TempDir {
    let folder = small_sequence(frames, "tum");
    let (sequence, out) = (folder.path().join("sequence"), folder.path().join("out"));
    let open = with_open_holes(folder.path());
    let arguments = [
        "reconstruct",
        text(&sequence),
        "--every",
        "1",
        "--no-picture",
        "--config",
        text(&open),
        "--quiet",
        "--out",
        text(&out),
    ];
    expect_status(0, arguments);
    folder
}

#[test]
#[ignore = "needs chromium"]
fn the_page_shows_the_surface_of_every_keyframe() {
    let chromium = chromium();
    let folder = reconstructed(5);
    let out = folder.path().join("out");
    let address = format!("file://{}", out.join("report.html").display());
    let found = self_test(&chromium, &address);
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    assert_eq!(found["webgl"], true);
    assert!(found["drawn_share"].as_f64().unwrap() > 0.05, "{found}");

    let states = found["states"].as_array().unwrap();
    assert_eq!(states.len(), 5);
    let triangles: Vec<u64> = states
        .iter()
        .map(|s| s["triangles"][0].as_u64().unwrap())
        .collect();
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(
        triangles.last(),
        report["result"]["triangles"].as_u64().as_ref()
    );
    assert_eq!(states[4]["elements"][0][0], report["result"]["segments"]);
    assert_eq!(states[4]["elements"][0][1], report["result"]["clusters"]);
    assert!(
        triangles.windows(2).all(|pair| pair[0] != pair[1]),
        "{triangles:?}"
    );

    let picture = folder.path().join("page.png");
    let shot = format!("--screenshot={}", picture.display());
    browse(
        &chromium,
        &[&shot],
        &format!("{address}#keyframe=2&view=keyframe&show=wire"),
    );
    let picture = image::open(&picture).unwrap().to_rgb8();
    let mut colors: Vec<[u8; 3]> = picture.pixels().map(|pixel| pixel.0).collect();
    colors.sort_unstable();
    colors.dedup();
    assert!(colors.len() > 500, "{} colours", colors.len());
}

#[test]
fn the_page_needs_no_network() {
    let folder = reconstructed(2);
    let page = std::fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    // Namespaces and the texts of messages apart, nothing names another place, and nothing is fetched.
    for tag in [
        "<link rel=\"stylesheet\"",
        "src=\"",
        "@import",
        "href=\"http",
    ] {
        assert!(!page.contains(tag), "{tag}");
    }
    assert!(
        page.contains("three.js authors"),
        "the licence is on the page"
    );
    assert!(!page.contains("localStorage"));
}

/// A running `linecarve view`, ended when dropped.
struct Viewer {
    child: Child,
    /// `127.0.0.1:PORT`
    host: String,
}

impl Viewer {
    fn start(folder: &Path) -> Self {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
            .args(["view", text(folder), "--quiet"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let host = line
            .trim()
            .strip_prefix("http://")
            .unwrap()
            .trim_end_matches('/')
            .to_owned();
        Self { child, host }
    }

    /// The head and the body of an answer.
    fn answer(&self, request: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        // The server may have closed the connection before all is sent, and not read all that was.
        let _ = stream.write_all(request.as_bytes());
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let head = answer.windows(4).position(|four| four == b"\r\n\r\n");
        // A connection that is closed while a request is sent may lose the answer.
        let Some(head) = head else {
            return (String::from("closed 0"), answer);
        };
        let text = String::from_utf8(answer[..head + 4].to_vec()).unwrap();
        (text, answer[head + 4..].to_vec())
    }

    fn head(&self, request: &str) -> String {
        self.answer(request).0
    }

    /// The status and the body of an answer.
    fn ask(&self, request: &str) -> (u16, Vec<u8>) {
        let (head, body) = self.answer(request);
        (head.split(' ').nth(1).unwrap().parse().unwrap(), body)
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.ask(&format!(
            "GET {path} HTTP/1.0\r\nHost: {}\r\n\r\n",
            self.host
        ))
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_server_gives_the_folder_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir_all(out.join("keyframes")).unwrap();
    std::fs::write(out.join("report.html"), "<p>page</p>").unwrap();
    std::fs::write(out.join("keyframes/000001.glb"), "glTF").unwrap();
    std::fs::write(folder.path().join("secret.txt"), "secret").unwrap();
    std::fs::create_dir(out.join(".linecarve")).unwrap();
    std::fs::write(out.join(".linecarve/run.txt"), "hidden").unwrap();
    #[cfg(unix)]
    for (name, target) in [
        ("link.txt", folder.path().join("secret.txt")),
        ("hidden.txt", out.join(".linecarve/run.txt")),
    ] {
        std::os::unix::fs::symlink(target, out.join(name)).unwrap();
    }

    let viewer = Viewer::start(&out);
    assert!(viewer.host.starts_with("127.0.0.1:"));
    assert_eq!(viewer.get("/"), (200, b"<p>page</p>".to_vec()));
    assert_eq!(viewer.get("/keyframes/000001.glb").1, b"glTF");
    for path in [
        "/../secret.txt",
        "/%2e%2e/secret.txt",
        "/..%2fsecret.txt",
        "/link.txt",
        "/hidden.txt",
        "/.linecarve/run.txt",
        "/keyframes",
        "/none",
    ] {
        assert_eq!(viewer.get(path).0, 404, "{path}");
    }
    let host = &viewer.host;
    assert_eq!(
        viewer
            .ask(&format!("POST / HTTP/1.0\r\nHost: {host}\r\n\r\n"))
            .0,
        405
    );
    assert_eq!(
        viewer
            .ask("GET / HTTP/1.0\r\nHost: elsewhere.example\r\n\r\n")
            .0,
        403
    );

    // Its port is taken now.
    let port = host.rsplit(':').next().unwrap();
    let output = linecarve(["view", text(&out), "--port", port]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains(&format!("port {port} is in use")),
        "{}",
        stderr(&output)
    );
}

#[test]
fn a_page_cannot_be_shown_in_another_page_or_load_anything_from_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("report.html"), "<p>page</p>").unwrap();
    let viewer = Viewer::start(folder.path());
    for path in ["/", "/none"] {
        let request = format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", viewer.host);
        let head = viewer.head(&request).to_lowercase();
        assert!(head.contains("x-frame-options: deny\r\n"), "{head}");
        assert!(head.contains("content-security-policy: default-src 'none'; "));
        assert!(head.contains("frame-ancestors 'none'\r\n"), "{head}");
        assert!(head.contains("x-content-type-options: nosniff\r\n"));
        assert!(head.contains("connection: close\r\n"));
    }
}

/// What no request may do to a server: end it, hold it up, or take memory.
#[test]
fn a_server_outlives_all_requests() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("report.html"), "<p>page</p>").unwrap();
    let viewer = Viewer::start(folder.path());
    let host = &viewer.host;
    let get = format!("GET / HTTP/1.1\r\nHost: {host}\r\n");
    let long = "x".repeat(100_000);
    for (request, status) in [
        (format!("{get}Content-Length: 1000000000000\r\n\r\n"), 413),
        (
            format!("{get}Content-Length: 10000000000000000000\r\n\r\n"),
            413,
        ),
        (
            format!("{get}Content-Length: 99999999999999999999\r\n\r\n"),
            400,
        ),
        (format!("{get}Transfer-Encoding: chunked\r\n\r\n"), 413),
        (
            format!("POST / HTTP/1.1\r\nHost: {host}\r\nContent-Length: 9\r\n\r\n"),
            405,
        ),
        (format!("{get}A: {long}\r\n\r\n"), 431),
        (format!("{get}{}\r\n", "A: 1\r\n".repeat(1000)), 431),
    ] {
        let found = viewer.ask(&request).0;
        let may_be_closed = status == 431;
        assert!(
            found == status || (may_be_closed && found == 0),
            "{found}, not {status}"
        );
    }
    // More than one worker, or a few, would have; they stay open.
    let unfinished: Vec<TcpStream> = [&get, "", "GET", "\r\n"]
        .iter()
        .cycle()
        .take(20)
        .map(|start| {
            let mut stream = TcpStream::connect(host).unwrap();
            stream.write_all(start.as_bytes()).unwrap();
            stream
        })
        .collect();
    assert_eq!(viewer.get("/"), (200, b"<p>page</p>".to_vec()));
    drop(unfinished);
}

/// As `nc -N` does, also while the answer is longer than what the system keeps for a connection.
#[test]
fn a_client_that_sends_nothing_more_gets_its_answer() {
    let folder = tempfile::tempdir().unwrap();
    let page = "<p>page</p>".repeat(1_000_000);
    std::fs::write(folder.path().join("report.html"), &page).unwrap();
    std::fs::write(folder.path().join("mesh.ply"), "ply").unwrap();
    let viewer = Viewer::start(folder.path());
    let ask = |path: &str| {
        let mut stream = TcpStream::connect(&viewer.host).unwrap();
        let request = format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", viewer.host);
        stream.write_all(request.as_bytes()).unwrap();
        stream.shutdown(Shutdown::Write).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        answer
    };
    for _ in 0..200 {
        assert!(ask("/mesh.ply").ends_with(b"\r\n\r\nply"));
    }
    assert!(ask("/").ends_with(page.as_bytes()));
}

#[test]
fn a_folder_without_a_page_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = linecarve(["view", text(folder.path())]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("holds no report.html"),
        "{}",
        stderr(&output)
    );
    let output = linecarve(["view", "/no/such/folder"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
#[ignore = "needs chromium"]
fn the_page_works_through_the_server() {
    let chromium = chromium();
    let folder = reconstructed(3);
    let viewer = Viewer::start(&folder.path().join("out"));
    let found = self_test(&chromium, &format!("http://{}/", viewer.host));
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    assert_eq!(found["states"].as_array().unwrap().len(), 3);
}

fn reconstructed_model() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (model, out) = (folder.path().join("model"), folder.path().join("out"));
    colmap_relief(&model, [0.0; 3]);
    let arguments = ["reconstruct", text(&model), "--from", "map-points"];
    let to = ["--no-picture", "--quiet", "--out", text(&out)];
    expect_status(0, arguments.iter().chain(&to));
    folder
}

#[test]
fn a_model_without_images_has_a_page() {
    let folder = reconstructed_model();
    assert!(folder.path().join("out/report.html").is_file());
}

#[test]
#[ignore = "needs chromium"]
fn the_page_of_a_model_shows_its_surface() {
    let chromium = chromium();
    let folder = reconstructed_model();
    let out = folder.path().join("out");
    let address = format!("file://{}", out.join("report.html").display());
    let found = self_test(&chromium, &address);
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    assert!(found["drawn_share"].as_f64().unwrap() > 0.05, "{found}");
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    let states = found["states"].as_array().unwrap();
    assert_eq!(states.len(), 4);
    assert_eq!(states[3]["triangles"][0], report["result"]["triangles"]);
    assert!(report["result"]["triangles"].as_u64().unwrap() > 100);
}
