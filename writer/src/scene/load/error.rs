//! Why a scene file was refused.

use std::path::PathBuf;

use super::text;

/// A scene file that was refused: one line that says which file, where, expected, found, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}: {fault}", text::line(&path.to_string_lossy()))]
pub struct LoadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with a scene file. `at` says where: a line, an element, an accessor.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// There is no such file.
    #[error("expected a scene file, found nothing there; check the path")]
    Missing,
    /// It is a directory.
    #[error("expected a scene file, found a directory; name a file in it")]
    Directory,
    /// It is a pipe, a device or the like.
    #[error("expected a regular file, found a pipe or device; save the scene to a file first")]
    NotAFile,
    /// The system can't read it.
    #[error("expected a readable file, found an error of the system ({reason}); check permissions and the disk")]
    Unreadable {
        /// The system's words.
        reason: String,
    },
    /// It has no bytes.
    #[error("expected a scene, found an empty file; export or fetch it again")]
    Empty,
    /// Neither extension nor content is of a known format.
    #[error(
        "expected OBJ, PLY or glTF (.obj, .ply, .gltf, .glb), found extension `{}` and content that starts with {found}; \
         convert the scene to one of these",
        text::line(extension)
    )]
    UnknownFormat {
        /// The extension, in lower case.
        extension: String,
        /// The first bytes.
        found: String,
    },
    /// It ends too early.
    #[error("{at}: expected {expected}, found {found}; the file is cut short, export or fetch it again")]
    Truncated {
        /// Where.
        at: String,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// It isn't written as its format demands.
    #[error("{at}: expected {expected}, found {found}; repair the file or export it again")]
    Syntax {
        /// Where.
        at: String,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A coordinate is infinite or not a number.
    #[error("{at}: expected finite numbers, found {found}; repair the mesh")]
    NotFinite {
        /// Where.
        at: String,
        /// What is there.
        found: String,
    },
    /// An index points at nothing.
    #[error("{at}: expected an index into {count} {what}, found {found}; repair the file or export it again")]
    Index {
        /// Where.
        at: String,
        /// What the index is of.
        what: &'static str,
        /// How many of them there are.
        count: usize,
        /// The index as it is written.
        found: String,
    },
    /// More than is allowed, or than memory holds.
    #[error("{at}: expected at most {most}, found {found}; split or simplify the scene")]
    TooLarge {
        /// Where.
        at: String,
        /// The limit.
        most: String,
        /// What is there.
        found: String,
    },
    /// What its alpha masks are cut into does not fit the budget.
    #[error(
        "memory budget of {} MiB: {at}: the scene with what its alpha masks are cut into needs {} MiB by then; \
         simplify their textures, or give at least --memory {}",
        budget >> 20,
        needed.div_ceil(1 << 20),
        needed.div_ceil(1 << 20) + 1
    )]
    Memory {
        /// Where.
        at: String,
        /// What was given, bytes.
        budget: u64,
        /// What was about to be held, bytes.
        needed: u64,
    },
    /// The caller did not want to go on.
    #[error("interrupted; nothing was loaded")]
    Stopped,
    /// Right by its format, but not known here.
    #[error("{at}: expected {expected}, found {found}, which is not supported; export the scene without it")]
    Unsupported {
        /// Where.
        at: String,
        /// What is supported.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Nothing casts a shadow.
    #[error("expected triangles, found none ({vertices} vertices); give a scene that has surfaces")]
    NoTriangles {
        /// How many vertices there are.
        vertices: usize,
    },
    /// A file that this one refers to has a fault.
    #[error("{at}: `{}`: {fault}", text::line(file))]
    External {
        /// What refers to it.
        at: String,
        /// The file.
        file: String,
        /// What is wrong with it.
        fault: Box<Fault>,
    },
}

impl Fault {
    pub(super) fn syntax(at: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Fault {
        Fault::Syntax { at: at.into(), expected: expected.into(), found: found.into() }
    }
}
