//! Light projections: how a point of the world becomes a point of the light-space lattice.

mod orthographic;

pub use orthographic::{Lattice, UNCOVERED};
