//! Why a configuration file is refused.

use std::path::PathBuf;

/// Why a configuration file is refused. Lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum ConfigurationError {
    /// The file cannot be read.
    #[error("cannot read the configuration {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{}, line {line}: not TOML: {problem}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// The error of the parser.
        problem: String,
    },
    /// There is no such key.
    #[error("{}, line {line}: unknown key `{key}`; {remedy}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// Table and key.
        key: String,
        /// The key that was probably meant.
        nearest: Option<&'static str>,
        /// What to write instead.
        remedy: String,
    },
    /// The value has the wrong type or is out of range.
    #[error("{}, line {line}: {key} = {value}: {expected} is needed", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The line.
        line: usize,
        /// Table and key.
        key: String,
        /// The refused value.
        value: String,
        /// The accepted values.
        expected: &'static str,
    },
}
