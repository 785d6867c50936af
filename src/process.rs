//! What concerns the whole process: signals, limits of its memory, and its end with the process that started it.

use std::sync::atomic::{AtomicBool, Ordering};

use linecarve_engine::run::{CancelToken, MemoryLimit, UnknownMemory, resident_mb};

/// Set by signals; process-wide, as a process runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Cancellation is not available.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The system does not report memory use.
    #[error("--memory-limit is not supported: {0}")]
    Memory(#[from] UnknownMemory),
    /// Nothing can end the work in between.
    #[error(
        "--memory-limit is checked between views, and a model without updates is carved at once: leave it out"
    )]
    AtOnce,
    /// Signal handlers cannot be installed.
    #[error("cannot install the handler for Ctrl-C: {0}")]
    Signals(#[from] ctrlc::Error),
}

/// A token for Ctrl-C, termination signals and a memory limit. A second signal ends the program at once; written files
/// stay complete.
///
/// # Errors
/// When signals cannot be handled, or a limit is given and the system does not report memory use.
pub(crate) fn watch(limit: Option<MemoryLimit>) -> Result<CancelToken, WatchError> {
    let token = CancelToken::with_limit(limit)?.cancelled_by(&REQUESTED);
    let handler = || {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            // Exit status of a program ended by Ctrl-C.
            std::process::exit(130);
        }
        eprintln!("stopping after this keyframe; press Ctrl-C again to stop at once");
    };
    match ctrlc::set_handler(handler) {
        Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(token),
        Err(error) => Err(error.into()),
    }
}

/// Lets this process end with the one that started it, and refuses it more memory than `limit`; then it aborts.
///
/// # Errors
/// When the system does not do that. Only Linux does; elsewhere a limit is refused and the rest left out.
#[cfg(target_os = "linux")]
pub(crate) fn limit_task(limit: Option<MemoryLimit>) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, Signal, set_parent_process_death_signal, setrlimit};

    set_parent_process_death_signal(Some(Signal::KILL))?;
    let Some(limit) = limit else { return Ok(()) };
    if resident_mb().is_some_and(|resident| resident > limit.megabytes) {
        let text = "the memory limit is less than the program takes without any data";
        return Err(std::io::Error::other(text));
    }
    let bytes = (limit.megabytes * 1e6) as u64;
    let limit = Rlimit {
        current: Some(bytes),
        maximum: Some(bytes),
    };
    Ok(setrlimit(Resource::As, limit)?)
}

/// Refuses a limit.
///
/// # Errors
/// When there is a limit: only Linux holds it.
#[cfg(not(target_os = "linux"))]
pub(crate) fn limit_task(limit: Option<MemoryLimit>) -> std::io::Result<()> {
    match limit {
        Some(_) => Err(std::io::ErrorKind::Unsupported.into()),
        None => Ok(()),
    }
}

/// Ends this process with exit status 2 and a text on standard error once it holds more memory than `limit`: for work that cannot be
/// stopped in between. The memory is looked at fifty times a second. Does nothing where the system does not report it.
pub(crate) fn end_beyond(limit: MemoryLimit, text: String) {
    let look = move || {
        if let Some(resident) = resident_mb().filter(|mb| *mb > limit.megabytes) {
            eprintln!("linecarve: {resident:.0} MB are in use: {text}");
            std::process::exit(2);
        }
    };
    look();
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(std::time::Duration::from_millis(20));
            look();
        }
    });
}
