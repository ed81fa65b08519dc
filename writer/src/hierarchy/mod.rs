//! From depth intervals to a tree of pages.
//!
//! [`mh`] merges four children into a node (the paper's algorithm 2), [`top`] chooses values from above (algorithm 1); [`build`] runs over the map and asks
//! [`crate::interval`] for the truth; [`layers`] takes it from a depth source instead; [`page`] cuts the tree into
//! pages and writes their words; [`spool`] holds them until all are there; [`mmh`] merges a whole tree before it is cut.

pub mod build;
pub mod layers;
pub mod mh;
pub mod mmh;
pub mod page;
pub mod spool;
pub mod top;
pub mod vector;
