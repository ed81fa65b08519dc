//! The registry of kinds: how the words of a page are read. One room for each kind that has a layout.
//!
//! - [`mh`]: quadtree of leaf, inner and empty nodes with absolute values (Scandolo et al. 2016, section 3.2);
//! - [`vector`]: quadtree whose nodes refer to planes, silhouette lines and small pictures in a palette.
//!
//! Pages of the other kinds have a place in the registry and travel through container, index and frame; a reader of
//! this version hands out their bytes and answers no query.

pub mod mh;
pub mod vector;

use crate::error::{FormatError, Rule, Value};
use crate::page::{FrameHead, PageContext};

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

    /// Whether the root group's types fit the 8-bit mask of the frame: kinds of 4 children.
    pub const fn has_frame_mask(self) -> bool {
        matches!(self, Kind::Mh | Kind::Mmh | Kind::Vector)
    }
}

/// What a page holds, counted by the check of its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageCounts {
    /// Leaf nodes.
    pub leaves: u32,
    /// Inner nodes.
    pub inner: u32,
    /// Empty nodes.
    pub empty: u32,
    /// Smallest value; `u32::MAX` where there is none. In `vector` the smallest of the bounds of entries.
    pub min: u32,
    /// Largest value, alike; 0 where there is none.
    pub max: u32,
    /// Finest level of a node.
    pub level_finest: u8,
}

impl PageCounts {
    /// Adds a node of a type.
    #[inline]
    pub(crate) const fn add(&mut self, kind: mh::NodeType) {
        match kind {
            mh::NodeType::None => {}
            mh::NodeType::Leaf => self.leaves += 1,
            mh::NodeType::Inner => self.inner += 1,
            mh::NodeType::Empty => self.empty += 1,
        }
    }

    /// Holds level and values against the page's record.
    fn check_values(&self, cx: &PageContext<'_>, rule: Rule) -> Result<(), FormatError> {
        let (min, max) = (cx.page.min_depth.get(), cx.page.max_depth.get());
        let valued = self.leaves + self.inner != 0;
        if valued && (self.min < min || self.max > max) {
            let out = if self.min < min { self.min } else { self.max };
            return Err(cx.fault(rule, 0, Value::Between(min.into(), max.into()), Value::Number(out.into())));
        }
        Ok(())
    }
}

/// What the quadtree kinds ask of a page before they look at its nodes: form, root group, footprint, in this order;
/// `rules` are those of the kind.
fn check_place(head: &FrameHead, cx: &PageContext<'_>, rules: [Rule; 3]) -> Result<(), FormatError> {
    let [plain, root, footprint] = rules;
    if cx.page.is_flat() || cx.page.is_shared() || cx.page.dep_count.get() != 0 {
        let found = Value::Text("a flat or shared page, or dependencies");
        return Err(cx.fault(plain, 0, Value::Text("a page of the tree"), found));
    }
    let found = Value::Hex(head.root_mask.into());
    if cx.is_root() {
        let full = head.root_mask == mh::NodeType::Leaf as u8 || head.root_mask == mh::NodeType::Inner as u8;
        if !full || head.root_level != cx.record.log2_resolution {
            return Err(cx.fault(root, 0, Value::Text("one leaf or inner node of the whole map"), found));
        }
    } else if head.root_mask == 0 || head.root_level >= cx.record.log2_resolution {
        return Err(cx.fault(root, 0, Value::Text("a group of nodes below the root"), found));
    }
    // A root group spans twice its nodes' side; the root node is the whole map.
    let side = if cx.is_root() { head.root_level } else { head.root_level.saturating_add(1) };
    if (cx.page.log2_x, cx.page.log2_y, cx.page.log2_l, cx.page.origin_l.get()) != (side, side, 0, 0) {
        let (expected, found) = (Value::Number(side.into()), Value::Number(cx.page.log2_x.into()));
        return Err(cx.fault(footprint, 1, expected, found));
    }
    Ok(())
}

/// Holds a child page against what its parent says: level, first texel, root; then its depths against the parent's, and
/// against the bounds of what it inherits, where a lookup may answer that. `rules` are the kind's for both.
fn check_announced(
    pairs: &[(u64, u64)],
    depths: (u32, u32),
    inherited: Option<(u32, u32)>,
    cx: &PageContext<'_>,
    rules: [Rule; 2],
) -> Result<(), FormatError> {
    let [link, within] = rules;
    if let Some((expected, found)) = pairs.iter().find(|(expected, found)| expected != found) {
        return Err(cx.fault(link, 0, Value::Number(*expected), Value::Number(*found)));
    }
    let (min, max) = (cx.page.min_depth.get(), cx.page.max_depth.get());
    let (lowest, highest) = depths;
    if min < lowest || max > highest {
        let (expected, out) = (Value::Between(lowest.into(), highest.into()), if min < lowest { min } else { max });
        return Err(cx.fault(within, 0, expected, Value::Number(out.into())));
    }
    match inherited.filter(|(low, high)| *low < min || *high > max) {
        None => Ok(()),
        Some((low, high)) => {
            let out = if low < min { low } else { high };
            Err(cx.fault(within, 0, Value::Between(min.into(), max.into()), Value::Number(out.into())))
        }
    }
}
