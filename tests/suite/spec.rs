//! The tables of `spec/` that are made from the code: between `<!-- generated: NAME -->` and `<!-- end -->` stands what
//! the format's own tables say. With `UMBRAGE_BLESS=1` the test writes them.

use std::fmt::Write as _;

use umbrage::format::kind::mh::{Children, Mask, Node, NodeType};
use umbrage::format::page::FrameHead;
use umbrage::format::record::{RECORDS, Record, Scalar};
use umbrage::format::structure::{GUARANTEES, POLICIES};
use umbrage::format::{Kind, PageRecord, Rule};

use crate::golden::samples::{self, At, field, position};
use crate::golden::{hold, named, workspace};

#[test]
fn tables_are_those_of_the_code() {
    let mut tables = Vec::new();
    for file in std::fs::read_dir(workspace("spec")).unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_none_or(|e| e != "md") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let mut out = String::new();
        let mut rest = text.as_str();
        while let Some((before, marked)) = rest.split_once("<!-- generated: ") {
            let (name, old) = marked.split_once(" -->\n").expect("the end of a marker");
            let (_, after) = old.split_once("<!-- end -->").expect("the end of a table");
            let _ = write!(out, "{before}<!-- generated: {name} -->\n{}<!-- end -->", table(name));
            tables.push(name.to_string());
            rest = after;
        }
        out += rest;
        hold(&path, out.as_bytes());
    }
    let records = RECORDS.iter().map(|r| format!("record {}", r.name));
    let mut all: Vec<String> =
        records.chain(["kinds", "policies", "guarantees", "rules", "example"].map(String::from)).collect();
    all.sort();
    tables.sort();
    assert_eq!(tables, all, "each table stands in one place");
}

fn table(name: &str) -> String {
    match name.split_once(' ') {
        Some(("record", record)) => fields(RECORDS.iter().find(|r| r.name == record).unwrap()),
        _ => match name {
            "kinds" => kinds(),
            "policies" => policies(),
            "guarantees" => guarantees(),
            "rules" => rules(),
            "example" => example(),
            _ => panic!("nothing makes the table '{name}'"),
        },
    }
}

/// Name of a type as the text has it.
fn scalar(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::U8 => "u8",
        Scalar::U16 => "u16",
        Scalar::U32 => "u32",
        Scalar::U64 => "u64",
        Scalar::F64 => "f64",
        Scalar::PageRecord => "page record",
    }
}

fn fields(record: &Record) -> String {
    let mut out = format!("`{}`, {} bytes:\n\n", record.name, record.bytes);
    out += "| Offset | Bytes | Type | Field | Meaning |\n|---|---|---|---|---|\n";
    for f in record.fields {
        let count = if f.count == 1 { String::new() } else { format!("[{}]", f.count) };
        let doc = f.doc.replace('|', "\\|");
        let _ = writeln!(out, "| {} | {} | {}{count} | `{}` | {doc} |", f.offset, f.bytes, scalar(f.scalar), f.name);
    }
    out
}

fn kinds() -> String {
    let mut out = String::from("| Code | Kind | Root mask in the frame | Words |\n|---|---|---|---|\n");
    for kind in Kind::ALL {
        let mask = if kind.has_frame_mask() { "yes" } else { "no, zero" };
        let text = format!("[{0}.md]({0}.md)", kind.name());
        let words = if kind.has_layout() { &text } else { "not defined yet" };
        let _ = writeln!(out, "| {} | `{}` | {mask} | {words} |", kind.code(), kind.name());
    }
    out
}

fn policies() -> String {
    let mut out = String::from("| Code | Policy | Guarantee | Parameter |\n|---|---|---|---|\n");
    for p in POLICIES {
        let parameter = if p.has_parameter { "above 0" } else { "0" };
        let _ = writeln!(out, "| {} | {} | {} | {parameter} |", p.code, p.name, p.guarantee);
    }
    out
}

fn guarantees() -> String {
    let mut out = String::from("| Code | Guarantee |\n|---|---|\n");
    for (code, name) in GUARANTEES {
        let _ = writeln!(out, "| {code} | {name} |");
    }
    out
}

fn rules() -> String {
    let samples = samples::all();
    let mut out = String::from("| Id | Rule | Broken in the samples at |\n|---|---|---|\n");
    for rule in Rule::ALL {
        let mut places: Vec<&str> = Vec::new();
        for s in samples.iter().filter(|s| s.rule == rule.id()) {
            if !places.contains(&s.at.as_str()) {
                places.push(&s.at);
            }
        }
        let _ = writeln!(out, "| `{}` | {} | {} |", rule.id(), rule.meaning(), places.join(", "));
    }
    out
}

/// Every byte of the example file.
fn example() -> String {
    let bytes = &named("example").bytes;
    let mut e = Annotated { bytes, at: 0, out: String::new() };
    e.record("Header", "Header");
    for what in ["structures", "index of structure 0", "pages of structure 0"] {
        e.record("SectionRecord", &format!("Section record: {what}"));
    }
    e.padding(position(bytes, At::Structure(0, "name")));
    e.record("StructureRecord", "Structure record 0");
    e.record("BlockHeader", "Index block 0 of structure 0");
    for ordinal in 0..3 {
        e.record("PageRecord", &format!("Page record {ordinal}"));
    }
    let pages = position(bytes, At::Page(0, 0, 0));
    e.heading("Rest of the index block");
    e.row(pages - e.at, "unused", "Zero");
    for ordinal in 0..3 {
        e.padding(position(bytes, At::Page(ordinal, 0, 0)));
        e.page(ordinal);
    }
    assert_eq!(e.at, bytes.len(), "every byte is explained");
    e.out
}

struct Annotated<'a> {
    bytes: &'a [u8],
    at: usize,
    out: String,
}

impl Annotated<'_> {
    fn heading(&mut self, title: &str) {
        let line = if self.out.is_empty() { "" } else { "\n" };
        let _ = writeln!(self.out, "{line}### {title}\n\n| Offset | Bytes | What | Value |\n|---|---|---|---|");
    }

    fn row(&mut self, length: usize, what: &str, value: &str) {
        let bytes = hex(&self.bytes[self.at..self.at + length]);
        let _ = writeln!(self.out, "| {} | `{bytes}` | {what} | {value} |", self.at);
        self.at += length;
    }

    fn padding(&mut self, to: usize) {
        if to > self.at {
            self.heading("Padding");
            self.row(to - self.at, "zero bytes", "up to the alignment");
        }
    }

    fn record(&mut self, record: &str, title: &str) {
        let record = RECORDS.iter().find(|r| r.name == record).unwrap();
        self.heading(title);
        for f in record.fields {
            let size = f.bytes / f.count;
            let whole = f.scalar == Scalar::U8 || f.count == 1;
            for i in 0..if whole { 1 } else { f.count } {
                let bytes = &self.bytes[self.at..][..if whole { f.bytes } else { size }];
                let name = if whole { format!("`{}`", f.name) } else { format!("`{}[{i}]`", f.name) };
                self.row(bytes.len(), &name, &value(f.name, f.scalar, bytes));
            }
        }
    }

    fn page(&mut self, ordinal: usize) {
        let words: Vec<u32> = {
            let length = field("PageRecord", "hot_words").offset - field("PageRecord", "offset").offset;
            let at = position(self.bytes, At::Record(0, ordinal, "offset")) + length;
            let words = usize::from(u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]]));
            self.bytes[self.at..][..4 * words]
                .chunks_exact(4)
                .map(|w| u32::from_le_bytes(w.try_into().unwrap()))
                .collect()
        };
        let head = FrameHead::decode(&words).unwrap();
        let (tag, mask) = (head.tag, types(Mask(head.root_mask)));
        let mut notes = vec![(String::new(), String::new()); words.len()];
        notes[0] = ("frame, word 0".into(), format!("tag {tag}, root mask {mask}, child_refs {}", head.child_refs));
        notes[1] = ("frame, word 1".into(), format!("words {}, root level {}", head.words, head.root_level));
        let mut groups = vec![(2usize, Mask(head.root_mask), head.root_level)];
        while let Some((start, mask, level)) = groups.pop() {
            for c in 0..4 {
                let (kind, at) = (mask.child(c), start + mask.words_before(c) as usize);
                let node = format!("child {c} at level {level}, {}", format!("{kind:?}").to_lowercase());
                if kind.has_children() {
                    let n = Node::decode(words[at]);
                    let place = match n.children {
                        Children::Here(word) => {
                            groups.push((usize::from(word), n.mask, level - 1));
                            format!("children from word {word}")
                        }
                        Children::Page(child) => format!("children in child page {child}"),
                    };
                    notes[at] = (node.clone(), format!("mask {}, {place}", types(n.mask)));
                }
                match kind {
                    NodeType::Leaf => notes[at] = (node, format!("value {}", words[at])),
                    NodeType::Inner => {
                        notes[at + 1] = (format!("its value, word {}", at + 1), words[at + 1].to_string())
                    }
                    NodeType::None | NodeType::Empty => {}
                }
            }
        }
        self.heading(&format!("Page {ordinal}"));
        for (i, (what, value)) in notes.into_iter().enumerate() {
            let what = if i < 2 || what.starts_with("its") { what } else { format!("word {i}: {what}") };
            self.row(4, &what, &value);
        }
    }
}

fn types(mask: Mask) -> String {
    let names = [0, 1, 2, 3].map(|c| format!("{:?}", mask.child(c)).to_lowercase());
    format!("{:#04X} ({})", mask.0, names.join(", "))
}

/// Bytes in base 16; runs of more than 4 equal ones as `00 * n`.
fn hex(bytes: &[u8]) -> String {
    let runs = bytes.chunk_by(|a, b| a == b).map(|run| match run.len() {
        n @ 5.. => format!("{:02X} * {n}", run[0]),
        n => vec![format!("{:02X}", run[0]); n].join(" "),
    });
    runs.collect::<Vec<_>>().join(" ")
}

/// A field's bytes as the reader of the text would say them.
fn value(name: &str, scalar: Scalar, bytes: &[u8]) -> String {
    let number = || bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    match (name, scalar) {
        (n, _) if n.starts_with("reserved") => "zero".into(),
        ("name", _) => format!("\"{}\"", String::from_utf8_lossy(bytes).trim_end_matches('\0')),
        ("magic", _) => "the magic bytes".into(),
        ("file_id", _) => "the file's identity".into(),
        (_, Scalar::PageRecord) => format!("record 0 of the index, {} bytes", PageRecord::BYTES),
        (_, Scalar::F64) => f64::from_le_bytes(bytes.try_into().unwrap()).to_string(),
        ("crc32" | "content_hash", _) => format!("{:#X}", number()),
        _ if bytes.iter().all(|b| *b == 0xFF) => format!("{:#X}", number()),
        _ => number().to_string(),
    }
}
