//! Tests of the workspace as a whole, in one binary.

mod cli;
mod flips;
mod golden;
mod intervals;
mod losing;
mod python;
mod round_trip;
mod spec;
#[allow(dead_code, reason = "of the reader's tests, which use all of it")]
#[path = "../../reader/tests/suite/tree.rs"]
mod tree;
mod verify;
