//! What concerns the whole process: signals, limits of its memory, and its end with the process that started it.

use std::sync::atomic::{AtomicBool, Ordering};

use linecarve_engine::run::{CancelToken, MemoryLimit, UnknownMemory, resident_mb};

use crate::standard_error::say;

/// Set by signals; process-wide, as a process runs one command.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Makes a write beyond the limit of the size of files an error, which is reported with the name of the file. Otherwise the system ends
/// the program.
pub fn set_up() {
    #[cfg(unix)]
    {
        let ignored = std::sync::Arc::new(AtomicBool::new(false));
        // Without the handler all is as before.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, ignored);
    }
}

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
    on_signal(|| say!("stopping after this keyframe; press Ctrl-C again to stop at once"))?;
    Ok(token)
}

/// Does something on the first Ctrl-C or termination signal; the second ends the program at once.
///
/// # Errors
/// When signals cannot be handled.
pub(crate) fn on_signal(first: impl Fn() + Send + 'static) -> Result<(), ctrlc::Error> {
    let handler = move || {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            // Exit status of a program ended by Ctrl-C.
            std::process::exit(130);
        }
        first();
    };
    match ctrlc::set_handler(handler) {
        Err(ctrlc::Error::MultipleHandlers) | Ok(()) => Ok(()),
        Err(error) => Err(error),
    }
}

/// Whether a signal has come.
pub(crate) fn is_signalled() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

/// Lets this process end with the one that started it, and refuses it more memory than `limit`; then it aborts.
///
/// # Errors
/// When the system does not do that. Only Linux does; elsewhere a limit is refused and the rest left out.
#[cfg(target_os = "linux")]
pub(crate) fn limit_task(limit: Option<MemoryLimit>) -> std::io::Result<()> {
    use linecarve_engine::run::size_mb;
    use rustix::process::{Resource, Rlimit, Signal, set_parent_process_death_signal, setrlimit};

    set_parent_process_death_signal(Some(Signal::KILL))?;
    let Some(limit) = limit else { return Ok(()) };
    let resident = resident_mb().unwrap_or(0.0);
    if resident > limit.megabytes {
        let text = "the memory limit is less than the program takes without any data";
        return Err(std::io::Error::other(text));
    }
    // Addresses are what the system limits. Those of the program itself and of libraries take hardly any memory: only what comes on top of
    // them counts.
    let addresses = size_mb().unwrap_or(resident);
    let bytes = ((addresses + limit.megabytes - resident) * 1e6) as u64;
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
            say!("linecarve: {resident:.0} MB are in use: {text}");
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
