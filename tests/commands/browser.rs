//! A headless browser that is told what to do, for pages that go on: over pipes, by the protocol of its developer tools.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::program::text;
use crate::report_page::chromium;
use serde_json::{Value, json};

/// How long a page may take to show something.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page; ended when dropped.
pub(crate) struct Browser {
    child: Child,
    to: File,
    from: BufReader<File>,
    calls: u64,
    session: Option<String>,
    _folder: tempfile::TempDir,
}

impl Browser {
    pub(crate) fn open(address: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [to, from] = ["to", "from"].map(|name| folder.path().join(name));
        let made = Command::new("mkfifo").args([&to, &from]).status().unwrap();
        assert!(made.success());
        let profile = format!(
            "--user-data-dir={}",
            folder.path().join("profile").display()
        );
        // The browser reads from descriptor 3 and writes to 4.
        let child = Command::new("sh")
            .args([
                "-c",
                "to=$1 from=$2; shift 2; exec \"$@\" 3<\"$to\" 4>\"$from\"",
                "sh",
            ])
            .args([text(&to), text(&from), text(&chromium())])
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--use-angle=swiftshader",
            ])
            .args([
                "--enable-unsafe-swiftshader",
                "--no-first-run",
                "--disable-dev-shm-usage",
            ])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-sync",
            ])
            .args([
                "--window-size=1280,1000",
                "--remote-debugging-pipe",
                &profile,
            ])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the browser starts");
        let mut browser = Self {
            child,
            to: File::options().write(true).open(&to).unwrap(),
            from: BufReader::new(File::open(&from).unwrap()),
            calls: 0,
            session: None,
            _folder: folder,
        };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", attach);
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        browser.call("Page.navigate", json!({ "url": address }));
        browser
    }

    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut call = json!({ "id": self.calls, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            call["sessionId"] = json!(session);
        }
        write!(self.to, "{call}\0").unwrap();
        loop {
            let mut answer = Vec::new();
            self.from.read_until(0, &mut answer).unwrap();
            assert_eq!(answer.pop(), Some(0), "the browser goes on");
            let answer: Value = serde_json::from_slice(&answer).unwrap();
            if answer["id"] == self.calls {
                return answer["result"].clone();
            }
        }
    }

    /// What the page has noted about itself, as soon as it is as it should be.
    pub(crate) fn self_test(&mut self, is_done: impl Fn(&Value) -> bool) -> Value {
        let expression = "document.getElementById('selftest')?.textContent ?? 'null'";
        let until = Instant::now() + PATIENCE;
        loop {
            let evaluate = json!({ "expression": expression, "returnByValue": true });
            let found = self.call("Runtime.evaluate", evaluate);
            let found = found["result"]["value"].as_str().unwrap_or("null");
            let found: Value = serde_json::from_str(found).unwrap();
            if is_done(&found) {
                return found;
            }
            assert!(Instant::now() < until, "the page shows {found}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
