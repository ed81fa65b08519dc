//! Where a certificate looks when it doesn't look everywhere: half of the texels in squares spread at random, half
//! around what goes wrong first: edges of triangles, borders of leaves, borders of pages.

use super::Region;
use umbrage_writer::solid::SnappedMesh;

/// Side of a square that is spread at random.
const WIDE: u32 = 64;
/// Side of a square around a point.
const NEAR: u32 = 16;

/// A fixed sequence (splitmix64): the same sample every time.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u64) -> u64 {
        if n == 0 { 0 } else { self.next() % n }
    }

    /// A point on the border of the square of side `2^log2` at `origin`.
    fn border(&mut self, origin: [u32; 2], log2: u8) -> [u32; 2] {
        let r = self.next();
        let (along, far) = ((r >> 8) & ((1u64 << log2) - 1), r & 1);
        let across = far << log2;
        let step = if r & 2 == 0 { [along, across] } else { [across, along] };
        [0, 1].map(|i| u64::from(origin[i]).saturating_add(step[i]).min(u32::MAX.into()) as u32)
    }
}

/// What a sample has to know about the file.
pub struct Borders<'a> {
    /// Pages.
    pub pages: u32,
    /// First texel of a page's footprint and log2 of its side.
    pub page: &'a dyn Fn(u32) -> Option<([u32; 2], u8)>,
    /// Level of the leaf that answers a texel.
    pub leaf: &'a dyn Fn(u32, u32) -> Option<u8>,
}

/// Regions that hold at least `count` texels together, and how many of those are near a border or an edge. A
/// texel may occur more than once.
pub fn regions(mesh: Option<&SnappedMesh>, resolution: u32, count: u64, borders: &Borders) -> (Vec<Region>, u64) {
    let mut sequence = Sequence(0x9E37_79B9_7F4A_7C15);
    let mut regions = Vec::new();
    let wide = resolution.min(WIDE);
    for _ in 0..(count / 2).div_ceil(u64::from(wide).pow(2)) {
        let mut at = || sequence.below(u64::from(resolution / wide)) as u32 * wide;
        regions.push(Region { x: at(), y: at(), width: wide, height: wide });
    }
    let near = resolution.min(NEAR);
    let squares = (count - count / 2).div_ceil(u64::from(near).pow(2));
    for i in 0..squares {
        let p = match i % 3 {
            0 => mesh.and_then(|mesh| on_an_edge(mesh, &mut sequence)),
            1 => {
                let [x, y] = [0; 2].map(|_| sequence.below(resolution.into()) as u32);
                (borders.leaf)(x, y).map(|l| sequence.border([x >> l << l, y >> l << l], l))
            }
            _ => {
                let page = sequence.below(borders.pages.into()) as u32;
                (borders.page)(page).map(|(origin, log2)| sequence.border(origin, log2))
            }
        };
        let start = |c: u32| c.saturating_sub(near / 2).min(resolution - near);
        // a place that can't be found is replaced by a random one
        let [x, y] = p.unwrap_or_else(|| [0; 2].map(|_| sequence.below(resolution.into()) as u32)).map(start);
        regions.push(Region { x, y, width: near, height: near });
    }
    (regions, squares * u64::from(near).pow(2))
}

/// A texel on an edge of some triangle.
fn on_an_edge(mesh: &SnappedMesh, sequence: &mut Sequence) -> Option<[u32; 2]> {
    let last = i64::from(mesh.lattice.resolution()) - 1;
    Some(point_on_an_edge(mesh, sequence)?.map(|v| (v >> mesh.lattice.subtexel_bits).clamp(0, last) as u32))
}

/// A place inside a texel, in 1/256 texel from the map's corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    /// Both coordinates.
    pub at: [u64; 2],
    /// It was spread over the map at random, not put near something.
    pub spread: bool,
}

impl Spot {
    /// The texel.
    pub fn texel(&self) -> [u32; 2] {
        self.at.map(|v| (v >> 8) as u32)
    }

    /// Where in the texel.
    pub fn sub(&self) -> [u8; 2] {
        self.at.map(|v| v as u8)
    }
}

/// `count` places: half of them at random, half within 2/256 texel of edges of triangles and borders of leaves and
/// pages.
pub fn spots(mesh: &SnappedMesh, count: u64, borders: &Borders) -> Vec<Spot> {
    let mut sequence = Sequence(0xD1B5_4A32_D192_ED03);
    let side = u64::from(mesh.lattice.resolution()) << 8;
    let fine = mesh.lattice.subtexel_bits - 8;
    let mut spot = |i: u64| {
        let random = [0; 2].map(|_| sequence.below(side));
        let texel = random.map(|v| (v >> 8) as u32);
        let along = sequence.below(256);
        // somewhere on the border, not only at texels' corners
        let mut border = |origin: [u32; 2], log2: u8| {
            let [x, y] = sequence.border(origin, log2).map(|v| u64::from(v) << 8);
            if sequence.below(2) == 0 { [x + along, y] } else { [x, y + along] }
        };
        let near = match i % 8 {
            1 | 5 => point_on_an_edge(mesh, &mut sequence).map(|p| p.map(|v| (v >> fine).max(0) as u64)),
            3 => (borders.leaf)(texel[0], texel[1]).map(|l| border(texel.map(|v| v >> l << l), l)),
            7 => (borders.page)(texel[0] % borders.pages.max(1)).map(|(origin, log2)| border(origin, log2)),
            _ => None,
        };
        let spread = i.is_multiple_of(2);
        let at = near.map_or(random, |p| p.map(|v| (v + sequence.below(5)).saturating_sub(2)));
        Spot { at: at.map(|v| v.min(side - 1)), spread }
    };
    (0..count).map(&mut spot).collect()
}

/// A lattice point on an edge of some triangle, rounded down.
fn point_on_an_edge(mesh: &SnappedMesh, sequence: &mut Sequence) -> Option<[i64; 2]> {
    let t = mesh.triangles.get(sequence.below(mesh.triangles.len() as u64) as usize)?;
    let k = sequence.below(3) as usize;
    let [a, b] = [t[k], t[(k + 1) % 3]].map(|i| mesh.positions[i as usize]);
    let part = sequence.below(1 << 16) as i128;
    Some([0, 1].map(|i| a[i] + ((i128::from(b[i] - a[i]) * part) >> 16) as i64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use umbrage_writer::mesh::Mesh;
    use umbrage_writer::solid::{Policy, snap};

    #[test]
    fn half_of_a_sample_lies_near_borders_and_all_of_it_in_the_map() {
        let mesh =
            Mesh { positions: vec![[0.0, 0.0, 0.0], [9.0, 1.0, 0.0], [0.0, 0.0, 7.0]], triangles: vec![[0, 1, 2]] };
        for log2 in [0u8, 3, 5, 10, 24] {
            let lattice = umbrage_writer::frame::orthographic([0.1, -1.0, 0.2], log2, &mesh.positions, 0.0).unwrap();
            let snapped = snap(&mesh, lattice, Policy::OneSided).unwrap();
            let resolution = 1u32 << log2;
            let borders = Borders {
                pages: 3,
                page: &|p| Some(([resolution >> 1; 2], log2.saturating_sub(1 + p as u8))),
                leaf: &|x, _| (x % 5 != 0).then_some(log2.min(2)),
            };
            for count in [1, 5000, 100_000] {
                let (regions, near) = regions(Some(&snapped), resolution, count, &borders);
                let texels: u64 = regions.iter().map(|r| u64::from(r.width) * u64::from(r.height)).sum();
                assert!(texels >= count && near * 2 >= count, "{log2} {count}: {texels} {near}");
                assert!(texels < count + 2 * u64::from(WIDE * WIDE));
                for r in regions {
                    assert!(r.x + r.width <= resolution && r.y + r.height <= resolution, "{log2}: {r:?}");
                }
            }
        }
    }
}
