// Percentage-closer filtering (Scandolo et al. 2016, section 3.3): the lit ones of N x N texels of a level around a
// receiver's. Twin of query/filter.rs; what a tap is stands in umbrage_reader::query::filter.

struct UmbReceiver {
    // Texel of level 0.
    x: u32,
    y: u32,
    // Lattice depth, rounded up.
    depth: u32,
    // Rise of its plane from a texel of level 0 to the next, 1/16 lattice step.
    gradient: vec2<i32>,
}

struct UmbShare {
    // Lit taps of `taps`; of a blend each counts 256.
    lit: u32,
    taps: u32,
    inside: bool,
    // A page that a tap needed, did not get and could not do without, or UMB_NO_PAGE: ancestors answered for a part of the taps.
    missing: u32,
    // UMB_STALE where the receiver's texel is out of date, else 0.
    stale: u32,
}

// Goes on by the structure's kind; one that has no walk ends as one whose root is missing.
fn umb_go(from_walk: UmbWalk, x: u32, y: u32, level: u32) -> UmbWalk {
    if umb_view.maps[umb_selected].kind == UMB_KIND_VECTOR {
        return umb_go_vector(from_walk, x, y, level);
    }
    if umb_view.maps[umb_selected].kind == UMB_KIND_MH {
        return umb_go_mh(from_walk, x, y, level);
    }
    if umb_view.maps[umb_selected].kind == UMB_KIND_MMH {
        return umb_go_mmh(from_walk, x, y, level);
    }
    var w = from_walk;
    w.d.missing = w.d.page;
    w.ended = true;
    return w;
}

// Rise of the plane from texel `own` of level 0 to that one under texel v of `level` where it is nearest to the light.
fn umb_rise(gradient: i32, v: u32, own: u32, level: u32) -> vec2<u32> {
    let corner = (v << level) + select(0u, (1u << level) - 1u, gradient < 0);
    let steps = i32(corner) - i32(own);
    let way = umb_wide_signed_product(gradient, u32(abs(steps)));
    if steps < 0 {
        return umb_wide_negative(way);
    }
    return way;
}

// Taps of side `side` (1 to UMB_MAX_SIDE) on `level` around a receiver, on root `root`: together to their lowest common
// node (figure 5), then those below each of its children together to theirs, then each by itself, unless a node answers
// all. The second node is never more levels above its taps than a square as large as the kernel needs.
fn umb_pcf(root: u32, r: UmbReceiver, side: u32, level: u32) -> UmbShare {
    let n = clamp(side, 1u, UMB_MAX_SIDE);
    if umb_outside(r.x, r.y) {
        return UmbShare(n * n, n * n, false, UMB_NO_PAGE, 0u);
    }
    let l = min(level, umb_top());
    let own = vec2<u32>(r.x, r.y) >> vec2<u32>(l);
    let low = own - min(own, vec2<u32>(n / 2u));
    let high = min(own + vec2<u32>(n - 1u - n / 2u), vec2<u32>((1u << (umb_top() - l)) - 1u));
    let is_vector = umb_view.maps[umb_selected].kind == UMB_KIND_VECTOR;
    let levels = umb_common_levels(low, high);
    let together = umb_go(
        umb_start(root, select(UMB_ROOT_GROUP, 0u, is_vector)), low.x << l, low.y << l, l + levels,
    );
    umb_end(together);
    // Taps outside the map are lit.
    let size = high - low + vec2<u32>(1u);
    var share = UmbShare(n * n - size.x * size.y, n * n, true, UMB_NO_PAGE, umb_stale(r.x, r.y));
    // A node that answers all has one part.
    let shift = select(max(levels, 1u) - 1u, levels, together.ended);
    let first = low >> vec2<u32>(shift);
    let last = high >> vec2<u32>(shift);
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let corner = vec2<u32>(column, row) << vec2<u32>(shift);
            let from_texel = max(low, corner);
            let to_texel = min(high, corner + vec2<u32>((1u << shift) - 1u));
            let w = umb_go(
                together, from_texel.x << l, from_texel.y << l, l + umb_common_levels(from_texel, to_texel),
            );
            let found = umb_part(w, r, from_texel, to_texel, l);
            share.lit += found.x;
            share.missing = min(share.missing, found.y);
        }
    }
    return share;
}

// Levels from two texels up to their lowest common node, by the bits in which they differ.
fn umb_common_levels(a: vec2<u32>, b: vec2<u32>) -> u32 {
    return 32u - countLeadingZeros((a.x ^ b.x) | (a.y ^ b.y));
}

// Lit taps of a part that a walk has come to, and a page that was missing and is needed.
fn umb_part(
    together: UmbWalk, r: UmbReceiver, low: vec2<u32>, high: vec2<u32>, l: u32,
) -> vec2<u32> {
    var lit = 0u;
    var missing = UMB_NO_PAGE;
    // The page that is missing, what the index says of it, and whether it has been asked for.
    var absent = UMB_NO_PAGE;
    var bounds = UmbBounds();
    var asked = false;
    // The entry that was decoded last, kind vector.
    var page = together.entry_page;
    var index = UMB_NO_PAGE;
    var sections = UmbSections();
    var entry = 0u;
    let depth = vec2<u32>(r.depth << UMB_GRADIENT_BITS, r.depth >> (32u - UMB_GRADIENT_BITS));
    for (var y = low.y; y <= high.y; y++) {
        let row = umb_wide_sum(depth, umb_rise(r.gradient.y, y, r.y, l));
        for (var x = low.x; x <= high.x; x++) {
            var w = together;
            if !w.ended {
                w = umb_go(w, x << l, y << l, l);
                umb_end(w);
            }
            var value = w.d.value;
            if w.found {
                if w.index != index || w.entry_page.base != page.base {
                    page = w.entry_page;
                    index = w.index;
                    sections = umb_sections(page);
                    entry = umb_packed(page, sections.indexes, sections.index_bits, index);
                }
                value = umb_vector_value(page, sections, entry, x << l, y << l, l);
            }
            let tap = umb_wide_sum(row, umb_rise(r.gradient.x, x, r.x, l));
            var is_lit = umb_tap_lit(value, tap);
            if w.d.missing != UMB_NO_PAGE {
                if w.d.missing != absent {
                    absent = w.d.missing;
                    bounds = umb_bounds(absent);
                    asked = false;
                }
                let above = bounds.known && umb_tap_lit(bounds.lit, tap);
                let below = bounds.known && !above && !umb_tap_lit(bounds.dark, tap);
                is_lit = above || (is_lit && !below);
                if !above && !below && !(bounds.known && bounds.suffices) {
                    missing = min(missing, absent);
                    if !asked {
                        asked = true;
                        umb_want(w.d, l);
                    }
                }
            }
            lit += u32(is_lit);
        }
    }
    umb_end(together);
    return vec2<u32>(lit, missing);
}

// Whether `value` lights a tap at a depth in 1/16 step.
fn umb_tap_lit(value: u32, tap: vec2<u32>) -> bool {
    let limit = vec2<u32>(value << UMB_GRADIENT_BITS, value >> (32u - UMB_GRADIENT_BITS));
    return value == UMB_UNCOVERED || umb_wide_at_least(limit, tap);
}

// The same between two levels, `lod` in 1/256 level: both are blended.
fn umb_trilinear(root: u32, r: UmbReceiver, side: u32, lod: u32) -> UmbShare {
    let level = min(min(lod >> UMB_LOD_BITS, 255u), umb_top());
    let part = lod & ((1u << UMB_LOD_BITS) - 1u);
    let finer = umb_pcf(root, r, side, level);
    var coarser = finer;
    if part != 0u && level < umb_top() {
        coarser = umb_pcf(root, r, side, level + 1u);
    }
    let lit = finer.lit * ((1u << UMB_LOD_BITS) - part) + coarser.lit * part;
    let missing = min(finer.missing, coarser.missing);
    return UmbShare(lit, finer.taps << UMB_LOD_BITS, finer.inside, missing, finer.stale);
}

// UMB_LIT (all taps), UMB_ANCESTOR, UMB_OUTSIDE, UMB_EXACT, UMB_STALE as bits, the lit taps above them.
fn umb_share_state(share: UmbShare) -> u32 {
    var state = (share.lit << UMB_SHARE_SHIFT) | select(UMB_ANCESTOR, UMB_EXACT, share.missing == UMB_NO_PAGE);
    state |= share.stale;
    if share.lit == share.taps {
        state |= UMB_LIT;
    }
    if !share.inside {
        state |= UMB_OUTSIDE;
    }
    return state;
}
