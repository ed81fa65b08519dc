//! Bytes behind the JSON: chunks of GLB, buffers, accessors.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::json::{Accessor, Index, Root};
use super::{Fault, text};

/// Elements that may be read of any file, and how many more for each of its bytes. Meshes alone never come near.
const EFFORT: u64 = 1 << 30;
const EFFORT_PER_BYTE: u64 = 64;

/// Some exporters leave the padding out.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// The JSON of a .gltf or .glb file, and the binary chunk of the latter.
pub fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| {
        let four = bytes.get(at..at + 4).and_then(|b| <[u8; 4]>::try_from(b).ok());
        let left = bytes.len().saturating_sub(at);
        four.map(u32::from_le_bytes).ok_or_else(|| cut(format!("GLB, byte {at}"), 4, left))
    };
    let version = word(4)?;
    if version != 2 {
        return Err(Fault::Unsupported {
            at: "GLB header, byte 4".into(),
            expected: "version 2".into(),
            found: format!("version {version}"),
        });
    }
    let length = word(8)? as usize;
    if length > bytes.len() || length < 12 {
        return Err(cut("GLB header, byte 8: whole file".into(), length, bytes.len()));
    }
    let (mut at, mut json, mut binary) = (12, None, None);
    while at < length {
        let (size, kind) = (word(at)? as usize, word(at + 4)?);
        let rest = &bytes[(at + 8).min(length)..length];
        let content = rest.get(..size).ok_or_else(|| cut(format!("GLB chunk at byte {at}"), size, rest.len()))?;
        match &kind.to_le_bytes() {
            b"JSON" if at == 12 => json = Some(content),
            b"BIN\0" if binary.is_none() => binary = Some(content),
            // Others belong to extensions.
            _ => {}
        }
        // Chunks are padded to four bytes; where a writer forgot it, the next would be misread either way.
        at += 8 + size;
    }
    let json = json.ok_or_else(|| Fault::syntax("GLB, byte 12", "a chunk `JSON`", "none"))?;
    Ok((json, binary))
}

fn cut(at: String, expected: usize, found: usize) -> Fault {
    Fault::Truncated { at, expected: format!("{expected} bytes"), found: found.to_string() }
}

/// What URIs of a file give.
pub struct Sources<'a> {
    /// The folder that relative paths start from.
    pub folder: &'a Path,
    read: HashMap<PathBuf, Arc<Vec<u8>>>,
}

impl<'a> Sources<'a> {
    pub fn new(folder: &'a Path) -> Sources<'a> {
        Sources { folder, read: HashMap::new() }
    }

    /// The bytes that `uri` stands for: base64 data, or a file below or beside this one.
    pub fn get(&mut self, uri: &str, at: &str) -> Result<Arc<Vec<u8>>, Fault> {
        if let Some(data) = uri.strip_prefix("data:") {
            let bad = |found: String| Fault::syntax(at, "a data URI with base64", found);
            let (kind, data) = data.split_once(',').ok_or_else(|| bad(text::quote(data.as_bytes())))?;
            if !kind.ends_with(";base64") {
                return Err(bad(text::quote(kind.as_bytes())));
            }
            return BASE64.decode(data).map(Arc::new).map_err(|e| bad(text::line(&e.to_string())));
        }
        let name = percent_decoded(uri);
        let scheme = name.split_once(':').is_some_and(|(s, _)| s.bytes().all(|b| b.is_ascii_alphanumeric()));
        if scheme || Path::new(&*name).has_root() {
            return Err(Fault::Unsupported {
                at: at.into(),
                expected: "a data URI or a relative path".into(),
                found: text::quote(uri.as_bytes()),
            });
        }
        let external = |fault| Fault::External { at: at.into(), file: name.to_string(), fault: Box::new(fault) };
        let path = self.folder.join(&*name);
        // Many buffers may name one file, in many ways; it takes memory once.
        let path = path.canonicalize().unwrap_or(path);
        if let Some(bytes) = self.read.get(&path) {
            return Ok(bytes.clone());
        }
        let bytes = Arc::new(super::super::read(&path).map_err(external)?);
        self.read.insert(path, bytes.clone());
        Ok(bytes)
    }
}

/// `uri` with %20 and the like as the characters they stand for; others stay.
fn percent_decoded(uri: &str) -> Cow<'_, str> {
    if !uri.contains('%') {
        return uri.into();
    }
    let bytes = uri.as_bytes();
    let (mut decoded, mut i) = (Vec::with_capacity(bytes.len()), 0);
    while i < bytes.len() {
        let code = bytes.get(i + 1..i + 3).filter(|h| bytes[i] == b'%' && h.iter().all(u8::is_ascii_hexdigit));
        let code = code.and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        decoded.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&decoded).into_owned().into()
}

/// The buffers of a file and what its accessors read from them.
pub struct Data<'a> {
    root: &'a Root,
    buffers: Vec<Bytes<'a>>,
    /// All bytes there are: an accessor without bytes of its own may not have more elements.
    pub size: usize,
    /// What reading has cost so far, in elements.
    spent: Cell<u64>,
}

/// A buffer: read or decoded, or a part of the file.
enum Bytes<'a> {
    Own(Arc<Vec<u8>>),
    Part(&'a [u8]),
}

impl std::ops::Deref for Bytes<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Bytes::Own(bytes) => bytes,
            Bytes::Part(bytes) => bytes,
        }
    }
}

/// Where elements lie: bytes from the first one on, and how far apart they are.
struct Span<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> Data<'a> {
    pub fn new(
        root: &'a Root,
        sources: &mut Sources,
        binary: Option<&'a [u8]>,
        size: usize,
    ) -> Result<Data<'a>, Fault> {
        let mut data = Data { root, buffers: Vec::new(), size, spent: Cell::new(0) };
        for (i, buffer) in root.buffers.iter().enumerate() {
            let at = format!("buffer {i}");
            let bytes = match (&buffer.uri, binary) {
                (Some(uri), _) => Bytes::Own(sources.get(uri, &at)?),
                (None, Some(binary)) if i == 0 => Bytes::Part(binary),
                // Extensions may leave a buffer without bytes; it is missed when it is read.
                (None, _) => Bytes::Part(&[]),
            };
            if (bytes.len() as u64) < buffer.byte_length && (buffer.uri.is_some() || !bytes.is_empty()) {
                let expected = format!("{} bytes", buffer.byte_length);
                return Err(Fault::Truncated { at, expected, found: bytes.len().to_string() });
            }
            data.buffers.push(bytes);
        }
        data.size += data.buffers.iter().map(|b| b.len()).sum::<usize>();
        Ok(data)
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: Index, at: &str) -> Result<&[u8], Fault> {
        let view = super::get(&self.root.buffer_views, index, "buffer views", at)?;
        let at = format!("{at}, buffer view {index}");
        let buffer = super::get(&self.buffers, view.buffer, "buffers", &at)?;
        let end = view.byte_offset.checked_add(view.byte_length).filter(|e| *e <= buffer.len() as u64);
        let end = end.ok_or_else(|| Fault::Truncated {
            at: format!("{at}, buffer {}", view.buffer),
            expected: format!("{} bytes from byte {}", view.byte_length, view.byte_offset),
            found: format!("{} bytes in all", buffer.len()),
        })?;
        Ok(&buffer[view.byte_offset as usize..end as usize])
    }

    /// `count` elements of `size` bytes from `offset` of a view; all are there.
    fn span(&self, index: Index, offset: u64, count: u64, size: usize, at: &str) -> Result<Span<'_>, Fault> {
        let bytes = self.view(index, at)?;
        let stride = self.root.buffer_views[index].byte_stride.unwrap_or(0);
        let stride = if stride == 0 { size as u64 } else { stride };
        if stride < size as u64 {
            return Err(Fault::syntax(
                format!("{at}, buffer view {index}"),
                format!("a stride from {size}"),
                stride.to_string(),
            ));
        }
        let needed = (u128::from(count).saturating_sub(1)) * u128::from(stride) + size as u128 + u128::from(offset);
        if count > 0 && needed > bytes.len() as u128 {
            return Err(Fault::Truncated {
                at: format!("{at}, buffer view {index}"),
                expected: format!("{needed} bytes for {count} elements"),
                found: bytes.len().to_string(),
            });
        }
        Ok(Span { bytes: bytes.get(offset as usize..).unwrap_or(&[]), stride: stride as usize })
    }

    /// Counts work. A small file may name one list many times and would else take hours.
    pub fn spend(&self, cost: u64, at: &str) -> Result<(), Fault> {
        let most = EFFORT + EFFORT_PER_BYTE * self.size as u64;
        self.spent.set(self.spent.get().saturating_add(cost));
        if self.spent.get() <= most {
            return Ok(());
        }
        let (most, found) = (format!("{most} elements to read for a file of this size"), "more".into());
        Err(Fault::TooLarge { at: at.into(), most, found })
    }

    /// The elements of an accessor of N components, whatever their type; normalized ones within -1..=1.
    pub fn read<const N: usize>(&self, index: Index, at: &str) -> Result<Vec<[f64; N]>, Fault> {
        let at = format!("{at}, accessor {index}");
        let (accessor, element) = self.element::<N>(index, &at)?;
        let count = self.checked_count(accessor, &at)?;
        self.spend(count as u64, &at)?;
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let span = self.span(view, accessor.byte_offset, accessor.count, element.size, &at)?;
                (0..count).map(|i| element.value(&span, i)).collect()
            }
            None => vec![[0.0; N]; count],
        };
        if let Some(sparse) = &accessor.sparse {
            let at = format!("{at}, sparse");
            let place = Element::<1>::new(sparse.indices.component_type, false, &at)?;
            let places =
                self.span(sparse.indices.buffer_view, sparse.indices.byte_offset, sparse.count, place.size, &at)?;
            let news =
                self.span(sparse.values.buffer_view, sparse.values.byte_offset, sparse.count, element.size, &at)?;
            self.spend(sparse.count, &at)?;
            for i in 0..sparse.count as usize {
                let [place] = place.value(&places, i);
                let value = values.get_mut(place as usize).filter(|_| place >= 0.0).ok_or_else(|| Fault::Index {
                    at: format!("{at} index {i}"),
                    what: "elements",
                    count,
                    found: place.to_string(),
                })?;
                *value = element.value(&news, i);
            }
        }
        Ok(values)
    }

    /// The elements at `places`, all below `count`, which the accessor must have.
    pub fn gather<const N: usize>(
        &self,
        index: Index,
        places: &[u32],
        count: usize,
        at: &str,
    ) -> Result<Vec<[f64; N]>, Fault> {
        let here = format!("{at}, accessor {index}");
        let (accessor, element) = self.element::<N>(index, &here)?;
        if accessor.count != count as u64 {
            let expected = format!("{count} elements, one for each vertex");
            return Err(Fault::syntax(here, expected, accessor.count.to_string()));
        }
        if let (Some(view), None) = (accessor.buffer_view, &accessor.sparse) {
            let span = self.span(view, accessor.byte_offset, accessor.count, element.size, &here)?;
            return Ok(places.iter().map(|i| element.value(&span, *i as usize)).collect());
        }
        let all = self.read::<N>(index, at)?;
        Ok(places.iter().map(|i| all[*i as usize]).collect())
    }

    fn element<const N: usize>(&self, index: Index, at: &str) -> Result<(&'a Accessor, Element<N>), Fault> {
        let accessor = super::get(&self.root.accessors, index, "accessors", at)?;
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        if accessor.shape != shape {
            return Err(Fault::syntax(at, shape, text::quote(accessor.shape.as_bytes())));
        }
        Ok((accessor, Element::new(accessor.component_type, accessor.normalized, at)?))
    }

    fn checked_count(&self, accessor: &Accessor, at: &str) -> Result<usize, Fault> {
        let most = if accessor.buffer_view.is_some() { super::super::MOST * 3 } else { self.size };
        usize::try_from(accessor.count).ok().filter(|c| *c <= most).ok_or_else(|| Fault::TooLarge {
            at: at.into(),
            most: format!("{most} elements"),
            found: accessor.count.to_string(),
        })
    }
}

/// How elements of N components are stored.
struct Element<const N: usize> {
    kind: u32,
    normalized: bool,
    /// Bytes of all components.
    size: usize,
}

impl<const N: usize> Element<N> {
    fn new(kind: u32, normalized: bool, at: &str) -> Result<Element<N>, Fault> {
        let size = match kind {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5125 | 5126 => 4,
            _ => return Err(Fault::syntax(at, "a component type from 5120 to 5126 except 5124", kind.to_string())),
        };
        Ok(Element { kind, normalized, size: size * N })
    }

    /// Element `i` of a span that was made for this size.
    fn value(&self, span: &Span, i: usize) -> [f64; N] {
        let mut value = [0.0; N];
        let bytes = &span.bytes[i * span.stride..][..self.size];
        for (value, bytes) in value.iter_mut().zip(bytes.chunks_exact(self.size / N)) {
            *value = component(bytes, self.kind, self.normalized);
        }
        value
    }
}

/// `bytes` are as many as the type has.
fn component(bytes: &[u8], kind: u32, normalized: bool) -> f64 {
    let mut b = [0; 4];
    b[..bytes.len()].copy_from_slice(bytes);
    let low = u32::from_le_bytes(b);
    let (value, one) = match kind {
        5120 => (f64::from(low as u8 as i8), 127.0),
        5121 => (f64::from(low), 255.0),
        5122 => (f64::from(low as u16 as i16), 32767.0),
        5123 => (f64::from(low), 65535.0),
        5126 => return f64::from(f32::from_bits(low)),
        _ => (f64::from(low), f64::from(u32::MAX)),
    };
    if normalized { (value / one).max(-1.0) } else { value }
}
