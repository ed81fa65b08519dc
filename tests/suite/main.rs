//! Tests of the workspace as a whole, in one binary.

mod cli;
mod intervals;
mod masks;
mod round_trip;
