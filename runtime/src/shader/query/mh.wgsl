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
    var d = umb_nothing(root);
    var page = umb_page(root);
    if !page.resident {
        d.missing = root;
        umb_request(root);
        return d;
    }
    var ordinal = root;
    var mask = umb_root_mask(page);
    var group = UMB_ROOT_GROUP;
    var at_level = umb_top();
    for (var step = 0u; step < UMB_MAX_STEPS; step++) {
        let c = umb_child(x, y, at_level);
        let kind = (mask >> (c * 2u)) & 3u;
        if kind == UMB_NODE_NONE {
            break;
        }
        let at = group + umb_words_before(mask, c);
        let word = umb_word(page, at);
        if kind == UMB_NODE_LEAF {
            d = UmbAnswer(word, at_level, ordinal, at, UMB_NO_PAGE);
            break;
        }
        if kind == UMB_NODE_INNER {
            d = UmbAnswer(umb_word(page, at + 1u), at_level, ordinal, at, UMB_NO_PAGE);
        }
        if at_level <= level {
            break;
        }
        let place = (word >> UMB_NODE_AT_SHIFT) & 0xFFFFu;
        if ((word >> UMB_NODE_PAGE_SHIFT) & 1u) == 0u {
            mask = (word >> UMB_NODE_MASK_SHIFT) & 0xFFu;
            group = place;
        } else {
            let child = umb_child_page(page, place);
            let next = umb_page(child);
            if !next.resident {
                d.missing = child;
                umb_request(child);
                break;
            }
            page = next;
            ordinal = child;
            mask = umb_root_mask(page);
            group = UMB_ROOT_GROUP;
        }
        at_level -= 1u;
    }
    umb_use(page.base);
    return d;
}
