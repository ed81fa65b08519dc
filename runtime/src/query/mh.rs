//! Kind `mh`: twin of `shader/query/mh.wgsl`.

use umbrage_format::kind::mh::{Children, Node, NodeType, ROOT_GROUP, child_of};

use super::pool::{Answer, MAX_STEPS, NONE, Pool};

impl Pool<'_> {
    /// Walks from root `root` to texel (x, y) at `level`, in a structure of kind `mh`.
    pub fn mh(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        let mut d = self.nothing(root);
        let Some(mut page) = self.page(root) else { return Answer { missing: root, ..d } };
        let mut ordinal = root;
        let (mut mask, mut group) = (page.root_mask(), u32::from(ROOT_GROUP));
        let mut at_level = self.top();
        for _ in 0..MAX_STEPS {
            let c = child_of(x, y, at_level);
            let kind = mask.child(c);
            if kind == NodeType::None {
                break;
            }
            let at = group + mask.words_before(c);
            let word = page.word(at);
            let answer = |value| Answer { value, level: at_level.into(), page: ordinal, word: at, missing: NONE };
            if kind == NodeType::Leaf {
                d = answer(word);
                break;
            }
            if kind == NodeType::Inner {
                d = answer(page.word(at + 1));
            }
            if u32::from(at_level) <= level {
                break;
            }
            let node = Node::decode(word);
            match node.children {
                Children::Here(first) => (mask, group) = (node.mask, first.into()),
                Children::Page(place) => {
                    let child = page.first_child.saturating_add(place.into());
                    let Some(next) = self.page(child) else {
                        d.missing = child;
                        break;
                    };
                    (page, ordinal) = (next, child);
                    (mask, group) = (page.root_mask(), u32::from(ROOT_GROUP));
                }
            }
            at_level -= 1;
        }
        d
    }
}
