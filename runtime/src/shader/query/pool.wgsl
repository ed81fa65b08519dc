// What the walks of all kinds share: pages in the pool, the feedback, what an answer is. Twin of query/pool.rs: the same
// rules in the same order.

struct UmbAnswer {
    // The depth; UMB_UNCOVERED where there was no value.
    value: u32,
    // Level of the node that it comes from.
    level: u32,
    // Page of that node.
    page: u32,
    // That node in its page: its word in mh and mmh, its number 4 * group + c in vector.
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

// The structure that is asked.
var<private> umb_selected: u32 = 0u;

// From now on structure `number` is asked.
fn umb_select(number: u32) {
    umb_selected = min(number, UMB_MAPS - 1u);
}

// Place of root `root` in the table. No structure has the place at which this saturates.
fn umb_root(root: u32) -> u32 {
    let base = umb_view.maps[umb_selected].base;
    return base + min(root, 0xFFFFFFFFu - base);
}

// UMB_STALE where what was baked for a texel is out of date, else 0.
fn umb_stale(x: u32, y: u32) -> u32 {
    let first = umb_view.maps[umb_selected].stale_first;
    let count = min(umb_view.maps[umb_selected].stale_count, UMB_STALE_RECTS);
    for (var i = 0u; i < count; i++) {
        let rect = umb_view.stale[min(first + i, UMB_STALE_RECTS - 1u)];
        if x >= rect.x0 && x < rect.x1 && y >= rect.y0 && y < rect.y1 {
            return UMB_STALE;
        }
    }
    return 0u;
}

// A page by its place in the table. Whatever table and frame say, base + words does not leave the pool.
fn umb_page(ordinal: u32) -> UmbPage {
    if ordinal >= umb_view.pages {
        return UmbPage(false, 0u, 0u, 0u);
    }
    let entry = umb_table[ordinal].xy;
    if entry.x >= umb_view.pool_words {
        return UmbPage(false, 0u, 0u, 0u);
    }
    let room = umb_view.pool_words - entry.x;
    var words = 0u;
    if UMB_FRAME_WORDS_WORD < room {
        words = (umb_pool_word(entry.x + UMB_FRAME_WORDS_WORD) >> UMB_FRAME_WORDS_SHIFT) & 0xFFFFu;
    }
    return UmbPage(true, entry.x, min(words, room), entry.y);
}

// A word of a page; 0 outside.
fn umb_word(page: UmbPage, at: u32) -> u32 {
    if at >= page.words {
        return 0u;
    }
    return umb_pool_word(page.base + at);
}

// Puts a page that a receiver missed into the table of the missed, `weight` being what the receiver loses on the screen.
fn umb_request(ordinal: u32, weight: u32) {
    if ordinal >= umb_view.pages {
        return;
    }
    let key = ordinal + 1u;
    // Multiplicative hashing: the ordinals of children follow one another.
    let first = (ordinal * 0x9E3779B1u) >> (32u - UMB_FEEDBACK_LOG2);
    for (var probe = 0u; probe < UMB_FEEDBACK_PROBES; probe++) {
        let at = UMB_FEEDBACK_HEAD + 2u * ((first + probe) % UMB_FEEDBACK_SLOTS);
        // Most invocations of a frame miss the same few pages: look before writing.
        var found = atomicLoad(&umb_feedback[at]);
        // The exchange may fail for no reason; once more is enough but for a listing lost until the next frame.
        for (var turn = 0u; turn < 2u && found == 0u; turn++) {
            let exchange = atomicCompareExchangeWeak(&umb_feedback[at], 0u, key);
            found = exchange.old_value;
            if exchange.exchanged {
                atomicAdd(&umb_feedback[0], 1u);
                found = key;
            }
        }
        if found == key {
            if atomicLoad(&umb_feedback[at + 1u]) < UMB_MOST_WEIGHT {
                atomicAdd(&umb_feedback[at + 1u], weight);
            }
            return;
        }
    }
    atomicAdd(&umb_feedback[2], 1u);
}

// Asks for the page that a walk missed on its way to `level`. Each level that the answer is too coarse doubles how far it is
// off on the screen.
fn umb_want(d: UmbAnswer, level: u32) {
    if d.missing != UMB_NO_PAGE {
        let gap = d.level - min(d.level, level);
        umb_request(d.missing, 1u << min(gap, UMB_MOST_GAP));
        if atomicLoad(&umb_feedback[3]) < gap {
            atomicMax(&umb_feedback[3], gap);
        }
    }
}

// Notes that a walk ended in the page at this word of the pool.
fn umb_use(base: u32) {
    let unit = base / UMB_UNIT_WORDS;
    if unit / 32u >= umb_view.used_words {
        return;
    }
    let word = UMB_FEEDBACK_USED + unit / 32u;
    let bit = 1u << (unit % 32u);
    if (atomicLoad(&umb_feedback[word]) & bit) == 0u {
        atomicOr(&umb_feedback[word], bit);
    }
}

// Level of the root.
fn umb_top() -> u32 {
    return min(umb_view.maps[umb_selected].log2_resolution, UMB_MAX_LOG2);
}

// What a walk from a root knows before its first page.
fn umb_nothing(root: u32) -> UmbAnswer {
    return UmbAnswer(UMB_UNCOVERED, umb_view.maps[umb_selected].log2_resolution, umb_root(root), 0u, UMB_NO_PAGE);
}

// Which child a texel lies in, of a group of nodes at `level`.
fn umb_child(x: u32, y: u32, level: u32) -> u32 {
    return ((x >> level) & 1u) | (((y >> level) & 1u) << 1u);
}

// Child page `place` of a page. No structure has the ordinal at which this saturates.
fn umb_child_page(page: UmbPage, place: u32) -> u32 {
    return page.first_child + min(place, 0xFFFFFFFFu - page.first_child);
}

// A walk on its way, in a structure of any kind.
struct UmbWalk {
    // The answer so far; in kind vector without its value.
    d: UmbAnswer,
    page: UmbPage,
    // First word of the page that is noted as used: in mmh the last with a place in the map, which keeps those that it
    // depends on.
    own: u32,
    ordinal: u32,
    // The next group, and in mh and mmh its types, unless a node has been visited that must be opened first.
    mask: u32,
    group: u32,
    // Level of the next group or of that node.
    level: u32,
    // That node: its word, in vector the group below it.
    node: u32,
    opens: bool,
    ended: bool,
    // Rises so far, in mmh.
    sum: u32,
    // What gives the value, in vector.
    found: bool,
    entry_page: UmbPage,
    index: u32,
}

// A walk at the group of a root, which is `group` in its page.
fn umb_start(root: u32, group: u32) -> UmbWalk {
    var d = umb_nothing(root);
    let first = d.page;
    let page = umb_page(first);
    if !page.resident {
        d.missing = first;
    }
    let mask = (umb_word(page, UMB_FRAME_MASK_WORD) >> UMB_FRAME_MASK_SHIFT) & 0xFFu;
    return UmbWalk(d, page, page.base, first, mask, group, umb_top(), 0u, false, !page.resident, 0u, false, page, 0u);
}

// Notes the page that a walk has come to.
fn umb_end(w: UmbWalk) {
    if w.page.resident {
        umb_use(w.own);
    }
}

// What the index says of a page that is missing: at most the depth `lit` all receivers are lit, beyond `dark` none is; and
// whether what stands above the page is good enough between.
struct UmbBounds {
    lit: u32,
    dark: u32,
    suffices: bool,
    known: bool,
}

fn umb_bounds(ordinal: u32) -> UmbBounds {
    if umb_view.maps[umb_selected].skips == 0u || ordinal >= umb_view.pages {
        return UmbBounds(0u, 0u, false, false);
    }
    let entry = umb_table[ordinal];
    let error = umb_view.maps[umb_selected].error;
    let suffices = error != 0u && entry.y <= error;
    return UmbBounds(entry.z, entry.w, suffices, entry.x == UMB_NOT_RESIDENT);
}

// Light or shadow for a receiver at lattice depth `depth`, rounded up, in texel (x, y) at `level`, in a structure of any
// kind: a state as of umb_state. UMB_SETTLED: a page was missing and not needed.
fn umb_shadow(root: u32, x: u32, y: u32, level: u32, depth: u32) -> u32 {
    if umb_outside(x, y) {
        return UMB_LIT | UMB_OUTSIDE | UMB_EXACT;
    }
    let d = umb_walk(root, x, y, level);
    var state = umb_state(d, depth) | umb_stale(x, y);
    if d.missing == UMB_NO_PAGE {
        return state;
    }
    let bounds = umb_bounds(d.missing);
    let above = bounds.known && depth <= bounds.lit;
    let below = bounds.known && depth > bounds.dark;
    if !above && !below && !(bounds.known && bounds.suffices) {
        umb_want(d, level);
        return state;
    }
    if above {
        state |= UMB_LIT;
    } else if below {
        state &= ~UMB_LIT;
    }
    return (state & ~UMB_ANCESTOR) | UMB_EXACT | UMB_SETTLED;
}

// Light or shadow for a receiver in the answer's texel at lattice depth `depth`, rounded up: UMB_LIT, UMB_ANCESTOR,
// UMB_OUTSIDE, UMB_EXACT as bits, level and word of the answering node above them.
fn umb_state(d: UmbAnswer, depth: u32) -> u32 {
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
    return (x >> umb_top()) != 0u || (y >> umb_top()) != 0u;
}
