//! What the bytes of a `vector` page are spent on.

use umbrage::format::kind::vector::{Header, TOPOLOGY};
use umbrage::reader::CheckedPage;

/// Parts of a page, in their order.
pub const SECTIONS: [&str; 13] = [
    "frames",
    "headers",
    "topology",
    "stubs",
    "indexes",
    "proofs",
    "lines",
    "constants",
    "planes",
    "splits",
    "masks",
    "raws",
    "heap",
];

/// Words of each part.
pub fn sections(page: &CheckedPage) -> [u64; 13] {
    let sections = Header::decode(page.words()).section_words(page.head().child_refs).map(u64::from);
    let mut all = [0; 13];
    (all[0], all[1]) = (2, u64::from(TOPOLOGY) - 2);
    all[2..12].copy_from_slice(&sections);
    // A checked page has room for its sections.
    all[12] = page.words().len() as u64 - all.iter().sum::<u64>();
    all
}
