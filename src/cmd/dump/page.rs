//! One page: its record and its words.

use umbrage::format::Kind;
use umbrage::format::kind::vector::Header;
use umbrage::reader::Structure;

use super::super::Failure;
use super::super::output::line;
use super::vector::{SECTIONS, sections};

/// Prints page `ordinal` of a structure.
pub fn print(s: &Structure, ordinal: u32) -> Result<(), Failure> {
    let (r, page) = (s.page_record(ordinal)?, s.page(ordinal)?);
    line(&format!("page {ordinal} of '{}': {} words at byte {}", s.name(), r.hot_words.get(), r.offset.get()))?;
    if r.cold_words.get() != 0 {
        line(&format!("  cold       stored in {} words", r.cold_words.get()))?;
    }
    let [x, y] = [r.origin_x.get(), r.origin_y.get()];
    line(&format!("  texels     x {x} + {}, y {y} + {}", 1u64 << r.log2_x, 1u64 << r.log2_y))?;
    line(&format!("  levels     {} to {}", r.level_coarsest, r.level_finest))?;
    line(&format!("  children   {} from page {}", r.child_count.get(), r.first_child.get()))?;
    let (min, max, stop) = (r.min_depth.get(), r.max_depth.get(), r.stop_error.get());
    line(&format!("  depths     {min} to {max}; error without it {stop}"))?;
    line(&format!("  hash       {:016x}, crc {:08x}", r.content_hash.get(), r.crc32.get()))?;
    let c = page.counts();
    line(&format!("  nodes      {} leaves, {} inner, {} empty", c.leaves, c.inner, c.empty))?;
    if s.kind() == Kind::Vector {
        let h = Header::decode(page.words());
        let palette = [
            ("constants", h.constants),
            ("planes", h.planes),
            ("splits", h.splits),
            ("masks", h.masks),
            ("raws", h.raws),
            ("lines", h.lines),
        ];
        line(&format!("  palette    {}", palette.map(|(name, n)| format!("{n} {name}")).join(", ")))?;
        let proofs = if h.flags & Header::PROOFS == 0 { "without" } else { "with" };
        line(&format!("  indexes    {} of {} bits, {proofs} proofs", h.entries, h.index_bits))?;
        let words = SECTIONS.iter().zip(sections(&page)).map(|(name, n)| format!("{name} {n}"));
        line(&format!("  words      {}", words.collect::<Vec<_>>().join(", ")))?;
    }
    for (i, words) in page.words().chunks(8).enumerate() {
        let words: Vec<String> = words.iter().map(|w| format!("{w:08x}")).collect();
        line(&format!("  {:5}  {}", i * 8, words.join(" ")))?;
    }
    Ok(())
}
