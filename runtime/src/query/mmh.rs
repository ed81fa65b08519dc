//! Kind `mmh`: twin of `shader/query/mmh.wgsl`.

use umbrage_format::kind::mh::{NodeType, ROOT_GROUP, child_of};
use umbrage_format::kind::mmh::{Children, Node};

use super::pool::{Answer, NONE, Pool, Walk};

impl<'a> Pool<'a> {
    /// Walks from root `root` to texel (x, y) at `level` and adds up the rises on its way, in a structure of kind `mmh`.
    pub fn mmh(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        self.go_mmh(self.start(root, ROOT_GROUP.into()), x, y, level).found
    }

    /// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended.
    pub(super) fn go_mmh(&self, mut w: Walk<'a>, x: u32, y: u32, level: u32) -> Walk<'a> {
        while !w.ended {
            if w.opens {
                if u32::from(w.level) <= level {
                    break;
                }
                let node = Node::decode(w.node);
                let there = match node.children {
                    Children::Here(_) => None,
                    Children::Page(place) => Some(w.page.first_child.saturating_add(place.into())),
                    Children::Shared(dependency, _) => Some(w.page.dependency(dependency.into())),
                };
                if let Some(there) = there {
                    let Some(next) = self.page(there) else {
                        (w.found.missing, w.ended) = (there, true);
                        break;
                    };
                    (w.page, w.ordinal) = (next, there);
                }
                (w.mask, w.group) = match node.children {
                    Children::Here(first) | Children::Shared(_, first) => (node.mask, first.into()),
                    Children::Page(_) => (w.page.root_mask(), u32::from(ROOT_GROUP)),
                };
                (w.opens, w.level) = (false, w.level - 1);
            }
            let c = child_of(x, y, w.level);
            let kind = w.mask.child(c);
            if kind == NodeType::None {
                w.ended = true;
                break;
            }
            let at = w.group + w.mask.words_before(c);
            let word = w.page.word(at);
            if kind == NodeType::Leaf || kind == NodeType::Inner {
                w.sum = w.sum.wrapping_add(if kind == NodeType::Leaf { word } else { w.page.word(at + 1) });
                w.found = Answer { value: w.sum, level: w.level.into(), page: w.ordinal, word: at, missing: NONE };
            }
            (w.node, w.opens, w.ended) = (word, true, kind == NodeType::Leaf);
        }
        w
    }
}
