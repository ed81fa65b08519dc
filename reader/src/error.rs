//! What can go wrong while a container is read.

use std::io;
use std::sync::Arc;

use umbrage_format::{FormatError, Kind, Rule};

/// Why a file, structure, page or query failed. `file` is the name that the source has.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum ReaderError {
    /// The system could not open or read the source.
    #[error("{file}: could not {action}: {source}")]
    Io {
        /// Name of the source.
        file: Arc<str>,
        /// What was tried.
        action: &'static str,
        /// What the system said; shared, so that the error can be kept.
        source: Arc<io::Error>,
    },
    /// The file breaks a rule of the format, or a limit of the caller.
    #[error("{file}: {error}")]
    Format {
        /// Name of the source.
        file: Arc<str>,
        /// The rule, the place and what to do.
        error: FormatError,
    },
    /// No structure has this name.
    #[error("{file}: no structure is named '{name}'; it has {}", names.join(", "))]
    UnknownStructure {
        /// Name of the source.
        file: Arc<str>,
        /// The name asked for.
        name: String,
        /// The names there are.
        names: Vec<String>,
    },
    /// No structure or page has this number.
    #[error("{file}: there is no {what} {number}; there are {count}, counted from 0")]
    OutOfRange {
        /// Name of the source.
        file: Arc<str>,
        /// `structure`, `page of structure s` or `root of structure s`.
        what: String,
        /// The number asked for.
        number: u32,
        /// How many there are.
        count: u32,
    },
    /// The kind has no query in this version.
    #[error("{file}: kind {} (structure '{structure}') is not supported by this version; its pages can be read as bytes", kind.name())]
    UnsupportedKind {
        /// Name of the source.
        file: Arc<str>,
        /// Name of the structure.
        structure: String,
        /// Its kind.
        kind: Kind,
    },
    /// The caller asked to stop.
    #[error("{file}: stopped")]
    Stopped {
        /// Name of the source.
        file: Arc<str>,
    },
}

impl ReaderError {
    /// A broken rule of `file`.
    pub(crate) fn format(file: &Arc<str>) -> impl Fn(FormatError) -> Self + use<> {
        let file = file.clone();
        move |error| Self::Format { file: file.clone(), error }
    }

    /// A failure of the system.
    pub(crate) fn io(file: &Arc<str>, action: &'static str, source: io::Error) -> Self {
        Self::Io { file: file.clone(), action, source: Arc::new(source) }
    }

    /// The broken rule, where one was.
    pub fn rule(&self) -> Option<Rule> {
        match self {
            Self::Format { error, .. } => Some(error.rule),
            _ => None,
        }
    }
}
