// A picture of the snapped mesh with the shadows that are resident, in two passes: which triangle each pixel sees, then
// one receiver and one colour for each pixel. The colours are those of render/shade.rs, whose constants stand in front.

struct Picture {
    // The eye on the lattice: whole steps, and what is left; bits of a step below a texel; near plane, world units.
    eye: vec3<u32>,
    subtexel_bits: u32,
    rest: vec3<f32>,
    near: f32,
    // From lattice steps beyond the eye: clip x, y and w.
    clip: array<vec4<f32>, 3>,
    // Way of a pixel's ray at the upper left corner and what a pixel across and one down add: on the lattice, in the world.
    ray: array<vec4<f32>, 3>,
    sky: array<vec4<f32>, 3>,
    // From lattice covectors to world ones. Their w: world lengths of a lattice step along x, y and depth.
    world: array<vec4<f32>, 3>,
    // Unit vectors of the world: way of the light, with the steepest rise that filters follow, in lattice steps of depth for one
    // step across, in w; up.
    light: vec4<f32>,
    up: vec4<f32>,
    // How to look the map up, taps on a side, what to lay over the picture, number of the structure.
    look: vec4<u32>,
    // Word of the mesh at which triangles begin, texels on a side as a power of two.
    triangles: u32,
    log2_resolution: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> picture: Picture;
// Positions, three words each; then triangles, the numbers of three positions and of a solid.
@group(0) @binding(1) var<storage, read> mesh: array<u32>;
@group(0) @binding(2) var ids: texture_2d<u32>;

// A whole number less the eye's, exact but for the rounding of one conversion.
fn beyond(value: u32, eye: u32) -> f32 {
    return select(-f32(eye - value), f32(value - eye), value >= eye);
}

fn position(number: u32) -> vec3<u32> {
    return vec3<u32>(mesh[3u * number], mesh[3u * number + 1u], mesh[3u * number + 2u]);
}

fn from_eye(p: vec3<u32>) -> vec3<f32> {
    let e = picture.eye;
    return vec3<f32>(beyond(p.x, e.x), beyond(p.y, e.y), beyond(p.z, e.z)) - picture.rest;
}

fn edge(to_corner: vec3<u32>, own: vec3<u32>) -> vec3<f32> {
    return vec3<f32>(beyond(to_corner.x, own.x), beyond(to_corner.y, own.y), beyond(to_corner.z, own.z));
}

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) id: u32,
}

// 1 and the triangle's number; 0 is the sky.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let triangle = index / 3u;
    let p = from_eye(position(mesh[picture.triangles + 4u * triangle + index % 3u]));
    let c = picture.clip;
    // Depth from 1 near to 0 far away.
    let clip = vec4<f32>(dot(c[0].xyz, p), dot(c[1].xyz, p), picture.near, dot(c[2].xyz, p));
    return Corner(clip, triangle + 1u);
}

@fragment
fn identify(in: Corner) -> @location(0) u32 {
    return in.id;
}

@vertex
fn whole(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// Where a pixel's ray meets its triangle's plane.
struct Point {
    // Lattice steps beyond the eye.
    place: vec3<f32>,
    // On the lattice; not of length 1.
    normal: vec3<f32>,
    // Rise of depth for one step along x and y; 0 where the light sees the plane edge-on.
    slope: vec2<f32>,
    // Bound of what the place may be off in depth, on the plane.
    off: f32,
}

fn size_in_world(p: vec3<f32>) -> f32 {
    return length(p * vec3<f32>(picture.world[0].w, picture.world[1].w, picture.world[2].w));
}

// The magnitudes that cancel in the components of a cross product.
fn cancelled(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return abs(a.yzx * b.zxy) + abs(a.zxy * b.yzx);
}

// What rounds less than 4 times is off by at most this part.
const ROUNDED: f32 = 2.3841858e-7;

fn point(triangle: u32, way: vec3<f32>) -> Point {
    let first = picture.triangles + 4u * triangle;
    let a = position(mesh[first]);
    let b = position(mesh[first + 1u]);
    let c = position(mesh[first + 2u]);
    let edges = array<vec3<f32>, 2>(edge(b, a), edge(c, a));
    let normal = cross(edges[0], edges[1]);
    // From the nearest corner: the less is rounded.
    var near = from_eye(a);
    let others = array<vec3<f32>, 2>(from_eye(b), from_eye(c));
    for (var i = 0; i < 2; i++) {
        if size_in_world(others[i]) < size_in_world(near) {
            near = others[i];
        }
    }
    let t = dot(normal, near) / dot(normal, way);
    // Seen edge-on: a corner is as good as any place.
    let met = select(near, way * t, t > 0.0 && t < 1e30);
    let first_corner = from_eye(a);
    let low = min(first_corner, min(others[0], others[1]));
    let place = clamp(met, low, max(first_corner, max(others[0], others[1])));
    var slope = vec2<f32>(0.0);
    var slope_off = vec2<f32>(0.0);
    if normal.z != 0.0 {
        let steepest = vec2<f32>(picture.light.w);
        slope = clamp(-normal.xy / normal.z, -steepest, steepest);
        // Thin triangles have normals of few digits.
        let lost = cancelled(edges[0], edges[1]) * (ROUNDED / abs(normal.z));
        slope_off = min(lost.xy + abs(slope) * lost.z, steepest);
    }
    let reach = abs(place) + abs(near);
    let off = (dot(abs(slope), reach.xy) + reach.z) * (2.0 * ROUNDED) + dot(slope_off, abs(place - near).xy);
    return Point(place, normal, slope, off);
}

struct Site {
    x: u32,
    y: u32,
    // Rounded up, less what it may be off.
    depth: u32,
    inside: bool,
    // 1/256 texel.
    sub: vec2<u32>,
}

// A whole number and steps from there, rounded down; whether it is still one of 32 bits.
fn step_from(base: u32, steps: f32) -> vec2<u32> {
    let size = u32(min(abs(steps), 4294967040.0));
    if steps < 0.0 {
        return vec2<u32>(base - min(base, size), u32(size <= base));
    }
    let room = 0xFFFFFFFFu - base;
    return vec2<u32>(base + min(room, size), u32(size <= room));
}

fn site(p: Point) -> Site {
    let at = p.place + picture.rest;
    let x = step_from(picture.eye.x, floor(at.x));
    let y = step_from(picture.eye.y, floor(at.y));
    let depth = step_from(picture.eye.z, ceil(at.z - p.off)).x;
    let bits = picture.subtexel_bits;
    let texel = vec2<u32>(x.x, y.x) >> vec2<u32>(bits);
    let inside = x.y * y.y != 0u && ((texel.x | texel.y) >> picture.log2_resolution) == 0u;
    let sub = (vec2<u32>(x.x, y.x) >> vec2<u32>(bits - 8u)) & vec2<u32>(255u);
    return Site(texel.x, texel.y, depth, inside, sub);
}

// Level of detail in 1/256: the pixel's footprint, from where the rays of its neighbours meet the plane. Twin of
// render/filter.rs.
fn level_of_detail(p: Point, way: vec3<f32>) -> u32 {
    let height = dot(p.normal, p.place);
    var larger = 0.0;
    for (var i = 1; i < 3; i++) {
        let next = way + picture.ray[i].xyz;
        let t = height / dot(p.normal, next);
        if !(t > 0.0) || t > 1e30 {
            return picture.log2_resolution << UMB_LOD_BITS;
        }
        larger = max(larger, length((next * t - p.place).xy));
    }
    let texels = larger * exp2(-f32(picture.subtexel_bits));
    let lod = clamp(log2(texels), 0.0, f32(picture.log2_resolution));
    return u32(round(lod * f32(1u << UMB_LOD_BITS)));
}

fn receiver(p: Point, s: Site) -> UmbReceiver {
    let texel = exp2(f32(picture.subtexel_bits) + f32(UMB_GRADIENT_BITS));
    let gradient = vec2<i32>(clamp(round(p.slope * texel), vec2<f32>(-2147483000.0), vec2<f32>(2147483000.0)));
    return UmbReceiver(s.x, s.y, s.depth, gradient);
}

// What the map says of a receiver.
struct Light {
    // Share of sunlight.
    lit: f32,
    // Of the receiver's own texel: state, page that answers, page that is missing.
    state: u32,
    page: u32,
    missing: u32,
    level: u32,
}

fn light_at(p: Point, s: Site, lod: u32) -> Light {
    umb_select(picture.look.w);
    let mode = picture.look.x;
    let nearest = (lod + (1u << (UMB_LOD_BITS - 1u))) >> UMB_LOD_BITS;
    var light = Light(1.0, UMB_LIT | UMB_OUTSIDE | UMB_EXACT, UMB_NO_PAGE, UMB_NO_PAGE, 0u);
    if !s.inside {
        return light;
    }
    var level = 0u;
    if mode == LOOK_HARD {
        light.state = umb_shadow(0u, s.x, s.y, 0u, s.depth);
        light.lit = f32(light.state & UMB_LIT) / f32(UMB_LIT);
    } else if mode == LOOK_PLACE {
        light.state = umb_state(umb_continuous(0u, s.x, s.y, s.sub), s.depth) | umb_stale(s.x, s.y);
        light.lit = f32(light.state & UMB_LIT) / f32(UMB_LIT);
    } else {
        var at = lod;
        if mode == LOOK_PCF {
            at = 0u;
        } else if mode == LOOK_HPCF {
            at = nearest << UMB_LOD_BITS;
        }
        level = at >> UMB_LOD_BITS;
        let share = umb_trilinear(0u, receiver(p, s), picture.look.y, at);
        light.state = umb_share_state(share) & (UMB_EXACT | UMB_ANCESTOR | UMB_OUTSIDE | UMB_STALE);
        light.lit = f32(share.lit) / f32(share.taps);
    }
    if (light.state & UMB_EXACT) == 0u {
        atomicAdd(&umb_feedback[1], 1u);
    }
    if picture.look.z != OVERLAY_NONE {
        let d = umb_walk(0u, s.x, s.y, level);
        light.page = d.page;
        light.missing = d.missing;
        light.level = d.level;
    }
    return light;
}

// A hue for a number; neighbours are told apart.
fn hue(number: u32) -> vec3<f32> {
    let h = fract(f32(number % 4096u) * 0.61803399) * 6.0;
    return clamp(abs(vec3<f32>(h, (h + 4.0) % 6.0, (h + 2.0) % 6.0) - vec3<f32>(3.0)) - vec3<f32>(1.0), vec3<f32>(0.08), vec3<f32>(1.0));
}

// What is laid over the picture, and how much it hides.
fn overlay(l: Light, s: Site) -> vec4<f32> {
    let over = picture.look.z;
    if (l.state & UMB_OUTSIDE) != 0u {
        return vec4<f32>(0.3, 0.3, 0.3, 0.7);
    }
    if over == OVERLAY_RESIDENCY {
        if (l.state & UMB_STALE) != 0u {
            return vec4<f32>(0.5, 0.1, 0.6, 0.7);
        }
        if (l.state & UMB_EXACT) == 0u {
            // The coarser, the redder.
            return vec4<f32>(0.9, 0.55 / (1.0 + f32(l.level)), 0.02, 0.75);
        }
        // Answered without a page that is not there: the index was enough.
        if l.missing != UMB_NO_PAGE {
            return vec4<f32>(0.05, 0.45, 0.75, 0.6);
        }
        return vec4<f32>(0.1, 0.5, 0.12, 0.5);
    }
    if over == OVERLAY_LEVEL {
        return vec4<f32>(hue(l.level), 0.6);
    }
    if over == OVERLAY_MISSING {
        if l.missing == UMB_NO_PAGE {
            return vec4<f32>(0.02, 0.02, 0.02, 0.75);
        }
        return vec4<f32>(hue(l.missing), 0.8);
    }
    if over == OVERLAY_PAGES {
        return vec4<f32>(hue(l.page), 0.6);
    }
    let cell = (vec2<u32>(s.x, s.y) >> vec2<u32>(l.level)) & vec2<u32>(1u);
    return vec4<f32>(vec3<f32>(f32(cell.x ^ cell.y)), 0.4);
}

// Linear light to sRGB, as render/shade.rs.
fn encoded(colour: vec3<f32>) -> vec4<f32> {
    let v = clamp(colour, vec3<f32>(0.0), vec3<f32>(1.0));
    return vec4<f32>(select(1.055 * pow(v, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * v, v <= vec3<f32>(0.0031308)), 1.0);
}

@fragment
fn resolve(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let id = textureLoad(ids, vec2<i32>(at.xy), 0).x;
    let ray = normalize(picture.sky[0].xyz + at.x * picture.sky[1].xyz + at.y * picture.sky[2].xyz);
    if id == 0u {
        return encoded(mix(HORIZON, ZENITH, sqrt(clamp(dot(ray, picture.up.xyz), 0.0, 1.0))));
    }
    let way = picture.ray[0].xyz + at.x * picture.ray[1].xyz + at.y * picture.ray[2].xyz;
    let p = point(id - 1u, way);
    // Lattice steps are powers of many ten: scaled before anything is squared.
    let scaled = p.normal / max(max(abs(p.normal.x), abs(p.normal.y)), max(abs(p.normal.z), 1e-30));
    var normal = normalize(scaled.x * picture.world[0].xyz + scaled.y * picture.world[1].xyz + scaled.z * picture.world[2].xyz);
    if dot(normal, ray) > 0.0 {
        normal = -normal;
    }
    let sun = max(-dot(normal, picture.light.xyz), 0.0);
    let s = site(p);
    var light = Light(0.0, UMB_EXACT, UMB_NO_PAGE, UMB_NO_PAGE, 0u);
    // What the light can't reach asks for no page.
    if sun > 0.0 {
        light = light_at(p, s, level_of_detail(p, way));
    }
    var palette = PALETTE;
    let base = palette[mesh[picture.triangles + 4u * (id - 1u) + 3u] % PALETTE_SIZE];
    let dome = mix(GROUND, SKY, 0.5 + 0.5 * dot(normal, picture.up.xyz));
    var colour = base * (dome + SUN * (sun * light.lit));
    if picture.look.z != OVERLAY_NONE && sun > 0.0 {
        let over = overlay(light, s);
        colour = mix(colour, over.xyz, over.w);
    }
    return encoded(colour);
}
