//! glTF 2.0, text or binary: the triangles of one scene, with all node transforms applied in f64.
//!
//! - `json`: the parts of the JSON that matter here
//! - `data`: bytes behind it: chunks, buffers, accessors
//! - `mask`: alpha MASK
//!
//! A small file may repeat a mesh by many nodes. Such a scene may have [`REPEATED`] triangles and vertices, and one more
//! for every byte of the file and its buffers; what may be read over and over is bounded likewise (`data`).

mod data;
mod json;
mod mask;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::path::Path;

#[cfg(test)]
pub use mask::AlphaImage;
pub use mask::{AlphaMask, MaskedTriangle, Wrap};

use super::{Fault, Loaded, text};
use data::{Data, Sources};
use json::{Index, Node, Primitive, Root};
use mask::{Masks, Surface};

/// The most triangles, and vertices, beyond one for each byte.
const REPEATED: usize = 1 << 25;

/// What a primitive costs, in elements to read.
const PRIMITIVE: u64 = 256;

/// Required extensions that do not change where surfaces are, or are followed.
const FOLLOWED: [&str; 4] =
    ["KHR_texture_transform", "KHR_mesh_quantization", "KHR_lights_punctual", "KHR_animation_pointer"];

/// Extensions that change what is seen; unless they are required, a scene without them is right too.
const NOTED: [&str; 4] =
    ["EXT_mesh_gpu_instancing", "KHR_node_visibility", "MSFT_lod", "KHR_materials_pbrSpecularGlossiness"];

/// Rows of the upper 3x4 part of a matrix.
type Affine = [[f64; 4]; 3];

const STILL: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Reads a whole file; relative paths start from `folder`.
pub fn parse(bytes: &[u8], folder: &Path) -> Result<Loaded, Fault> {
    let (json, binary) = data::split(bytes)?;
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    let root: Root = serde_json::from_slice(json).map_err(|e| {
        let at = format!("JSON, line {}, column {}", e.line(), e.column());
        if e.is_eof() {
            return Fault::Truncated { at, expected: "more of it".into(), found: "its end".into() };
        }
        Fault::syntax(at, "JSON of glTF 2.0", text::line(&e.to_string()))
    })?;
    check_kind(&root)?;
    let mut sources = Sources::new(folder);
    let data = Data::new(&root, &mut sources, binary, bytes.len())?;
    let limit = super::MOST.min(REPEATED.saturating_add(data.size));
    let mut walk = Walk {
        root: &root,
        data,
        sources,
        masks: Masks::default(),
        scene: Loaded::default(),
        limit,
        seen: Seen::default(),
    };
    walk.nodes()?;
    Ok(walk.finish())
}

fn check_kind(root: &Root) -> Result<(), Fault> {
    let version = &root.asset.version;
    if version != "2" && !version.starts_with("2.") {
        let (expected, found) = ("version 2.x".into(), text::quote(version.as_bytes()));
        return Err(Fault::Unsupported { at: "asset".into(), expected, found });
    }
    let followed =
        |e: &String| FOLLOWED.contains(&e.as_str()) || e.starts_with("KHR_materials_") || e.starts_with("KHR_xmp");
    match root.extensions_required.iter().find(|e| !followed(e) || NOTED.contains(&e.as_str())) {
        Some(e) => Err(Fault::Unsupported {
            at: "extensionsRequired".into(),
            expected: "none that changes where surfaces are".into(),
            found: text::quote(e.as_bytes()),
        }),
        None => Ok(()),
    }
}

/// The element of a list that an index means.
fn get<'a, T>(list: &'a [T], index: Index, what: &'static str, at: &str) -> Result<&'a T, Fault> {
    list.get(index).ok_or_else(|| Fault::Index { at: at.into(), what, count: list.len(), found: index.to_string() })
}

/// How often what is ignored was met.
#[derive(Default)]
struct Seen {
    skins: usize,
    morphs: usize,
    cameras: usize,
    lights: usize,
    lines: usize,
    blended: usize,
    holes: usize,
    odd: usize,
    bare: usize,
    scenes: usize,
}

struct Walk<'a> {
    root: &'a Root,
    data: Data<'a>,
    sources: Sources<'a>,
    masks: Masks,
    scene: Loaded,
    limit: usize,
    seen: Seen,
}

impl Walk<'_> {
    fn nodes(&mut self) -> Result<(), Fault> {
        let root = self.root;
        let all;
        let (roots, at) = match root.scene.or((!root.scenes.is_empty()).then_some(0)) {
            Some(scene) => {
                if root.scene.is_none() {
                    self.seen.scenes = root.scenes.len() - 1;
                }
                (&get(&root.scenes, scene, "scenes", "scene")?.nodes, format!("scene {scene}"))
            }
            None => {
                let mut child = vec![false; root.nodes.len()];
                root.nodes.iter().flat_map(|n| &n.children).for_each(|c| {
                    if let Some(child) = child.get_mut(*c) {
                        *child = true;
                    }
                });
                all = (0..child.len()).filter(|n| !child[*n]).collect();
                (&all, "file without scenes".into())
            }
        };
        let mut met = vec![false; root.nodes.len()];
        // (node, transform of its parent, what names it); a stack, since files may nest deeper than the stack is
        let mut waiting: Vec<(Index, Affine, Option<Index>)> = roots.iter().rev().map(|n| (*n, STILL, None)).collect();
        while let Some((index, above, parent)) = waiting.pop() {
            let at = || parent.map_or_else(|| at.clone(), |p| format!("node {p}"));
            let node = get(&root.nodes, index, "nodes", &at())?;
            if std::mem::replace(&mut met[index], true) {
                return Err(Fault::syntax(at(), "each node once, in a tree", format!("node {index} again")));
            }
            let transform = product(&above, &local(node, index)?);
            waiting.extend(node.children.iter().rev().map(|c| (*c, transform, Some(index))));
            self.seen.cameras += usize::from(node.camera.is_some());
            self.seen.lights += usize::from(node.extensions.light.is_some());
            if let Some(mesh) = node.mesh {
                self.seen.skins += usize::from(node.skin.is_some());
                self.mesh(index, mesh, &transform)?;
            }
        }
        Ok(())
    }

    fn mesh(&mut self, node: Index, mesh: Index, transform: &Affine) -> Result<(), Fault> {
        let at = format!("node {node}, mesh {mesh}");
        // Primitives often share vertices and differ in material only: first vertex and count, by accessor.
        let mut shared: HashMap<Index, (usize, usize)> = HashMap::new();
        for (i, primitive) in
            get(&self.root.meshes, mesh, "meshes", &format!("node {node}"))?.primitives.iter().enumerate()
        {
            self.primitive(primitive, transform, &mut shared, &format!("{at}, primitive {i}"))?;
        }
        Ok(())
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        transform: &Affine,
        shared: &mut HashMap<Index, (usize, usize)>,
        at: &str,
    ) -> Result<(), Fault> {
        self.data.spend(PRIMITIVE, at)?;
        match primitive.mode {
            0..=3 => {
                self.seen.lines += 1;
                return Ok(());
            }
            4..=6 => {}
            other => return Err(Fault::syntax(at, "a mode from 0 to 6", other.to_string())),
        }
        let Some(accessor) = primitive.attributes.get("POSITION") else {
            self.seen.bare += 1;
            return Ok(());
        };
        let compressed = self.root.accessors.get(*accessor).is_some_and(|a| a.buffer_view.is_none());
        if primitive.extensions.draco.is_some() && compressed {
            let (expected, found) = ("plain accessors".into(), "`KHR_draco_mesh_compression`".into());
            return Err(Fault::Unsupported { at: at.into(), expected, found });
        }
        self.seen.morphs += usize::from(!primitive.targets.is_empty());
        let (base, count) = match shared.get(accessor) {
            Some(found) => *found,
            None => {
                let placed = self.place(*accessor, transform, at)?;
                shared.insert(*accessor, placed);
                placed
            }
        };
        if let Some(material) = primitive.material.and_then(|m| self.root.materials.get(m)) {
            self.seen.blended += usize::from(material.alpha_mode == "BLEND");
        }
        let corners = self.corners(primitive, count, at)?;
        let drawn = (corners.as_slice(), count);
        let surface = self.masks.surface(self.root, &self.data, &mut self.sources, primitive, drawn, at)?;
        if matches!(surface, Surface::Hole) {
            self.seen.holes += 1;
            return Ok(());
        }
        let flip = determinant(transform) < 0.0;
        let triangles = triangles(primitive.mode, corners.len());
        self.seen.odd += usize::from(primitive.mode == 4 && corners.len() % 3 != 0);
        self.fits("triangles", self.scene.mesh.triangles.len(), triangles.len(), at)?;
        for mut t in triangles {
            if flip {
                t.swap(1, 2);
            }
            if let Surface::Masked { mask, uv, opacity } = &surface {
                self.masks.list[*mask].triangles.push(MaskedTriangle {
                    triangle: self.scene.mesh.triangles.len() as u32,
                    uv: t.map(|i| uv[i]),
                    opacity: t.map(|i| opacity[i]),
                });
            }
            self.scene.mesh.triangles.push(t.map(|i| base as u32 + corners[i]));
        }
        Ok(())
    }

    /// Adds the vertices of an accessor; gives the first one's index and how many.
    fn place(&mut self, accessor: Index, transform: &Affine, at: &str) -> Result<(usize, usize), Fault> {
        let at = format!("{at}, POSITION");
        let base = self.scene.mesh.positions.len();
        // Before they are read: the scene may be full.
        let count = get(&self.root.accessors, accessor, "accessors", &at)?.count;
        self.fits("vertices", base, usize::try_from(count).unwrap_or(usize::MAX), &at)?;
        let positions = self.data.read::<3>(accessor, &at)?;
        for (i, p) in positions.iter().enumerate() {
            let placed = transform.map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3]);
            if !placed.iter().all(|c| c.is_finite()) {
                let found = format!("{p:?}, in the scene {placed:?}");
                return Err(Fault::NotFinite { at: format!("{at}, accessor {accessor}, vertex {i}"), found });
            }
            self.scene.mesh.positions.push(placed);
        }
        Ok((base, positions.len()))
    }

    fn fits(&self, what: &str, now: usize, more: usize, at: &str) -> Result<(), Fault> {
        let found = now.saturating_add(more);
        if found <= self.limit {
            return Ok(());
        }
        let most = format!("{} {what} for a file of this size", self.limit);
        Err(Fault::TooLarge { at: at.into(), most, found: found.to_string() })
    }

    /// Vertices in the order they are drawn; all are below `count`.
    fn corners(&self, primitive: &Primitive, count: usize, at: &str) -> Result<Vec<u32>, Fault> {
        let Some(indices) = primitive.indices else { return Ok((0..count as u32).collect()) };
        let at = format!("{at}, indices");
        let kind = get(&self.root.accessors, indices, "accessors", &at)?.component_type;
        if !matches!(kind, 5121 | 5123 | 5125) {
            let at = format!("{at}, accessor {indices}");
            return Err(Fault::syntax(at, "component type 5121, 5123 or 5125", kind.to_string()));
        }
        let read = self.data.read::<1>(indices, &at)?;
        let checked = read.iter().enumerate().map(|(i, [index])| {
            if *index < count as f64 {
                return Ok(*index as u32);
            }
            let at = format!("{at}, accessor {indices}, element {i}");
            Err(Fault::Index { at, what: "vertices (0 is the first)", count, found: index.to_string() })
        });
        checked.collect()
    }

    fn finish(mut self) -> Loaded {
        let seen = &self.seen;
        let animations = self.root.animations.len();
        for (count, what) in [
            (seen.scenes, "scenes after the first are left out (none is the default)"),
            (seen.skins, "skinned meshes are taken as modelled, their skins are ignored"),
            (seen.morphs, "primitives with morph targets are taken without them"),
            (animations, "animations are ignored"),
            (seen.cameras, "cameras are ignored"),
            (seen.lights, "lights are ignored"),
            (seen.lines, "primitives of points or lines are ignored"),
            (seen.bare, "primitives without positions are ignored"),
            (seen.odd, "lists of triangles end within a triangle, which is ignored"),
            (seen.blended, "primitives with alpha BLEND are taken as solid"),
            (seen.holes, "primitives whose alpha MASK hides all of them are left out"),
        ] {
            if count > 0 {
                self.scene.notes.push(format!("{count} {what}"));
            }
        }
        for extension in self.root.extensions_used.iter().filter(|e| NOTED.contains(&e.as_str())) {
            self.scene.notes.push(format!("extension `{extension}` is ignored"));
        }
        self.scene.masks = self.masks.list;
        self.scene.masks.retain(|m| !m.triangles.is_empty());
        self.scene
    }
}

/// Places in the order drawn of each triangle's corners, in the order that keeps all facing one way.
fn triangles(mode: u32, corners: usize) -> impl ExactSizeIterator<Item = [usize; 3]> {
    let count = if mode == 4 { corners / 3 } else { corners.saturating_sub(2) };
    (0..count).map(move |i| match mode {
        4 => [3 * i, 3 * i + 1, 3 * i + 2],
        5 => [i, i + 1 + i % 2, i + 2 - i % 2],
        _ => [i + 1, i + 2, 0],
    })
}

/// A node's own transform.
fn local(node: &Node, index: Index) -> Result<Affine, Fault> {
    if let Some(m) = node.matrix {
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            let found = format!("{:?}", [m[3], m[7], m[11], m[15]]);
            return Err(Fault::syntax(format!("node {index}, matrix"), "a last row of 0, 0, 0, 1", found));
        }
        return Ok([0, 1, 2].map(|r| [m[r], m[4 + r], m[8 + r], m[12 + r]]));
    }
    let [x, y, z, w] = node.rotation;
    // Exporters round to f32, so that the length is 1 only nearly.
    let length = x * x + y * y + z * z + w * w;
    if !(length > 0.0 && length.is_finite()) {
        let found = format!("{:?}", node.rotation);
        return Err(Fault::syntax(format!("node {index}, rotation"), "a quaternion of length 1", found));
    }
    let s = 2.0 / length;
    let rotation = [
        [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
    ];
    let (t, k) = (node.translation, node.scale);
    Ok([0, 1, 2].map(|r| [rotation[r][0] * k[0], rotation[r][1] * k[1], rotation[r][2] * k[2], t[r]]))
}

/// `a` after `b`.
fn product(a: &Affine, b: &Affine) -> Affine {
    a.map(|r| {
        let mut row = [0, 1, 2, 3].map(|c| r[0] * b[0][c] + r[1] * b[1][c] + r[2] * b[2][c]);
        row[3] += r[3];
        row
    })
}

fn determinant(m: &Affine) -> f64 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}
