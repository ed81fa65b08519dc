// Walk of kind mmh over the resident pages. Twin of query/mmh.rs: the same rules in the same order.

// Ordinal of dependency `d` of a page: the list lies behind its words. UMB_NO_PAGE outside the pool.
fn umb_dependency(page: UmbPage, d: u32) -> u32 {
    let at = page.words + d;
    if at >= umb_view.pool_words - page.base {
        return UMB_NO_PAGE;
    }
    return umb_pool[page.base + at];
}

// Walks from root `root` to texel (x, y) at `level` and adds up the rises on its way, in a structure of kind mmh.
fn umb_mmh(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    var d = umb_nothing(root);
    var page = umb_page(root);
    if !page.resident {
        d.missing = root;
        umb_request(root);
        return d;
    }
    // Of the pages with a place in the map the last: it keeps those that it depends on.
    var own = page.base;
    var ordinal = root;
    var mask = umb_root_mask(page);
    var group = UMB_ROOT_GROUP;
    var at_level = umb_top();
    var sum = 0u;
    for (var step = 0u; step < UMB_MAX_STEPS; step++) {
        let c = umb_child(x, y, at_level);
        let kind = (mask >> (c * 2u)) & 3u;
        if kind == UMB_NODE_NONE {
            break;
        }
        let at = group + umb_words_before(mask, c);
        let word = umb_word(page, at);
        if kind == UMB_NODE_LEAF {
            d = UmbAnswer(sum + word, at_level, ordinal, at, UMB_NO_PAGE);
            break;
        }
        if kind == UMB_NODE_INNER {
            sum += umb_word(page, at + 1u);
            d = UmbAnswer(sum, at_level, ordinal, at, UMB_NO_PAGE);
        }
        if at_level <= level {
            break;
        }
        let place = (word >> UMB_RISE_PLACE_SHIFT) & UMB_RISE_PLACE_MASK;
        group = (word >> UMB_NODE_AT_SHIFT) & 0xFFFFu;
        mask = (word >> UMB_NODE_MASK_SHIFT) & 0xFFu;
        if place != UMB_RISE_HERE {
            var there = umb_child_page(page, group);
            if place != UMB_RISE_PAGE {
                there = umb_dependency(page, place - UMB_RISE_SHARED);
            }
            let next = umb_page(there);
            if !next.resident {
                d.missing = there;
                umb_request(there);
                break;
            }
            page = next;
            ordinal = there;
            if place == UMB_RISE_PAGE {
                own = page.base;
                mask = umb_root_mask(page);
                group = UMB_ROOT_GROUP;
            }
        }
        at_level -= 1u;
    }
    umb_use(own);
    return d;
}
