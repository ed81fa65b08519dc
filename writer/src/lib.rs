//! Scene -> depth intervals -> hierarchy -> pages -> container.
#![forbid(unsafe_code)]

pub mod mesh;
