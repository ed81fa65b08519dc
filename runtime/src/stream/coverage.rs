//! How far the answer at a point can be trusted, for blending with cascades and dynamic maps.

use super::{Streamer, StructureId};

/// What is known of the answers at a point. All of them are of the static casters that were baked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Coverage {
    /// Whether it lies in the map; outside nothing is known.
    pub inside: bool,
    /// Finest level that the pages which are resident now answer; none before the roots have come, or outside.
    pub level: Option<u8>,
    /// Whether the region was marked as changed since the bake.
    pub stale: bool,
}

impl Streamer {
    /// How far the answer of a structure's first root at a world point can be trusted. None where the structure has gone.
    /// Reads index blocks only of pages that are resident, which are in memory.
    pub fn coverage(&self, id: StructureId, point: [f64; 3]) -> Option<Coverage> {
        let attached = self.get(id)?;
        let lattice = attached.structure.lattice();
        let [x, y, _] = lattice.to_lattice(point).map(|v| (v / f64::from(lattice.subtexel_bits).exp2()).floor());
        let side = f64::from(lattice.log2_resolution).exp2();
        if !(0.0..side).contains(&x) || !(0.0..side).contains(&y) {
            return Some(Coverage { inside: false, level: None, stale: false });
        }
        let texel = [x as u32, y as u32];
        let stale = attached.stale.iter().any(|r| r.contains(texel));
        Some(Coverage { inside: true, level: self.level_at(id, texel), stale })
    }

    /// Finest level that resident pages answer at a texel.
    fn level_at(&self, id: StructureId, [x, y]: [u32; 2]) -> Option<u8> {
        let attached = self.get(id)?;
        let (structure, base) = (&attached.structure, attached.span.base);
        let mut page = base;
        if !self.residency.is_resident(page) {
            return None;
        }
        // Each page begins below the one above it.
        loop {
            let own = structure.page_record(page - base).ok()?;
            let mut known = 0;
            let covers = |child: u32| {
                let r = structure.page_record(child - base).ok()?;
                let within = |v: u32, from: u32, log2: u8| v.checked_sub(from).is_some_and(|d| d >> log2 == 0);
                let here = within(x, r.origin_x.get(), r.log2_x) && within(y, r.origin_y.get(), r.log2_y);
                here.then_some((child, r.level_coarsest))
            };
            let below = self.residency.children(page).inspect(|_| known += 1).find_map(|(child, _)| covers(child));
            match below {
                Some((child, _)) if self.residency.is_resident(child) => page = child,
                Some((_, coarsest)) => return Some(coarsest.saturating_add(1)),
                // What the index says of its children could not be read.
                None if known == 0 && own.child_count.get() != 0 => return Some(own.level_coarsest),
                None => return Some(0),
            }
        }
    }
}
