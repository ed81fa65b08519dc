// From a point relative to the camera to integers of the lattice. Twin of lattice.rs, which states the error bound.

// What a frame uploads for one light.
struct UmbLattice {
    // Rows of the 3x4: texels, texels, depth units; input relative to the camera, output to `base`.
    row_x: vec4<f32>,
    row_y: vec4<f32>,
    row_depth: vec4<f32>,
    // Texel x, texel y (signed), depth (unsigned) of the base, texels on a side.
    base: vec4<u32>,
}

struct UmbPlace {
    x: u32,
    y: u32,
    // Depth rounded up, clamped to 32 bits.
    depth: u32,
    inside: bool,
}

fn umb_row(row: vec4<f32>, p: vec3<f32>) -> f32 {
    return ((row.x * p.x + row.y * p.y) + row.z * p.z) + row.w;
}

fn umb_locate(lattice: UmbLattice, p: vec3<f32>) -> UmbPlace {
    let limit = 1073741824.0;
    let tx = bitcast<i32>(lattice.base.x) + i32(clamp(floor(umb_row(lattice.row_x, p)), -limit, limit));
    let ty = bitcast<i32>(lattice.base.y) + i32(clamp(floor(umb_row(lattice.row_y, p)), -limit, limit));
    let side = i32(lattice.base.w);
    let inside = tx >= 0 && ty >= 0 && tx < side && ty < side;
    // Magnitude and sign apart: an i32 does not hold the difference of two depths.
    let d = clamp(ceil(umb_row(lattice.row_depth, p)), -4294967040.0, 4294967040.0);
    let size = u32(abs(d));
    var depth = lattice.base.z;
    if d < 0.0 {
        depth -= min(depth, size);
    } else {
        depth += min(0xFFFFFFFFu - depth, size);
    }
    return UmbPlace(u32(max(tx, 0)), u32(max(ty, 0)), depth, inside);
}
