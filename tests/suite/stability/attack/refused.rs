//! What a bake must refuse, and what it must say.

use std::path::Path;

use super::shapes::*;
use umbrage::format::Kind;
use umbrage::writer::bake::{BakeError, BakeOptions, Baked, Light, bake};
use umbrage::writer::mesh::Mesh;
use umbrage::writer::solid::Policy;

/// Input that is refused.
pub struct Refused {
    /// What is wrong with it.
    pub name: &'static str,
    /// The triangles.
    pub mesh: Mesh,
    /// What lies behind a surface.
    pub policy: Policy,
    /// Where the light travels.
    pub light: [f64; 3],
    /// Texels on a side.
    pub resolution: u64,
    /// Words of the message: what was expected, or what to do.
    pub words: &'static str,
}

impl Refused {
    /// Tries to bake it.
    ///
    /// # Errors
    /// What it is refused with.
    pub fn bake(&self, kind: Kind, target: &Path) -> Result<Baked, BakeError> {
        let options = BakeOptions {
            lights: vec![Light { name: "sun".to_string(), direction: self.light }],
            resolution: self.resolution,
            policy: self.policy,
            kind,
            exhaustive: false,
            top_down: false,
            mmh: Default::default(),
            memory_bytes: None,
            cold: false,
        };
        bake(&self.mesh, &options, target, &Default::default())
    }
}

/// All of them.
pub fn refused() -> Vec<Refused> {
    let good = || block([0.0; 3], [1.0; 3]);
    let with = |value: f64| {
        let mut mesh = good();
        mesh.positions[3][1] = value;
        mesh
    };
    let base = |name, mesh, words| Refused {
        name,
        mesh,
        policy: Policy::Auto,
        light: [0.4, -0.8, 0.3],
        resolution: 64,
        words,
    };
    let index = |i: u32| {
        let mut mesh = good();
        mesh.triangles[5][1] = i;
        mesh
    };
    let lidless = || {
        let mut mesh = good();
        mesh.triangles.pop();
        mesh
    };
    let lit = |name, light| Refused { light, ..base(name, good(), "three finite numbers that are not all 0") };
    let sized = |name, resolution| Refused { resolution, ..base(name, good(), "a power of two from 1 to 16777216") };
    let extent = "an extent between 1e-30 and 1e30";
    let flat = "has an area on the lattice";
    vec![
        base("a coordinate that is no number", with(f64::NAN), "vertex 3: expected finite coordinates"),
        base("an infinite coordinate", with(f64::NEG_INFINITY), "vertex 3: expected finite coordinates"),
        base("a coordinate of 1e300", with(1e300), extent),
        base("an extent of 1e31", scaled(good(), [1e31; 3]), extent),
        base("an extent of 1e-31", scaled(good(), [1e-31; 3]), extent),
        base("denormal coordinates", scaled(good(), [1e-310; 3]), extent),
        base("1e32 away", moved(good(), [1e32; 3]), extent),
        base("all in one point, as floats at 1e20 have it", moved(good(), [1e20; 3]), flat),
        base("1e12 deep and 1 wide, from the side", super::far::deep(), flat),
        base("triangles of no area", scaled(good(), [1.0, 0.0, 0.0]), flat),
        base("no triangles", Mesh { triangles: vec![], ..good() }, "has no triangles"),
        base("no vertices", Mesh { positions: vec![], ..good() }, "expected vertex indices below 0"),
        base("an index too large by one", index(8), "triangle 5: expected vertex indices below 8"),
        base("the largest index", index(u32::MAX), "triangle 5: expected vertex indices below 8"),
        Refused {
            policy: Policy::Closed,
            ..base("an open box as closed", lidless(), "found 1 open ones with 3 boundary")
        },
        Refused {
            policy: Policy::Closed,
            ..base("T-junctions as closed", super::open_joints(), "expected every component to be closed")
        },
        Refused { policy: Policy::Closed, ..base("a Moebius band as closed", super::moebius(), "open ones") },
        Refused { policy: Policy::Thickness(f64::NAN), ..base("a thickness that is no number", good(), extent) },
        Refused { policy: Policy::Thickness(1e31), ..base("a thickness of 1e31", good(), extent) },
        lit("a light without direction", [0.0; 3]),
        lit("a light that is no number", [0.0, f64::NAN, 1.0]),
        lit("an infinite light", [0.0, f64::INFINITY, 1.0]),
        sized("no texels", 0),
        sized("a side that is no power of two", 1000),
        sized("a side of 2^25", 1 << 25),
        sized("a side of 2^63", 1 << 63),
    ]
}
