//! Fuzz targets, each with a claim beyond 'no crash'. A target is a function of bytes, so that the kept inputs in
//! `corpus` also run as an ordinary test on a stable compiler.
//!
//! - [`open`]: a file that is accepted answers every texel of every level, lazily and preloaded alike;
//! - [`page`]: `mh::check` accepts just what a naive walk accepts, and every node it counts is found by a lookup; a
//!   `vector` page that is accepted answers at every node as plain arithmetic on its words does ([`vector_page`]), an `mmh` page
//!   as a plain recursion does ([`mmh_page`]);
//! - [`cold`]: any bytes decode to nothing or to the words asked for, and any words come back from their cold form;
//! - [`roundtrip`]: intervals and trees come back from the file as a naive evaluation has them, at every level;
//! - [`query_agrees`]: on the device an accepted file gives the reader's answers, to the bit;
//! - [`scene`]: a mesh file that is accepted is a sound mesh that can be baked; refusals are one line;
//! - [`layers`]: an OpenEXR file that is accepted bakes to a sound file whose values are in the layers' intervals;
//! - [`intervals`]: the baker's tree holds what the exact oracle allows, with the oracle's counts.
//!
//! ```text
//! cargo +nightly fuzz run --fuzz-dir tests/fuzz TARGET -- -max_total_time=120     from the root of the repository
//! cargo test --manifest-path tests/fuzz/Cargo.toml                                the kept inputs, any compiler
//! cargo run --manifest-path tests/fuzz/Cargo.toml --example seeds                 makes the kept seeds again
//! ```
#![forbid(unsafe_code)]

pub mod cold;
pub mod input;
pub mod intervals;
pub mod layers;
pub mod mmh_page;
pub mod open;
pub mod page;
pub mod query_agrees;
pub mod roundtrip;
pub mod scene;
pub mod vector_page;

// The comparison of the runtime's parity test.
#[path = "../../../runtime/tests/suite/agree.rs"]
#[allow(missing_docs)]
mod agree;
#[path = "../../../reader/tests/suite/mmh_tree.rs"]
#[allow(dead_code, missing_docs)]
mod mmh_tree;
#[path = "../../../reader/tests/suite/tree.rs"]
#[allow(dead_code, missing_docs)]
mod tree;

#[path = "../../../reader/tests/suite/vector_tree.rs"]
#[allow(dead_code, missing_docs)]
mod vector_tree;
