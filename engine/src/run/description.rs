//! What a run reads and how, so that a run of something else does not go on with its checkpoint.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use rayon::prelude::*;
use xxhash_rust::xxh3::xxh3_64;

/// Begins the lines of files.
const FILE: &str = "file ";

/// What identifies a run.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunDescription {
    /// Source, options, cameras and keyframes, line by line.
    pub text: String,
    /// The files that keyframes are made from.
    pub files: Vec<PathBuf>,
}

/// A file as a run found it.
#[derive(Debug, Clone, PartialEq, Eq)]
struct FileState {
    bytes: u64,
    /// Nanoseconds since 1970 of the last change; 0 where the system does not tell.
    changed_ns: u128,
}

impl FileState {
    /// The state of a file; `None` when it is missing.
    fn of(path: &Path) -> Option<Self> {
        let found = path.metadata().ok()?;
        let changed = found.modified().ok();
        let changed = changed.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Some(Self {
            bytes: found.len(),
            changed_ns: changed.map_or(0, |time| time.as_nanos()),
        })
    }
}

/// Digest of the content of a file; 0 when it cannot be read, which is reported by what needs it.
fn digest(path: &Path) -> u64 {
    std::fs::read(path).map_or(0, |bytes| xxh3_64(&bytes))
}

impl RunDescription {
    /// The text of `run.txt`: the description, and state and digest of each file. Reads all files.
    pub(super) fn written(&self) -> String {
        let lines: Vec<String> = self
            .files
            .par_iter()
            .map(|path| {
                let state = match FileState::of(path) {
                    Some(FileState { bytes, changed_ns }) => format!("{bytes} {changed_ns}"),
                    None => "missing 0".to_owned(),
                };
                format!("{FILE}{state} {:016x} {}\n", digest(path), path.display())
            })
            .collect();
        format!("{}{}", self.text, lines.concat())
    }

    /// The description in the text of a `run.txt`, without its files.
    pub(super) fn text_of(written: &str) -> String {
        let lines = written.lines().filter(|line| !line.starts_with(FILE));
        lines.flat_map(|line| [line, "\n"]).collect()
    }

    /// What is different from the text of a `run.txt`. Files of the same size and time stamp are taken for the same; the content of others
    /// is compared.
    pub(super) fn difference(&self, written: &str) -> Option<String> {
        let found = Self::text_of(written);
        if let Some(difference) = first_difference(&found, &self.text) {
            return Some(difference);
        }
        let known: BTreeMap<&str, (&str, &str)> = written
            .lines()
            .filter_map(|line| {
                let mut words = line.strip_prefix(FILE)?.splitn(4, ' ');
                let [bytes, changed, digest, path] = [(); 4].map(|()| words.next());
                let state = &line[FILE.len()..FILE.len() + bytes?.len() + 1 + changed?.len()];
                Some((path?, (state, digest?)))
            })
            .collect();
        self.files.par_iter().find_map_first(|path| {
            let name = path.display().to_string();
            let Some((state, content)) = known.get(name.as_str()) else {
                return Some(format!("{name} was not part of it"));
            };
            let Some(FileState { bytes, changed_ns }) = FileState::of(path) else {
                let was_missing = state.starts_with("missing");
                return (!was_missing).then(|| format!("{name} is missing"));
            };
            let is_same = *state == format!("{bytes} {changed_ns}")
                || *content == format!("{:016x}", digest(path));
            (!is_same).then(|| format!("{name} has changed"))
        })
    }
}

/// The first line that differs between two texts.
fn first_difference(found: &str, asked: &str) -> Option<String> {
    if found == asked {
        return None;
    }
    let (mut before, mut now) = (found.lines(), asked.lines());
    loop {
        match (before.next(), now.next()) {
            (Some(a), Some(b)) if a == b => {}
            (None, None) => return Some("line endings".to_owned()),
            (a, b) => {
                let text = |line: Option<&str>| line.unwrap_or("nothing").to_owned();
                return Some(format!("then \"{}\", now \"{}\"", text(a), text(b)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{File, FileTimes};
    use std::time::{Duration, SystemTime};

    use super::*;

    #[test]
    fn changed_files_are_named_and_touched_ones_are_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let files = ["a b.png", "c.png"].map(|name| folder.path().join(name));
        for path in &files {
            std::fs::write(path, "one").unwrap();
        }
        let description = RunDescription {
            text: "every 2\n".to_owned(),
            files: files.to_vec(),
        };
        let written = description.written();
        assert_eq!(RunDescription::text_of(&written), "every 2\n");
        assert_eq!(description.difference(&written), None);

        let later = SystemTime::now() + Duration::from_secs(100);
        let touch = |path: &Path| {
            let file = File::options().write(true).open(path).unwrap();
            file.set_times(FileTimes::new().set_modified(later))
                .unwrap();
        };
        touch(&files[1]);
        assert_eq!(description.difference(&written), None);
        std::fs::write(&files[1], "two").unwrap();
        touch(&files[1]);
        let difference = description.difference(&written).unwrap();
        assert!(difference.ends_with("c.png has changed"), "{difference}");
        std::fs::remove_file(&files[0]).unwrap();
        let difference = description.difference(&written).unwrap();
        assert!(difference.ends_with("a b.png is missing"), "{difference}");
    }
}
