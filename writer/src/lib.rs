//! Scene -> depth intervals -> hierarchy -> pages -> container.
//!
//! Follow one texel: [`scene`] (where triangles come from) -> [`frame`] (the light's lattice) -> [`solid`] (snapped,
//! welded, oriented) -> [`interval`] (what a texel may store) -> [`hierarchy`] (nodes and pages) -> [`container`] (the
//! file). [`bake`] is the whole way.
#![forbid(unsafe_code)]

pub mod bake;
pub mod cold;
pub mod container;
pub mod frame;
pub mod hierarchy;
pub mod interval;
pub mod layers;
pub mod mesh;
pub mod scene;
pub mod solid;
