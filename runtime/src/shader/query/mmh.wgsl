// Walk of kind mmh over the resident pages. Twin of query/mmh.rs: the same rules in the same order.

// Ordinal of dependency `d` of a page: the list lies behind its words. UMB_NO_PAGE outside the pool.
fn umb_dependency(page: UmbPage, d: u32) -> u32 {
    let at = page.words + d;
    if at >= umb_view.pool_words - page.base {
        return UMB_NO_PAGE;
    }
    return umb_pool_word(page.base + at);
}

// Walks from root `root` to texel (x, y) at `level` and adds up the rises on its way, in a structure of kind mmh.
fn umb_mmh(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    let w = umb_go_mmh(umb_start(root, UMB_ROOT_GROUP), x, y, level);
    umb_end(w);
    return w.d;
}

// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended.
fn umb_go_mmh(from_walk: UmbWalk, x: u32, y: u32, level: u32) -> UmbWalk {
    var w = from_walk;
    for (var step = 0u; step < UMB_MAX_STEPS && !w.ended; step++) {
        if w.opens {
            if w.level <= level {
                break;
            }
            let place = (w.node >> UMB_RISE_PLACE_SHIFT) & UMB_RISE_PLACE_MASK;
            w.group = (w.node >> UMB_NODE_AT_SHIFT) & 0xFFFFu;
            w.mask = (w.node >> UMB_NODE_MASK_SHIFT) & 0xFFu;
            if place != UMB_RISE_HERE {
                var there = umb_child_page(w.page, w.group);
                if place != UMB_RISE_PAGE {
                    there = umb_dependency(w.page, place - UMB_RISE_SHARED);
                }
                let next = umb_page(there);
                if !next.resident {
                    w.d.missing = there;
                    w.ended = true;
                    break;
                }
                w.page = next;
                w.ordinal = there;
                if place == UMB_RISE_PAGE {
                    w.own = next.base;
                    w.mask = umb_root_mask(next);
                    w.group = UMB_ROOT_GROUP;
                }
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
        if kind == UMB_NODE_LEAF || kind == UMB_NODE_INNER {
            w.sum += select(umb_word(w.page, at + 1u), word, kind == UMB_NODE_LEAF);
            w.d = UmbAnswer(w.sum, w.level, w.ordinal, at, UMB_NO_PAGE);
        }
        w.node = word;
        w.opens = true;
        w.ended = kind == UMB_NODE_LEAF;
    }
    return w;
}
