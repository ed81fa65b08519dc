//! The oracle of `stream`: the blocks of 4 KiB of a file that hold the nodes which lookups touch.

use std::collections::HashSet;

use umbrage::format::Kind;
use umbrage::format::kind::vector::{Child, Layout, TOPOLOGY};
use umbrage::reader::query::Map;

use super::Asked;
use crate::Failure;

/// Bytes of a block.
const BLOCK: u64 = 4096;

/// Nodes and blocks so far.
pub struct Touched {
    map: Map,
    nodes: HashSet<(u8, u32, u32)>,
    blocks: HashSet<u64>,
}

impl Touched {
    /// Of a file of kind `mh` or `vector`.
    pub fn new(map: Map) -> Self {
        Self { map, nodes: HashSet::new(), blocks: HashSet::new() }
    }

    /// Looks receivers up, from the level that each asks for to the root.
    pub fn add(&mut self, asked: &[Asked]) -> Result<(), Failure> {
        let top = self.map.structure().record().log2_resolution;
        for &([x, y], _, level) in asked {
            for level in level..=top {
                if !self.nodes.insert((level, x >> level, y >> level)) {
                    break;
                }
                let answer = self.map.texel(x, y, level)?;
                let page = self.map.page(answer.page)?;
                let (words, start) = (page.words(), page.record().offset.get());
                let mut touch = |word: u32| {
                    self.blocks.insert((start + 4 * u64::from(word)) / BLOCK);
                };
                if self.map.structure().kind() != Kind::Vector {
                    touch(answer.word);
                    continue;
                }
                // The node's types, the index of its entry and the first word of that.
                let layout = Layout::of(words);
                let (group, c) = (answer.word / 4, answer.word % 4);
                touch(TOPOLOGY + 5 * (group / 16));
                let index = Child::of(words, group, c).index;
                touch(u32::from(layout.indexes_at) + index * u32::from(layout.index_bits) / 32);
                let entry = layout.entry(words, index);
                let places = [
                    (layout.first_raw, layout.raws_at, 2),
                    (layout.first_mask, layout.masks_at, 2),
                    (layout.first_split, layout.splits_at, 1),
                    (layout.first_plane, layout.planes_at, 3),
                    (0, layout.constants_at, 1),
                ];
                if let Some((first, at, words)) = places.into_iter().find(|p| entry >= u32::from(p.0)) {
                    touch(u32::from(at) + (entry - u32::from(first)) * words);
                }
            }
        }
        Ok(())
    }

    /// Bytes of the blocks.
    pub fn bytes(&self) -> u64 {
        self.blocks.len() as u64 * BLOCK
    }
}
