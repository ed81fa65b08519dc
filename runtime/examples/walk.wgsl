// A picture of a baked city and of something that moves in it. Positions are relative to the camera.

struct Picture {
    clip: mat4x4<f32>,
    // World to the small shadow map: across and down 0 to 1, depth along the light 0 to 1.
    near: mat4x4<f32>,
    // Way of the light; lattice steps of depth that a position may be off.
    light: vec4<f32>,
}

@group(1) @binding(0) var<uniform> picture: Picture;
@group(1) @binding(1) var<uniform> sun: UmbLattice;
@group(1) @binding(2) var near_map: texture_depth_2d;
@group(1) @binding(3) var near_sampler: sampler_comparison;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) place: vec3<f32>,
    // Its w is 1 for what moves.
    @location(1) @interpolate(flat) normal: vec4<f32>,
}

@vertex
fn corner(@location(0) place: vec3<f32>, @location(1) normal: vec4<f32>) -> Corner {
    return Corner(picture.clip * vec4<f32>(place, 1.0), place, normal);
}

// Of what moves, into the small map. A caster behind the end of the map is as good as one at its end.
@vertex
fn caster(@location(0) place: vec3<f32>, @location(1) normal: vec4<f32>) -> @builtin(position) vec4<f32> {
    let p = picture.near * vec4<f32>(place, 1.0);
    return vec4<f32>(2.0 * p.x - 1.0, 1.0 - 2.0 * p.y, p.z, 1.0);
}

const FACES: u32 = 1u;
const BAKED: u32 = 2u;
const NEAR: u32 = 4u;
const MOVES: u32 = 8u;

// Out: place, and as bits whether it faces the light, whether the baked map and the small one let light through, and whether
// it belongs to what moves; the cosine in 1/255 from bit 8 on.
@fragment
fn shade(in: Corner) -> @location(0) vec4<f32> {
    let cosine = -dot(in.normal.xyz, picture.light.xyz);
    let at = umb_locate(sun, in.place);
    // What a float is off must not throw a shadow on itself.
    let depth = at.depth - min(at.depth, u32(picture.light.w));
    let state = umb_shadow(0u, at.x, at.y, 0u, depth);
    var bits = 0u;
    if cosine > 0.0 {
        bits |= FACES;
    }
    if !at.inside || (state & UMB_LIT) != 0u {
        bits |= BAKED;
    }
    let p = (picture.near * vec4<f32>(in.place, 1.0)).xyz;
    let reaches = all(p.xy > vec2<f32>(0.0)) && all(p.xy < vec2<f32>(1.0)) && p.z > 0.0;
    // The back faces of what moves are in the map: its own light side is never behind them.
    let free = textureSampleCompareLevel(near_map, near_sampler, p.xy, min(p.z, 1.0));
    if !reaches || free > 0.5 {
        bits |= NEAR;
    }
    if in.normal.w != 0.0 {
        bits |= MOVES;
    }
    return vec4<f32>(in.place, f32(bits | (u32(clamp(cosine, 0.0, 1.0) * 255.0) << 8u)));
}
