// Walk of kind vector over the resident pages, and its entries. Twin of query/vector.rs: the same rules in the same
// order; what the bits mean stands in the format, from which the numbers of words, shifts and widths come.

// Bits of topology that say that a child has children.
const UMB_HAVE_CHILDREN: u32 = 0xAAAAAAAAu;

// Whether n words from word `at` on lie in a page; what does not wholly reads as 0.
fn umb_inside(page: UmbPage, at: u32, n: u32) -> bool {
    return at <= page.words && n <= page.words - at;
}

// A field of a page's header.
fn umb_header(page: UmbPage, word: u32, shift: u32, bits: u32) -> u32 {
    if !umb_inside(page, UMB_HEADER_AT, UMB_HEADER_WORDS) {
        return 0u;
    }
    return extractBits(umb_pool_word(page.base + UMB_HEADER_AT + word), shift, bits);
}

// Number n of those packed from word `at` on, `width` bits each, at most 32.
fn umb_packed(page: UmbPage, at: u32, width: u32, n: u32) -> u32 {
    let bit = n * width;
    let shift = bit % 32u;
    let first = at + bit / 32u;
    var v = umb_word(page, first) >> shift;
    if shift + width > 32u {
        v |= umb_word(page, first + 1u) << (32u - shift);
    }
    return extractBits(v, 0u, width);
}

// Where the walk is: a child of a group.
struct UmbVectorChild {
    // Types of the group's children; 0 on a stub.
    mask: u32,
    // The group of the child's own children, if it has some.
    below: u32,
    // Its index, if it has an entry.
    index: u32,
}

// Nodes with children among the types in a word of topology (x), and nodes with an entry (y).
fn umb_ranks(types: u32) -> vec2<u32> {
    // Of a leaf and an inner node the two bits differ.
    return vec2<u32>(
        countOneBits(types & UMB_HAVE_CHILDREN),
        countOneBits((types ^ (types << 1u)) & UMB_HAVE_CHILDREN),
    );
}

// Child c of group `number`.
fn umb_vector_child(page: UmbPage, number: u32, c: u32) -> UmbVectorChild {
    let at = UMB_TOPOLOGY + UMB_BLOCK_WORDS * (number / UMB_BLOCK_GROUPS);
    if !umb_inside(page, at, UMB_BLOCK_WORDS) {
        return UmbVectorChild(0u, 1u, 0u);
    }
    let block = page.base + at;
    let counts = umb_pool_word(block);
    var ranks = vec2<u32>(counts & 0xFFFFu, counts >> 16u);
    // The masks of 4 groups in a word.
    let last = (number % UMB_BLOCK_GROUPS) / 4u;
    for (var w = 0u; w < last; w++) {
        ranks += umb_ranks(umb_pool_word(block + 1u + w));
    }
    let own = umb_pool_word(block + 1u + last);
    let shift = 8u * (number % 4u);
    ranks += umb_ranks(own & ((1u << (shift + 2u * c)) - 1u));
    return UmbVectorChild((own >> shift) & 0xFFu, 1u + ranks.x, ranks.y);
}

// Where the sections of a page start, and where the classes of its palette begin.
struct UmbSections {
    indexes: u32,
    proofs: u32,
    lines: u32,
    constants: u32,
    planes: u32,
    splits: u32,
    masks: u32,
    raws: u32,
    first_plane: u32,
    first_split: u32,
    first_mask: u32,
    first_raw: u32,
    index_bits: u32,
    proven: bool,
    short_lines: bool,
}

fn umb_stubs(page: UmbPage) -> u32 {
    return extractBits(umb_word(page, UMB_FRAME_REFS_WORD), UMB_FRAME_REFS_SHIFT, UMB_FRAME_REFS_BITS);
}

fn umb_stubs_at(page: UmbPage) -> u32 {
    let groups = umb_header(page, UMB_GROUPS_WORD, UMB_GROUPS_SHIFT, UMB_GROUPS_BITS);
    return UMB_TOPOLOGY + UMB_BLOCK_WORDS * ((groups + UMB_BLOCK_GROUPS - 1u) / UMB_BLOCK_GROUPS);
}

// Place of a group in the list of stubs, UMB_NO_PAGE where it is not in it.
fn umb_stub(page: UmbPage, group: u32) -> u32 {
    let at = umb_stubs_at(page);
    let count = umb_stubs(page);
    var low = 0u;
    var high = count;
    while low < high {
        let middle = low + (high - low) / 2u;
        if umb_packed(page, at, 16u, middle) < group {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    if low < count && umb_packed(page, at, 16u, low) == group {
        return low;
    }
    return UMB_NO_PAGE;
}

// Numbers beyond 16 bits lie behind the end of every page.
fn umb_narrow(v: u32) -> u32 {
    return min(v, 0xFFFFu);
}

fn umb_sections(page: UmbPage) -> UmbSections {
    var s = UmbSections();
    let entries = umb_header(page, UMB_ENTRIES_WORD, UMB_ENTRIES_SHIFT, UMB_ENTRIES_BITS);
    let bits = umb_header(page, UMB_INDEX_BITS_WORD, UMB_INDEX_BITS_SHIFT, UMB_INDEX_BITS_BITS);
    let flags = umb_header(page, UMB_FLAGS_WORD, UMB_FLAGS_SHIFT, UMB_FLAGS_BITS);
    let constants = umb_header(page, UMB_CONSTANTS_WORD, UMB_CONSTANTS_SHIFT, UMB_CONSTANTS_BITS);
    let planes = umb_header(page, UMB_PLANES_WORD, UMB_PLANES_SHIFT, UMB_PLANES_BITS);
    let splits = umb_header(page, UMB_SPLITS_WORD, UMB_SPLITS_SHIFT, UMB_SPLITS_BITS);
    let masks = umb_header(page, UMB_MASKS_WORD, UMB_MASKS_SHIFT, UMB_MASKS_BITS);
    let lines = umb_header(page, UMB_LINES_WORD, UMB_LINES_SHIFT, UMB_LINES_BITS);
    s.proven = (flags & UMB_FLAG_PROOFS) != 0u;
    s.short_lines = (flags & UMB_FLAG_SHORT_LINES) != 0u;
    s.index_bits = bits & 31u;
    var at = umb_stubs_at(page) + (umb_stubs(page) + 1u) / 2u;
    s.indexes = umb_narrow(at);
    at += (entries * bits + 31u) / 32u;
    s.proofs = umb_narrow(at);
    at += select(0u, (entries + 31u) / 32u, s.proven);
    s.lines = umb_narrow(at);
    at += select(UMB_LINE_WORDS, UMB_SHORT_LINE_WORDS, s.short_lines) * lines;
    s.constants = umb_narrow(at);
    at += constants;
    s.planes = umb_narrow(at);
    at += UMB_PLANE_WORDS * planes;
    s.splits = umb_narrow(at);
    at += UMB_SPLIT_WORDS * splits;
    s.masks = umb_narrow(at);
    at += UMB_MASK_WORDS * masks;
    s.raws = umb_narrow(at);
    s.first_plane = constants;
    s.first_split = umb_narrow(constants + planes);
    s.first_mask = umb_narrow(constants + planes + splits);
    s.first_raw = umb_narrow(constants + planes + splits + masks);
    return s;
}

// Depth of the plane at word `at`. `place` is X and Y, 1/256 of a texel from the corner of the page's footprint.
fn umb_plane(page: UmbPage, at: u32, place: vec2<u32>) -> u32 {
    if !umb_inside(page, at, UMB_PLANE_WORDS) {
        return 0u;
    }
    let words = page.base + at;
    // Shift and slope in x share a word, those in y and the high bits of the offset the next.
    let first = umb_pool_word(words + UMB_PLANE_X_WORD);
    let second = umb_pool_word(words + UMB_PLANE_Y_WORD);
    var x = extractBits(bitcast<i32>(first), UMB_PLANE_X_SHIFT, UMB_PLANE_X_BITS);
    var y = extractBits(bitcast<i32>(second), UMB_PLANE_Y_SHIFT, UMB_PLANE_Y_BITS);
    var shift = extractBits(first, UMB_PLANE_SHIFT_SHIFT, UMB_PLANE_SHIFT_BITS);
    var high = bitcast<i32>(second) >> UMB_PLANE_HIGH_SHIFT;
    if (first >> 31u) != 0u {
        // A fine plane: of the slope in x the sign stands with that in y.
        let sign = extractBits(second, UMB_FINE_SLOPE_BITS, 1u);
        x = extractBits(bitcast<i32>(insertBits(first, sign, UMB_FINE_SLOPE_BITS - 1u, 1u)), 0u, UMB_FINE_SLOPE_BITS);
        y = extractBits(bitcast<i32>(second), 0u, UMB_FINE_SLOPE_BITS);
        shift = extractBits(first, UMB_FINE_SLOPE_BITS - 1u, 5u) + UMB_FINE_SHIFT;
        high = bitcast<i32>(second) >> (UMB_FINE_SLOPE_BITS + 1u);
    }
    let offset = vec2<u32>(umb_pool_word(words + UMB_PLANE_LOW_WORD), bitcast<u32>(high));
    let rise = umb_wide_sum(umb_wide_signed_product(x, place.x), umb_wide_signed_product(y, place.y));
    let v = umb_wide_sum(offset, umb_wide_shift(rise, shift));
    if bitcast<i32>(v.y) < 0 {
        return 0u;
    }
    return select(min(v.x, UMB_PLANE_MAX), UMB_PLANE_MAX, v.y != 0u);
}

// Whether a place lies beyond line `line`.
fn umb_beyond(page: UmbPage, s: UmbSections, line: u32, place: vec2<u32>) -> bool {
    var m = 0u;
    var low = 0u;
    var high = 0u;
    var axis = 0u;
    if s.short_lines {
        let at = s.lines + line * UMB_SHORT_LINE_WORDS;
        if umb_inside(page, at, UMB_SHORT_LINE_WORDS) {
            // The axis stands above half the slope.
            let first = umb_pool_word(page.base + at);
            m = first << 1u;
            axis = first >> 31u;
            low = umb_pool_word(page.base + at + 1u);
            high = bitcast<u32>(bitcast<i32>(low) >> 31u);
        }
    } else {
        let at = s.lines + line * UMB_LINE_WORDS;
        if umb_inside(page, at, UMB_LINE_WORDS) {
            m = umb_pool_word(page.base + at + UMB_LINE_M_WORD);
            low = umb_pool_word(page.base + at + UMB_LINE_LOW_WORD);
            let last = umb_pool_word(page.base + at + UMB_LINE_HIGH_WORD);
            axis = (last >> UMB_LINE_AXIS_SHIFT) & 1u;
            high = bitcast<u32>(extractBits(bitcast<i32>(last), UMB_LINE_HIGH_SHIFT, UMB_LINE_HIGH_BITS));
        }
    }
    let u = select(place.x, place.y, axis == 1u);
    let t = select(place.y, place.x, axis == 1u);
    let edge = umb_wide_sum(vec2<u32>(low, high), umb_wide_shift(umb_wide_signed_product(bitcast<i32>(m), u), 19u));
    return umb_wide_at_least(vec2<u32>(t << 12u, t >> 20u), edge);
}

// Value of entry `entry` of the palette at a place of the page.
fn umb_entry(page: UmbPage, s: UmbSections, entry: u32, place: vec2<u32>) -> u32 {
    var number = entry;
    // Of 4 x 4 texels.
    let cell = (((place.y >> 8u) & 3u) << 2u) | ((place.x >> 8u) & 3u);
    if number >= s.first_raw {
        let at = s.raws + (number - s.first_raw) * UMB_RAW_WORDS;
        if !umb_inside(page, at, UMB_RAW_WORDS) {
            return 0u;
        }
        let words = page.base + at;
        let first = extractBits(umb_pool_word(words + UMB_RAW_AT_WORD), UMB_RAW_AT_SHIFT, UMB_RAW_AT_BITS);
        let width = extractBits(umb_pool_word(words + UMB_RAW_WIDTH_WORD), UMB_RAW_WIDTH_SHIFT, UMB_RAW_WIDTH_BITS);
        let shift = extractBits(umb_pool_word(words + UMB_RAW_SHIFT_WORD), UMB_RAW_SHIFT_SHIFT, UMB_RAW_SHIFT_BITS);
        return umb_pool_word(words + UMB_RAW_BASE_WORD) + (umb_packed(page, first, min(width, 32u), cell) << shift);
    }
    if number >= s.first_mask {
        let at = s.masks + (number - s.first_mask) * UMB_MASK_WORDS;
        number = 0u;
        if umb_inside(page, at, UMB_MASK_WORDS) {
            let words = page.base + at;
            let selectors = umb_pool_word(words + UMB_MASK_SELECTORS_WORD);
            // Three fields of one width beside each other; a selector of 3 counts as 2.
            let n = min((selectors >> (2u * cell)) & 3u, 2u);
            number = extractBits(umb_pool_word(words + UMB_MASK_A_WORD), UMB_MASK_A_SHIFT + n * UMB_MASK_A_BITS, UMB_MASK_A_BITS);
        }
    } else {
        for (var depth = 0u; depth < UMB_MAX_DEPTH && number >= s.first_split; depth++) {
            let split = umb_word(page, s.splits + (number - s.first_split) * UMB_SPLIT_WORDS);
            let line = extractBits(split, UMB_SPLIT_LINE_SHIFT, UMB_SPLIT_LINE_BITS);
            if umb_beyond(page, s, line, place) {
                number = extractBits(split, UMB_SPLIT_B_SHIFT, UMB_SPLIT_B_BITS);
            } else {
                number = extractBits(split, UMB_SPLIT_A_SHIFT, UMB_SPLIT_A_BITS);
            }
        }
    }
    if number < s.first_plane {
        return umb_word(page, s.constants + number);
    }
    return umb_plane(page, s.planes + (number - s.first_plane) * UMB_PLANE_WORDS, place);
}

// Goes on towards texel (x, y) until a node of `level` or above has been visited or the walk has ended. The entry found
// is not evaluated yet.
fn umb_go_vector(from_walk: UmbWalk, x: u32, y: u32, level: u32) -> UmbWalk {
    var w = from_walk;
    for (var step = 0u; step < UMB_MAX_STEPS && !w.ended; step++) {
        if w.opens {
            if w.level <= level {
                break;
            }
            w.group = w.node;
            w.opens = false;
            w.level -= 1u;
        }
        let c = umb_child(x, y, w.level);
        var child = umb_vector_child(w.page, w.group, c);
        if child.mask == 0u && w.group != 0u {
            let place = umb_stub(w.page, w.group);
            if place == UMB_NO_PAGE {
                w.ended = true;
                break;
            }
            let below = umb_child_page(w.page, place);
            let next = umb_page(below);
            if !next.resident {
                w.d.missing = below;
                w.ended = true;
                break;
            }
            w.page = next;
            w.own = next.base;
            w.ordinal = below;
            w.group = 0u;
            child = umb_vector_child(next, 0u, c);
        }
        let kind = (child.mask >> (c * 2u)) & 3u;
        if kind == UMB_NODE_LEAF || kind == UMB_NODE_INNER {
            w.d = UmbAnswer(UMB_UNCOVERED, w.level, w.ordinal, 4u * w.group + c, UMB_NO_PAGE);
            w.found = true;
            w.entry_page = w.page;
            w.index = child.index;
        }
        w.node = child.below;
        w.opens = true;
        w.ended = kind == UMB_NODE_NONE || kind == UMB_NODE_LEAF;
    }
    return w;
}

// The bits of a texel's coordinates that count in a page's footprint: its side is twice that of the root group's nodes;
// the root page's is the map, and the bit above it 0.
fn umb_side_mask(page: UmbPage) -> u32 {
    let level = extractBits(umb_word(page, UMB_FRAME_LEVEL_WORD), UMB_FRAME_LEVEL_SHIFT, UMB_FRAME_LEVEL_BITS);
    return (2u << (level & 31u)) - 1u;
}

// Value at the centre of the texel of `level` around (x, y) by an entry of a page.
fn umb_vector_value(page: UmbPage, s: UmbSections, entry: u32, x: u32, y: u32, level: u32) -> u32 {
    let l = min(level, umb_top());
    let texel = (vec2<u32>(x, y) & vec2<u32>(umb_side_mask(page))) >> vec2<u32>(l);
    // In two steps: no shift is by 32.
    let corner = (texel << vec2<u32>(l)) << vec2<u32>(8u);
    return umb_entry(page, s, entry, corner + vec2<u32>(128u << l));
}

// Walks from root `root` to texel (x, y) at `level`, in a structure of kind vector.
fn umb_vector(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    var w = umb_go_vector(umb_start(root, 0u), x, y, level);
    umb_end(w);
    if w.found {
        let s = umb_sections(w.entry_page);
        let entry = umb_packed(w.entry_page, s.indexes, s.index_bits, w.index);
        w.d.value = umb_vector_value(w.entry_page, s, entry, x, y, level);
    }
    return w.d;
}

// Answer at a place inside texel (x, y), (fx, fy) 1/256 of a texel from its corner (the low 8 bits count): the entry's
// value there where it is proven over its whole square, else that of the texel.
fn umb_vector_continuous(root: u32, x: u32, y: u32, fx: u32, fy: u32) -> UmbAnswer {
    var w = umb_go_vector(umb_start(root, 0u), x, y, 0u);
    umb_end(w);
    if w.found {
        let page = w.entry_page;
        let s = umb_sections(page);
        let entry = umb_packed(page, s.indexes, s.index_bits, w.index);
        var sub = vec2<u32>(128u);
        if s.proven && ((umb_word(page, s.proofs + w.index / 32u) >> (w.index % 32u)) & 1u) == 1u {
            sub = vec2<u32>(fx, fy) & vec2<u32>(0xFFu);
        }
        let corner = (vec2<u32>(x, y) & vec2<u32>(umb_side_mask(page))) << vec2<u32>(8u);
        w.d.value = umb_entry(page, s, entry, corner | sub);
    }
    return w.d;
}
