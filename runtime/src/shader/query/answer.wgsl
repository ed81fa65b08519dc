// The walk for the structure's kind. Twin of query/pool.rs.

// Walks from root `root` to texel (x, y) at `level`. A kind that has no walk answers as one whose root is missing.
fn umb_walk(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    if umb_view.maps[umb_selected].kind == UMB_KIND_VECTOR {
        return umb_vector(root, x, y, level);
    }
    if umb_view.maps[umb_selected].kind == UMB_KIND_MH {
        return umb_mh(root, x, y, level);
    }
    if umb_view.maps[umb_selected].kind == UMB_KIND_MMH {
        return umb_mmh(root, x, y, level);
    }
    var d = umb_nothing(root);
    d.missing = d.page;
    return d;
}

// The value at texel (x, y) of `level`; asks for the page that was missing.
fn umb_answer(root: u32, x: u32, y: u32, level: u32) -> UmbAnswer {
    let d = umb_walk(root, x, y, level);
    umb_want(d, level);
    return d;
}

// Answer at a place inside texel (x, y), `sub` 1/256 of a texel from its corner; in kinds mh and mmh the texel's own.
fn umb_continuous(root: u32, x: u32, y: u32, sub: vec2<u32>) -> UmbAnswer {
    if umb_view.maps[umb_selected].kind == UMB_KIND_VECTOR {
        let d = umb_vector_continuous(root, x, y, sub.x, sub.y);
        umb_want(d, 0u);
        return d;
    }
    return umb_answer(root, x, y, 0u);
}
