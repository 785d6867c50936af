//! The page of a run while it goes on: what its server sends, and what a browser shows of it.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use crate::browser::Browser;
use crate::program::delta_reader::{Corners, sorted};
use crate::program::live_client::LiveClient;
use crate::program::{small_sequence, text, with_open_holes};
use crate::report_page::{chromium, self_test};
use crate::stream::Recording;
use crate::track::room_without_poses;
use serde_json::{Value, json};

/// A run with `--live`, ended when dropped.
struct LiveRun {
    child: Child,
    /// `127.0.0.1:PORT`
    host: String,
}

impl LiveRun {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
            .args(arguments)
            .arg("--live")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let host = lines
            .find_map(|line| {
                let line = line.unwrap();
                let (_, address) = line.split_once("http://")?;
                Some(address.trim_end_matches('/').to_owned())
            })
            .expect("the address is printed");
        // Else the program would be stopped by a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, host }
    }

    /// The status and the body of an answer.
    fn ask(&self, path: &str, host: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let request = format!("GET {path} HTTP/1.0\r\nHost: {host}\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (status, body.to_owned())
    }

    fn connect(&self) -> Events {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let request = format!("GET /events HTTP/1.1\r\nHost: {}\r\n\r\n", self.host);
        stream.write_all(request.as_bytes()).unwrap();
        Events(BufReader::new(stream))
    }
}

impl Drop for LiveRun {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The messages of `/events`.
struct Events(BufReader<TcpStream>);

impl Events {
    /// The next message; `None` at the end.
    fn next(&mut self) -> Option<Value> {
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).unwrap_or(0) == 0 {
                return None;
            }
            if let Some(json) = line.strip_prefix("data: ") {
                return Some(serde_json::from_str(json).unwrap());
            }
        }
    }

    /// Hands messages to a client until it is as it should be.
    fn follow(&mut self, client: &mut LiveClient, until: impl Fn(&LiveClient) -> bool) {
        while !until(client) {
            client.apply(&self.next().expect("the run goes on"));
        }
    }
}

/// The triangles of a mesh file, as a page sees them.
fn surface_of(path: &Path) -> Vec<Corners> {
    let mesh = linecarve_mesh::read_geometry(path).unwrap().into_mesh();
    let corner = |v: u32| {
        let [x, y, z]: [f64; 3] = mesh.positions[v as usize].into();
        [x, y, z].map(|value| (value as f32).to_bits())
    };
    sorted(mesh.triangles.iter().map(|triangle| triangle.map(corner)))
}

/// A `stream` that is written to message by message.
struct Session {
    run: LiveRun,
    input: Option<ChildStdin>,
    output: Option<BufReader<ChildStdout>>,
}

impl Session {
    fn start(recording: &Recording, arguments: &[&str]) -> Self {
        Self::start_with(&recording.start, arguments)
    }

    fn start_with(start: &Value, arguments: &[&str]) -> Self {
        let mut run = LiveRun::start(&[&["stream"], arguments].concat());
        let input = run.child.stdin.take();
        let output = BufReader::new(run.child.stdout.take().unwrap());
        let output = Some(output);
        let mut session = Self { run, input, output };
        session.send(start);
        session
    }

    /// Sends a message and waits for the reply.
    fn send(&mut self, message: &Value) {
        writeln!(self.input.as_mut().unwrap(), "{message}").unwrap();
        let mut reply = String::new();
        let output = self.output.as_mut().unwrap();
        output.read_line(&mut reply).unwrap();
        assert!(!reply.contains("\"error\""), "{reply}");
    }

    /// Ends the input, and reads the last replies, so that the program never waits for a reader.
    fn end(&mut self) {
        drop(self.input.take());
        let output = self.output.take();
        std::thread::spawn(move || {
            output.map(|mut output| std::io::copy(&mut output, &mut std::io::sink()))
        });
    }
}

#[test]
fn a_live_page_follows_a_session() {
    let recording = Recording::new();
    let out = recording.folder().join("out");
    let open = with_open_holes(recording.folder());
    let options = ["--out", text(&out), "--config", text(&open)];
    let mut session = Session::start(&recording, &options);
    let host = session.run.host.clone();
    assert!(host.starts_with("127.0.0.1:"));
    let (status, page) = session.run.ask("/", &host);
    assert_eq!(status, 200);
    assert!(page.contains("{\"live\":true}"));
    for path in ["/", "/events"] {
        assert_eq!(session.run.ask(path, "elsewhere.example").0, 403);
    }
    assert_eq!(session.run.ask("/report.json", &host).0, 404);

    let (mut first, mut seen_first) = (session.run.connect(), LiveClient::default());
    first.follow(&mut seen_first, |_| true);
    for frame in 0..3 {
        session.send(&recording.keyframe(frame, &recording.poses[frame]));
    }
    first.follow(&mut seen_first, |client| client.rows.len() == 3);
    assert_eq!(seen_first.keyframes.len(), 3);
    assert!(seen_first.has_scene && seen_first.image.is_some());
    assert!(!seen_first.surface().is_empty() && seen_first.segments > 0);

    // Another browser, or the same again: the whole state first.
    let (mut second, mut seen) = (session.run.connect(), LiveClient::default());
    second.follow(&mut seen, |client| client.has_scene);
    assert_eq!(seen, seen_first);
    drop(first);

    session.send(&recording.keyframe(3, &recording.poses[3]));
    // A corrected pose moves its keyframe.
    let moved =
        json!({ "type": "poses", "poses": [{ "id": 1, "world_from_camera": recording.poses[2] }] });
    session.send(&moved);
    let is_moved = |client: &LiveClient| {
        client.keyframes.len() == 4
            && client.keyframes[1]["position"] == client.keyframes[2]["position"]
    };
    second.follow(&mut seen, is_moved);
    session.send(&recording.keyframe(4, &recording.poses[4]));
    session.end();
    second.follow(&mut seen, |client| client.has_ended);
    assert_eq!(seen.keyframes.len(), 5);
    // The depth images contradict this pose: the end corrects it, as a run does.
    assert_ne!(seen.keyframes[1]["position"], seen.keyframes[2]["position"]);
    assert!(session.run.child.wait().unwrap().success());
    assert_eq!(seen.surface(), surface_of(&out.join("mesh.ply")));
}

#[test]
fn a_live_page_ends_with_the_surface_of_the_run() {
    let folder = small_sequence(5, "tum");
    let (sequence, out) = (folder.path().join("sequence"), folder.path().join("out"));
    let mut run = LiveRun::start(&[
        "reconstruct",
        text(&sequence),
        "--every",
        "1",
        "--no-picture",
        "--out",
        text(&out),
    ]);
    let mut seen = LiveClient::default();
    run.connect().follow(&mut seen, |client| client.has_ended);
    assert!(run.child.wait().unwrap().success());
    assert_eq!(
        seen.surface(),
        surface_of(&out.join("keyframes/000004.glb"))
    );
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(Some(seen.segments), report["result"]["segments"].as_u64());
    assert_eq!(Some(seen.clusters), report["result"]["clusters"].as_u64());
    assert_eq!((seen.keyframes.len(), seen.rows.len()), (5, 5));
}

/// Neither a request without an end, nor a client that does not read, nor one that asks for more memory than there is, holds up a run.
#[test]
fn a_run_never_waits_for_a_client() {
    let mut session = Session::start_with(&map_messages(5)[0], &[]);
    let host = session.run.host.clone();
    let head = format!("HTTP/1.1\r\nHost: {host}\r\n");
    let clients: Vec<TcpStream> = [
        "POST / HTTP/1.1\r\nHost: evil\r\nContent-Length: 2000\r\n\r\n".to_owned(),
        format!("GET / {head}Content-Length: 1000000000000\r\n\r\n"),
        format!("GET / {head}"),
        format!("GET /events {head}\r\n"),
        String::new(),
    ]
    .iter()
    .map(|request| {
        let mut stream = TcpStream::connect(&host).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        stream
    })
    .collect();
    for message in &map_messages(5)[1..] {
        session.send(message);
    }
    assert_eq!(session.run.ask("/", &host).0, 200);
    session.end();
    assert!(session.run.child.wait().unwrap().success());
    drop(clients);
}

/// A map without images: cameras in a row that look along z at points between 3 and 4, and two lines.
fn map_messages(cameras: u64) -> Vec<Value> {
    let points: Vec<Value> = (0..150_u64)
        .map(|id| {
            let at = |prime: u64| (id * prime % 151) as f64 / 151.0;
            let position = [4.0 * at(29) - 2.0, 4.0 * at(53) - 2.0, 3.0 + at(97)];
            json!({ "id": id, "position": position })
        })
        .collect();
    let ids: Vec<u64> = (0..150).collect();
    let start = json!({
        "type": "start", "depth_source": "none",
        "calibration": { "color": { "fx": 500, "fy": 500, "cx": 320, "cy": 240 } },
    });
    let mut messages = vec![start];
    for id in 0..cameras {
        let pose = json!({ "translation": [0.2 * id as f64, 0, 0], "rotation": [0, 0, 0, 1] });
        messages.push(json!({ "type": "keyframe", "id": id, "world_from_camera": pose }));
        if id == 0 {
            messages.push(json!({ "type": "points", "points": points }));
        }
        messages.push(json!({ "type": "observations", "keyframe": id, "points": ids }));
    }
    let line = |id: u64| {
        let ends = [[-1.0, id as f64, 2.9], [1.0, id as f64, 2.9]];
        json!({ "id": id, "ends": ends, "keyframes": [0, 1] })
    };
    messages.push(json!({ "type": "lines", "lines": [line(0), line(1)] }));
    messages
}

#[test]
fn a_live_page_shows_a_map_without_images() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let messages = map_messages(5);
    let mut session = Session::start_with(&messages[0], &["--out", text(&out)]);
    let (mut events, mut seen) = (session.run.connect(), LiveClient::default());
    for message in &messages[1..] {
        session.send(message);
    }
    events.follow(&mut seen, |client| client.segments == 2);
    assert!(seen.has_scene && seen.image.is_none());
    assert_eq!((seen.keyframes.len(), seen.rows.len()), (5, 5));
    assert!(seen.points > 100 && !seen.surface().is_empty());

    // A line that is removed is gone, and so is a keyframe.
    session.send(&json!({ "type": "lines", "lines": [], "removed": [1] }));
    session.send(&json!({ "type": "remove", "ids": [4] }));
    session.end();
    events.follow(&mut seen, |client| client.has_ended);
    assert_eq!((seen.keyframes.len(), seen.segments), (4, 1));
    assert!(session.run.child.wait().unwrap().success());
    assert_eq!(seen.surface(), surface_of(&out.join("mesh.ply")));
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("4 keyframes, "), "the page tells its size");
}

#[test]
fn a_live_page_follows_tracking() {
    let folder = room_without_poses(20);
    let out = folder.path().join("out");
    let input = folder.path();
    let mut run = LiveRun::start(&["track", text(input), "--out", text(&out)]);
    let mut seen = LiveClient::default();
    run.connect().follow(&mut seen, |client| client.has_ended);
    assert!(run.child.wait().unwrap().success());
    assert!(seen.has_scene && seen.image.is_some());
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("track.json")).unwrap()).unwrap();
    let submap = &report["submaps"][0];
    assert_eq!(Some(seen.points), submap["points"].as_u64());
    let mut names = submap["keyframes"].as_array().unwrap().clone();
    names.sort_by_key(|name| name.as_str().map(str::to_owned));
    let shown: Vec<Value> = (seen.keyframes.iter())
        .map(|keyframe| keyframe["name"].clone())
        .collect();
    assert_eq!(shown, names);
    assert!(!seen.rows.is_empty() && seen.rows.len() <= shown.len());
}

#[test]
#[ignore = "needs chromium"]
fn the_page_of_tracking_shows_cameras_and_points() {
    let folder = room_without_poses(20);
    let out = folder.path().join("out");
    let run = LiveRun::start(&["track", text(folder.path()), "--out", text(&out)]);
    let mut browser = Browser::open(&format!("http://{}/#selftest", run.host));
    let found = browser.self_test(|found| found["ended"] == true);
    assert_eq!(found["errors"], json!([]), "{found}");
    assert_eq!(
        (&found["image"], &found["plots"]),
        (&json!(true), &json!(1))
    );
    let page = self_test(
        &chromium(),
        &format!("file://{}", text(&out.join("report.html"))),
    );
    assert_eq!(page["errors"], json!([]), "{page}");
    let last = page["states"].as_array().unwrap().last().unwrap();
    // No segments, no clusters: points are all there is.
    assert_eq!(last["elements"][0], json!([found["elements"][2]]));
    assert!(found["elements"][2].as_u64().unwrap() > 100, "{found}");
    assert!(page["drawn_share"].as_f64().unwrap() > 0.01, "{page}");
}

#[test]
#[ignore = "needs chromium"]
fn the_page_of_a_map_without_images_shows_its_points() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let messages = map_messages(5);
    let mut session = Session::start_with(&messages[0], &["--out", text(&out)]);
    let (mut events, mut seen) = (session.run.connect(), LiveClient::default());
    let mut browser = Browser::open(&format!("http://{}/#selftest", session.run.host));
    for message in &messages[1..] {
        session.send(message);
    }
    events.follow(&mut seen, |client| client.segments == 2);
    let shows_all = |found: &Value| found["cameras"] == 5 && found["elements"][0] == 2;
    let found = browser.self_test(shows_all);
    assert_eq!(found["errors"], json!([]), "{found}");
    assert_eq!(found["triangles"], seen.surface().len());
    assert_eq!(found["elements"][2], seen.points);
    assert_eq!(found["image"], false);
    assert!(found["drawn_share"].as_f64().unwrap() > 0.02, "{found}");
    session.end();
    assert!(session.run.child.wait().unwrap().success());
    let page = format!("file://{}", text(&out.join("report.html")));
    let found = self_test(&chromium(), &page);
    assert_eq!(found["errors"], json!([]), "{found}");
    let last = found["states"].as_array().unwrap().last().unwrap();
    assert_eq!(last["triangles"][0], seen.surface().len());
    assert_eq!(last["elements"][0][0], 2);
}

#[test]
#[ignore = "needs chromium"]
fn the_page_of_a_live_session_shows_its_surface() {
    let recording = Recording::new();
    let mut session = Session::start(&recording, &[]);
    let (mut events, mut seen) = (session.run.connect(), LiveClient::default());
    session.send(&recording.keyframe(0, &recording.poses[0]));
    let mut browser = Browser::open(&format!("http://{}/#selftest", session.run.host));
    browser.self_test(|found| found["cameras"] == 1);
    for frame in 1..4 {
        session.send(&recording.keyframe(frame, &recording.poses[frame]));
    }
    events.follow(&mut seen, |client| client.rows.len() == 4);
    let found = browser.self_test(|found| found["cameras"] == 4 && found["keyframe"] == 3);
    assert_eq!(found["errors"], json!([]), "{found}");
    assert_eq!(found["triangles"], seen.surface().len());
    assert_eq!(found["elements"][0], seen.segments);
    assert_eq!(found["elements"][1], seen.clusters);
    assert_eq!(found["image"], true);
    assert!(found["drawn_share"].as_f64().unwrap() > 0.02, "{found}");
    session.end();
    let found = browser.self_test(|found| found["ended"] == true);
    assert_eq!(found["triangles"], seen.surface().len());
    assert_eq!(found["plots"], 2);
}
