//! Wavefront OBJ: vertices and polygons; groups, materials, normals and texture coordinates are not needed.

use super::polygon::Fans;
use super::{Fault, Loaded, text};

/// Keywords that say nothing about where surfaces are.
const SILENT: [&[u8]; 22] = [
    b"vt",
    b"vn",
    b"vp",
    b"g",
    b"o",
    b"s",
    b"mg",
    b"mtllib",
    b"usemtl",
    b"usemap",
    b"maplib",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
    b"shadow_obj",
    b"trace_obj",
    b"call",
    b"csh",
    b"bmat",
    b"step",
    b"deg",
];

/// Reads a whole file.
pub fn parse(bytes: &[u8]) -> Result<Loaded, Fault> {
    let mut scene = Loaded::default();
    let mut fans = Fans::default();
    let mut ignored = Ignored::default();
    let mut corners = Vec::new();
    // A face may come before its vertices, so the largest index is checked at the end: (index, line).
    let mut largest = (0usize, 0usize);
    let mut lines = Lines { rest: bytes, number: 0 };
    while let Some((line, number)) = lines.next_line() {
        let mut words = line.split(|b| b.is_ascii_whitespace() || *b == b'\\').filter(|w| !w.is_empty());
        let Some(keyword) = words.next() else { continue };
        match keyword {
            b"v" => scene.mesh.positions.push(vertex(words, number)?),
            b"f" | b"fo" => {
                corners.clear();
                for word in words.take_while(|w| w[0] != b'#') {
                    let corner = corner(word, scene.mesh.positions.len(), number)?;
                    if corner >= largest.0 {
                        largest = (corner, number);
                    }
                    corners.push(u32::try_from(corner).unwrap_or(u32::MAX));
                }
                if corners.len() < 3 {
                    ignored.add("faces with fewer than three corners", number);
                } else {
                    fans.add(&mut scene.mesh.triangles, &corners, number);
                }
            }
            b"l" | b"p" => ignored.add("lines and points", number),
            _ if keyword[0] == b'#' || SILENT.contains(&keyword) => {}
            b"curv" | b"curv2" | b"surf" | b"cstype" | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end"
            | b"con" | b"ctech" | b"stech" => ignored.add("statements of curves and curved surfaces", number),
            _ => ignored.add("lines of unknown meaning", number),
        }
    }
    let count = scene.mesh.positions.len();
    if largest.1 > 0 && largest.0 >= count {
        return Err(bad_index(largest.1, count, (largest.0 as u64 + 1).to_string()));
    }
    scene.notes =
        ignored.0.iter().map(|(what, n, line)| format!("{n} {what} are ignored, first at line {line}")).collect();
    scene.notes.extend(fans.finish(&mut scene.mesh, "line"));
    Ok(scene)
}

/// What was ignored, how often, and the first line of it.
#[derive(Default)]
struct Ignored(Vec<(&'static str, usize, usize)>);

impl Ignored {
    fn add(&mut self, what: &'static str, line: usize) {
        match self.0.iter_mut().find(|i| i.0 == what) {
            Some(i) => i.1 += 1,
            None => self.0.push((what, 1, line)),
        }
    }
}

struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    /// The next line, with those that it continues on, and the number of its first line.
    fn next_line(&mut self) -> Option<(&'a [u8], usize)> {
        if self.rest.is_empty() {
            return None;
        }
        let first = self.number + 1;
        // A comment or a name may end in the backslash of a path; only numbers go on in the next line.
        let keyword = self.rest.iter().find(|b| !matches!(b, b' ' | b'\t'));
        let goes_on = matches!(keyword, Some(b'v' | b'f'));
        let mut end = 0;
        loop {
            self.number += 1;
            let Some(length) = self.rest[end..].iter().position(|b| *b == b'\n') else {
                end = self.rest.len();
                break;
            };
            let line = &self.rest[end..end + length];
            end += length + 1;
            if !goes_on || !line.strip_suffix(b"\r").unwrap_or(line).ends_with(b"\\") {
                break;
            }
        }
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        Some((line, first))
    }
}

fn vertex<'a>(words: impl Iterator<Item = &'a [u8]>, line: usize) -> Result<[f64; 3], Fault> {
    let at = || format!("line {line}");
    let mut position = [0.0f64; 3];
    let mut found = 0;
    // A weight or a colour may follow.
    for word in words.take(3) {
        position[found] =
            text::number(word).ok_or_else(|| Fault::syntax(at(), "a number as coordinate", text::quote(word)))?;
        if !position[found].is_finite() {
            return Err(Fault::NotFinite { at: at(), found: text::quote(word) });
        }
        found += 1;
    }
    if found < 3 {
        return Err(Fault::syntax(at(), "three coordinates after `v`", found.to_string()));
    }
    Ok(position)
}

/// The vertex, counted from 0, that `i`, `i/t`, `i//n` or `i/t/n` means when there are `count` vertices so far.
fn corner(word: &[u8], count: usize, line: usize) -> Result<usize, Fault> {
    let digits = word.split(|b| *b == b'/').next().unwrap_or_default();
    let index: i64 = text::number(digits).ok_or_else(|| {
        Fault::syntax(format!("line {line}"), "a corner such as `1`, `1/1` or `1/1/1`", text::quote(word))
    })?;
    let place = if index < 0 { index.checked_add(count as i64) } else { index.checked_sub(1) };
    place.and_then(|p| usize::try_from(p).ok()).ok_or_else(|| bad_index(line, count, index.to_string()))
}

fn bad_index(line: usize, count: usize, found: String) -> Fault {
    Fault::Index { at: format!("line {line}"), what: "vertices (1 is the first, -1 the latest)", count, found }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn fault(text: &str) -> Fault {
        parse(text.as_bytes()).expect_err(text)
    }

    #[test]
    fn faces_of_every_shape() {
        let text = "# c:\\dir\\\r\nmtllib a b.mtl\r\no C:\\x\\\r\nv 0 0 0\r\nv\t1 0 0 1.0\r\n v 1 1 0 0.5 0.5 0.5\r\n\
                    vt 0 0\r\nvn 0 0 1\r\nv 0 \\\r\n 1 0\r\ng some\r\ns off\r\nf 1/1/1 2//1 3/1 \\\r\n 4 # all\r\n\
                    f -4 -3/9 -2\r\nf 1 2 3";
        let scene = parse(text.as_bytes()).unwrap();
        assert_eq!(scene.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(scene.mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 1, 2]]);
        assert!(scene.notes.is_empty(), "{:?}", scene.notes);
    }

    #[test]
    fn faces_may_come_first() {
        assert_eq!(parse(format!("f 1 2 4\n{SQUARE}").as_bytes()).unwrap().mesh.triangles, [[0, 1, 3]]);
    }

    #[test]
    fn what_is_ignored_is_noted() {
        let scene = parse(format!("{SQUARE}f 1 2\nl 1 2\np 1\nbanana\nf 1 2 3\ncurv 0 1\n").as_bytes()).unwrap();
        assert_eq!(
            scene.notes,
            [
                "1 faces with fewer than three corners are ignored, first at line 5",
                "2 lines and points are ignored, first at line 6",
                "1 lines of unknown meaning are ignored, first at line 8",
                "1 statements of curves and curved surfaces are ignored, first at line 10",
            ]
        );
    }

    #[test]
    fn faults_name_the_line() {
        for (text, start, found) in [
            ("v 0 0 0\n\nv 1 x 0\n", "line 3: expected a number", "`x`"),
            ("v 0 0\n", "line 1: expected three coordinates", "2"),
            ("v 0 \\\n\\\n nan 0\n", "line 1: expected finite numbers", "`nan`"),
            ("v 0 \\\n 0 0\nv 1 1 1e999\n", "line 3: expected finite numbers", "`1e999`"),
            ("v 0 0 0\nf 1 1 0\n", "line 2: expected an index into 1 vertices", "0"),
            ("v 0 0 0\nf 1 1 -2\n", "line 2: expected an index into 1 vertices", "-2"),
            ("v 0 0 0\nf 1 1 9\nf 1 1 2\n", "line 2: expected an index into 1 vertices", "9"),
            ("f 1 1 1\n", "line 1: expected an index into 0 vertices", "1"),
            ("f 1 1 9223372036854775807\n", "line 1: expected an index", "9223372036854775807"),
            ("f -9223372036854775808 1 1\n", "line 1: expected an index", "-9223372036854775808"),
            ("f 1 1 99999999999999999999\n", "line 1: expected a corner", "`99999999999999999999`"),
            ("f /1 1 1\n", "line 1: expected a corner", "`/1`"),
        ] {
            let message = fault(text).to_string();
            assert!(message.starts_with(start) && message.contains(&format!("found {found};")), "{message}");
        }
        assert!(matches!(fault("v 0 0 inf"), Fault::NotFinite { .. }));
        assert!(matches!(fault("v 0 0 0\nf 1 1 2"), Fault::Index { .. }));
    }

    #[test]
    fn truncations_never_panic() {
        let text = format!("{SQUARE}f -4 -3 \\\n-2/1 -1\nl 1 2\nf 1//1 2//1 3//1\n");
        for length in 0..text.len() {
            let _ = parse(&text.as_bytes()[..length]);
        }
    }
}
