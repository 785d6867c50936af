//! The files that a command is told to write: none is an input, a folder, or another of them.

use std::path::{Path, PathBuf};

use linecarve_sequence::Sequence;

/// An option that names a file to write, and the file.
pub(crate) type OutputFile<'a> = (&'static str, &'a Path);

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OutputFileError {
    /// The file is read.
    #[error("{option} {} would overwrite the input {}: give another name", file.display(), input.display())]
    Input {
        /// The option.
        option: &'static str,
        /// What it names.
        file: PathBuf,
        /// What is read.
        input: PathBuf,
    },
    /// Two options name the same file.
    #[error("{option} {} would overwrite the file of {other}: give each a name of its own", file.display())]
    Twice {
        /// The option.
        option: &'static str,
        /// What it names.
        file: PathBuf,
        /// The other option.
        other: &'static str,
    },
    /// The name is that of a folder.
    #[error("{option} {} is a folder: give the name of a file", file.display())]
    Folder {
        /// The option.
        option: &'static str,
        /// What it names.
        file: PathBuf,
    },
    /// The folder of the file does not exist.
    #[error("{option} {}: the folder {} does not exist: make it, or give another name", file.display(), folder.display())]
    NoFolder {
        /// The option.
        option: &'static str,
        /// What it names.
        file: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// The name has another ending.
    #[error("{option} {}: give a name that ends with .{ending}", file.display())]
    Ending {
        /// The option.
        option: &'static str,
        /// What it names.
        file: PathBuf,
        /// The ending.
        ending: &'static str,
    },
}

/// Checks what a command is told to write, before any work. An older file of the same name may be replaced, unless it is an input.
///
/// # Errors
/// When a file is one of the inputs, a folder, in a folder that does not exist, or also the file of another option.
pub(crate) fn check_outputs(
    outputs: &[OutputFile<'_>],
    inputs: &[&Path],
) -> Result<(), OutputFileError> {
    for (index, &(option, file)) in outputs.iter().enumerate() {
        if file.is_dir() {
            let file = file.to_owned();
            return Err(OutputFileError::Folder { option, file });
        }
        let Some(real) = real_path(file) else {
            return Err(OutputFileError::NoFolder {
                option,
                file: file.to_owned(),
                folder: folder_of(file).to_owned(),
            });
        };
        let is_this = |other: &Path| real_path(other).is_some_and(|other| other == real);
        if let Some(input) = inputs.iter().find(|input| is_this(input)) {
            return Err(OutputFileError::Input {
                option,
                file: file.to_owned(),
                input: (*input).to_owned(),
            });
        }
        let mut before = outputs[..index].iter();
        if let Some(&(other, _)) = before.find(|(_, other)| is_this(other)) {
            return Err(OutputFileError::Twice {
                option,
                file: file.to_owned(),
                other,
            });
        }
    }
    Ok(())
}

/// Refuses to overwrite a file that a sequence is read from.
///
/// # Errors
/// When the file is one of the sequence's.
pub(crate) fn keep_sequence(
    (option, file): OutputFile<'_>,
    sequence: &Sequence,
) -> Result<(), OutputFileError> {
    match sequence.reads(file) {
        true => Err(OutputFileError::Input {
            option,
            file: file.to_owned(),
            input: sequence.folder().to_owned(),
        }),
        false => Ok(()),
    }
}

/// Demands that a name has the ending of what is written.
///
/// # Errors
/// When it has another.
pub(crate) fn check_ending(
    (option, file): OutputFile<'_>,
    ending: &'static str,
) -> Result<(), OutputFileError> {
    let found = file.extension().and_then(|found| found.to_str());
    match found.is_some_and(|found| found.eq_ignore_ascii_case(ending)) {
        true => Ok(()),
        false => Err(OutputFileError::Ending {
            option,
            file: file.to_owned(),
            ending,
        }),
    }
}

/// The folder of a file.
pub(crate) fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Where a file is, or would be: links are followed. `None` without its folder.
fn real_path(file: &Path) -> Option<PathBuf> {
    let there = file.canonicalize().ok();
    there.or_else(|| Some(folder_of(file).canonicalize().ok()?.join(file.file_name()?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(outputs: &[OutputFile<'_>], inputs: &[&Path]) -> String {
        let refused = check_outputs(outputs, inputs);
        refused.err().map_or_else(String::new, |it| it.to_string())
    }

    #[test]
    fn outputs_are_apart_from_inputs_and_from_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let [input, same, old, new] = ["a.ply", "./a.ply", "old.ply", "new.ply"].map(at);
        std::fs::write(&input, "mine").unwrap();
        std::fs::write(&old, "a result").unwrap();
        // An older result may be replaced.
        assert_eq!(
            refused(&[("--out", &old), ("--heat-map", &new)], &[&input]),
            ""
        );
        let text = refused(&[("--out", &same)], &[&old, &input]);
        assert!(
            text.contains("--out") && text.contains("the input"),
            "{text}"
        );
        let text = refused(&[("--out", &new), ("--junit", &new)], &[]);
        assert!(text.contains("--junit") && text.contains("--out"), "{text}");
        assert!(refused(&[("--out", folder.path())], &[]).contains("is a folder"));
        let nowhere = at("missing/a.ply");
        assert!(refused(&[("--out", &nowhere)], &[]).contains("missing does not exist"));
        assert!(check_ending(("--out", &new), "glb").is_err());
        assert!(check_ending(("--out", Path::new("a.GLB")), "glb").is_ok());
    }

    #[test]
    #[cfg(unix)]
    fn links_to_an_input_are_that_input() {
        let folder = tempfile::tempdir().unwrap();
        let [input, link] = ["a.ply", "b.ply"].map(|name| folder.path().join(name));
        std::fs::write(&input, "mine").unwrap();
        std::os::unix::fs::symlink(&input, &link).unwrap();
        assert!(refused(&[("--out", &link)], &[&input]).contains("the input"));
    }
}
