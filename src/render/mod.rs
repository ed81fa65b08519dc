//! Pictures and the reference: the snapped mesh seen by a camera, and exact shadow rays.
//!
//! A [`Camera`] makes world rays. [`Scene::view`] takes them to the light-space lattice, finds the first triangle
//! ([`Scene`] over a bounding volume hierarchy) and moves each hit to a lattice point of that triangle: a [`Receiver`]
//! with an exact [`Depth`]. Whether a receiver is lit comes from a shadow map (`ceil(depth) <= stored`) or from
//! [`ShadowRays`], the reference, which decides in integers only. [`shade`] and [`difference`] make an [`RgbImage`]
//! of the answers, [`write_png`] a file.
//!
//! | Room | What is in it |
//! |---|---|
//! | `camera` | pixels to world rays |
//! | `bvh` | hierarchy of conservative integer boxes, shared by both kinds of ray |
//! | `scene` | primary rays, [`View`] |
//! | `receiver` | hit to lattice point |
//! | `depth` | exact fractions, depth of a triangle over a lattice point |
//! | `shadow` | the reference |
//! | `filter` | what filters ask: planes, footprints |
//! | `look` | how the map is looked up |
//! | `flight` | cameras over time |
//! | `shade` | colours, differences |
//! | `image` | pixels in memory, PNG |

mod bvh;
mod camera;
mod depth;
mod filter;
mod flight;
mod image;
mod look;
mod receiver;
mod scene;
mod shade;
mod shadow;
#[cfg(test)]
mod testing;

pub use camera::{Camera, CameraError, UpAxis};
pub use depth::Depth;
pub use filter::Footprints;
pub use flight::{Flight, FlightError, Recording};
pub use image::{ImageError, RgbImage, write_png, write_text};
pub use look::{Filter, Look, parse_look};
pub use receiver::{Placement, Receiver};
pub use scene::{Hit, Scene, Surface, View};
#[cfg(feature = "gpu")]
pub(crate) use shade::constants as shade_constants;
pub use shade::{Shading, coverage, difference, shade};
pub use shadow::ShadowRays;
#[cfg(feature = "gpu")]
pub(crate) use {
    camera::{cross, dot, normalised},
    filter::STEEPEST,
};
