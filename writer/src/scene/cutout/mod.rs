//! Alpha masks become geometry: a masked triangle is replaced by triangles of its solid part.
//!
//! - `sample`: the mask as a function of the position in its image
//! - `root`: where a cubic changes sign
//! - `edge`: where the mask changes along an edge of a triangle
//! - `piece`: chords along the outline, cell by cell
//! - `simplify`: chords in a line joined
//! - `triangulate`: triangles between the chords
//! - `bounds`: memory, and whether it goes on
//!
//! A point is solid where alpha x opacity >= cutoff, alpha sampled as [`AlphaMask`] says and opacity linear over the
//! triangle. Nearest sampling is cut along the borders of pixels and, where opacity varies, along straight lines within
//! them: exactly but for rounding, 2^-20 of a pixel. Bilinear sampling is cut along polylines: every point farther than
//! [`DEVIATION`] from the outline is solid or not as sampling says. Where the texture coordinates of a triangle lie on one
//! line and its opacity varies too, this holds on its edges only.
//!
//! Pieces share their vertices. On an edge between two masked triangles with equal texture coordinates and opacities at
//! its ends both get the same points, so that no crack opens.

mod bounds;
mod edge;
mod piece;
mod root;
mod sample;
mod simplify;
#[cfg(test)]
mod tests;
mod triangulate;

use std::cmp::Ordering;
use std::collections::HashMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::load::{AlphaMask, Bounds, Fault, Loaded, MOST, MaskedTriangle};
use crate::mesh::Mesh;
use bounds::{Account, Halt, Work};
use edge::{Corner, Edge};
use piece::{Chord, Shape, cross};
use sample::{FARTHEST, Field, UNIT};
use triangulate::{Pieces, Place, Points, triangulate};

/// How far the cut may be from the outline of bilinear sampling, in pixels: an eighth for [`piece::CHORD`], five for
/// [`simplify::JOINT`], two for saddles of the mask at the height of the cutoff, where what f32 rounds to the
/// cutoff moves the outline most.
const DEVIATION: f64 = 1.0 / 64.0;

/// The most pixels along the edges of a masked triangle.
const MOST_EDGE: f64 = (1u64 << 21) as f64;

/// The most pixels below all masked triangles that differ.
const MOST_PIXELS: f64 = (1u64 << 31) as f64;

/// Triangles are narrow if less high than this share of their longest edge.
const NARROW: f64 = 1.0 / 128.0;

/// The most chords of a narrow triangle: the time that it takes grows with their square.
const MOST_NARROW: usize = 1 << 14;

/// Triangles that are cut before the next check.
const BATCH: usize = 256;

/// What is left of a triangle.
#[derive(Debug, PartialEq)]
enum Cut {
    Whole,
    Nothing,
    Pieces(Pieces),
}

/// Triangles of one mask with equal coordinates and opacities are cut once.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    mask: usize,
    uv: [[u32; 2]; 3],
    opacity: [u32; 3],
}

/// Replaces the masked triangles of a scene by their solid parts and drops its masks; a note says how many became how
/// many. The other triangles keep their order, all keep facing as they did. The outcome does not depend on the number
/// of threads.
///
/// # Errors
/// [`Fault::TooLarge`] if texture coordinates reach too far, or there would be more than [`MOST`] triangles;
/// [`Fault::Memory`] and [`Fault::Stopped`] by the bounds.
pub(super) fn cut(scene: &mut Loaded, bounds: &Bounds) -> Result<(), Fault> {
    let masks = std::mem::take(&mut scene.masks);
    let mut jobs: Vec<(usize, &MaskedTriangle)> = Vec::new();
    let mut known: HashMap<Key, u32> = HashMap::new();
    let mut masked: Vec<(u32, u32)> = Vec::new();
    for (index, mask) in masks.iter().enumerate() {
        for triangle in &mask.triangles {
            let (uv, opacity) = (triangle.uv.map(|uv| uv.map(f32::to_bits)), triangle.opacity.map(f32::to_bits));
            let job = *known.entry(Key { mask: index, uv, opacity }).or_insert_with(|| {
                jobs.push((index, triangle));
                jobs.len() as u32 - 1
            });
            masked.push((triangle.triangle, job));
        }
    }
    if masked.is_empty() {
        return Ok(());
    }
    drop(known);
    masked.sort_unstable();
    let account = Account::new(bounds);
    let held = bytes_of(&scene.mesh) + given(&masks) + (size_of_val(&*jobs) + size_of_val(&*masked)) as u64;
    account.take(held).map_err(|halt| halted(halt, &account, || "alpha masks".into()))?.keep();
    let cuts = cuts(&masks, &jobs, &account)?;
    let mesh = replaced(&scene.mesh, &masked, &cuts, &account)?;
    let others = scene.mesh.triangles.len() - masked.len();
    let (before, after) = (masked.len(), mesh.triangles.len() - others);
    scene.notes.push(format!("{before} triangles with an alpha mask are cut into {after}"));
    scene.mesh = mesh;
    Ok(())
}

fn bytes_of(mesh: &Mesh) -> u64 {
    (size_of_val(&*mesh.positions) + size_of_val(&*mesh.triangles)) as u64
}

/// Bytes of masks as they are given; several may share an image.
fn given(masks: &[AlphaMask]) -> u64 {
    let images: HashMap<_, usize> = masks.iter().map(|m| (Arc::as_ptr(&m.image), m.image.alpha.len())).collect();
    let triangles = masks.iter().map(|m| size_of_val(&*m.triangles));
    images.into_values().chain(triangles).sum::<usize>() as u64
}

/// Where a triangle is.
fn place(mask: &AlphaMask, triangle: &MaskedTriangle) -> String {
    format!("alpha mask of material {}, triangle {}", mask.material, triangle.triangle)
}

/// Says why a triangle is not cut.
fn halted(halt: Halt, account: &Account, at: impl Fn() -> String) -> Fault {
    match halt {
        Halt::Lines(limit) => {
            Fault::TooLarge { at: at(), most: format!("{limit} lines along its outline"), found: "more".into() }
        }
        Halt::Far => Fault::TooLarge {
            at: at(),
            most: format!("{FARTHEST} pixels from the first to its texture coordinates"),
            found: "more".into(),
        },
        Halt::Memory(needed) => Fault::Memory { at: at(), budget: account.budget(), needed },
        Halt::Stopped => Fault::Stopped,
    }
}

/// What is left of every job. Where several triangles at once don't fit the budget, those that broke off are cut alone,
/// after the others.
fn cuts(masks: &[AlphaMask], jobs: &[(usize, &MaskedTriangle)], account: &Account) -> Result<Vec<Cut>, Fault> {
    let (mut pixels, mut triangles) = (0.0, 0);
    for (mask, triangle) in jobs {
        check(&masks[*mask], triangle)?;
        pixels += extent(&masks[*mask], triangle)[1];
        most(&masks[*mask], triangle, pixels, MOST_PIXELS, "pixels below all masked triangles that differ")?;
    }
    let mut cuts = Vec::with_capacity(jobs.len());
    for batch in jobs.chunks(BATCH) {
        let one = |(mask, triangle): &(usize, &MaskedTriangle)| cut_one(&masks[*mask], triangle, account);
        let mut done: Vec<Result<Cut, Halt>> = batch.par_iter().map(one).collect();
        for (cut, job) in done.iter_mut().zip(batch) {
            if matches!(cut, Err(Halt::Memory(_))) {
                *cut = one(job);
            }
        }
        for (cut, (mask, triangle)) in done.into_iter().zip(batch) {
            let cut = cut.map_err(|halt| halted(halt, account, || place(&masks[*mask], triangle)))?;
            if let Cut::Pieces(pieces) = &cut {
                triangles += pieces.triangles.len();
                most(&masks[*mask], triangle, triangles as f64, MOST as f64, "triangles cut by masks")?;
            }
            cuts.push(cut);
        }
    }
    Ok(cuts)
}

fn most(mask: &AlphaMask, triangle: &MaskedTriangle, found: f64, most: f64, what: &str) -> Result<(), Fault> {
    if found <= most {
        return Ok(());
    }
    Err(Fault::TooLarge {
        at: place(mask, triangle),
        most: format!("{most} {what}"),
        found: format!("{}", found.ceil()),
    })
}

/// How many pixels lie along the edges of a triangle, and about how many it covers or touches.
fn extent(mask: &AlphaMask, triangle: &MaskedTriangle) -> [f64; 2] {
    let [a, b, c] = pixels(mask, triangle);
    let d = |p: [f64; 2], q: [f64; 2]| [q[0] - p[0], q[1] - p[1]];
    let around: f64 = [d(a, b), d(b, c), d(c, a)].iter().map(|d| d[0].abs() + d[1].abs()).sum();
    let (u, v) = (d(a, b), d(a, c));
    [around, (u[0] * v[1] - u[1] * v[0]).abs() / 2.0 + around + 1.0]
}

/// Texture coordinates in pixels.
fn pixels(mask: &AlphaMask, triangle: &MaskedTriangle) -> [[f64; 2]; 3] {
    let size = [f64::from(mask.image.width), f64::from(mask.image.height)];
    triangle.uv.map(|uv| [f64::from(uv[0]) * size[0], f64::from(uv[1]) * size[1]])
}

/// Refuses texture coordinates that reach too far.
fn check(mask: &AlphaMask, triangle: &MaskedTriangle) -> Result<(), Fault> {
    let reach = pixels(mask, triangle).iter().flatten().fold(0.0, |r: f64, v| r.max(v.abs()));
    most(mask, triangle, reach, (FARTHEST - 1) as f64, "pixels from the first to its texture coordinates")?;
    most(mask, triangle, extent(mask, triangle)[0], MOST_EDGE, "pixels along its edges")
}

fn cut_one(mask: &AlphaMask, triangle: &MaskedTriangle, account: &Account) -> Result<Cut, Halt> {
    let field = Field::new(mask, triangle.opacity);
    let mut corners = [Corner { at: [0; 2], opacity: 0.0 }; 3];
    for (k, corner) in corners.iter_mut().enumerate() {
        corner.at = field.place(triangle.uv[k]).ok_or(Halt::Far)?;
        corner.opacity = f64::from(triangle.opacity[k]);
    }
    let mut work = Work::begin(account, extent(mask, triangle)[0] as u64)?;
    let [a, b, c] = corners.map(|c| c.at);
    let area = cross(a, b, c);
    let mut cut = if area == 0 {
        flat(&field, corners, &mut work)?
    } else {
        let order = if area > 0 { [0, 1, 2] } else { [0, 2, 1] };
        reordered(spread(&field, order.map(|k| corners[k]), &mut work)?, order)
    };
    drop(work);
    if let Cut::Pieces(pieces) = &mut cut {
        if pieces.triangles.is_empty() {
            return Ok(Cut::Nothing);
        }
        pieces.points.shrink_to_fit();
        pieces.triangles.shrink_to_fit();
        account.take((size_of_val(&*pieces.points) + size_of_val(&*pieces.triangles)) as u64)?.keep();
    }
    Ok(cut)
}

/// Names corners by `order`; the weight of each stays with it.
fn renamed(mut cut: Cut, order: [usize; 3]) -> Cut {
    if let Cut::Pieces(pieces) = &mut cut {
        for place in &mut pieces.points {
            *place = match *place {
                Place::Corner(k) => Place::Corner(order[k]),
                Place::Edge { from, to, t } => Place::Edge { from: order[from], to: order[to], t },
                Place::Inside(weights) => {
                    let mut named = [0.0; 3];
                    order.iter().zip(weights).for_each(|(k, w)| named[*k] = w);
                    Place::Inside(named)
                }
            };
        }
    }
    cut
}

/// Names corners by `order` and turns the triangles if it does.
fn reordered(cut: Cut, order: [usize; 3]) -> Cut {
    let mut cut = renamed(cut, order);
    if let Cut::Pieces(pieces) = &mut cut
        && order == [0, 2, 1]
    {
        pieces.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    cut
}

/// The way around the triangle: its corners and marks, each with whether it is solid from there on.
fn rim(edges: &[Edge; 3], points: &mut Points) -> Vec<(u32, bool)> {
    let mut rim = Vec::new();
    // First, so that they have the first numbers.
    (0..3).for_each(|k| _ = points.corner(k));
    for (k, edge) in edges.iter().enumerate() {
        let mut stops: Vec<f64> = [0.0].into_iter().chain(edge.marks.iter().map(|m| m.t)).chain([1.0]).collect();
        if edge.turned {
            stops.reverse();
        }
        for (i, pair) in stops.windows(2).enumerate() {
            let point = if i == 0 { points.corner(k) } else { points.mark(k, edge, pair[0]) };
            rim.push((point, edge.solid(0.5 * (pair[0] + pair[1]))));
        }
    }
    rim
}

/// What is left if there are no chords.
fn plain(rim: &[(u32, bool)]) -> Option<Cut> {
    match (rim.len(), rim.iter().all(|r| r.1), rim.iter().any(|r| r.1)) {
        (3, true, _) => Some(Cut::Whole),
        (_, _, false) => Some(Cut::Nothing),
        _ => None,
    }
}

/// Cuts a triangle that is counter-clockwise in the image.
///
/// # Errors
/// More chords than there may be, memory, or stopped.
fn spread(field: &Field, corners: [Corner; 3], work: &mut Work) -> Result<Cut, Halt> {
    let d = |p: usize, q: usize| [0, 1].map(|k| (corners[q].at[k] - corners[p].at[k]) as f64 / UNIT as f64);
    let length = |d: [f64; 2]| (d[0] * d[0] + d[1] * d[1]).sqrt();
    let across = [d(1, 2), d(2, 0), d(0, 1)].map(length);
    // The widest angle comes first.
    let first = (1..3).fold(0, |f, k| if across[k] > across[f] { k } else { f });
    let order = [0, 1, 2].map(|k| (first + k) % 3);
    let corners = order.map(|k| corners[k]);
    let legs = [across[order[2]], across[order[1]]];
    let cut = spread_wide(field, corners, legs, work)?;
    Ok(renamed(cut, order))
}

/// Cuts a triangle whose first angle is the widest, with edges there of these lengths in pixels.
fn spread_wide(field: &Field, corners: [Corner; 3], legs: [f64; 2], work: &mut Work) -> Result<Cut, Halt> {
    let shape = Shape::new(field, corners);
    let chords = shape.outline(work)?;
    let mut points = Points::new(legs);
    let rim = rim(&shape.edges, &mut points);
    if chords.is_empty()
        && let Some(cut) = plain(&rim)
    {
        return Ok(cut);
    }
    let mut fixed: HashMap<[i64; 2], u32> = HashMap::new();
    for (k, edge) in shape.edges.iter().enumerate() {
        for mark in &edge.marks {
            fixed.insert(mark.at, points.mark(k, edge, mark.t));
        }
    }
    for (k, corner) in corners.iter().enumerate() {
        fixed.insert(corner.at, points.corner(k));
    }
    let tolerance = if field.linear() { simplify::JOINT } else { 0.0 };
    let found = chords;
    let chords: Vec<Chord> = simplify::simplify(&found, tolerance, |at| fixed.contains_key(&at));
    drop(found);
    work.joined(chords.len())?;
    let [a, b, c] = corners.map(|c| c.at);
    let area = cross(a, b, c) as f64;
    let longest = [[b, c], [c, a], [a, b]].into_iter().map(|[p, q]| [0, 1].map(|k| (q[k] - p[k]) as f64));
    let longest = longest.map(|d| d[0] * d[0] + d[1] * d[1]).fold(0.0, f64::max);
    if area < NARROW * longest && chords.len() > MOST_NARROW {
        return Err(Halt::Lines(MOST_NARROW));
    }
    let mut number = |at: [i64; 2]| {
        let inside = || points.inside([cross(a, at, c) as f64 / area, cross(a, b, at) as f64 / area]);
        fixed.get(&at).copied().unwrap_or_else(inside)
    };
    let chords: Vec<[u32; 2]> = chords.iter().map(|c| c.map(&mut number)).collect();
    // a triangle that can't be cut stays whole: no light where there was none
    Ok(triangulate(points, &rim, &chords, work)?.map_or(Cut::Whole, Cut::Pieces))
}

/// Cuts a triangle whose texture coordinates lie on a line or in a point: straight between marks on its edges.
///
/// # Errors
/// More chords than there may be, memory, or stopped.
fn flat(field: &Field, corners: [Corner; 3], work: &mut Work) -> Result<Cut, Halt> {
    let edges = [0, 1, 2].map(|k| Edge::new(field, corners[k], corners[(k + 1) % 3]));
    let mut points = Points::new([1.0; 2]);
    let rim = rim(&edges, &mut points);
    if let Some(cut) = plain(&rim) {
        return Ok(cut);
    }
    if rim.len() > MOST_NARROW {
        return Err(Halt::Lines(MOST_NARROW));
    }
    // Lines across join what is equally far along; the farthest corner starts and ends the way on both sides.
    let key = |k: &usize| (corners[*k].at, corners[*k].opacity);
    let least = (0..3).min_by(|k, l| key(k).partial_cmp(&key(l)).unwrap_or(Ordering::Equal)).unwrap_or(0);
    let start = rim.iter().position(|r| r.0 == least as u32).unwrap_or(0);
    let before = |i: usize| rim[(i + rim.len() - 1) % rim.len()].1;
    let around = (start..start + rim.len()).map(|i| i % rim.len());
    let changes: Vec<usize> = around.filter(|i| rim[*i].1 != before(*i)).collect();
    let n = changes.len();
    let chords = (0..n / 2).map(|i| {
        let (up, down) = (changes[i], changes[n - 1 - i]);
        let chord = if before(up) { [up, down] } else { [down, up] };
        chord.map(|i| rim[i].0)
    });
    let chords: Vec<[u32; 2]> = chords.collect();
    // a triangle that can't be cut stays whole: no light where there was none
    Ok(triangulate(points, &rim, &chords, work)?.map_or(Cut::Whole, Cut::Pieces))
}

/// The mesh with every masked triangle (index and job, rising) replaced.
fn replaced(mesh: &Mesh, masked: &[(u32, u32)], cuts: &[Cut], account: &Account) -> Result<Mesh, Fault> {
    let (mut points, mut triangles) = (mesh.positions.len(), mesh.triangles.len() - masked.len());
    for (_, job) in masked {
        let (more_points, more) = match &cuts[*job as usize] {
            Cut::Whole => (0, 1),
            Cut::Nothing => (0, 0),
            Cut::Pieces(p) => (p.points.len(), p.triangles.len()),
        };
        (points, triangles) = (points.saturating_add(more_points), triangles.saturating_add(more));
    }
    let large = |most: String, found: usize| Fault::TooLarge {
        at: "triangles cut by alpha masks".into(),
        most,
        found: found.to_string(),
    };
    for (what, found) in [("vertices", points), ("triangles", triangles)] {
        if found > MOST {
            return Err(large(format!("{MOST} {what}"), found));
        }
    }
    let at = || "triangles cut by alpha masks".to_string();
    let bytes = (points * size_of::<[f64; 3]>() + triangles * size_of::<[u32; 3]>()) as u64;
    account.take(bytes).map_err(|halt| halted(halt, account, at))?.keep();
    let mut cut = Mesh::default();
    let memory = |_| large("what fits in memory".into(), triangles);
    cut.positions.try_reserve_exact(points).map_err(memory)?;
    cut.triangles.try_reserve_exact(triangles).map_err(memory)?;
    cut.positions.extend_from_slice(&mesh.positions);
    let mut next = masked.iter().peekable();
    let mut numbers = Vec::new();
    for (index, corners) in mesh.triangles.iter().enumerate() {
        if index % BATCH == 0 {
            account.go_on().map_err(|halt| halted(halt, account, at))?;
        }
        let Some((_, job)) = next.next_if(|m| m.0 as usize == index) else {
            cut.triangles.push(*corners);
            continue;
        };
        match &cuts[*job as usize] {
            Cut::Whole => cut.triangles.push(*corners),
            Cut::Nothing => {}
            Cut::Pieces(pieces) => {
                numbers.clear();
                for place in &pieces.points {
                    numbers.push(place_at(*place, *corners, &mut cut.positions));
                }
                cut.triangles.extend(pieces.triangles.iter().map(|t| t.map(|i| numbers[i as usize])));
            }
        }
    }
    Ok(cut)
}

/// The vertex at a place of a triangle.
fn place_at(place: Place, corners: [u32; 3], positions: &mut Vec<[f64; 3]>) -> u32 {
    let p = |k: usize| positions[corners[k] as usize];
    let position = match place {
        Place::Corner(k) => return corners[k],
        Place::Edge { from, to, t } => {
            let (a, b) = (p(from), p(to));
            [0, 1, 2].map(|d| a[d] * (1.0 - t) + b[d] * t)
        }
        Place::Inside(w) => {
            let (a, b, c) = (p(0), p(1), p(2));
            [0, 1, 2].map(|d| a[d] * w[0] + b[d] * w[1] + c[d] * w[2])
        }
    };
    positions.push(position);
    positions.len() as u32 - 1
}
