//! Writer and reader against each other and against naive models, in one binary.
//!
//! - `tree`: a naive quadtree, its lookup, and the simplest pager; files made of it;
//! - `round_trip`: what was written is read back and answers as the naive tree does;
//! - `vector_tree`, `vector`: the same for kind `vector`;
//! - `mmh_tree`, `mmh`: the same for kind `mmh`;
//! - `hostile`: truncations, flipped bits, repaired checksums, hand-made breaches;
//! - `filter`: filters against their definition;
//! - `later`: pages of kinds that come later travel unchanged;
//! - `target`: what the writer does when the target is no good.

mod filter;
mod hostile;
mod later;
mod mmh;
#[allow(dead_code, reason = "the workspace's tests and the fuzz targets make trees of it, too")]
mod mmh_tree;
mod round_trip;
mod target;
mod tree;
mod vector;
#[allow(dead_code, reason = "the workspace's tests and the fuzz targets make trees of it, too")]
mod vector_tree;
