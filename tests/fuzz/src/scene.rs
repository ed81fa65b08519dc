//! Mesh files that nobody promised. What is accepted is a mesh: finite vertices, all of them used, indices in range;
//! the same bytes give the same mesh; and it can be baked, or is refused, in one line, for its extent. What is refused
//! is refused in one line.

use std::path::Path;

use umbrage_writer::frame;
use umbrage_writer::hierarchy::build::{Options, Progress, build};
use umbrage_writer::hierarchy::spool::Spool;
use umbrage_writer::mesh::Mesh;
use umbrage_writer::scene::load::parse;
use umbrage_writer::solid::{Policy, snap};

use crate::input::Input;

/// Names by format; without an extension the content decides.
const NAMES: [&str; 5] = ["nowhere/a.obj", "nowhere/a.ply", "nowhere/a.gltf", "nowhere/a.glb", "nowhere/a"];
/// Larger meshes are not baked.
const MOST: usize = 200;

fn one_line(what: &str, text: &str) {
    assert!(!text.is_empty() && !text.chars().any(char::is_control), "{what}: {text:?}");
}

fn check(mesh: &Mesh) {
    assert!(!mesh.triangles.is_empty(), "a scene has triangles");
    assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
    let mut used = vec![false; mesh.positions.len()];
    for i in mesh.triangles.iter().flatten() {
        used[*i as usize] = true;
    }
    assert!(used.iter().all(|u| *u), "every vertex is used");
}

fn bake(mesh: &Mesh) {
    let lattice = match frame::orthographic([0.3, -0.9, 0.2], 3, &mesh.positions, 0.0) {
        Ok(lattice) => lattice,
        Err(e) => return one_line("frame", &e.to_string()),
    };
    for policy in [Policy::Auto, Policy::SecondSurface] {
        let snapped = match snap(mesh, lattice, policy) {
            Ok(snapped) => snapped,
            Err(e) => return one_line("snap", &e.to_string()),
        };
        build(&snapped, Options::default(), Spool::in_memory(), &Progress::default()).expect("nobody cancels");
    }
}

/// One input: a byte for the name, then the file.
pub fn run(data: &[u8]) {
    let mut input = Input(data);
    let name = Path::new(NAMES[usize::from(input.byte()) % NAMES.len()]);
    match parse(name, input.0) {
        Err(e) => {
            one_line("error", &e.to_string());
            assert_eq!(parse(name, input.0), Err(e));
        }
        Ok(scene) => {
            check(&scene.mesh);
            scene.notes.iter().for_each(|n| one_line("note", n));
            if scene.mesh.triangles.len() <= MOST {
                bake(&scene.mesh);
            }
            assert_eq!(parse(name, input.0).as_ref(), Ok(&scene));
        }
    }
}
