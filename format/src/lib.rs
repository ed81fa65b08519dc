//! Bytes of the Umbrage container and their meaning.
//!
//! [`projection`] says how a point of the world becomes a point of the light-space lattice.
#![no_std]
#![forbid(unsafe_code)]

pub mod projection;
