//! Kind `mmh`: twin of `shader/query/mmh.wgsl`.

use umbrage_format::kind::mh::{NodeType, ROOT_GROUP, child_of};
use umbrage_format::kind::mmh::{Children, Node};

use super::pool::{Answer, MAX_STEPS, NONE, Pool};

impl Pool<'_> {
    /// Walks from root `root` to texel (x, y) at `level` and adds up the rises on its way, in a structure of kind `mmh`.
    pub fn mmh(&self, root: u32, x: u32, y: u32, level: u32) -> Answer {
        let mut d = self.nothing(root);
        let Some(mut page) = self.page(root) else { return Answer { missing: root, ..d } };
        let mut ordinal = root;
        let (mut mask, mut group) = (page.root_mask(), u32::from(ROOT_GROUP));
        let mut at_level = self.top();
        let mut sum = 0u32;
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
                d = answer(sum.wrapping_add(word));
                break;
            }
            if kind == NodeType::Inner {
                sum = sum.wrapping_add(page.word(at + 1));
                d = answer(sum);
            }
            if u32::from(at_level) <= level {
                break;
            }
            let node = Node::decode(word);
            let there = match node.children {
                Children::Here(_) => None,
                Children::Page(place) => Some(page.first_child.saturating_add(place.into())),
                Children::Shared(dependency, _) => Some(page.dependency(dependency.into())),
            };
            if let Some(there) = there {
                let Some(next) = self.page(there) else {
                    d.missing = there;
                    break;
                };
                (page, ordinal) = (next, there);
            }
            (mask, group) = match node.children {
                Children::Here(first) | Children::Shared(_, first) => (node.mask, first.into()),
                Children::Page(_) => (page.root_mask(), u32::from(ROOT_GROUP)),
            };
            at_level -= 1;
        }
        d
    }
}
