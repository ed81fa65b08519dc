//! The runtime against the reader and against its CPU twin, on a real driver: Mesa's software Vulkan is enough, and a
//! machine without one fails here with the line that installs it.

mod agree;
mod bare;
#[path = "../../examples/engine.rs"]
mod engine;
mod faults;
mod filter;
mod later;
mod moving;
mod parity;
mod pieces;
mod remote;
mod server;
mod several;
mod skip;
mod steady;
mod support;
// The naive tree of the reader's tests, and files made of it.
#[allow(dead_code)]
#[path = "../../../reader/tests/suite/tree.rs"]
mod tree;
// The naive tree of kind `vector`.
#[allow(dead_code)]
#[path = "../../../reader/tests/suite/mmh_tree.rs"]
mod mmh_tree;
#[allow(dead_code, reason = "of the reader's tests, which use all of it")]
#[path = "../../../reader/tests/suite/vector_tree.rs"]
mod vector_tree;
mod view;
#[path = "../../examples/walk.rs"]
mod walk;
