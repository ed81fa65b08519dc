// Walk of kind mh over the resident pages. Twin of query/mh.rs: the same rules in the same order.

fn umb_root_mask(page: UmbPage) -> u32 {
    return (umb_word(page, UMB_FRAME_MASK_WORD) >> UMB_FRAME_MASK_SHIFT) & 0xFFu;
}

// Words of the children before child c.
fn umb_words_before(mask: u32, c: u32) -> u32 {
    let low = mask & ((1u << (c * 2u)) - 1u);
    let first = low & 0x55u;
    let second = (low >> 1u) & 0x55u;
    return countOneBits(first & ~second) * UMB_WORDS_LEAF
        + countOneBits(second & ~first) * UMB_WORDS_INNER
        + countOneBits(first & second) * UMB_WORDS_EMPTY;
}

// Walks from root `root` to texel (x, y) at `level`, in a structure of kind mh.
fn umb_mh(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    let w = umb_go_mh(umb_start(root, UMB_ROOT_GROUP), x, y, level);
    umb_end(w);
    return w.d;
}

// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended.
fn umb_go_mh(from_walk: UmbWalk, x: u32, y: u32, level: u32) -> UmbWalk {
    var w = from_walk;
    for (var step = 0u; step < UMB_MAX_STEPS && !w.ended; step++) {
        if w.opens {
            if w.level <= level {
                break;
            }
            let place = (w.node >> UMB_NODE_AT_SHIFT) & 0xFFFFu;
            if ((w.node >> UMB_NODE_PAGE_SHIFT) & 1u) == 0u {
                w.mask = (w.node >> UMB_NODE_MASK_SHIFT) & 0xFFu;
                w.group = place;
            } else {
                let child = umb_child_page(w.page, place);
                let next = umb_page(child);
                if !next.resident {
                    w.d.missing = child;
                    w.ended = true;
                    break;
                }
                w.page = next;
                w.own = next.base;
                w.ordinal = child;
                w.mask = umb_root_mask(next);
                w.group = UMB_ROOT_GROUP;
            }
            w.opens = false;
            w.level -= 1u;
        }
        let c = umb_child(x, y, w.level);
        let kind = (w.mask >> (c * 2u)) & 3u;
        if kind == UMB_NODE_NONE {
            w.ended = true;
            break;
        }
        let at = w.group + umb_words_before(w.mask, c);
        let word = umb_word(w.page, at);
        if kind == UMB_NODE_LEAF {
            w.d = UmbAnswer(word, w.level, w.ordinal, at, UMB_NO_PAGE);
        }
        if kind == UMB_NODE_INNER {
            w.d = UmbAnswer(umb_word(w.page, at + 1u), w.level, w.ordinal, at, UMB_NO_PAGE);
        }
        w.node = word;
        w.opens = true;
        w.ended = kind == UMB_NODE_LEAF;
    }
    return w;
}
