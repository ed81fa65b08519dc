// Walk of kind mh over the resident pages. Twin of query/mh.rs: the same rules in the same order.

struct UmbAnswer {
    // The stored depth; UMB_UNCOVERED where there was no value.
    value: u32,
    // Level of the node that holds it.
    level: u32,
    // Page of that node.
    page: u32,
    // Word of that node in its page.
    word: u32,
    // The page that the walk needed and did not get, or UMB_NO_PAGE.
    missing: u32,
}

struct UmbPage {
    resident: bool,
    base: u32,
    words: u32,
    first_child: u32,
}

// A page by its ordinal. Whatever table and frame say, base + words does not leave the pool.
fn umb_page(ordinal: u32) -> UmbPage {
    if ordinal >= umb_view.pages {
        return UmbPage(false, 0u, 0u, 0u);
    }
    let entry = umb_table[ordinal];
    if entry.x >= umb_view.pool_words {
        return UmbPage(false, 0u, 0u, 0u);
    }
    let room = umb_view.pool_words - entry.x;
    var words = 0u;
    if UMB_FRAME_WORDS_WORD < room {
        words = (umb_pool[entry.x + UMB_FRAME_WORDS_WORD] >> UMB_FRAME_WORDS_SHIFT) & 0xFFFFu;
    }
    return UmbPage(true, entry.x, min(words, room), entry.y);
}

// A word of a page; 0 outside.
fn umb_word(page: UmbPage, at: u32) -> u32 {
    if at >= page.words {
        return 0u;
    }
    return umb_pool[page.base + at];
}

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

// Puts a page into the list of the missed, once a frame.
fn umb_request(ordinal: u32) {
    if ordinal >= umb_view.pages {
        return;
    }
    let word = UMB_FEEDBACK_LIST + umb_view.used_words + ordinal / 32u;
    let bit = 1u << (ordinal % 32u);
    // Most invocations of a frame miss the same few pages: look before writing.
    if (atomicLoad(&umb_feedback[word]) & bit) != 0u {
        return;
    }
    if (atomicOr(&umb_feedback[word], bit) & bit) != 0u {
        return;
    }
    let at = atomicAdd(&umb_feedback[0], 1u);
    if at < UMB_FEEDBACK_CAPACITY {
        atomicStore(&umb_feedback[UMB_FEEDBACK_HEAD + at], ordinal);
    }
}

// Notes that a walk ended in the page at this word of the pool.
fn umb_use(base: u32) {
    let unit = base / UMB_UNIT_WORDS;
    if unit / 32u >= umb_view.used_words {
        return;
    }
    let word = UMB_FEEDBACK_LIST + unit / 32u;
    let bit = 1u << (unit % 32u);
    if (atomicLoad(&umb_feedback[word]) & bit) == 0u {
        atomicOr(&umb_feedback[word], bit);
    }
}

// Walks from root `root` to texel (x, y) at `level`.
fn umb_mh(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    var d = UmbAnswer(UMB_UNCOVERED, umb_view.log2_resolution, root, 0u, UMB_NO_PAGE);
    var page = umb_page(root);
    if !page.resident {
        d.missing = root;
        umb_request(root);
        return d;
    }
    var ordinal = root;
    var mask = umb_root_mask(page);
    var group = UMB_ROOT_GROUP;
    var at_level = min(umb_view.log2_resolution, UMB_MAX_LOG2);
    for (var step = 0u; step < UMB_MAX_STEPS; step++) {
        let c = ((x >> at_level) & 1u) | (((y >> at_level) & 1u) << 1u);
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
            let child = page.first_child + min(place, 0xFFFFFFFFu - page.first_child);
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

// Light or shadow for a receiver in texel (x, y) at lattice depth `depth`, rounded up: UMB_LIT, UMB_ANCESTOR,
// UMB_OUTSIDE, UMB_EXACT as bits, level and word of the answering node above them.
fn umb_mh_state(d: UmbAnswer, depth: u32) -> u32 {
    var state = (d.level << UMB_LEVEL_SHIFT) | (d.word << UMB_WORD_SHIFT);
    if depth <= d.value {
        state |= UMB_LIT;
    }
    if d.missing == UMB_NO_PAGE {
        state |= UMB_EXACT;
    } else {
        state |= UMB_ANCESTOR;
    }
    return state;
}

// Whether a texel lies outside the map.
fn umb_outside(x: u32, y: u32) -> bool {
    let log2 = min(umb_view.log2_resolution, UMB_MAX_LOG2);
    return (x >> log2) != 0u || (y >> log2) != 0u;
}
