//! Rules of the format and the error that names the one that was broken.
//!
//! A [`Rule`] has an id that stays the same from version to version (`page.crc`), a sentence that states it and an
//! advice. A [`FormatError`] adds the place, the byte, what was expected and what was found. [`Rule::ALL`] is the
//! list that the spec prints and that the samples of broken files are held against.

use core::fmt;

macro_rules! rules {
    ($($name:ident $id:literal $meaning:literal $advice:ident;)*) => {
        /// A rule that a file can break.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum Rule {
            $( #[doc = $meaning] $name, )*
        }

        impl Rule {
            /// Every rule, in the order in which a reader meets them.
            pub const ALL: &'static [Rule] = &[ $( Rule::$name, )* ];

            /// Stable id: `room.rule`.
            pub const fn id(self) -> &'static str {
                match self { $( Rule::$name => $id, )* }
            }

            /// The rule in one sentence.
            pub const fn meaning(self) -> &'static str {
                match self { $( Rule::$name => $meaning, )* }
            }

            /// What to do about a file that breaks it.
            pub const fn advice(self) -> &'static str {
                match self { $( Rule::$name => $advice, )* }
            }
        }
    };
}

const DAMAGED: &str = "the bytes are damaged: fetch or bake the file again";
const WRITER: &str = "the file was not written by the rules: tell the maker of the tool that wrote it";
const NEWER: &str = "the file was made for a newer version: update this program";
const OTHER: &str = "check that this is a .umb file, copied in binary mode";
const SHORT: &str = "the file was cut or is still being written: fetch it again";
const LIMIT: &str = "raise the limit if you trust the file";

rules! {
    HeaderMagic "header.magic" "a file starts with the magic bytes" OTHER;
    HeaderTruncated "header.truncated" "a file holds at least a whole header and section table" SHORT;
    HeaderVersion "header.version" "the major version is one that the reader knows" NEWER;
    HeaderSize "header.size" "the header has 128 bytes" WRITER;
    HeaderLength "header.length" "the file is as long as its header says" SHORT;
    HeaderFeature "header.feature" "required features are known to the reader" NEWER;
    HeaderAlignment "header.alignment" "the alignment exponent is in its range" WRITER;
    HeaderReserved "header.reserved" "reserved bytes of the header are zero" WRITER;
    HeaderCrc "header.crc" "header and section table match their CRC" DAMAGED;
    SectionReserved "section.reserved" "reserved bytes of a section record are zero" WRITER;
    SectionFlags "section.flags" "only known flags are set" WRITER;
    SectionUnknown "section.unknown" "required sections are of a type that the reader knows" NEWER;
    SectionOrder "section.order" "the structures section comes first, and once" WRITER;
    SectionStructure "section.structure" "sections of structures come in the structures' order, one each" WRITER;
    SectionCrcField "section.crc-field" "sections whose contents have CRCs have none of their own" WRITER;
    SectionOffset "section.offset" "a section starts at the next aligned byte behind the one before" WRITER;
    SectionLength "section.length" "a section lies inside the file and has the length of its contents" WRITER;
    SectionTrailing "section.trailing" "the file ends where the last section ends" WRITER;
    SectionMissing "section.missing" "each structure has an index and pages" WRITER;
    SectionPadding "section.padding" "bytes between sections are zero" WRITER;
    SectionCrc "section.crc" "a model of cold pages, or an unknown section, matches its CRC" DAMAGED;
    ColdModel "cold.model" "a model has a table of each of its kind's, whole, and fills its section" WRITER;
    StructureCrc "structure.crc" "a structure record matches its CRC" DAMAGED;
    StructureName "structure.name" "a structure has a name: UTF-8, not empty, padded with zero bytes" WRITER;
    StructureUnique "structure.unique" "names of structures differ" WRITER;
    StructureKind "structure.kind" "the kind is in the registry" NEWER;
    StructureProjection "structure.projection" "the projection is known" NEWER;
    StructurePolicy "structure.policy" "the policy is known" NEWER;
    StructureGuarantee "structure.guarantee" "the guarantee is known" NEWER;
    StructurePromise "structure.promise" "the guarantee is that of the policy" WRITER;
    StructureRoots "structure.roots" "the number of roots is in its range" WRITER;
    StructurePages "structure.pages" "there are at least as many pages as roots and shared pages" WRITER;
    StructureBlock "structure.block" "the index blocks have an allowed size and hold their records" WRITER;
    StructureResolution "structure.resolution" "resolution and sub-texel bits are in their range" WRITER;
    StructureNumber "structure.number" "real numbers are finite" WRITER;
    StructureTransform "structure.transform" "the world-to-lattice map can be inverted" WRITER;
    StructureLight "structure.light" "the light's direction has length 1" WRITER;
    StructureGuard "structure.guard" "the transform's error is not negative, and the guard not below it" WRITER;
    StructureParameter "structure.parameter" "the policy's parameter is above 0, or 0 where the policy has none" WRITER;
    StructureReserved "structure.reserved" "reserved bytes of a structure record are zero" WRITER;
    StructureRoot "structure.root" "the copy of the root page's record equals record 0 of the index" WRITER;
    IndexLength "index.length" "an index section is its blocks, whole" WRITER;
    IndexCrc "index.crc" "an index block matches its CRC" DAMAGED;
    IndexReserved "index.reserved" "reserved bytes of a block are zero" WRITER;
    IndexHead "index.head" "a block's header agrees with its place and contents" WRITER;
    IndexUnused "index.unused" "unused bytes of a block are zero" WRITER;
    IndexPageType "index.page-type" "the page type is known, and only the pages behind the tree are shared" WRITER;
    IndexWords "index.words" "a page has 2 to 16384 words" WRITER;
    IndexOffset "index.offset" "pages lie in their section, aligned, one behind the other" WRITER;
    IndexChildren "index.children" "children are consecutive ordinals in level order" WRITER;
    IndexRoot "index.root" "a page belongs to a root of the structure; the first pages are the roots'" WRITER;
    IndexFootprint "index.footprint" "a footprint is a power of two, aligned to its size, inside the map" WRITER;
    IndexLevels "index.levels" "the level band lies within the levels of the map" WRITER;
    IndexDepths "index.depths" "the smallest depth is not above the largest" WRITER;
    IndexDependency "index.dependency" "dependencies are shared pages of higher ordinal, listed in page order" WRITER;
    IndexShared "index.shared" "shared pages have neither footprint nor depths nor a stop error" WRITER;
    PagePadding "page.padding" "bytes between pages are zero" WRITER;
    PageCrc "page.crc" "a page matches its CRC" DAMAGED;
    PageHash "page.hash" "a page matches its content hash" WRITER;
    PageTag "page.tag" "a page's tag is that of its structure's kind or flat" WRITER;
    PageLength "page.length" "a page is as long as its record says" WRITER;
    PageChildren "page.children" "a page refers to as many child pages as its record has" WRITER;
    PageLevel "page.level" "the root group's level is the record's coarsest level, 0 on flat pages" WRITER;
    PageFlags "page.flags" "unused bits of the frame are zero" WRITER;
    PageCold "page.cold" "a cold page decodes by its structure's model to the words that its record says" WRITER;
    MhPlain "mh.plain" "pages of the kind are trees, not shared, without dependencies" WRITER;
    MhRoot "mh.root" "a root page holds one full node of the whole map, another page a group below it" WRITER;
    MhFootprint "mh.footprint" "the footprint is the square of the root group, of one light" WRITER;
    MhBounds "mh.bounds" "nodes lie inside their page" WRITER;
    MhOverlap "mh.overlap" "no word belongs to two nodes" WRITER;
    MhPlace "mh.place" "the place of the children is 0 or 1" WRITER;
    MhChildless "mh.childless" "inner and empty nodes have children" WRITER;
    MhDepth "mh.depth" "nodes at level 0 are leaves" WRITER;
    MhOrder "mh.order" "children lie behind their node" WRITER;
    MhReference "mh.reference" "each child page is referred to exactly once" WRITER;
    MhHole "mh.hole" "every word of a page belongs to a node" WRITER;
    MhLevels "mh.levels" "the record's finest level is that of the finest node" WRITER;
    MhValues "mh.values" "values lie between the record's smallest and largest depth" WRITER;
    MhLink "mh.link" "a child page's root group is the one that its parent's node describes" WRITER;
    MhDepths "mh.depths" "a page's depths lie within its parent's and hold the value that it inherits" WRITER;
    MmhPlain "mmh.plain" "pages of the kind are trees with at most 254 dependencies, shared ones with none, and both fit 16384 words" WRITER;
    MmhRoot "mmh.root" "a root page holds one full node of the whole map, another page a group below it, a shared page none" WRITER;
    MmhFootprint "mmh.footprint" "the footprint is the square of the root group, of one light" WRITER;
    MmhEntries "mmh.entries" "a shared page lists the types of groups that no node before them refers to, and no others" WRITER;
    MmhHole "mmh.hole" "every word of a page belongs to a group that a node or an entry announces" WRITER;
    MmhBounds "mmh.bounds" "groups lie inside their page" WRITER;
    MmhChildless "mmh.childless" "inner and empty nodes have children" WRITER;
    MmhDepth "mmh.depth" "nodes at level 0 are leaves" WRITER;
    MmhOrder "mmh.order" "children lie behind their node" WRITER;
    MmhOverlap "mmh.overlap" "groups do not overlap, and all nodes give one group the same types" WRITER;
    MmhReference "mmh.reference" "each child page is referred to exactly once, from a group with one place in the map" WRITER;
    MmhDependency "mmh.dependency" "nodes refer to dependencies of their page, and to each of them" WRITER;
    MmhLevels "mmh.levels" "the record's finest level is that of the finest node" WRITER;
    MmhValues "mmh.values" "values lie between the record's smallest and largest depth, on every way to their node" WRITER;
    MmhLink "mmh.link" "child pages and groups in shared pages are those that the nodes describe which refer to them" WRITER;
    MmhDepths "mmh.depths" "a page's depths lie within its parent's and hold the value that it inherits" WRITER;
    VectorPlain "vector.plain" "pages of the kind are trees, not shared, without dependencies" WRITER;
    VectorRoot "vector.root" "a root page holds one full node of the whole map, another page a group below it" WRITER;
    VectorFootprint "vector.footprint" "the footprint is the square of the root group, of one light" WRITER;
    VectorHeader "vector.header" "the counts of a page agree with its contents" WRITER;
    VectorLength "vector.length" "the sections of a page fill it to its end" WRITER;
    VectorRanks "vector.ranks" "each block of the topology has the counts of nodes before it" WRITER;
    VectorOrder "vector.order" "groups are those of the nodes with children, in level order" WRITER;
    VectorStubs "vector.stubs" "groups without nodes are the child pages, listed in order" WRITER;
    VectorDepth "vector.depth" "nodes at level 0 have no children" WRITER;
    VectorPadding "vector.padding" "unused bits of a section are zero" WRITER;
    VectorLevels "vector.levels" "the record's finest level is that of the finest group" WRITER;
    VectorLine "vector.line" "unused bits of a line are zero, and lines are short where all of the page may be" WRITER;
    VectorPlane "vector.plane" "a plane is fine only where its slopes need it" WRITER;
    VectorSplit "vector.split" "splits refer to a line and to entries before them, at most 4 deep" WRITER;
    VectorMask "vector.mask" "masks choose among constants and planes" WRITER;
    VectorRaw "vector.raw" "raws lie one behind the other in the heap, their values in 32 bits" WRITER;
    VectorIndex "vector.index" "indexes are numbers of the palette" WRITER;
    VectorValues "vector.values" "bounds of entries lie between the record's smallest and largest depth" WRITER;
    VectorLink "vector.link" "a child page's root group is the one that its parent's node describes" WRITER;
    VectorDepths "vector.depths" "a page's depths lie within its parent's and hold the entry that it inherits" WRITER;
    StructureNodes "structure.nodes" "the structure's counts of nodes are those of its pages" WRITER;
    LimitSections "limit.sections" "the file has no more sections than the caller allows" LIMIT;
    LimitStructures "limit.structures" "the file has no more structures than the caller allows" LIMIT;
    LimitPages "limit.pages" "a structure has no more pages than the caller allows" LIMIT;
    LimitPageBytes "limit.page-bytes" "a page is no longer than the caller allows" LIMIT;
    LimitAllocation "limit.allocation" "a request needs no more memory than the caller allows" LIMIT;
}

/// Part of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The header.
    Header,
    /// The table of sections.
    SectionTable,
    /// A section by its place in the table.
    Section(u32),
    /// The record of a structure by number.
    Structure(u32),
    /// The index of a structure.
    Index(u32),
    /// A page.
    Page {
        /// Number of the structure.
        structure: u32,
        /// Ordinal of the page.
        ordinal: u32,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Header => f.write_str("header"),
            Place::SectionTable => f.write_str("section table"),
            Place::Section(i) => write!(f, "section {i}"),
            Place::Structure(i) => write!(f, "structure {i}"),
            Place::Index(i) => write!(f, "index of structure {i}"),
            Place::Page { structure, ordinal } => write!(f, "page {ordinal} of structure {structure}"),
        }
    }
}

/// What was expected or found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number.
    Number(u64),
    /// A number that is read best in base 16.
    Hex(u64),
    /// At least this.
    AtLeast(u64),
    /// At most this.
    AtMost(u64),
    /// From the first to the second, both included.
    Between(u64, u64),
    /// In words.
    Text(&'static str),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Number(v) => write!(f, "{v}"),
            Value::Hex(v) => write!(f, "{v:#X}"),
            Value::AtLeast(v) => write!(f, "at least {v}"),
            Value::AtMost(v) => write!(f, "at most {v}"),
            Value::Between(lo, hi) => write!(f, "{lo} to {hi}"),
            Value::Text(t) => f.write_str(t),
        }
    }
}

/// A broken rule: which, where, what was expected, what was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {} ({place}, byte {offset}: expected {expected}, found {found}); {}", rule.id(), rule.meaning(), rule.advice())]
pub struct FormatError {
    /// The rule.
    pub rule: Rule,
    /// The part of the file.
    pub place: Place,
    /// Byte of the file, or of the records handed in where a caller checks them alone.
    pub offset: u64,
    /// What the rule asks for.
    pub expected: Value,
    /// What is there.
    pub found: Value,
}

impl FormatError {
    /// An error of all its parts.
    pub const fn new(rule: Rule, place: Place, offset: u64, expected: Value, found: Value) -> Self {
        Self { rule, place, offset, expected, found }
    }

    /// Compares two CRCs: `computed` from the bytes, `stored` in the file at `offset`.
    ///
    /// # Errors
    /// `rule` where they differ.
    pub fn crc(rule: Rule, place: Place, offset: u64, computed: u32, stored: u32) -> Result<(), FormatError> {
        if computed == stored {
            return Ok(());
        }
        Err(Self::new(rule, place, offset, Value::Hex(computed.into()), Value::Hex(stored.into())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_differ_and_name_a_room() {
        for (i, rule) in Rule::ALL.iter().enumerate() {
            assert!(rule.id().split_once('.').is_some());
            assert!(Rule::ALL.iter().skip(i + 1).all(|r| r.id() != rule.id()), "{}", rule.id());
        }
    }

    #[test]
    fn an_error_reads_as_a_sentence() {
        let e = FormatError::crc(Rule::PageCrc, Place::Page { structure: 1, ordinal: 2 }, 4096, 1, 2).unwrap_err();
        assert_eq!(
            std::string::ToString::to_string(&e),
            "page.crc: a page matches its CRC (page 2 of structure 1, byte 4096: expected 0x1, found 0x2); \
             the bytes are damaged: fetch or bake the file again"
        );
    }
}
