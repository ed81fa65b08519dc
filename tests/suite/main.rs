//! Tests of the workspace as a whole, in one binary.

mod cli;
mod cold;
mod continuous;
#[path = "../../examples/depth_source.rs"]
mod depth_source;
mod filter;
mod flips;
mod golden;
mod intervals;
mod layers;
mod limits;
mod losing;
mod masks;
mod mmh;
#[allow(dead_code, reason = "of the reader's tests, which use all of it")]
#[path = "../../reader/tests/suite/mmh_tree.rs"]
mod mmh_tree;
mod openexr;
mod python;
mod remote;
mod round_trip;
#[allow(dead_code, reason = "of the runtime's tests, which use all of it")]
#[path = "../../runtime/tests/suite/server.rs"]
mod server;
mod skip;
mod spec;
mod stability;
#[allow(dead_code, reason = "of the reader's tests, which use all of it")]
#[path = "../../reader/tests/suite/tree.rs"]
mod tree;
mod vector;
#[allow(dead_code, reason = "of the reader's tests, which use all of it")]
#[path = "../../reader/tests/suite/vector_tree.rs"]
mod vector_tree;
mod verify;
#[cfg(feature = "viewer")]
mod view;

#[test]
fn the_example_of_a_depth_source_runs() {
    depth_source::main().unwrap();
}
