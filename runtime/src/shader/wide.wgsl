// 64-bit integers as pairs of words, the low one in x: no device needs 64-bit integers of its own. What overflows wraps.

// a * b, both without sign.
fn umb_wide_product(a: u32, b: u32) -> vec2<u32> {
    let low = (a & 0xFFFFu) * (b & 0xFFFFu);
    let first = (a >> 16u) * (b & 0xFFFFu);
    let second = (a & 0xFFFFu) * (b >> 16u);
    let middle = (low >> 16u) + (first & 0xFFFFu) + (second & 0xFFFFu);
    return vec2<u32>(a * b, (a >> 16u) * (b >> 16u) + (first >> 16u) + (second >> 16u) + (middle >> 16u));
}

// a * b, a with sign.
fn umb_wide_signed_product(a: i32, b: u32) -> vec2<u32> {
    let product = umb_wide_product(bitcast<u32>(a), b);
    // Without its sign a is 2^32 more.
    return vec2<u32>(product.x, product.y - select(0u, b, a < 0));
}

fn umb_wide_sum(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2<u32>(low, a.y + b.y + u32(low < a.x));
}

fn umb_wide_negative(v: vec2<u32>) -> vec2<u32> {
    return umb_wide_sum(~v, vec2<u32>(1u, 0u));
}

// floor(v / 2^shift), v with sign, shift from 0 to 63.
fn umb_wide_shift(v: vec2<u32>, shift: u32) -> vec2<u32> {
    let high = bitcast<i32>(v.y);
    let by = shift & 31u;
    if shift >= 32u {
        return vec2<u32>(bitcast<u32>(high >> by), bitcast<u32>(high >> 31u));
    }
    // In two steps, as no shift is by 32.
    return vec2<u32>((v.x >> by) | ((v.y << 1u) << (31u - by)), bitcast<u32>(high >> by));
}

// a >= b, both with sign.
fn umb_wide_at_least(a: vec2<u32>, b: vec2<u32>) -> bool {
    if a.y != b.y {
        return bitcast<i32>(a.y) > bitcast<i32>(b.y);
    }
    return a.x >= b.x;
}
