//! Files that break one rule each: a golden file, the bytes that change, and which checksums are made good behind them.

use umbrage::format::checksum::{FileId, block_crc, content_hash, page_crc};
use umbrage::format::cold;
use umbrage::format::kind::vector::Layout;
use umbrage::format::record::{Field, RECORDS};
use umbrage::format::{Header, Kind, SectionRecord};
use umbrage::reader::Limits;

use super::named;
use At::{Block, Cold, Contents, Gap, Page, Part, Record, Root, Section, Structure};
use Seal::{All, Head, Index, Nothing, Records};

/// What of a file changes.
#[derive(Clone, Copy)]
pub enum At {
    /// A field of the header.
    Header(&'static str),
    /// A field of a section record.
    Section(usize, &'static str),
    /// A field of a structure record.
    Structure(usize, &'static str),
    /// A field of the copy of the root page's record.
    Root(&'static str),
    /// A field of the header of a structure's first index block.
    Block(usize, &'static str),
    /// A field of a page record: structure, ordinal.
    Record(usize, usize, &'static str),
    /// A byte of the first index block that nothing uses.
    Unused,
    /// A byte of a page of structure 0: ordinal, word, byte of the word.
    Page(usize, usize, usize),
    /// A byte of a `vector` page of structure 0: ordinal, part (`header` or a section's name), word of it, byte of the
    /// word.
    Part(usize, &'static str, usize, usize),
    /// The byte before a section, or before a page of structure 0.
    Gap(&'static str, usize),
    /// A byte of a section's contents.
    Contents(usize, usize),
    /// A byte of a cold page of structure 0, as stored.
    Cold(usize, usize),
    /// The whole file.
    File(&'static str),
}

/// Which checksums are made good again; each includes those before it.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub enum Seal {
    Nothing,
    /// Of the header.
    Head,
    /// Of structure records.
    Records,
    /// Of index blocks, and the copies of root page records.
    Index,
    /// Of pages.
    All,
}

/// A file that breaks `rule` and no other.
pub struct Sample {
    pub rule: &'static str,
    /// What the change is, for the table of rules.
    pub at: String,
    pub bytes: Vec<u8>,
    /// `NAME=N` for `--limit`, where the rule is a limit of the caller.
    pub limit: Option<(&'static str, u64)>,
}

impl Sample {
    /// The limits to open it with.
    pub fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        if let Some((name, n)) = self.limit {
            match name {
                "sections" => limits.sections = n as u32,
                "structures" => limits.structures = n as u32,
                "pages" => limits.pages = n as u32,
                "page-bytes" => limits.page_bytes = n as u32,
                "allocation" => limits.allocation = n,
                other => panic!("{other}"),
            }
        }
        limits
    }
}

/// Golden file, place, new bytes, checksums.
type Row = (&'static str, &'static str, At, &'static [u8], Seal);

/// A first row that is the second one, up to its scale: 256 on the other axis becomes 512.
const SINGULAR: [u8; 16] = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x80, 0x40];

/// A byte is replaced, from the first byte of the place on.
#[rustfmt::skip]
const ROWS: &[Row] = &[
    ("header.magic", "example", At::Header("magic"), b"U", Head),
    ("header.version", "example", At::Header("version_major"), &[2], Head),
    ("header.size", "example", At::Header("header_bytes"), &[0], Head),
    ("header.length", "example", At::Header("total_bytes"), &[0], Head),
    ("header.feature", "example", At::Header("required_features"), &[4], Head),
    ("header.alignment", "example", At::Header("alignment_log2"), &[17], Head),
    ("header.alignment", "example", At::Header("alignment_log2"), &[1], Head),
    ("header.reserved", "example", At::Header("reserved0"), &[1], Head),
    ("header.reserved", "example", At::Header("reserved1"), &[1], Head),
    ("header.truncated", "example", At::Header("section_count"), &[0, 0, 0, 1], Head),
    ("header.crc", "example", At::Header("optional_features"), &[1], Nothing),
    ("section.missing", "example", At::Header("structure_count"), &[2], Head),
    ("section.trailing", "example", At::Header("section_count"), &[2], Head),
    ("section.reserved", "example", Section(0, "reserved"), &[1], Head),
    ("section.flags", "example", Section(0, "flags"), &[3], Head),
    ("section.unknown", "example", Section(1, "kind"), &[9], Head),
    ("section.order", "example", Section(1, "kind"), &[1], Head),
    ("section.order", "example", Section(0, "kind"), &[2], Head),
    ("section.structure", "example", Section(0, "structure"), &[0], Head),
    ("section.structure", "example", Section(1, "structure"), &[1], Head),
    ("section.structure", "two", Section(3, "structure"), &[1], Head),
    ("section.crc-field", "example", Section(1, "crc32"), &[1], Head),
    ("section.offset", "example", Section(1, "offset"), &[1], Head),
    ("section.length", "example", Section(2, "length"), &[0, 0, 0, 0x7F], Head),
    ("section.length", "example", Section(2, "length"), &[0], Head),
    ("section.padding", "example", Gap("section", 0), &[1], Nothing),
    ("structure.crc", "example", Structure(0, "name"), b"r", Head),
    ("structure.name", "example", Structure(0, "name"), &[0], Records),
    ("structure.name", "example", Structure(0, "name"), &[0xFF], Records),
    ("structure.name", "example", Structure(0, "name"), b"s\0n", Records),
    ("structure.unique", "two", Structure(1, "name"), b"sun\0\0\0\0", Records),
    ("structure.kind", "example", Structure(0, "kind"), &[0], Records),
    ("structure.projection", "example", Structure(0, "projection"), &[0], Records),
    ("structure.policy", "example", Structure(0, "policy"), &[0], Records),
    ("structure.guarantee", "example", Structure(0, "guarantee"), &[0], Records),
    ("structure.promise", "example", Structure(0, "guarantee"), &[2], Records),
    ("structure.promise", "example", Structure(0, "policy"), &[4], Records),
    ("structure.promise", "example", Structure(0, "policy"), &[6], Records),
    ("structure.roots", "example", Structure(0, "root_count"), &[0], Records),
    ("structure.pages", "example", Structure(0, "page_count"), &[0], Records),
    ("structure.block", "example", Structure(0, "records_per_block"), &[64], Records),
    ("structure.block", "example", Structure(0, "records_per_block"), &[0], Records),
    ("structure.block", "example", Structure(0, "index_block_log2"), &[11], Records),
    ("structure.resolution", "example", Structure(0, "log2_resolution"), &[25], Records),
    ("structure.resolution", "example", Structure(0, "subtexel_bits"), &[47], Records),
    ("structure.number", "example", Structure(0, "light_direction"), &[0, 0, 0, 0, 0, 0, 0xF8, 0x7F], Records),
    ("structure.number", "example", Structure(0, "policy_parameter"), &[0, 0, 0, 0, 0, 0, 0xF0, 0x7F], Records),
    ("structure.transform", "example", Structure(0, "world_to_lattice"), &[0; 8], Records),
    ("structure.transform", "example", Structure(0, "world_to_lattice"), &SINGULAR, Records),
    ("structure.light", "example", Structure(0, "light_direction"), &[0, 0, 0, 0, 0, 0, 0x60, 0x3F], Records),
    ("structure.light", "example", Structure(0, "light_direction"), &[0, 0, 0, 0, 0, 0, 0xE0, 0x7F], Records),
    // 2 without a guard, and a negative error
    ("structure.guard", "example", Structure(0, "transform_error"), &[0, 0, 0, 0, 0, 0, 0, 0x40], Records),
    ("structure.guard", "example", Structure(0, "transform_error"), &[0, 0, 0, 0, 0, 0, 0, 0xC0], Records),
    ("structure.parameter", "example", Structure(0, "policy"), &[3], Records),
    ("structure.parameter", "example", Structure(0, "policy_parameter"), &[1], Records),
    ("structure.reserved", "example", Structure(0, "reserved0"), &[1], Records),
    ("structure.reserved", "example", Structure(0, "reserved1"), &[1], Records),
    ("structure.root", "example", Root("stop_error"), &[7], Records),
    ("index.words", "example", Root("hot_words"), &[1], Records),
    ("index.length", "example", Structure(0, "records_per_block"), &[1], Records),
    ("index.crc", "example", At::Unused, &[1], Head),
    ("index.reserved", "example", Block(0, "reserved"), &[1], Index),
    ("index.head", "example", Block(0, "structure"), &[1], Index),
    ("index.head", "example", Block(0, "first_ordinal"), &[1], Index),
    ("index.head", "example", Block(0, "record_count"), &[2], Index),
    ("index.head", "example", Block(0, "dep_count"), &[1], Index),
    ("index.head", "later", Block(1, "dep_count"), &[4], Index),
    ("index.unused", "example", At::Unused, &[1], Index),
    ("index.page-type", "example", Record(0, 1, "page_type"), &[2], Index),
    ("index.page-type", "example", Record(0, 1, "page_type"), &[16], Index),
    ("index.page-type", "later", Record(1, 1, "page_type"), &[0], Index),
    ("index.words", "example", Record(0, 1, "hot_words"), &[0, 0xFF], Index),
    ("index.words", "example", Record(0, 1, "hot_words"), &[1, 0], Index),
    ("index.words", "example", Record(0, 1, "cold_words"), &[0, 0xFF], Index),
    ("index.offset", "example", Record(0, 1, "offset"), &[0, 0xFF], Index),
    ("index.offset", "example", Record(0, 1, "offset"), &[1], Index),
    ("index.offset", "example", Record(0, 2, "hot_words"), &[4], Index),
    ("index.offset", "example", Record(0, 0, "hot_words"), &[20], Index),
    ("index.children", "example", Record(0, 0, "first_child"), &[2], Index),
    ("index.children", "example", Record(0, 0, "child_count"), &[3], Index),
    ("index.children", "example", Record(0, 1, "first_child"), &[1], Index),
    ("index.children", "example", Record(0, 1, "first_child"), &[2], Index),
    ("index.children", "example", Record(0, 2, "child_count"), &[1], Index),
    ("index.children", "later", Record(1, 1, "first_child"), &[1], Index),
    ("index.root", "example", Record(0, 1, "root"), &[1], Index),
    ("index.root", "roots", Record(0, 1, "root"), &[0], Index),
    ("index.footprint", "example", Record(0, 1, "log2_x"), &[3], Index),
    ("index.footprint", "example", Record(0, 1, "log2_l"), &[17], Index),
    ("index.footprint", "example", Record(0, 1, "origin_x"), &[1], Index),
    ("index.footprint", "example", Record(0, 1, "origin_y"), &[4], Index),
    ("index.levels", "example", Record(0, 1, "level_coarsest"), &[3], Index),
    ("index.levels", "example", Record(0, 1, "level_finest"), &[1], Index),
    ("index.depths", "example", Record(0, 1, "min_depth"), &[0, 0, 0, 0xFF], Index),
    ("index.dependency", "example", Record(0, 1, "dep_first"), &[1], Index),
    ("index.dependency", "example", Record(0, 1, "dep_count"), &[1], Index),
    ("index.dependency", "example", Record(0, 1, "dep_count"), &[1, 1], Index),
    ("index.dependency", "later", Record(1, 1, "dep_first"), &[0], Index),
    ("index.shared", "later", Record(1, 1, "max_depth"), &[9], Index),
    ("index.shared", "later", Record(1, 1, "root"), &[1], Index),
    ("index.shared", "later", Record(1, 1, "stop_error"), &[1], Index),
    ("index.shared", "later", Record(1, 1, "log2_x"), &[1], Index),
    ("index.shared", "later", Record(1, 1, "log2_y"), &[1], Index),
    ("index.shared", "later", Record(1, 1, "log2_l"), &[1], Index),
    ("page.padding", "pages", Gap("page", 1), &[1], Nothing),
    ("page.crc", "example", Page(1, 2, 0), &[0], Nothing),
    ("page.hash", "example", Record(0, 1, "content_hash"), &[0], Index),
    ("page.cold", "example", Record(0, 1, "cold_words"), &[4], All),
    // Fewer halves than the states take.
    ("page.cold", "cold", Cold(1, 0), &[0, 0], All),
    ("page.hash", "cold", Record(0, 1, "content_hash"), &[0], Index),
    ("section.structure", "cold", Section(6, "structure"), &[0], Head),
    ("section.structure", "cold", Section(4, "structure"), &[3], Head),
    ("section.crc", "cold", Section(4, "crc32"), &[0, 0], Head),
    // What counts as near; no zeros in a row of zeros.
    ("cold.model", "cold", Contents(4, 0), &[41], All),
    ("cold.model", "cold", Contents(4, 1), &[0, 0], All),
    ("page.tag", "example", Page(1, 0, 0), &[2], All),
    ("page.children", "example", Page(1, 0, 2), &[9], All),
    ("page.length", "example", Page(1, 1, 0), &[1], All),
    ("page.level", "example", Page(1, 1, 2), &[2], All),
    ("page.level", "later", Record(3, 0, "level_coarsest"), &[2], All),
    ("page.flags", "example", Page(1, 1, 3), &[1], All),
    ("mh.plain", "example", Record(0, 1, "page_type"), &[1], All),
    ("mh.root", "example", Page(0, 0, 1), &[3], All),
    ("mh.root", "example", Page(1, 0, 1), &[0], All),
    ("mh.footprint", "example", Record(0, 1, "log2_x"), &[0], All),
    ("mh.footprint", "example", Record(0, 1, "log2_l"), &[1], All),
    ("mh.footprint", "example", Record(0, 1, "origin_l"), &[1], All),
    ("mh.bounds", "example", Page(0, 7, 0), &[1, 0, 8, 0], All),
    ("mh.overlap", "example", Page(0, 4, 0), &[1, 0, 6, 0], All),
    ("mh.place", "example", Page(0, 4, 1), &[2], All),
    ("mh.childless", "example", Page(0, 7, 0), &[0], All),
    ("mh.depth", "example", Page(1, 0, 1), &[0x43], All),
    ("mh.order", "example", Page(0, 4, 0), &[1, 0, 4, 0], All),
    ("mh.reference", "example", Page(0, 7, 2), &[2], All),
    ("mh.reference", "example", Page(0, 7, 2), &[0], All),
    ("mh.hole", "example", Page(1, 0, 1), &[0x01], All),
    ("mh.levels", "example", Record(0, 0, "level_finest"), &[0], All),
    ("mh.values", "example", Record(0, 1, "max_depth"), &[0x60, 0x03], All),
    ("mh.link", "example", Record(0, 1, "origin_x"), &[2], All),
    ("mh.link", "example", Record(0, 2, "origin_y"), &[0], All),
    // Below the least depth of the parent, above its largest one; an inherited value outside.
    ("mh.depths", "example", Record(0, 2, "min_depth"), &[0], All),
    ("mh.depths", "example", Record(0, 2, "max_depth"), &[0, 0, 1], All),
    ("mh.depths", "example", Record(0, 1, "max_depth"), &[0x66, 0x03], All),
    ("mh.depths", "example", Record(0, 2, "max_depth"), &[0xD0, 0x02], All),
    ("mmh.plain", "mmh", Record(0, 5, "page_type"), &[17], All),
    ("mmh.root", "mmh", Page(3, 0, 1), &[0], All),
    ("mmh.root", "mmh", Page(5, 0, 1), &[1], All),
    ("mmh.footprint", "mmh", Record(0, 3, "log2_x"), &[2], All),
    ("mmh.entries", "mmh", Page(6, 2, 0), &[0], All),
    ("mmh.entries", "mmh", Page(6, 2, 0), &[2], All),
    ("mmh.entries", "mmh", Page(6, 2, 2), &[1], All),
    ("mmh.entries", "mmh", Page(6, 3, 1), &[1], All),
    ("mmh.hole", "mmh", Page(3, 0, 1), &[1], All),
    ("mmh.hole", "mmh", Page(5, 3, 0), &[0x05], All),
    ("mmh.bounds", "mmh", Page(3, 0, 1), &[0x55], All),
    ("mmh.bounds", "mmh", Page(1, 8, 2), &[0xFF], All),
    ("mmh.childless", "mmh", Page(1, 8, 0), &[0], All),
    ("mmh.depth", "mmh", Page(1, 8, 0), &[2], All),
    ("mmh.order", "mmh", Page(1, 8, 2), &[2], All),
    ("mmh.overlap", "mmh", Page(4, 9, 0), &[0x11], All),
    ("mmh.reference", "mmh", Page(0, 10, 2), &[1], All),
    ("mmh.reference", "mmh", Page(0, 10, 2), &[9], All),
    ("mmh.dependency", "mmh", Page(2, 8, 1), &[9], All),
    ("mmh.dependency", "mmh", Page(2, 8, 1), &[2], All),
    ("mmh.levels", "mmh", Record(0, 3, "level_finest"), &[1], All),
    ("mmh.values", "mmh", Record(0, 3, "max_depth"), &[0x7F], All),
    // The sign of a rise in a group with several places, in a tree page and in a shared one.
    ("mmh.values", "mmh", Page(4, 30, 3), &[0x7F], All),
    ("mmh.values", "mmh", Page(6, 4, 3), &[0x7F], All),
    ("mmh.link", "mmh", Record(0, 3, "origin_x"), &[0], All),
    // Two nodes that give one group different types; a reference into the middle of a group.
    ("mmh.link", "mmh", Page(2, 10, 0), &[0x01], All),
    ("mmh.link", "mmh", Page(1, 11, 2), &[5], All),
    // Below the least depth of the parent; what is inherited lies outside.
    ("mmh.depths", "mmh", Record(0, 3, "min_depth"), &[0, 0, 0, 0], All),
    ("mmh.depths", "mmh", Record(0, 3, "min_depth"), &[0xC1], All),
    ("vector.plain", "vector", Record(0, 3, "page_type"), &[1], All),
    ("vector.root", "vector", Page(0, 0, 1), &[3], All),
    ("vector.root", "vector", Page(3, 0, 1), &[0], All),
    ("vector.root", "vector", Part(2, "topology", 1, 0), &[0x40], All),
    ("vector.footprint", "vector", Record(0, 3, "log2_x"), &[0], All),
    ("vector.footprint", "vector", Record(0, 3, "log2_l"), &[1], All),
    ("vector.footprint", "vector", Record(0, 3, "origin_l"), &[1], All),
    // No group, an unknown flag, a bit too many, a word that is zero; a node less with an entry.
    ("vector.header", "vector", Part(0, "header", 0, 0), &[0], All),
    ("vector.header", "vector", Part(0, "header", 0, 1), &[0x80], All),
    ("vector.header", "vector", Part(0, "header", 1, 1), &[4], All),
    ("vector.header", "vector", Part(0, "header", 1, 0), &[9], All),
    ("vector.header", "vector", Part(0, "header", 4, 2), &[1], All),
    ("vector.header", "vector", Part(0, "header", 0, 2), &[6], All),
    ("vector.length", "vector", Part(0, "header", 1, 2), &[0xFF, 0x7F], All),
    // A raw of no words where the last one had some, and one that leaves the page.
    ("vector.length", "vector", Part(0, "raws", 1, 2), &[0], All),
    ("vector.length", "vector", Part(0, "raws", 1, 2), &[32], All),
    ("vector.ranks", "vector", Part(0, "topology", 0, 0), &[1], All),
    ("vector.ranks", "vector", Part(0, "topology", 0, 2), &[1], All),
    ("vector.order", "vector", Part(2, "topology", 1, 1), &[0x04], All),
    ("vector.order", "vector", Part(0, "topology", 1, 1), &[0x55], All),
    ("vector.stubs", "vector", Part(0, "stubs", 0, 0), &[4], All),
    ("vector.stubs", "vector", Part(1, "stubs", 0, 2), &[1], All),
    ("vector.depth", "vector", Part(2, "topology", 1, 2), &[0x80], All),
    ("vector.padding", "vector", Part(0, "topology", 4, 3), &[1], All),
    ("vector.padding", "vector", Part(0, "proofs", 0, 3), &[1], All),
    ("vector.padding", "vector", Part(0, "heap", 2, 3), &[1], All),
    ("vector.levels", "vector", Record(0, 2, "level_finest"), &[1], All),
    ("vector.line", "vector", Part(0, "lines", 2, 3), &[1], All),
    ("vector.line", "vector", Part(0, "lines", 6, 0), &[0], All),
    ("vector.plane", "vector", Part(0, "planes", 1, 3), &[0x80], All),
    ("vector.split", "vector", Part(0, "splits", 0, 0), &[0xFF], All),
    ("vector.split", "vector", Part(0, "splits", 0, 3), &[0xFF], All),
    ("vector.mask", "vector", Part(0, "masks", 1, 0), &[0xFF], All),
    ("vector.mask", "vector", Part(0, "masks", 0, 3), &[0x80], All),
    ("vector.mask", "vector", Part(0, "masks", 0, 0), &[0xFF], All),
    ("vector.raw", "vector", Part(0, "raws", 1, 3), &[0x80], All),
    ("vector.raw", "vector", Part(0, "raws", 1, 0), &[0], All),
    ("vector.raw", "vector", Part(0, "raws", 0, 0), &[0xFF; 4], All),
    ("vector.raw", "vector", Part(0, "raws", 1, 2), &[33], All),
    ("vector.index", "vector", Part(0, "indexes", 0, 0), &[0xFF], All),
    ("vector.values", "vector", Record(0, 0, "max_depth"), &[0, 0, 0, 0x7F], All),
    ("vector.link", "vector", Record(0, 3, "origin_x"), &[0], All),
    ("vector.link", "vector", Record(0, 2, "origin_y"), &[0], All),
    // Below the least depth of the parent; what is inherited lies outside.
    ("vector.depths", "vector", Record(0, 3, "min_depth"), &[0, 0, 0, 0], All),
    ("vector.depths", "vector", Record(0, 3, "min_depth"), &[0x50, 0x0A, 0, 0], All),
    ("structure.nodes", "example", Structure(0, "leaf_nodes"), &[0], Records),
    ("structure.nodes", "vector", Structure(0, "leaf_nodes"), &[0], Records),
    ("structure.nodes", "example", Structure(0, "inner_nodes"), &[0], Records),
    ("structure.nodes", "example", Structure(0, "empty_nodes"), &[9], Records),
];

/// Samples whose rule is about the caller's limits.
const LIMITED: &[(&str, &str, u64)] = &[
    ("limit.sections", "sections", 2),
    ("limit.structures", "structures", 0),
    ("limit.pages", "pages", 2),
    ("limit.page-bytes", "page-bytes", 8),
    ("limit.allocation", "allocation", 100),
];

/// All samples.
pub fn all() -> Vec<Sample> {
    let mut samples: Vec<Sample> = ROWS
        .iter()
        .map(|&(rule, base, at, new, seal)| {
            let mut bytes = named(base).bytes.clone();
            let start = position(&bytes, at);
            bytes[start..start + new.len()].copy_from_slice(new);
            if rule == "mh.plain" {
                // A flat page in a tree: its tag and root mask must then be those of a flat page.
                let word = position(&bytes, Page(1, 0, 0));
                bytes[word..word + 2].copy_from_slice(&[0xFF, 0]);
            }
            if rule == "mmh.plain" {
                // A flat shared page: its tag is then that of a flat page.
                let word = position(&bytes, Page(5, 0, 0));
                bytes[word] = 0xFF;
            }
            if rule == "vector.plain" {
                // The same; and the record of such a page has the level 0 already.
                let word = position(&bytes, Page(3, 0, 0));
                bytes[word..word + 2].copy_from_slice(&[0xFF, 0]);
            }
            if rule == "page.level" && base == "later" {
                // A flat page whose record agrees: only that it is flat is wrong.
                let root_level = offset(&bytes, Record(3, 0, "offset")) + 4 + 2;
                bytes[root_level] = new[0];
            }
            if rule == "mh.depth" {
                // An empty node with a child below level 0.
                let word = position(&bytes, Page(1, 2, 0));
                bytes[word..word + 4].copy_from_slice(&[1, 0, 3, 0]);
            }
            repair(&mut bytes, seal);
            Sample { rule, at: at.to_string(), bytes, limit: None }
        })
        .collect();
    let example = &named("example").bytes;
    let special = |rule, at: At, bytes: Vec<u8>| Sample { rule, at: at.to_string(), bytes, limit: None };
    samples.push(special("header.magic", At::File("an empty file"), Vec::new()));
    samples.push(special("header.truncated", At::File("a file of 100 bytes"), example[..100].to_vec()));
    samples.push(special("header.length", At::File("a byte behind the file"), [&example[..], &[0]].concat()));
    let mut extra = with_section(example, 0, b"later");
    let last = extra.len() - 1;
    extra[last] ^= 1;
    samples.push(special("section.crc", At::File("a byte of an unknown section"), extra));
    samples.push(special("section.unknown", Section(3, "flags"), with_section(example, 1, b"later")));
    for &(rule, name, n) in LIMITED {
        let at = At::File("a limit of the caller").to_string();
        samples.push(Sample { rule, at, bytes: example.clone(), limit: Some((name, n)) });
    }
    samples
}

/// A file with a section of an unknown type behind its last one.
pub fn with_section(bytes: &[u8], flags: u8, contents: &[u8]) -> Vec<u8> {
    // One section record more moves all that follows by one step of the alignment.
    let (shift, count) = (64u64, sections(bytes).len());
    let table = Header::BYTES + count * SectionRecord::BYTES;
    let first = offset(bytes, Section(0, "offset"));
    let mut out = bytes[..table].to_vec();
    out.resize(first + shift as usize, 0);
    out.extend(&bytes[first..]);
    out.resize(out.len().next_multiple_of(64), 0);
    let start = out.len() as u64;
    out.extend(contents);
    let mut add = |at: usize, by: u64| {
        let value = u64::from_le_bytes(out[at..at + 8].try_into().unwrap()) + by;
        out[at..at + 8].copy_from_slice(&value.to_le_bytes());
    };
    for i in 0..count {
        add(position(bytes, Section(i, "offset")), shift);
    }
    for ordinal in 0..offset(bytes, Structure(0, "page_count")) {
        add(position(bytes, Record(0, ordinal, "offset")) + shift as usize, shift);
    }
    let mut put = |at: usize, value: &[u8]| out[at..at + value.len()].copy_from_slice(value);
    let field = |name| table + field("SectionRecord", name).offset;
    put(field("kind"), &77u32.to_le_bytes());
    put(field("flags"), &[flags]);
    put(field("structure"), &u32::MAX.to_le_bytes());
    put(field("offset"), &start.to_le_bytes());
    put(field("length"), &(contents.len() as u64).to_le_bytes());
    let total = start + contents.len() as u64;
    put(position(bytes, At::Header("total_bytes")), &total.to_le_bytes());
    put(position(bytes, At::Header("section_count")), &[count as u8 + 1]);
    // The CRC of an unknown section covers its bytes, nothing else.
    let crc = plain_crc(contents);
    put(field("crc32"), &crc.to_le_bytes());
    repair(&mut out, All);
    out
}

fn plain_crc(bytes: &[u8]) -> u32 {
    let mut crc = umbrage::format::checksum::SectionCrc::default();
    crc.update(bytes);
    crc.finish()
}

/// A field of a record of the format.
pub fn field(record: &str, name: &str) -> Field {
    let record = RECORDS.iter().find(|r| r.name == record).unwrap();
    *record.fields.iter().find(|f| f.name == name).unwrap_or_else(|| panic!("{}.{name}", record.name))
}

fn number(bytes: &[u8], at: usize, length: usize) -> u64 {
    let mut word = [0; 8];
    if let Some(from) = at.checked_add(length).and_then(|end| bytes.get(at..end)) {
        word[..length].copy_from_slice(from);
    }
    u64::from_le_bytes(word)
}

/// Value of a number in a record.
fn offset(bytes: &[u8], at: At) -> usize {
    number(bytes, position(bytes, at), at.field().map_or(1, |f| f.bytes)) as usize
}

/// Type, offset and length of each section, as far as the file still says so.
fn sections(bytes: &[u8]) -> Vec<(u64, usize, usize)> {
    let count = number(bytes, field("Header", "section_count").offset, 4).min(16) as usize;
    let get = |i: usize, f: &str, n| {
        number(bytes, Header::BYTES + i * SectionRecord::BYTES + field("SectionRecord", f).offset, n) as usize
    };
    (0..count).map(|i| (get(i, "kind", 4) as u64, get(i, "offset", 8), get(i, "length", 8))).collect()
}

/// First byte of the index of a structure.
fn index(bytes: &[u8], structure: usize) -> usize {
    sections(bytes).iter().filter(|s| s.0 == 2).nth(structure).map_or(usize::MAX, |s| s.1)
}

/// First byte of a place.
pub fn position(bytes: &[u8], at: At) -> usize {
    let start = match at {
        At::Header(_) | At::File(_) => 0,
        Section(i, _) => Header::BYTES + i * SectionRecord::BYTES,
        Structure(i, _) => sections(bytes)[0].1 + 512 * i,
        Root(_) => sections(bytes)[0].1 + field("StructureRecord", "root_page").offset,
        Block(s, _) => index(bytes, s),
        At::Unused => index(bytes, 0) + 4095,
        Record(s, ordinal, _) => {
            let per_block = offset(bytes, Structure(s, "records_per_block")).max(1);
            let block = 1usize << offset(bytes, Structure(s, "index_block_log2")).min(16);
            index(bytes, s) + ordinal / per_block * block + 64 + 64 * (ordinal % per_block)
        }
        Page(ordinal, word, byte) => offset(bytes, Record(0, ordinal, "offset")) + 4 * word + byte,
        Cold(ordinal, byte) => offset(bytes, Record(0, ordinal, "offset")) + byte,
        Contents(i, byte) => offset(bytes, Section(i, "offset")) + byte,
        Part(ordinal, part, word, byte) => {
            let start = offset(bytes, Record(0, ordinal, "offset"));
            let words: Vec<u32> =
                bytes[start..].chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect();
            let l = Layout::of(&words);
            let first = match part {
                "header" => 2,
                "topology" => 7,
                "stubs" => l.stubs_at,
                "indexes" => l.indexes_at,
                "proofs" => l.proofs_at,
                "lines" => l.lines_at,
                "planes" => l.planes_at,
                "splits" => l.splits_at,
                "masks" => l.masks_at,
                "raws" => l.raws_at,
                "heap" => l.heap_at,
                other => panic!("{other}"),
            };
            start + 4 * (usize::from(first) + word) + byte
        }
        Gap("section", i) => offset(bytes, Section(i, "offset")) - 1,
        Gap(_, ordinal) => offset(bytes, Record(0, ordinal, "offset")) - 1,
    };
    start + at.field().map_or(0, |f| f.offset)
}

impl At {
    fn record(self) -> Option<(&'static str, &'static str)> {
        Some(match self {
            At::Header(f) => ("Header", f),
            Section(_, f) => ("SectionRecord", f),
            Structure(_, f) => ("StructureRecord", f),
            Root(f) | Record(_, _, f) => ("PageRecord", f),
            Block(_, f) => ("BlockHeader", f),
            _ => return None,
        })
    }

    fn field(self) -> Option<Field> {
        self.record().map(|(record, name)| field(record, name))
    }
}

impl std::fmt::Display for At {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Root(name) => write!(f, "`StructureRecord.root_page.{name}`"),
            At::Unused => f.write_str("unused bytes of an index block"),
            Part(_, "header", ..) => f.write_str("the header of a page"),
            Part(_, part, ..) => write!(f, "{part} of a page"),
            Page(_, word @ (0 | 1), _) => write!(f, "word {word} of the frame"),
            Page(..) => f.write_str("a node's word"),
            Gap(what, _) => write!(f, "bytes before a {what}"),
            Cold(..) => f.write_str("a cold page"),
            Contents(..) => f.write_str("a model of cold pages"),
            At::File(what) => f.write_str(what),
            at => {
                let (record, name) = at.record().unwrap_or_default();
                write!(f, "`{record}.{name}`")
            }
        }
    }
}

/// Makes checksums good again, as far as the bytes still say where they are.
pub fn repair(bytes: &mut [u8], seal: Seal) {
    let id: FileId = bytes[field("Header", "file_id").offset..][..16].try_into().unwrap();
    let table = sections(bytes);
    let structures = table.first().map_or(0, |s| s.1);
    let count = (offset(bytes, At::Header("structure_count"))).min(8);
    let put = |bytes: &mut [u8], at: usize, value: &[u8]| {
        if let Some(to) = bytes.get_mut(at..at.saturating_add(value.len())) {
            to.copy_from_slice(value);
        }
    };
    let range = |bytes: &[u8], at: usize, n: usize| Some(bytes.get(at..at.checked_add(n)?)?.to_vec());
    for s in 0..count {
        let record = structures.saturating_add(512 * s);
        // The model of its cold pages.
        let owner = |i: usize| {
            number(bytes, Header::BYTES + i * SectionRecord::BYTES + field("SectionRecord", "structure").offset, 4)
        };
        let section = (0..table.len()).find(|i| table[*i].0 == 4 && owner(*i) == s as u64);
        let contents = section.and_then(|i| range(bytes, table[i].1, table[i].2));
        if let (Some(i), Some(contents), true) = (section, &contents, seal >= All) {
            let at = Header::BYTES + i * SectionRecord::BYTES + field("SectionRecord", "crc32").offset;
            put(bytes, at, &plain_crc(contents).to_le_bytes());
        }
        let kind =
            Kind::from_code(number(bytes, record.saturating_add(field("StructureRecord", "kind").offset), 4) as u32);
        let model = contents.as_ref().zip(kind).and_then(|(bytes, kind)| cold::Model::read(kind, bytes));
        if seal >= Index {
            let index = index(bytes, s);
            let get = |f: &str, n| number(bytes, record.saturating_add(field("StructureRecord", f).offset), n);
            let log2 = get("index_block_log2", 1).clamp(12, 16);
            let per = get("records_per_block", 2).clamp(1, 1023);
            let pages = get("page_count", 4).clamp(1, 4096);
            for b in 0..pages.div_ceil(per) {
                let block = index.saturating_add((b << log2) as usize);
                for i in 0..per.min(pages - b * per) {
                    let r = block.saturating_add(64 + 64 * i as usize);
                    let get = |f: &str, n| number(bytes, r.saturating_add(field("PageRecord", f).offset), n) as usize;
                    let words = if get("cold_words", 2) == 0 { get("hot_words", 2) } else { get("cold_words", 2) };
                    let Some(page) = range(bytes, get("offset", 8), 4 * words).filter(|_| seal >= All) else {
                        continue;
                    };
                    let (is_cold, hot_words) = (get("cold_words", 2) != 0, get("hot_words", 2) as u16);
                    let crc = page_crc(&id, s as u32, (b * per + i) as u32, &page);
                    put(bytes, r.saturating_add(field("PageRecord", "crc32").offset), &crc.to_le_bytes());
                    let hash = r.saturating_add(field("PageRecord", "content_hash").offset);
                    // Of a cold page the hash is of what it decodes to; where it doesn't, nobody asks for it.
                    if !is_cold {
                        put(bytes, hash, &content_hash(&page).to_le_bytes());
                    } else if let Some(words) = model.as_ref().and_then(|m| cold::decode(m, &page, hot_words)) {
                        let hot: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
                        put(bytes, hash, &content_hash(&hot).to_le_bytes());
                    }
                }
                if let Some(block_bytes) = range(bytes, block, 1 << log2) {
                    put(bytes, block, &block_crc(&id, s as u32, b as u32, &block_bytes[4..]).to_le_bytes());
                }
            }
            if let Some(first) = range(bytes, index.saturating_add(64), 64) {
                put(bytes, record.saturating_add(field("StructureRecord", "root_page").offset), &first);
            }
        }
        if let (true, Some(r)) = (seal >= Records, range(bytes, record, 512)) {
            let crc = umbrage::format::checksum::structure_crc(&id, s as u32, &r[..508]);
            put(bytes, record + 508, &crc.to_le_bytes());
        }
    }
    let end = Header::BYTES + table.len() * SectionRecord::BYTES;
    if let (true, Some(mut head)) = (seal >= Head, range(bytes, 0, end)) {
        // The header's CRC is bound to nothing, as that of an unknown section.
        let at = field("Header", "crc32").offset;
        head[at..at + 4].fill(0);
        put(bytes, at, &plain_crc(&head).to_le_bytes());
    }
}
