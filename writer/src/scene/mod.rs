//! Scenes made from a seed, so that tests and demos need no files and everyone measures the same geometry.
//!
//! - `city`: streets, blocks and buildings (`building`) of many touching, nested and interpenetrating solids
//! - `forest`: ground, trees and hundreds of thousands of thin leaves
//! - `scan`: one finely tessellated bumpy ball on a slab
//! - `cutout`: alpha masks of scene files become geometry
//! - `load`: scene files
//! - `shape`: closed solids and the frames that place them
//! - `random`: random numbers and noise
//!
//! Every scene is in metres, +Y up, right-handed. Each connected component is closed and faces outward, except cavities,
//! which face into the hollow and lie inside a solid. Scenes are equal to the bit on every machine: only integers and
//! the operations + - * / and the square root of f64 are used, which IEEE 754 fixes.

mod building;
#[cfg(test)]
mod check;
mod city;
mod cutout;
mod forest;
pub mod load;
mod random;
mod scan;
mod shape;

use crate::mesh::Mesh;

/// The smallest SIZE of a generated scene.
pub const SMALLEST: f64 = 0.05;
/// The largest SIZE of a generated scene.
pub const LARGEST: f64 = 16.0;

/// Why a name of a generated scene was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeneratedError {
    /// The part after the first colon is not a seed.
    #[error(
        "scene `{spec}`: expected a seed (a whole number from 0 to 18446744073709551615) after `{kind}:`, \
         found `{found}`; write for example `{kind}:1`"
    )]
    Seed {
        /// The whole name.
        spec: String,
        /// `city`, `forest` or `scan`.
        kind: &'static str,
        /// What stands where the seed should.
        found: String,
    },
    /// The part after the second colon is not a size, or out of range.
    #[error(
        "scene `{spec}`: expected a size from 0.05 to 16 after the seed, found `{found}`; \
         write for example `{kind}:{seed}:0.5`, or `{kind}:{seed}` for size 1"
    )]
    Size {
        /// The whole name.
        spec: String,
        /// `city`, `forest` or `scan`.
        kind: &'static str,
        /// The seed, which was fine.
        seed: u64,
        /// What stands where the size should.
        found: String,
    },
}

/// A camera that shows a generated scene well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the eye in metres.
    pub eye: [f64; 3],
    /// The point in the middle of the picture, in metres.
    pub target: [f64; 3],
    /// Vertical angle of view in degrees; up is +Y.
    pub fov_degrees: f64,
}

/// The direction in which the demo light travels: (0.4, -0.8, 0.3), not of unit length.
pub const DEMO_LIGHT: [f64; 3] = [0.4, -0.8, 0.3];

#[derive(Clone, Copy)]
enum Kind {
    City,
    Forest,
    Scan,
}

#[derive(Clone, Copy)]
struct Spec {
    kind: Kind,
    seed: u64,
    size: f64,
}

/// Reads `KIND:SEED[:SIZE]`; `None` if it starts with no known kind and a colon.
fn parse(spec: &str) -> Option<Result<Spec, GeneratedError>> {
    let (name, rest) = spec.split_once(':')?;
    let (kind, name) = match name {
        "city" => (Kind::City, "city"),
        "forest" => (Kind::Forest, "forest"),
        "scan" => (Kind::Scan, "scan"),
        _ => return None,
    };
    let (seed, size) = match rest.split_once(':') {
        Some((seed, size)) => (seed, Some(size)),
        None => (rest, None),
    };
    // Digits only: `u64` itself would let a plus sign pass.
    let Some(seed) = seed.parse::<u64>().ok().filter(|_| seed.bytes().all(|b| b.is_ascii_digit())) else {
        return Some(Err(GeneratedError::Seed { spec: spec.into(), kind: name, found: seed.into() }));
    };
    let size = match size {
        None => 1.0,
        Some(text) => match text.parse::<f64>() {
            Ok(size) if (SMALLEST..=LARGEST).contains(&size) => size,
            _ => return Some(Err(GeneratedError::Size { spec: spec.into(), kind: name, seed, found: text.into() })),
        },
    };
    Some(Ok(Spec { kind, seed, size }))
}

/// Generates the scene that `spec` names: `city:SEED[:SIZE]`, `forest:SEED[:SIZE]` or `scan:SEED[:SIZE]`.
///
/// SEED is a whole number that fits 64 bits. SIZE, from 0.05 to 16 and 1 if left out, multiplies the number of triangles:
/// a larger city or forest covers more ground, a larger scan is finer. `None` if `spec` starts otherwise; it is then
/// something else, such as a path.
///
/// # Errors
/// [`GeneratedError`] if seed or size are not what they should be.
pub fn generated(spec: &str) -> Option<Result<Mesh, GeneratedError>> {
    let spec = match parse(spec)? {
        Ok(spec) => spec,
        Err(error) => return Some(Err(error)),
    };
    Some(Ok(match spec.kind {
        Kind::City => city::build(spec.seed, spec.size),
        Kind::Forest => forest::build(spec.seed, spec.size),
        Kind::Scan => scan::build(spec.seed, spec.size),
    }))
}

/// A good camera for the scene that `spec` names, for a light along [`DEMO_LIGHT`]; `None` and errors as [`generated`].
///
/// # Errors
/// [`GeneratedError`] if seed or size are not what they should be.
pub fn demo_view(spec: &str) -> Option<Result<View, GeneratedError>> {
    Some(parse(spec)?.map(|spec| match spec.kind {
        Kind::City => city::view(),
        Kind::Forest => forest::view(spec.seed, spec.size),
        Kind::Scan => scan::view(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(spec: &str) -> String {
        generated(spec).expect("a generated scene").expect_err(spec).to_string()
    }

    #[test]
    fn other_names_are_not_generated_scenes() {
        for spec in ["", "city", "town:1", "scene.glb", "C:city:1", "City:1"] {
            assert!(generated(spec).is_none() && demo_view(spec).is_none(), "{spec}");
        }
    }

    #[test]
    fn bad_seeds_are_refused() {
        for (spec, found) in [
            ("city:", "``"),
            ("city:x", "`x`"),
            ("forest:-1", "`-1`"),
            ("forest:+1", "`+1`"),
            ("scan:18446744073709551616", "`18446744073709551616`"),
            ("scan::2", "``"),
        ] {
            let message = refusal(spec);
            assert!(message.starts_with(&format!("scene `{spec}`: expected a seed")), "{message}");
            assert!(message.contains(&format!("found {found}; write for example")), "{message}");
            assert!(!message.contains('\n') && demo_view(spec).is_some_and(|v| v.is_err()));
        }
    }

    #[test]
    fn bad_sizes_are_refused() {
        for (spec, found) in [
            ("city:1:", "``"),
            ("city:1:big", "`big`"),
            ("forest:1:0.01", "`0.01`"),
            ("scan:1:17", "`17`"),
            ("scan:1:NaN", "`NaN`"),
            ("scan:1:1:1", "`1:1`"),
        ] {
            let message = refusal(spec);
            assert!(message.starts_with(&format!("scene `{spec}`: expected a size from 0.05 to 16")), "{message}");
            assert!(message.contains(&format!("found {found}; write for example")), "{message}");
        }
        assert_eq!((SMALLEST, LARGEST), (0.05, 16.0), "the message names them");
    }

    #[test]
    fn good_names_work() {
        for spec in ["city:7:0.05", "forest:18446744073709551615:0.05", "scan:0:0.05"] {
            let mesh = generated(spec).expect("a generated scene").expect(spec);
            assert!(mesh.triangles.len() > 1000, "{spec}");
            let view = demo_view(spec).expect("a generated scene").expect(spec);
            assert!(view.eye[1] > view.target[1] && (10.0..90.0).contains(&view.fov_degrees));
        }
    }
}
