//! Other people's methods, each from the same depth intervals as the product's kinds: what it takes, how fast it answers,
//! how often it is wrong. They are here to be measured and stay out of the product.
//!
//! | File | Method |
//! |---|---|
//! | [`image`] | the input: intervals of all texels |
//! | [`scanline`] | Arvo & Hirvikorpi 2005: line segments along scan lines |
//! | [`plane_tree`] | Myers 2016: quadtree with planes |
//! | [`voxel_dag`] | Sintorn et al. 2014, Kämpe et al. 2015: voxels in and out of shadow |
//! | [`depth_dag`] | Scandolo & Eisemann 2021: merged topology of MH, depths apart |
//! | [`unpadded`] | Scandolo, Bauszat & Eisemann 2016: MH without the bytes that align its nodes |
//! | [`plain`] | an array, tiles compressed with zstd, and the product's own kinds |
//! | [`tree`] | MH in memory, for the two above |
//! | [`error`] | what is wrong in a method's answers |

pub mod depth_dag;
pub mod error;
pub mod image;
pub mod plain;
pub mod plane_tree;
pub mod scanline;
pub mod tree;
pub mod unpadded;
pub mod voxel_dag;

/// One method with its data.
pub trait Baseline: Sync {
    /// In tables.
    fn name(&self) -> String;

    /// Where it is described.
    fn citation(&self) -> &'static str;

    /// Bytes of all that a lookup needs, headers and indices included.
    fn bytes(&self) -> u64;

    /// The depth that stands for a texel; none where a method has no depths.
    fn value(&self, x: u32, y: u32) -> Option<u32>;

    /// Whether a receiver at lattice depth `d` is lit.
    fn lit(&self, x: u32, y: u32, d: u32) -> bool;

    /// Looks up all receivers (x, y, d): how many are lit. A method's own loop, so that no call stands between lookups.
    fn count(&self, receivers: &[[u32; 3]]) -> usize;

    /// Whether a lookup unpacks much more than it asks for: then few of them are timed.
    fn is_slow(&self) -> bool {
        false
    }
}

/// Lookups without a call through a table in between.
#[inline(always)]
fn count(receivers: &[[u32; 3]], lit: impl Fn(u32, u32, u32) -> bool) -> usize {
    receivers.iter().filter(|[x, y, d]| lit(*x, *y, *d)).count()
}

/// The methods of a depth per texel: `value_of(x, y)` does the work.
macro_rules! answers_by_value {
    () => {
        fn value(&self, x: u32, y: u32) -> Option<u32> {
            Some(self.value_of(x, y))
        }

        fn lit(&self, x: u32, y: u32, d: u32) -> bool {
            d <= self.value_of(x, y)
        }

        fn count(&self, receivers: &[[u32; 3]]) -> usize {
            crate::baseline::count(receivers, |x, y, d| d <= self.value_of(x, y))
        }
    };
}
use answers_by_value;

#[cfg(test)]
mod tests {
    use umbrage::writer::interval::Interval;
    use umbrage::writer::solid::{self, Policy, SnappedMesh};
    use umbrage::writer::{bake, scene};

    use super::image::Image;

    /// A small city under the demo's light.
    pub fn city(side: u64) -> (SnappedMesh, Image) {
        of("city:3:0.05", Policy::Closed, side)
    }

    /// A generated scene under the demo's light.
    pub fn of(name: &str, policy: Policy, side: u64) -> (SnappedMesh, Image) {
        let mesh = scene::generated(name).expect("generated").expect("a scene");
        let light = bake::Light { name: "sun".to_string(), direction: scene::DEMO_LIGHT };
        let lattice = bake::lattice(&mesh, &light, side, policy).expect("a lattice");
        let snapped = solid::snap(&mesh, lattice, policy).expect("a solid");
        let image = Image::of(&snapped, 300);
        (snapped, image)
    }

    /// Intervals by hand: `of` says those of a texel.
    pub fn made(log2: u32, of: impl Fn(usize, usize) -> [u32; 2]) -> Image {
        let side = 1usize << log2;
        let one = |i: usize| {
            let [min, max] = of(i % side, i / side);
            Interval { min, max }
        };
        Image::new(log2, (0..side * side).map(one).collect())
    }
}
