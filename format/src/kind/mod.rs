//! The registry of kinds: how the words of a page are read. One room for each kind that has a layout.
//!
//! - [`mh`]: quadtree of leaf, inner and empty nodes with absolute values (Scandolo et al. 2016, section 3.2);
//! - [`mmh`]: the same with values as differences and subtrees that are stored once (Scandolo 2019, section 2.6);
//! - [`vector`]: quadtree whose nodes refer to planes, silhouette lines and small pictures in a palette;
//! - [`tree`]: what these have in common: the checks of any page whose kind has a layout.
//!
//! Pages of the other kinds have a place in the registry and travel through container, index and frame; a reader of
//! this version hands out their bytes and answers no query.

pub mod mh;
pub mod mmh;
pub mod tree;
pub mod vector;

/// How a structure is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Kind {
    /// Multiresolution hierarchy: quadtree with absolute values.
    Mh = 1,
    /// Merged multiresolution hierarchy: subtrees shared, values as differences.
    Mmh = 2,
    /// Leaves that hold planes and silhouette lines.
    Vector = 3,
    /// Octree over texels and lights.
    MhStack = 4,
    /// Octree over texels and lights, subtrees shared.
    MmhStack = 5,
    /// Tree over texels and lights that chooses its split axis.
    Stack = 6,
    /// List of quads of an aperture.
    Quads = 7,
}

impl Kind {
    /// All kinds by rising code.
    pub const ALL: [Kind; 7] =
        [Kind::Mh, Kind::Mmh, Kind::Vector, Kind::MhStack, Kind::MmhStack, Kind::Stack, Kind::Quads];

    /// The code in [`crate::StructureRecord::kind`].
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// The kind of a code, `None` where the registry has none.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.code() == code)
    }

    /// Name as `dump` and the command line have it.
    pub const fn name(self) -> &'static str {
        match self {
            Kind::Mh => "mh",
            Kind::Mmh => "mmh",
            Kind::Vector => "vector",
            Kind::MhStack => "mh-stack",
            Kind::MmhStack => "mmh-stack",
            Kind::Stack => "stack",
            Kind::Quads => "quads",
        }
    }

    /// Tag in word 0 of the kind's tree pages: the low 8 bits of its code.
    pub const fn tag(self) -> u8 {
        self.code().to_le_bytes()[0]
    }

    /// Whether the kind has a layout, so that its pages can be checked and queried.
    pub const fn has_layout(self) -> bool {
        matches!(self, Kind::Mh | Kind::Mmh | Kind::Vector)
    }

    /// Whether the root group's types fit the 8-bit mask of the frame: kinds of 4 children.
    pub const fn has_frame_mask(self) -> bool {
        matches!(self, Kind::Mh | Kind::Mmh | Kind::Vector)
    }
}
