//! `linecarve view`: the page of an output folder on a loopback address.

use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};

use crate::cli::ViewArgs;
use crate::commands::Outcome;
use crate::progress::Verbosity;
use crate::server::{Folder, PAGE, Server};
use crate::sinks::print_text;
use crate::standard_error::say;

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
    let server = Server::start(args.port, Duration::ZERO, Arc::new(Folder(root)))?;
    let url = format!("http://{}/", server.address());
    print_text(&format!("{url}\n"))?;
    if verbosity > Verbosity::Quiet {
        say!(
            "serving {} on this machine alone; Ctrl-C ends it",
            folder.display()
        );
    }
    if args.open
        && let Err(reason) = open_browser(&url)
    {
        say!("warning: no browser was opened ({reason}): open {url} by hand");
    }
    server.serve()?;
    Ok(Outcome::Done)
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
