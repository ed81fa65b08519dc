//! The WGSL of the queries: modules without entry points, behind constants made from the format's own.
//!
//! [`module`] is what an engine puts in front of its own shader: the constants, the bindings in a group of the
//! caller's choice, and the walks. It takes 3 storage buffers and a uniform, which leaves the caller one of the four
//! that every device has. [`kernels`] adds the entry points that this crate dispatches itself. Where a pool is larger than a
//! device binds in one buffer it lies in several, of which the module knows by [`module_over`].
//!
//! What a shader calls:
//!
//! - `umb_select(number)`: which structure all of the following ask, 0 before the first call;
//! - `umb_locate(lattice, point)`: texel and depth of a point;
//! - `umb_shadow(root, x, y, level, depth)`: light or shadow for a receiver, from what is resident; asks for a page only where
//!   what the index says of it does not settle the receiver;
//! - `umb_answer(root, x, y, level)`: the value at a texel, by the structure's kind; `umb_mh`, `umb_mmh`, `umb_vector` where the
//!   kind is known beforehand, which don't ask for the page that was missing (`umb_want` does);
//! - `umb_continuous(root, x, y, sub)`, `umb_vector_continuous`: the answer at a place inside a texel;
//! - `umb_pcf(root, receiver, side, level)`, `umb_trilinear`, `umb_share_state`: percentage-closer filtering;
//! - `umb_state(answer, depth)`: light or shadow, and how far to trust it.
//!
//! | binding | buffer |
//! |---|---|
//! | 0 | `umb_pool`: the words of the pages, each page from its entry's word; in kind `mmh` behind a page the ordinals that it depends on |
//! | 1 | `umb_table`: for each page an [`Entry`](crate::residency::Entry) |
//! | 2 | `umb_feedback`: what walks missed and used, see [`FEEDBACK_USED`] |
//! | 3 | `umb_view`: sizes and structures, the uniform [`View`] |
//! | 4, … | `umb_pool_1`, …: further pieces of the pool, where there are any |
//!
//! Pages are named by their places in the table, which all structures share.

mod constants;

pub use constants::prelude;

/// Words of a page table entry.
pub const TABLE_ENTRY_WORDS: u32 = 4;
/// Words before the table of the missed: how many distinct pages are in it, how many queries an ancestor answered, how
/// many times a page found no place in it, and by how many levels the coarsest answer of an ancestor was too coarse.
pub const FEEDBACK_HEAD: u32 = 4;
/// Binary logarithm of the slots of the table of the missed.
pub const FEEDBACK_LOG2: u32 = 12;
/// Slots of the table of the missed, two words each: 1 + the page's ordinal, 0 where it is free; and the sum of what the
/// receivers that missed it lose on the screen, at most about [`MOST_WEIGHT`].
pub const FEEDBACK_SLOTS: u32 = 1 << FEEDBACK_LOG2;
/// Slots that a page is looked for in, one behind the other.
pub const FEEDBACK_PROBES: u32 = 8;
/// Words of head and table of the missed; behind them one bit for each unit of the pool that was used.
pub const FEEDBACK_USED: u32 = FEEDBACK_HEAD + 2 * FEEDBACK_SLOTS;
/// A page that weighs so much gets no heavier: all receivers of a frame may miss the same one, and each would wait for its
/// turn to say so.
pub const MOST_WEIGHT: u32 = 1 << 16;
/// Most that one receiver adds, as a power of two: the levels that its answer is too coarse.
pub const MOST_GAP: u32 = 8;
/// Most structures at a time.
pub const MAPS: u32 = 256;
/// Most stale rectangles of all structures.
pub const STALE_RECTS: u32 = 64;
/// Most buffers of the pool: with table, feedback and two of the caller's they are the 8 of WebGPU's default limits.
pub const MOST_POOLS: u32 = 4;
/// Invocations of a workgroup in [`kernels`].
pub const WORKGROUP: u32 = 64;

/// Declares a uniform of words once, for both languages.
macro_rules! uniform {
    ($(#[doc = $doc:literal])+ $name:ident { $($(#[doc = $fdoc:literal])+ $field:ident,)+ }) => {
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        pub struct $name {
            $($(#[doc = $fdoc])+ pub $field: u32,)+
        }

        impl $name {
            /// The struct in WGSL.
            fn wgsl() -> String {
                concat!("struct Umb", stringify!($name), " {\n", $("    ", stringify!($field), ": u32,\n",)+ "}\n").into()
            }
        }
    };
}

uniform! {
    /// What the device knows of a structure.
    Map {
        /// Place of its first page in the table.
        base,
        /// Levels below the root.
        log2_resolution,
        /// Code of its kind; 0: there is none, or its roots have not come.
        kind,
        /// 1: pages that the index settles are not asked for.
        skips,
        /// Error in lattice steps up to which the index may settle a receiver by what stands above a page.
        error,
        /// Its first stale rectangle.
        stale_first,
        /// Its stale rectangles.
        stale_count,
        /// Zero.
        unused,
    }
}

uniform! {
    /// Texels of the finest level from one corner to another, ends excluded.
    Rect {
        /// First column.
        x0,
        /// First row.
        y0,
        /// Column behind the last.
        x1,
        /// Row behind the last.
        y1,
    }
}

impl Map {
    /// No structure.
    pub const NONE: Self =
        Self { base: 0, log2_resolution: 0, kind: 0, skips: 0, error: 0, stale_first: 0, stale_count: 0, unused: 0 };
}

impl Rect {
    /// Whether it has no texel.
    pub fn is_empty(&self) -> bool {
        self.x0 >= self.x1 || self.y0 >= self.y1
    }

    /// Whether a texel lies in it.
    pub fn contains(&self, [x, y]: [u32; 2]) -> bool {
        (self.x0..self.x1).contains(&x) && (self.y0..self.y1).contains(&y)
    }

    /// The smallest one that holds both.
    pub fn union(&self, o: Self) -> Self {
        Self { x0: self.x0.min(o.x0), y0: self.y0.min(o.y0), x1: self.x1.max(o.x1), y1: self.y1.max(o.y1) }
    }

    /// Its texels.
    pub fn area(&self) -> u64 {
        u64::from(self.x1.saturating_sub(self.x0)) * u64::from(self.y1.saturating_sub(self.y0))
    }
}

/// Sizes of the other buffers, and all structures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct View {
    /// Words of the pool.
    pub pool_words: u32,
    /// Entries of the page table.
    pub pages: u32,
    /// Words of the feedback's used bits.
    pub used_words: u32,
    /// Binary logarithm of the words in each buffer of the pool but the last, where it lies in several.
    pub piece_log2: u32,
    /// The structures by number.
    pub maps: [Map; MAPS as usize],
    /// Stale rectangles of all of them.
    pub stale: [Rect; STALE_RECTS as usize],
}

impl View {
    /// Tells of structures and of the stale rectangles that they refer to; what goes beyond the lists is left out.
    pub fn tell(&mut self, maps: &[Map], stale: &[Rect]) {
        (self.maps, self.stale) =
            ([Map::NONE; MAPS as usize], [Rect { x0: 0, y0: 0, x1: 0, y1: 0 }; STALE_RECTS as usize]);
        self.maps.iter_mut().zip(maps).for_each(|(to, from)| *to = *from);
        self.stale.iter_mut().zip(stale).for_each(|(to, from)| *to = *from);
    }

    fn wgsl() -> String {
        let own =
            "struct UmbView {\n    pool_words: u32,\n    pages: u32,\n    used_words: u32,\n    piece_log2: u32,\n";
        let lists = "    maps: array<UmbMap, UMB_MAPS>,\n    stale: array<UmbRect, UMB_STALE_RECTS>,\n}\n";
        [Map::wgsl(), Rect::wgsl(), own.into(), lists.into()].concat()
    }
}

/// What every module holds, in order.
const SOURCES: [&str; 8] = [
    include_str!("query/pool.wgsl"),
    include_str!("query/mh.wgsl"),
    include_str!("query/mmh.wgsl"),
    include_str!("wide.wgsl"),
    include_str!("query/vector.wgsl"),
    include_str!("query/answer.wgsl"),
    include_str!("query/filter.wgsl"),
    include_str!("lattice.wgsl"),
];
const KERNELS: &str = include_str!("kernel.wgsl");

/// Binding of a buffer of the pool.
pub const fn pool_binding(piece: u32) -> u32 {
    if piece == 0 { 0 } else { 3 + piece }
}

/// Bindings of the module in bind group `group`, the pool in `pools` buffers.
fn bindings(group: u32, pools: u32) -> String {
    let declare = |binding, what: &str| format!("@group({group}) @binding({binding}) {what};\n");
    let further = |i| declare(pool_binding(i), &format!("var<storage, read> umb_pool_{i}: array<u32>"));
    [
        View::wgsl(),
        declare(0, "var<storage, read> umb_pool: array<u32>"),
        declare(1, "var<storage, read> umb_table: array<vec4<u32>>"),
        declare(2, "var<storage, read_write> umb_feedback: array<atomic<u32>>"),
        declare(3, "var<uniform> umb_view: UmbView"),
        (1..pools).map(further).collect(),
        pool_word(pools),
    ]
    .concat()
}

/// How a word of the pool is read.
fn pool_word(pools: u32) -> String {
    let body = if pools <= 1 {
        "    return umb_pool[at];\n".to_string()
    } else {
        let piece = |i| format!("    if piece == {i}u {{\n        return umb_pool_{i}[word];\n    }}\n");
        [
            "    let piece = at >> umb_view.piece_log2;\n    let word = at & ((1u << umb_view.piece_log2) - 1u);\n"
                .into(),
            (1..pools).map(piece).collect(),
            "    return umb_pool[word];\n".to_string(),
        ]
        .concat()
    };
    format!("fn umb_pool_word(at: u32) -> u32 {{\n{body}}}\n")
}

/// Source of the queries for the caller's shader: constants, bindings in group `group`, functions.
pub fn module(group: u32) -> String {
    module_over(group, 1)
}

/// [`module`] for a pool that lies in `pools` buffers, at most [`MOST_POOLS`].
pub fn module_over(group: u32, pools: u32) -> String {
    [prelude(), bindings(group, pools), SOURCES.concat()].concat()
}

/// [`module_over`] in group 0 with the entry points `answer`, `pixels` and `filtered`, whose buffers are in group 1.
pub fn kernels(pools: u32) -> String {
    [&module_over(0, pools), KERNELS].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Engines of other APIs take the module through naga: it is valid WGSL, and both HLSL and SPIR-V come out.
    #[test]
    fn the_kernels_translate_to_hlsl_and_spir_v() {
        for pools in 1..=MOST_POOLS {
            translates(pools);
        }
    }

    fn translates(pools: u32) {
        let module = naga::front::wgsl::parse_str(&kernels(pools)).unwrap();
        let flags = naga::valid::ValidationFlags::all();
        let info = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty()).validate(&module).unwrap();
        let mut text = String::new();
        let options = naga::back::hlsl::Options::default();
        let pipeline = naga::back::hlsl::PipelineOptions::default();
        naga::back::hlsl::Writer::new(&mut text, &options, &pipeline).write(&module, &info, None).unwrap();
        for name in [
            "umb_answer(",
            "umb_shadow(",
            "umb_mh(",
            "umb_mmh(",
            "umb_vector(",
            "umb_vector_continuous(",
            "umb_locate(",
            "umb_pcf(",
            "umb_trilinear(",
            "InterlockedOr",
        ] {
            assert!(text.contains(name), "{name}");
        }
        let words = naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None).unwrap();
        assert!(words.len() > 500);
        let storage =
            module.global_variables.iter().filter(|(_, v)| matches!(v.space, naga::AddressSpace::Storage { .. }));
        assert_eq!(storage.count(), 3 + pools as usize);
    }

    /// The walk's source has no entry point, so that a caller can join it with any shader.
    #[test]
    fn the_module_has_no_entry_point() {
        assert!(!module(2).contains("@compute") && module(2).contains("@group(2) @binding(0)"));
        assert_eq!(kernels(1).matches("@compute").count(), 3);
    }
}
