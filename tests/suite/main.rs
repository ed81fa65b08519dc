//! Tests of the workspace as a whole, in one binary.

mod cli;
#[path = "../../examples/depth_source.rs"]
mod depth_source;
mod intervals;
mod layers;
mod openexr;
mod round_trip;

#[test]
fn the_example_of_a_depth_source_runs() {
    depth_source::main().unwrap();
}
