//! Depth layers from OpenEXR files.
//!
//! # Channels
//! The first depth is the channel `first.Z`, else `Z`, else the only channel whose name ends in `.Z`. The second is, in
//! the same file, `second.Z` (the next surface) or, beside the first, `ZBack` (where the solid is left: OpenEXR's name
//! for the back of a sample); in a file of its own it may also be called `Z` and is the next surface. A part of a
//! multi-part file gives its channels its name as a prefix.
//!
//! # Depths
//! As the file has them, half, float or uint. Infinity, anything from [`ExrOptions::far`] on, and the largest uint mean
//! that there is nothing. NaN is an error.
//!
//! # Where it lies in the world
//! [`Placement`]. Pixel (0, 0), the first of the data window, is texel (0, 0); rows go down in both.

mod file;

use std::path::PathBuf;

use exr::meta::header::Header;
use xxhash_rust::xxh3::Xxh3;

use file::{Channel, File, Plane};
pub use file::{ExrError, is_decoding};

use super::{DepthScale, DepthSource, LayersError, Projection, Second, SourceError, Square};
use crate::bake::memory_error;
use crate::scene::load::text::line;

/// Depths from here on mean that there is nothing, where nothing else is said: what renderers write for a background
/// (1e10, 1e30) lies there, and half floats end far before.
pub const FAR: f64 = 1e10;

/// How the pixels lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Placement {
    /// By the header's `worldToNDC` and `worldToCamera` (depth is the camera's z) where it has both, which must be
    /// orthographic; else as [`Placement::Image`].
    #[default]
    Header,
    /// x and y are pixels of the data window, z is the file's depth.
    Image,
    /// A light that travels along `direction` and sees the box from `low` to `high`, as for a scene of these bounds:
    /// pixel (0, 0) at smallest x and y of the light's frame, depth along the light from the world's origin, world units.
    Box {
        /// Any length but 0.
        direction: [f64; 3],
        /// Lowest corner, world units.
        low: [f64; 3],
        /// Highest corner, world units.
        high: [f64; 3],
    },
}

/// How to read.
#[derive(Clone, Debug, Default)]
pub struct ExrOptions {
    /// The file of first depth.
    pub first: PathBuf,
    /// The file of second depth; none: the same file.
    pub second: Option<PathBuf>,
    /// Names of the channels of first and second depth; none: found by the rules of the module.
    pub channels: Option<(String, Option<String>)>,
    /// What the second depth is; none: as its channel's name says. [`Second::NextSurface`] without a second channel
    /// means that there is no second surface anywhere.
    pub meaning: Option<Second>,
    /// Depths from here on mean that there is nothing; none: [`FAR`].
    pub far: Option<f64>,
    /// How the pixels lie in the world.
    pub placement: Placement,
    /// Most bytes for the pixels; none: no limit.
    pub memory_bytes: Option<u64>,
}

/// Layers of depth read from files.
pub struct ExrLayers {
    name: String,
    first: Plane,
    /// None: there is no second depth anywhere.
    back: Option<Plane>,
    second: Second,
    far: f64,
    projection: Projection,
    key: Vec<u8>,
    /// What a user should know about how the files were understood.
    pub notes: Vec<String>,
}

impl ExrLayers {
    /// Reads the layers of the light `name`. `keep_on` is asked now and then.
    ///
    /// # Errors
    /// Files, channels, sizes, the projection, pixels that need more than the budget, or stopped.
    pub fn read(name: &str, options: &ExrOptions, keep_on: &dyn Fn() -> bool) -> Result<ExrLayers, LayersError> {
        let file = File::open(&options.first)?;
        let other = options.second.as_deref().map(File::open).transpose()?;
        let mut notes = Vec::new();
        let explicit = options.channels.as_ref();
        let first = match explicit {
            Some((name, _)) => named(&file, name)?,
            None => first_channel(&file)?,
        };
        let found = match (explicit, &other) {
            (Some((_, None)), None) => None,
            (Some((_, Some(name))), other) => Some((named(other.as_ref().unwrap_or(&file), name)?, by_name(name))),
            (_, Some(other)) => Some(lone_second(other)?),
            (None, None) => second_channel(&file, &first)?,
        };
        let found = found.filter(|_| options.meaning != Some(Second::Absent));
        let second = options.meaning.unwrap_or(found.as_ref().map_or(Second::Absent, |f| f.1));
        if second == Second::Exit && found.is_none() {
            return Err(file
                .no_channel("a second depth (ZBack, second.Z, or --second FILE) for closed solids".into())
                .into());
        }
        let back = found.map(|f| f.0);
        // Names may hold anything.
        notes.push(line(&match (&back, second) {
            (None, Second::NextSurface) => format!("first depth {}; no second surface anywhere", first.name),
            (None, _) => format!("first depth {}; no second depth, so it is taken as it is", first.name),
            (Some(b), Second::Exit) => format!("first depth {}; solids are left at {}", first.name, b.name),
            (Some(b), _) => format!("first depth {}; next surface {}", first.name, b.name),
        }));
        let side = file.side(&first)?;
        if let Some(b) = &back {
            let home = other.as_ref().unwrap_or(&file);
            let (a, b) = (file.header(&first), home.header(b));
            if a.layer_size != b.layer_size || a.own_attributes.layer_position != b.own_attributes.layer_position {
                let what = format!(
                    "first depth has {} at {}, second depth {} at {}: expected the same data window",
                    size(a),
                    corner(a),
                    size(b),
                    corner(b)
                );
                return Err(ExrError::Content { file: options.first.clone(), what }.into());
            }
        }
        if let (Some(b), Some(other)) = (&back, &other) {
            other.side(b)?;
        }
        let needed = Plane::bytes(side * side) * if back.is_some() { 2 } else { 1 };
        if let Some(budget) = options.memory_bytes.filter(|b| needed > *b) {
            return Err(memory_error(budget, "the pixels", needed).into());
        }
        let projection = place(file.header(&first), side, options, &mut notes)
            .map_err(|what| ExrError::Content { file: options.first.clone(), what })?;
        let (first, back) = match (back, other) {
            (None, _) => (file.read(&[first], side, keep_on)?.remove(0), None),
            (Some(b), Some(other)) => {
                (file.read(&[first], side, keep_on)?.remove(0), Some(other.read(&[b], side, keep_on)?.remove(0)))
            }
            (Some(b), None) => {
                let mut planes = file.read(&[first, b], side, keep_on)?;
                let back = planes.pop();
                (planes.remove(0), back)
            }
        };
        let far = options.far.unwrap_or(FAR);
        let mut layers =
            ExrLayers { name: name.to_string(), first, back, second, far, projection, key: Vec::new(), notes };
        layers.key = layers.digest();
        Ok(layers)
    }

    fn side(&self) -> usize {
        1 << self.projection.log2_resolution
    }

    /// Hash of the depths, whatever type and compression they had in the files.
    fn digest(&self) -> Vec<u8> {
        let mut h = Xxh3::new();
        let mut bytes = Vec::with_capacity(8 * self.side());
        for plane in std::iter::once(&self.first).chain(&self.back) {
            for y in 0..self.side() {
                bytes.clear();
                let row = (0..self.side()).map(|x| plane.depth(y * self.side() + x, self.far));
                row.for_each(|d| bytes.extend(d.to_bits().to_le_bytes()));
                h.update(&bytes);
            }
        }
        h.digest128().to_le_bytes().to_vec()
    }
}

impl DepthSource for ExrLayers {
    fn name(&self) -> &str {
        &self.name
    }

    fn projection(&self) -> Projection {
        self.projection
    }

    fn second(&self) -> Second {
        self.second
    }

    fn key(&self) -> Vec<u8> {
        self.key.clone()
    }

    fn render(&self, square: Square, first: &mut [f64], second: &mut [f64]) -> Result<(), SourceError> {
        for (plane, out) in std::iter::once(&self.first).chain(&self.back).zip([first, second]) {
            for (i, depth) in out.iter_mut().enumerate() {
                let [x, y] = square.texel(i);
                *depth = plane.depth(y as usize * self.side() + x as usize, self.far);
            }
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        Plane::bytes((self.side() * self.side()) as u64) * if self.back.is_some() { 2 } else { 1 }
    }
}

fn size(h: &Header) -> String {
    format!("{} x {} pixels", h.layer_size.x(), h.layer_size.y())
}

fn corner(h: &Header) -> String {
    format!("({}, {})", h.own_attributes.layer_position.x(), h.own_attributes.layer_position.y())
}

fn named(file: &File, name: &str) -> Result<Channel, ExrError> {
    file.channels().into_iter().find(|c| c.name == name).ok_or_else(|| file.no_channel(format!("a channel '{name}'")))
}

/// What a second depth is, as its channel's name says.
fn by_name(name: &str) -> Second {
    if name.rsplit('.').next() == Some("ZBack") { Second::Exit } else { Second::NextSurface }
}

/// The only channel of these, or nothing; several are an error.
fn only(file: &File, wanted: &str, all: Vec<Channel>) -> Result<Option<Channel>, ExrError> {
    match all.len() {
        0 | 1 => Ok(all.into_iter().next()),
        _ => Err(file.no_channel(format!("only one {wanted}"))),
    }
}

fn first_channel(file: &File) -> Result<Channel, ExrError> {
    let wanted = "a channel of first depth (first.Z, Z, or one that ends in .Z)";
    let all = file.channels();
    for name in ["first.Z", "Z"] {
        if let Some(c) = only(file, name, all.iter().filter(|c| c.name == name).cloned().collect())? {
            return Ok(c);
        }
    }
    let rest = all.into_iter().filter(|c| c.name.ends_with(".Z") && c.name != "second.Z").collect();
    only(file, wanted, rest)?.ok_or_else(|| file.no_channel(wanted.to_string()))
}

/// The second depth beside the first.
fn second_channel(file: &File, first: &Channel) -> Result<Option<(Channel, Second)>, ExrError> {
    let layer = first.name.rsplit_once('.').map_or(String::new(), |(l, _)| format!("{l}."));
    let names = ["second.Z".to_string(), format!("{layer}ZBack")];
    let all = file.channels().into_iter().filter(|c| names.contains(&c.name)).collect();
    Ok(only(file, "second depth", all)?.map(|c| {
        let meaning = by_name(&c.name);
        (c, meaning)
    }))
}

/// The second depth in a file of its own.
fn lone_second(file: &File) -> Result<(Channel, Second), ExrError> {
    let ends = |c: &Channel| c.name == "second.Z" || c.name.rsplit('.').next() == Some("ZBack");
    let all = file.channels().into_iter().filter(ends).collect();
    let channel = match only(file, "second depth", all)? {
        Some(c) => c,
        None => first_channel(file)?,
    };
    let meaning = by_name(&channel.name);
    Ok((channel, meaning))
}

/// World to pixels of the data window and depth.
fn place(header: &Header, side: u64, options: &ExrOptions, notes: &mut Vec<String>) -> Result<Projection, String> {
    let mut projection = Projection::image(side).map_err(|e| e.to_string())?;
    match options.placement {
        Placement::Image => {}
        Placement::Box { direction, low, high } => {
            projection = Projection::orthographic(direction, low, high, side).map_err(|e| e.to_string())?;
            // The box is for x and y; surfaces may lie before or behind it.
            projection.depth = DepthScale::Found;
        }
        Placement::Header => {
            let own = &header.own_attributes;
            match (&own.world_to_normalized_device, &own.world_to_camera) {
                (Some(ndc), Some(camera)) => {
                    let window = header.shared_attributes.display_window;
                    let data = own.layer_position;
                    let (ndc, camera) = (affine("worldToNDC", ndc)?, affine("worldToCamera", camera)?);
                    // NDC (0, 0) and (1, 1) are the upper left and lower right corner of the display window.
                    let pixel = |row: [f64; 4], size: usize, from: i32, to: i32| {
                        let mut r = row.map(|v| v * size as f64);
                        r[3] += f64::from(from) - f64::from(to);
                        r
                    };
                    projection.world_to_layers = [
                        pixel(ndc[0], window.size.x(), window.position.x(), data.x()),
                        pixel(ndc[1], window.size.y(), window.position.y(), data.y()),
                        camera[2],
                    ];
                    notes.push("placed in the world by worldToNDC and worldToCamera".to_string());
                }
                (None, None) => notes.push("in image space: x and y in pixels, z in the depth of the file".to_string()),
                (ndc, _) => {
                    let (has, lacks) =
                        if ndc.is_some() { ("worldToNDC", "worldToCamera") } else { ("worldToCamera", "worldToNDC") };
                    notes.push(format!(
                        "in image space: x and y in pixels, z in the depth of the file; {has} needs {lacks} beside it"
                    ));
                }
            }
        }
    }
    Ok(projection)
}

/// Rows of the map of column vectors; OpenEXR's matrices are row-major and multiply row vectors from the right.
fn affine(name: &str, m: &[f32; 16]) -> Result<[[f64; 4]; 3], String> {
    let m = m.map(f64::from);
    let w = m[15];
    if m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || w == 0.0 || !m.iter().all(|v| v.is_finite()) {
        return Err(format!(
            "{name} is not the matrix of an orthographic view; bake in image space with --image-space, or place it with --light NAME=dir:X,Y,Z --bounds"
        ));
    }
    Ok([0, 1, 2].map(|j| [m[j] / w, m[4 + j] / w, m[8 + j] / w, m[12 + j] / w]))
}
