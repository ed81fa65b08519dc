//! Scenes from files: OBJ, PLY and glTF 2.0.
//!
//! - `error`: why a file was refused
//! - `obj`, `ply`, `gltf`: one loader for each format
//! - `polygon`: polygons cut into fans
//! - `text`: numbers and quotes in messages
//!
//! What a glTF alpha MASK leaves of a triangle is cut out of it (`cutout`, beside this folder).
//!
//! Coordinates and axes are those of the file; nothing is rescaled or turned. Memory stays within a small multiple of
//! the bytes read, plus what a glTF scene repeats by instances ([`MOST`], `gltf`).

mod error;
mod gltf;
mod obj;
mod ply;
mod polygon;
#[cfg(test)]
mod testing;
pub(crate) mod text;

use std::fs;
use std::io::Read;
use std::path::Path;

pub use error::{Fault, LoadError};
#[cfg(test)]
pub(super) use gltf::AlphaImage;
pub(super) use gltf::{AlphaMask, MaskedTriangle, Wrap};

use super::cutout;
use crate::mesh::Mesh;

/// The most vertices, and the most triangles, that a scene may have.
pub const MOST: usize = 1 << 28;

/// What a scene file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// The triangles; every vertex is used and finite, every index is good.
    pub mesh: Mesh,
    /// Materials that cut holes by a texture (glTF alpha MASK) and the triangles they are on; none once they are cut.
    pub(super) masks: Vec<AlphaMask>,
    /// What was ignored or changed, one line each.
    pub notes: Vec<String>,
}

/// What loading may take. Only what alpha masks are cut into can outgrow a file by much, so only that is bounded: the
/// mesh and what is cut out of it are counted, the file itself and what its format needs meanwhile are not.
#[derive(Clone, Copy)]
pub struct Bounds<'a> {
    /// Most bytes to hold; none: no limit.
    pub memory_bytes: Option<u64>,
    /// Asked now and then, from any thread, while masks are cut: whether to go on. Between two times lie milliseconds,
    /// and seconds where millions of lines cut one triangle.
    pub keep_on: &'a (dyn Fn() -> bool + Sync),
}

impl Default for Bounds<'_> {
    fn default() -> Self {
        Bounds { memory_bytes: None, keep_on: &|| true }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Obj,
    Ply,
    Gltf,
}

/// Loads the scene file at `path`: by its extension (.obj, .ply, .gltf, .glb), else by what it holds. Triangles under an
/// alpha mask are replaced by triangles of their solid part.
///
/// # Errors
/// [`LoadError`], one line that says what to do, if the file can't be read or isn't a scene.
pub fn load(path: &Path) -> Result<Loaded, LoadError> {
    load_within(path, &Bounds::default())
}

/// As [`load`], within bounds.
///
/// # Errors
/// As [`load`]; [`Fault::Memory`] and [`Fault::Stopped`] besides.
pub fn load_within(path: &Path, bounds: &Bounds) -> Result<Loaded, LoadError> {
    let bytes = read(path).map_err(|fault| LoadError { path: path.to_path_buf(), fault })?;
    parse_within(path, &bytes, bounds)
}

/// As [`load`], of bytes that are in memory; `path` names them and is where glTF looks for the files beside them.
///
/// # Errors
/// [`LoadError`] if they aren't a scene.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Loaded, LoadError> {
    parse_within(path, bytes, &Bounds::default())
}

/// As [`parse`], within bounds.
///
/// # Errors
/// As [`load_within`].
pub fn parse_within(path: &Path, bytes: &[u8], bounds: &Bounds) -> Result<Loaded, LoadError> {
    let scene = || {
        // Editors on Windows put a byte order mark before text.
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        let mut scene = match format(path, bytes)? {
            Format::Obj => obj::parse(bytes)?,
            Format::Ply => ply::parse(bytes)?,
            Format::Gltf => gltf::parse(bytes, path.parent().unwrap_or(Path::new("")))?,
        };
        cutout::cut(&mut scene, bounds)?;
        finish(&mut scene)?;
        Ok(scene)
    };
    scene().map_err(|fault| LoadError { path: path.to_path_buf(), fault })
}

/// The bytes of a regular file that isn't empty.
fn read(path: &Path) -> Result<Vec<u8>, Fault> {
    let unreadable = |e: std::io::Error| match e.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory => Fault::Missing,
        _ => Fault::Unreadable { reason: text::line(&e.to_string()) },
    };
    let about = fs::metadata(path).map_err(unreadable)?;
    if about.is_dir() {
        return Err(Fault::Directory);
    }
    if !about.is_file() {
        // A pipe or device may have no end.
        return Err(Fault::NotAFile);
    }
    if about.len() == 0 {
        return Err(Fault::Empty);
    }
    let mut bytes = Vec::new();
    let memory = |_| Fault::TooLarge {
        at: "whole file".into(),
        most: "what fits in memory".into(),
        found: format!("{} bytes", about.len()),
    };
    let length = usize::try_from(about.len()).unwrap_or(usize::MAX);
    bytes.try_reserve_exact(length).map_err(memory)?;
    // A file that grows meanwhile doesn't take more than was reserved.
    fs::File::open(path).map_err(unreadable)?.take(about.len()).read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

fn format(path: &Path, bytes: &[u8]) -> Result<Format, Fault> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "obj" => return Ok(Format::Obj),
        "ply" => return Ok(Format::Ply),
        "gltf" | "glb" => return Ok(Format::Gltf),
        _ => {}
    }
    if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        return Ok(Format::Ply);
    }
    if bytes.starts_with(b"glTF") || bytes.trim_ascii_start().starts_with(b"{") {
        return Ok(Format::Gltf);
    }
    // Comments may go on for long; the first line that says something decides.
    let first = bytes.split(|b| *b == b'\n').map(|l| l.trim_ascii()).find(|l| !l.is_empty() && l[0] != b'#');
    let word = first.and_then(|l| l.split(u8::is_ascii_whitespace).next()).unwrap_or_default();
    match word {
        b"v" | b"vn" | b"vt" | b"f" | b"o" | b"g" | b"mtllib" | b"usemtl" | b"s" => Ok(Format::Obj),
        _ => Err(Fault::UnknownFormat { extension, found: text::quote(&bytes[..bytes.len().min(16)]) }),
    }
}

/// Drops vertices that no triangle uses: they would widen the bounds that a map has to cover.
fn finish(scene: &mut Loaded) -> Result<(), Fault> {
    let mesh = &mut scene.mesh;
    if mesh.triangles.is_empty() {
        return Err(Fault::NoTriangles { vertices: mesh.positions.len() });
    }
    for (what, found) in [("vertices", mesh.positions.len()), ("triangles", mesh.triangles.len())] {
        if found > MOST {
            return Err(Fault::TooLarge {
                at: "whole scene".into(),
                most: format!("{MOST} {what}"),
                found: found.to_string(),
            });
        }
    }
    let mut place = vec![u32::MAX; mesh.positions.len()];
    for t in &mesh.triangles {
        t.iter().for_each(|i| place[*i as usize] = 0);
    }
    let unused = place.iter().filter(|p| **p != 0).count();
    if unused == 0 {
        return Ok(());
    }
    let mut next = 0;
    for (i, place) in place.iter_mut().enumerate().filter(|(_, p)| **p == 0) {
        *place = next;
        mesh.positions[next as usize] = mesh.positions[i];
        next += 1;
    }
    mesh.positions.truncate(next as usize);
    mesh.triangles.iter_mut().for_each(|t| *t = t.map(|i| place[i as usize]));
    scene.notes.push(format!("{unused} vertices that no triangle uses are left out"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::testing::{Folder, refusal};
    use super::*;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    #[test]
    fn files_that_are_no_scenes_are_refused() {
        let folder = Folder::new();
        let missing = folder.0.join("no.obj");
        assert_eq!(refusal(&missing).fault, Fault::Missing);
        assert_eq!(refusal(&folder.0).fault, Fault::Directory);
        assert_eq!(refusal(&missing.join("below.obj")).fault, Fault::Missing);
        #[cfg(unix)]
        assert_eq!(refusal(Path::new("/dev/null")).fault, Fault::NotAFile);
        assert_eq!(refusal(&folder.write("a.ply", b"")).fault, Fault::Empty);
        assert!(matches!(refusal(&folder.write("a.stl", b"solid\nx")).fault, Fault::UnknownFormat { .. }));
        assert!(matches!(refusal(&folder.write("a", &[0; 99])).fault, Fault::UnknownFormat { .. }));
        assert_eq!(refusal(&folder.write("a.obj", b"v 0 0 0\n")).fault, Fault::NoTriangles { vertices: 1 });
        // a file name that would break the one line
        let line = refusal(&folder.0.join("a\nb.obj")).to_string();
        assert!(line.contains("a\\nb.obj"), "{line}");
    }

    #[test]
    fn formats_are_found_by_extension_then_content() {
        let folder = Folder::new();
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let gltf = testing::gltf_triangle();
        let obj = format!("\u{feff}# some\n\n{TRIANGLE}");
        for (name, content) in [
            ("A.OBJ", obj.as_str()),
            ("plain", obj.as_str()),
            ("a.PlY", ply),
            ("a.mesh", ply),
            ("A.glTF", gltf.as_str()),
            ("a.txt", gltf.as_str()),
        ] {
            let scene = load(&folder.write(name, content.as_bytes())).expect(name);
            assert_eq!(scene.mesh.triangles, [[0, 1, 2]], "{name}");
            assert_eq!(scene.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "{name}");
            assert!(scene.notes.is_empty() && scene.masks.is_empty(), "{name}");
        }
    }

    #[test]
    fn unused_vertices_are_left_out() {
        let folder = Folder::new();
        let scene = load(&folder.write("a.obj", b"v 9 9 9\nv 0 0 0\nv 1 0 0\nv 8 8 8\nv 0 1 0\nf 2 3 5\n")).unwrap();
        assert_eq!(scene.mesh.triangles, [[0, 1, 2]]);
        assert_eq!(scene.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(scene.notes, ["2 vertices that no triangle uses are left out"]);
    }
}
