//! Tests of the workspace as a whole, in one binary.

mod cli;
mod intervals;
mod losing;
mod round_trip;
mod verify;
