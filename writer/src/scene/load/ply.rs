//! PLY, text or binary of either byte order: the elements `vertex` and `face`; all others are skipped.

use super::polygon::Fans;
use super::{Fault, Loaded, text};

/// The most elements; files have two or three, and each is compared with all others.
const MOST_ELEMENTS: usize = 256;
/// The longest header line; a longer one is not a header.
const LONGEST_LINE: usize = 4096;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &[u8]) -> Option<Scalar> {
        Some(match name {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    fn whole(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

#[derive(Debug)]
struct Property {
    name: Vec<u8>,
    /// Type of the number of items, if it is a list.
    list: Option<Scalar>,
    scalar: Scalar,
}

#[derive(Debug)]
struct Element {
    name: Vec<u8>,
    count: usize,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Bytes it takes.
    length: usize,
}

/// Reads a whole file.
pub fn parse(bytes: &[u8]) -> Result<Loaded, Fault> {
    let header = header(bytes)?;
    let mut scene = Loaded::default();
    let mut fans = Fans::default();
    let mut body = Body { bytes, at: header.length, encoding: header.encoding };
    let vertices = header.elements.iter().find(|e| e.name == b"vertex").map_or(0, |e| e.count);
    for element in &header.elements {
        match element.name.as_slice() {
            b"vertex" => read_vertices(element, &mut body, &mut scene)?,
            b"face" => read_faces(element, &mut body, vertices, &mut scene, &mut fans)?,
            name => {
                let skipped = format!("element {} is skipped ({} of them)", text::quote(name), element.count);
                scene.notes.push(skipped);
                // Without properties it takes no bytes, whatever its count.
                for index in 0..if element.properties.is_empty() { 0 } else { element.count } {
                    for property in &element.properties {
                        body.skip(&Spot { element, index, property })?;
                    }
                }
            }
        }
    }
    let rest = bytes[body.at..].trim_ascii().len();
    if rest > 0 {
        scene.notes.push(format!("{rest} bytes after the last element are ignored"));
    }
    scene.notes.extend(fans.finish(&mut scene.mesh, "face"));
    Ok(scene)
}

fn read_vertices(element: &Element, body: &mut Body, scene: &mut Loaded) -> Result<(), Fault> {
    // Where each property goes: a coordinate, or nowhere.
    let mut places = vec![None; element.properties.len()];
    for (axis, name) in [b"x", b"y", b"z"].into_iter().enumerate() {
        let place = element.properties.iter().position(|p| p.name == name && p.list.is_none());
        let expected = || format!("a scalar property {} of element `vertex`", text::quote(name));
        let place = place.ok_or_else(|| Fault::syntax("header", expected(), "none"))?;
        places[place] = Some(axis);
    }
    scene.mesh.positions.reserve(body.fitting(element));
    for index in 0..element.count {
        let mut position = [0.0; 3];
        for (property, place) in element.properties.iter().zip(&places) {
            let spot = Spot { element, index, property };
            match place {
                Some(axis) => {
                    let value = body.value(property.scalar, &spot)?;
                    if !value.is_finite() {
                        return Err(Fault::NotFinite { at: spot.to_string(), found: value.to_string() });
                    }
                    position[*axis] = value;
                }
                None => body.skip(&spot)?,
            }
        }
        scene.mesh.positions.push(position);
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    body: &mut Body,
    vertices: usize,
    scene: &mut Loaded,
    fans: &mut Fans,
) -> Result<(), Fault> {
    let expected = "a property `list <whole> <whole> vertex_indices` of element `face`";
    let wanted = |p: &Property| p.name == b"vertex_indices" || p.name == b"vertex_index";
    let place = element.properties.iter().position(|p| wanted(p) && p.list.is_some() && p.scalar.whole());
    let place = place.ok_or_else(|| Fault::syntax("header", expected, "none"))?;
    let mut corners: Vec<u32> = Vec::new();
    let mut small = 0;
    scene.mesh.triangles.reserve(body.fitting(element));
    for index in 0..element.count {
        for (i, property) in element.properties.iter().enumerate() {
            let spot = Spot { element, index, property };
            let Some(count) = property.list.filter(|_| i == place) else {
                body.skip(&spot)?;
                continue;
            };
            corners.clear();
            for _ in 0..body.items(count, &spot)? {
                let corner = body.value(property.scalar, &spot)?;
                if corner < 0.0 || corner >= vertices as f64 {
                    let (at, found) = (spot.to_string(), corner.to_string());
                    return Err(Fault::Index { at, what: "vertices (0 is the first)", count: vertices, found });
                }
                corners.push(corner as u32);
            }
            if corners.len() < 3 {
                small += 1;
            } else {
                fans.add(&mut scene.mesh.triangles, &corners, index);
            }
        }
    }
    if small > 0 {
        scene.notes.push(format!("{small} faces with fewer than three corners are ignored"));
    }
    Ok(())
}

/// Which value is being read, for messages.
struct Spot<'a> {
    element: &'a Element,
    index: usize,
    property: &'a Property,
}

impl std::fmt::Display for Spot<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let [element, property] = [&self.element.name, &self.property.name].map(|n| text::quote(n));
        write!(f, "element {element}, index {} of {}, property {property}", self.index, self.element.count)
    }
}

/// The values after the header.
struct Body<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
}

impl<'a> Body<'a> {
    /// How many of `element` fit the bytes left; its count may claim more.
    fn fitting(&self, element: &Element) -> usize {
        let least = |p: &Property| match self.encoding {
            Encoding::Ascii => 2,
            _ => p.list.unwrap_or(p.scalar).size(),
        };
        let size: usize = element.properties.iter().map(least).sum();
        element.count.min((self.bytes.len() - self.at) / size.max(1) + 1)
    }

    fn skip(&mut self, spot: &Spot) -> Result<(), Fault> {
        let items = spot.property.list.map_or(Ok(1), |count| self.items(count, spot))?;
        match self.encoding {
            Encoding::Ascii => (0..items).try_for_each(|_| self.word(spot).map(|_| ())),
            _ => self.take(items.saturating_mul(spot.property.scalar.size()), spot).map(|_| ()),
        }
    }

    /// The number of items of a list.
    fn items(&mut self, scalar: Scalar, spot: &Spot) -> Result<usize, Fault> {
        let count = self.value(scalar, spot)?;
        if count < 0.0 {
            return Err(Fault::syntax(spot.to_string(), "a number of items from 0", count.to_string()));
        }
        Ok(count as usize)
    }

    /// A number; those of whole types are whole and in range.
    fn value(&mut self, scalar: Scalar, spot: &Spot) -> Result<f64, Fault> {
        if self.encoding == Encoding::Ascii {
            return self.ascii(scalar, spot);
        }
        let taken = self.take(scalar.size(), spot)?;
        // Little-endian from here on, widened by zeros.
        let mut b = [0; 8];
        b[..taken.len()].copy_from_slice(taken);
        if self.encoding == Encoding::Big {
            b[..taken.len()].reverse();
        }
        let low = u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        Ok(match scalar {
            Scalar::I8 => f64::from(low as u8 as i8),
            Scalar::I16 => f64::from(low as u16 as i16),
            Scalar::I32 => f64::from(low as i32),
            Scalar::U8 | Scalar::U16 | Scalar::U32 => f64::from(low),
            Scalar::F32 => f64::from(f32::from_bits(low)),
            Scalar::F64 => f64::from_le_bytes(b),
        })
    }

    fn ascii(&mut self, scalar: Scalar, spot: &Spot) -> Result<f64, Fault> {
        let word = self.word(spot)?;
        if !scalar.whole() {
            let bad = || Fault::syntax(spot.to_string(), "a number", text::quote(word));
            return text::number(word).ok_or_else(bad);
        }
        let (low, high) = match scalar {
            Scalar::I8 => (i64::from(i8::MIN), i64::from(i8::MAX)),
            Scalar::U8 => (0, i64::from(u8::MAX)),
            Scalar::I16 => (i64::from(i16::MIN), i64::from(i16::MAX)),
            Scalar::U16 => (0, i64::from(u16::MAX)),
            Scalar::I32 => (i64::from(i32::MIN), i64::from(i32::MAX)),
            _ => (0, i64::from(u32::MAX)),
        };
        let whole = text::number(word).filter(|v: &i64| (low..=high).contains(v));
        let bad = || Fault::syntax(spot.to_string(), format!("a whole number from {low} to {high}"), text::quote(word));
        whole.map(|v| v as f64).ok_or_else(bad)
    }

    fn word(&mut self, spot: &Spot) -> Result<&'a [u8], Fault> {
        let rest = self.bytes[self.at..].trim_ascii_start();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at = self.bytes.len() - rest.len() + length;
        if length == 0 {
            let at = spot.to_string();
            return Err(Fault::Truncated { at, expected: "a number".into(), found: "the end of the file".into() });
        }
        Ok(&rest[..length])
    }

    fn take(&mut self, size: usize, spot: &Spot) -> Result<&'a [u8], Fault> {
        let rest = &self.bytes[self.at..];
        let taken = rest.get(..size).ok_or_else(|| Fault::Truncated {
            at: format!("{spot}, byte {}", self.at),
            expected: format!("{size} bytes"),
            found: rest.len().to_string(),
        })?;
        self.at += size;
        Ok(taken)
    }
}

fn header(bytes: &[u8]) -> Result<Header, Fault> {
    // Old files end lines with a lone carriage return, and then binary data may start with a line feed.
    let lone = bytes.starts_with(b"ply\r") && bytes.get(4) != Some(&b'\n');
    let end = if lone { b'\r' } else { b'\n' };
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut length, mut number) = (0, 0);
    loop {
        let rest = &bytes[length..];
        number += 1;
        let at = || format!("header line {number}");
        let Some(size) = rest[..rest.len().min(LONGEST_LINE)].iter().position(|b| *b == end) else {
            let expected = format!("a line of at most {LONGEST_LINE} bytes");
            if rest.len() > LONGEST_LINE {
                return Err(Fault::syntax(at(), expected, text::quote(rest)));
            }
            let (expected, found) = ("a header up to `end_header`".into(), text::quote(rest));
            return Err(Fault::Truncated { at: at(), expected, found });
        };
        length += size + 1;
        let line = &rest[..size];
        let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
        let wrong = |expected: &str| Fault::syntax(at(), expected, text::quote(line));
        match words.as_slice() {
            [b"ply"] if number == 1 => {}
            _ if number == 1 => return Err(wrong("`ply`")),
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", name, version] => {
                encoding = match *name {
                    b"ascii" => Some(Encoding::Ascii),
                    b"binary_little_endian" => Some(Encoding::Little),
                    b"binary_big_endian" => Some(Encoding::Big),
                    _ => return Err(wrong("`ascii`, `binary_little_endian` or `binary_big_endian` after `format`")),
                };
                if *version != b"1.0" {
                    return Err(wrong("version 1.0"));
                }
            }
            [b"element", name, count] => {
                if elements.iter().any(|e| e.name == *name) {
                    return Err(wrong("each element once"));
                }
                if elements.len() == MOST_ELEMENTS {
                    return Err(wrong(&format!("at most {MOST_ELEMENTS} elements")));
                }
                let count = text::number(count).ok_or_else(|| wrong("a whole number of elements"))?;
                elements.push(Element { name: name.to_vec(), count, properties: Vec::new() });
            }
            [b"property", rest @ ..] => {
                let (list, scalar, name) = match rest {
                    [b"list", count, scalar, name] => (Some(*count), *scalar, *name),
                    [scalar, name] => (None, *scalar, *name),
                    _ => return Err(wrong("`property TYPE NAME` or `property list TYPE TYPE NAME`")),
                };
                let known = |name| Scalar::named(name).ok_or_else(|| wrong("a type such as `float` or `uint32`"));
                let list = list.map(known).transpose()?;
                if list.is_some_and(|l| !l.whole()) {
                    return Err(wrong("a whole type for the number of items"));
                }
                let property = Property { name: name.to_vec(), list, scalar: known(scalar)? };
                elements.last_mut().ok_or_else(|| wrong("an element before its properties"))?.properties.push(property);
            }
            [b"end_header"] => break,
            _ => return Err(wrong("`format`, `element`, `property`, `comment` or `end_header`")),
        }
    }
    let encoding = encoding.ok_or_else(|| Fault::syntax("header", "a line `format`", "none"))?;
    if let Some(e) = elements.iter().find(|e| e.name == b"vertex" && e.count > super::MOST) {
        let (most, found) = (format!("{} vertices", super::MOST), e.count.to_string());
        return Err(Fault::TooLarge { at: "header".into(), most, found });
    }
    Ok(Header { encoding, elements, length })
}

#[cfg(test)]
mod tests;
