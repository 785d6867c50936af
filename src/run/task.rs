//! Limits of a process that another one started for a single task.

use super::MemoryLimit;

/// Lets this process end with the one that started it, and refuses it more memory than `limit`; then it aborts.
///
/// # Errors
/// When the system does not do that. Only Linux does; elsewhere a limit is refused and the rest left out.
#[cfg(target_os = "linux")]
pub fn limit_task(limit: Option<MemoryLimit>) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, Signal, set_parent_process_death_signal, setrlimit};

    set_parent_process_death_signal(Some(Signal::KILL))?;
    let Some(limit) = limit else { return Ok(()) };
    if super::resident_mb().is_some_and(|resident| resident > limit.megabytes) {
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
pub fn limit_task(limit: Option<MemoryLimit>) -> std::io::Result<()> {
    match limit {
        Some(_) => Err(std::io::ErrorKind::Unsupported.into()),
        None => Ok(()),
    }
}

/// Ends this process with exit status 2 and a text on standard error once it holds more memory than `limit`: for work that cannot be
/// stopped in between. The memory is looked at fifty times a second. Does nothing where the system does not report it.
pub fn end_beyond(limit: MemoryLimit, text: String) {
    let look = move || {
        if let Some(resident) = super::resident_mb().filter(|mb| *mb > limit.megabytes) {
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
