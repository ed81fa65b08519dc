//! Kind `mh`: twin of `shader/query/mh.wgsl`.

use umbrage_format::kind::mh::{Children, Node, NodeType, ROOT_GROUP, child_of};

use super::pool::{Answer, NONE, Pool, Walk};

impl<'a> Pool<'a> {
    /// Walks from root `root` to texel (x, y) at `level`, in a structure of kind `mh`.
    pub fn mh(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        self.go_mh(self.start(root, ROOT_GROUP.into()), x, y, level).found
    }

    /// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended.
    pub(super) fn go_mh(&self, mut w: Walk<'a>, x: u32, y: u32, level: u32) -> Walk<'a> {
        while !w.ended {
            if w.opens {
                if u32::from(w.level) <= level {
                    break;
                }
                let node = Node::decode(w.node);
                match node.children {
                    Children::Here(first) => (w.mask, w.group) = (node.mask, first.into()),
                    Children::Page(place) => {
                        let child = w.page.first_child.saturating_add(place.into());
                        let Some(next) = self.page(child) else {
                            (w.found.missing, w.ended) = (child, true);
                            break;
                        };
                        (w.page, w.ordinal) = (next, child);
                        (w.mask, w.group) = (next.root_mask(), u32::from(ROOT_GROUP));
                    }
                }
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
            let (level, page) = (w.level.into(), w.ordinal);
            if kind == NodeType::Leaf {
                w.found = Answer { value: word, level, page, word: at, missing: NONE };
            }
            if kind == NodeType::Inner {
                w.found = Answer { value: w.page.word(at + 1), level, page, word: at, missing: NONE };
            }
            (w.node, w.opens, w.ended) = (word, true, kind == NodeType::Leaf);
        }
        w
    }
}
