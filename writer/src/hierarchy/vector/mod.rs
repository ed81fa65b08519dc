//! Kind `vector`: a quadtree whose leaves are planes and silhouettes (spec/vector.md).
//!
//! Read in this order: [`entry`] (what a node may hold, in map coordinates), [`search`] (one entry for a whole square,
//! proven; its `continuous`: what that says between texel
//! centres), [`texels`] (blocks of 4 x 4 texels looked at one by one), [`raw`] (depths for those that few entries answer), [`build`] (the recursion), [`page`] (cutting into pages).

pub mod build;
pub mod entry;
pub mod page;
pub mod raw;
pub mod search;
pub mod segment;
pub mod texels;
