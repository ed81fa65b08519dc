//! Alpha MASK: textures that cut holes.

use std::collections::HashMap;
use std::io::Cursor;
use std::sync::Arc;

use super::data::{Data, Sources};
use super::json::{Image, Index, Material, Primitive, Root, Sampler, TextureTransform};
use super::{Fault, get, text};

/// The most pixels of all images together.
const MOST_PIXELS: u64 = 1 << 28;
/// More pixels than this per byte can't be in a PNG: deflate gives at most 1032 bytes for one, of 8 pixels each.
const PIXELS_PER_BYTE: u64 = 1032 * 8;

/// What texture coordinates outside 0..=1 mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The image repeats.
    Repeat,
    /// The outermost pixels go on.
    Clamp,
    /// The image repeats, every other one mirrored.
    Mirror,
}

/// The alpha of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlphaImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Alpha of each pixel, 255 is opaque; the first row is the one at v = 0.
    pub alpha: Vec<u8>,
}

/// A triangle with holes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskedTriangle {
    /// Its index in the mesh.
    pub triangle: u32,
    /// Texture coordinates of its corners, transformed; (0, 0) is the outer corner of the image's first pixel.
    pub uv: [[f32; 2]; 3],
    /// What the image's alpha is multiplied by, at each corner: the material's factor and the vertex colour's alpha.
    pub opacity: [f32; 3],
}

/// A material with alpha MASK: a point is solid where alpha x opacity >= cutoff, else a hole.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaMask {
    /// Index of the material in the file.
    pub material: usize,
    /// From this alpha on (1 is opaque), a point is solid.
    pub cutoff: f32,
    /// The alpha of the base colour texture, or one opaque pixel.
    pub image: Arc<AlphaImage>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// Bilinear between the centres of pixels; else the pixel that the point lies in.
    pub linear: bool,
    /// The triangles it is on, in the order of the mesh.
    pub triangles: Vec<MaskedTriangle>,
}

/// What a material does to the surfaces of a primitive.
pub enum Surface {
    /// No holes.
    Solid,
    /// One hole.
    Hole,
    /// Holes.
    Masked {
        /// Place in [`Masks::list`].
        mask: usize,
        /// Texture coordinates of each corner.
        uv: Vec<[f32; 2]>,
        /// Opacity of each corner.
        opacity: Vec<f32>,
    },
}

/// Masks of a file as they are met.
#[derive(Default)]
pub struct Masks {
    /// Those that any triangle is on.
    pub list: Vec<AlphaMask>,
    of_material: HashMap<Index, usize>,
    /// `None`: no pixel is less than opaque.
    images: HashMap<Index, Option<Arc<AlphaImage>>>,
    pixels: u64,
}

impl Masks {
    /// What a primitive's material does to it; `corners` are those of its `count` vertices
    /// that it draws.
    pub fn surface(
        &mut self,
        root: &Root,
        data: &Data,
        sources: &mut Sources,
        primitive: &Primitive,
        (corners, count): (&[u32], usize),
        at: &str,
    ) -> Result<Surface, Fault> {
        let Some(index) = primitive.material else { return Ok(Surface::Solid) };
        let material = get(&root.materials, index, "materials", at)?;
        match material.alpha_mode.as_str() {
            "MASK" => {}
            "OPAQUE" | "BLEND" => return Ok(Surface::Solid),
            other => {
                let at = format!("material {index}");
                return Err(Fault::syntax(at, "alphaMode `OPAQUE`, `MASK` or `BLEND`", text::quote(other.as_bytes())));
            }
        }
        let image = self.image_of(root, data, sources, material, index)?;
        let factor = material.pbr_metallic_roughness.base_color_factor[3] as f32;
        let coloured = primitive.attributes.get("COLOR_0").filter(|i| {
            // A colour without alpha cuts nothing.
            root.accessors.get(**i).is_some_and(|a| a.shape == "VEC4")
        });
        if image.is_none() && coloured.is_none() {
            return Ok(if factor >= material.alpha_cutoff as f32 { Surface::Solid } else { Surface::Hole });
        }
        let uv = coordinates(data, primitive, material, (corners, count), at)?;
        let opacity: Vec<f32> = match coloured {
            Some(colour) => {
                let colours = data.gather::<4>(*colour, corners, count, &format!("{at}, COLOR_0"))?;
                colours.iter().map(|c| c[3] as f32 * factor).collect()
            }
            None => vec![factor; corners.len()],
        };
        if !opacity.iter().all(|o| o.is_finite()) {
            return Err(Fault::NotFinite { at: format!("{at}, COLOR_0"), found: "an opacity that isn't".into() });
        }
        let mask = match self.of_material.get(&index) {
            Some(mask) => *mask,
            None => {
                self.list.push(mask(root, material, index, image)?);
                self.of_material.insert(index, self.list.len() - 1);
                self.list.len() - 1
            }
        };
        Ok(Surface::Masked { mask, uv, opacity })
    }

    fn image_of(
        &mut self,
        root: &Root,
        data: &Data,
        sources: &mut Sources,
        material: &Material,
        index: Index,
    ) -> Result<Option<Arc<AlphaImage>>, Fault> {
        let Some(info) = &material.pbr_metallic_roughness.base_color_texture else { return Ok(None) };
        let texture = get(&root.textures, info.index, "textures", &format!("material {index}"))?;
        let at = format!("material {index}, texture {}", info.index);
        let Some(source) = texture.source else {
            let (expected, found) = ("a PNG or JPEG image".into(), "an image that only an extension gives".into());
            return Err(Fault::Unsupported { at, expected, found });
        };
        if let Some(image) = self.images.get(&source) {
            return Ok(image.clone());
        }
        let image = get(&root.images, source, "images", &at)?;
        let at = format!("image {source}");
        let decoded = match image {
            Image { uri: Some(uri), .. } => self.decoded(&sources.get(uri, &at)?, &at)?,
            Image { buffer_view: Some(view), .. } => self.decoded(data.view(*view, &at)?, &at)?,
            _ => return Err(Fault::syntax(at, "`uri` or `bufferView`", "neither")),
        };
        let decoded = decoded.filter(|i| i.alpha.iter().any(|a| *a < 255)).map(Arc::new);
        self.images.insert(source, decoded.clone());
        Ok(decoded)
    }

    /// The alpha of an encoded image, if it has any.
    fn decoded(&mut self, bytes: &[u8], at: &str) -> Result<Option<AlphaImage>, Fault> {
        if bytes.starts_with(b"\xFF\xD8\xFF") {
            // JPEG knows no alpha.
            return Ok(None);
        }
        if !bytes.starts_with(b"\x89PNG") {
            let (expected, found) = ("a PNG or JPEG image".into(), text::quote(&bytes[..bytes.len().min(8)]));
            return Err(Fault::Unsupported { at: at.into(), expected, found });
        }
        let broken = |e: png::DecodingError| Fault::syntax(at, "a PNG image", text::line(&e.to_string()));
        let mut decoder = png::Decoder::new(Cursor::new(bytes));
        // Palettes and keyed colours become alpha too; 8 bits are what an engine samples.
        decoder.set_transformations(png::Transformations::normalize_to_color8() | png::Transformations::ALPHA);
        let header = decoder.read_header_info().map_err(broken)?;
        let (width, height) = (header.width, header.height);
        let pixels = u64::from(width) * u64::from(height);
        let fits = (bytes.len() as u64).saturating_mul(PIXELS_PER_BYTE);
        if pixels > fits {
            return Err(Fault::Truncated {
                at: at.into(),
                expected: format!("{width} x {height} pixels"),
                found: format!("{} bytes, which can't hold them", bytes.len()),
            });
        }
        self.pixels += pixels;
        if self.pixels > MOST_PIXELS {
            return Err(Fault::TooLarge {
                at: at.into(),
                most: format!("{MOST_PIXELS} pixels in all alpha masks"),
                found: self.pixels.to_string(),
            });
        }
        let mut reader = decoder.read_info().map_err(broken)?;
        let size = reader.output_buffer_size().ok_or_else(|| Fault::syntax(at, "a PNG image", "an endless one"))?;
        let mut decoded = vec![0; size];
        let frame = reader.next_frame(&mut decoded).map_err(broken)?;
        let channels = frame.color_type.samples();
        let alpha = decoded[..frame.buffer_size()].chunks_exact(channels).map(|p| p[channels - 1]).collect();
        Ok(Some(AlphaImage { width, height, alpha }))
    }
}

fn mask(root: &Root, material: &Material, index: Index, image: Option<Arc<AlphaImage>>) -> Result<AlphaMask, Fault> {
    let at = format!("material {index}");
    let texture = material.pbr_metallic_roughness.base_color_texture.as_ref().map(|i| i.index);
    let sampler = texture.and_then(|t| root.textures.get(t)).and_then(|t| t.sampler);
    let standard = Sampler::default();
    let sampler = sampler.map_or(Ok(&standard), |s| get(&root.samplers, s, "samplers", &at))?;
    let wrap = |wrap: Option<u32>| match wrap {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33071) => Ok(Wrap::Clamp),
        Some(33648) => Ok(Wrap::Mirror),
        Some(other) => Err(Fault::syntax(at.clone(), "a wrap mode 10497, 33071 or 33648", other.to_string())),
    };
    let opaque = || Arc::new(AlphaImage { width: 1, height: 1, alpha: vec![255] });
    Ok(AlphaMask {
        material: index,
        cutoff: material.alpha_cutoff as f32,
        image: image.unwrap_or_else(opaque),
        wrap: [wrap(sampler.wrap_s)?, wrap(sampler.wrap_t)?],
        linear: sampler.mag_filter != Some(9728),
        triangles: Vec::new(),
    })
}

/// Texture coordinates of the base colour, transformed.
fn coordinates(
    data: &Data,
    primitive: &Primitive,
    material: &Material,
    (corners, count): (&[u32], usize),
    at: &str,
) -> Result<Vec<[f32; 2]>, Fault> {
    let Some(info) = &material.pbr_metallic_roughness.base_color_texture else {
        return Ok(vec![[0.0; 2]; corners.len()]);
    };
    let still = TextureTransform { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None };
    let transform = info.extensions.transform.as_ref().unwrap_or(&still);
    let name = format!("TEXCOORD_{}", transform.tex_coord.unwrap_or(info.tex_coord));
    let at = format!("{at}, {name}");
    let accessor = primitive.attributes.get(&name);
    let accessor = accessor.ok_or_else(|| Fault::syntax(&at, "texture coordinates for alpha MASK", "none"))?;
    let uv = data.gather::<2>(*accessor, corners, count, &at)?;
    // Counter-clockwise as seen with v downwards.
    let (sin, cos) = transform.rotation.sin_cos();
    let transformed = uv.iter().enumerate().map(|(i, uv)| {
        let [u, v] = [uv[0] * transform.scale[0], uv[1] * transform.scale[1]];
        let uv = [cos * u + sin * v + transform.offset[0], cos * v - sin * u + transform.offset[1]].map(|c| c as f32);
        let finite = uv.iter().all(|c| c.is_finite());
        if finite {
            Ok(uv)
        } else {
            Err(Fault::NotFinite { at: format!("{at}, corner {i}"), found: format!("{uv:?}") })
        }
    });
    transformed.collect()
}
