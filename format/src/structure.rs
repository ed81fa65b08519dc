//! The record of one structure: the map of one light, a stack, an aperture.
//!
//! In: 512 bytes and the record's number. Out: a checked [`StructureRecord`]. It repeats the record of the root page,
//! so that a reader of the first 16 KiB of a file reaches the first coarse answer with one more read.
//! Next: [`crate::index`].

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use zerocopy::IntoBytes;

use crate::checksum::{FileId, structure_crc};
use crate::error::{FormatError, Place, Rule, Value};
use crate::index::{BlockHeader, PageRecord};
use crate::kind::Kind;
use crate::le::{F64, U16, U32, U64};
use crate::projection::Lattice;
use crate::record::{record, reserved_fault};

/// [`StructureRecord::projection`] of a directional light.
pub const ORTHOGRAPHIC: u32 = 1;
/// [`StructureRecord::guarantee`]: every receiver, static or moving.
pub const EVERYWHERE: u32 = 1;
/// [`StructureRecord::guarantee`]: only the surfaces of the baked scene.
pub const STATIC_SURFACES_ONLY: u32 = 2;
/// [`StructureRecord::guarantee`]: every receiver, static or moving, on the rays through texel centres.
pub const CENTRES: u32 = 3;
/// [`StructureRecord::guarantee`]: only the surfaces of the baked scene, on the rays through texel centres.
pub const STATIC_CENTRES: u32 = 4;
/// [`StructureRecord::policy`]: depth layers, the second where the solid behind the first is left.
pub const LAYERS_CLOSED: u32 = 6;
/// [`StructureRecord::policy`]: depth layers, the second the next surface (depth peeling).
pub const LAYERS_SECOND_SURFACE: u32 = 7;
/// [`StructureRecord::policy`]: a layer of first depth alone.
pub const LAYERS_ONE_SIDED: u32 = 8;

/// A code of the registry that [`StructureRecord::guarantee`] may have, and its name.
pub const GUARANTEES: &[(u32, &str)] = &[
    (EVERYWHERE, "everywhere"),
    (STATIC_SURFACES_ONLY, "static surfaces only"),
    (CENTRES, "texel centres"),
    (STATIC_CENTRES, "texel centres, static surfaces only"),
];

/// What a code in [`StructureRecord::policy`] stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PolicyRow {
    /// The code.
    pub code: u32,
    /// Its name.
    pub name: &'static str,
    /// The guarantee of every structure of this policy.
    pub guarantee: u32,
    /// Whether `policy_parameter` is above 0; it is 0 otherwise.
    pub has_parameter: bool,
}

/// The policies of the registry by rising code, from 1 on.
pub const POLICIES: &[PolicyRow] = &[
    PolicyRow { code: 1, name: "closed", guarantee: EVERYWHERE, has_parameter: false },
    PolicyRow { code: 2, name: "one-sided", guarantee: EVERYWHERE, has_parameter: false },
    PolicyRow { code: 3, name: "thickness", guarantee: EVERYWHERE, has_parameter: true },
    PolicyRow { code: 4, name: "second-surface", guarantee: STATIC_SURFACES_ONLY, has_parameter: false },
    PolicyRow { code: 5, name: "auto", guarantee: EVERYWHERE, has_parameter: false },
    PolicyRow { code: LAYERS_CLOSED, name: "layers, closed", guarantee: CENTRES, has_parameter: false },
    PolicyRow {
        code: LAYERS_SECOND_SURFACE,
        name: "layers, second-surface",
        guarantee: STATIC_CENTRES,
        has_parameter: false,
    },
    PolicyRow { code: LAYERS_ONE_SIDED, name: "layers, one-sided", guarantee: CENTRES, has_parameter: false },
];

/// Largest distance of the squared length of `light_direction` from 1: a direction that went through f32 passes.
pub const LIGHT_TOLERANCE: f64 = 1.0 / (1u64 << 20) as f64;
/// Least magnitude of the determinant of `world_to_lattice`, its rows divided by their largest component.
pub const LEAST_DETERMINANT: f64 = 1.0 / (1u64 << 40) as f64;

/// Largest `log2_resolution`.
pub const MAX_LOG2_RESOLUTION: u8 = 24;
/// Largest `log2_resolution + subtexel_bits`: lattice coordinates stay below `1 << 48`.
pub const MAX_LATTICE_BITS: u8 = 48;
/// Exponent of the smallest and the largest index block.
pub const BLOCK_LOG2: core::ops::RangeInclusive<u8> = 12..=16;

record! {
    /// One structure. Counts are for statistics; nothing is decoded by them.
    StructureRecord: 512 bytes {
        /// UTF-8, padded with zero bytes; not empty and unique in the file.
        0 => name: [u8; 64];
        /// Rows of the affine map: lattice = m * (x, y, z, 1); world units in, lattice steps out.
        64 => world_to_lattice: [F64; 12];
        /// Unit vector along which light travels, in the world.
        160 => light_direction: [F64; 3];
        /// Largest distance by which snapping moved a vertex, world units.
        184 => snap_displacement: F64;
        /// Bound of the error of the world-to-lattice transform, lattice units of depth.
        192 => transform_error: F64;
        /// Parameter of the policy, above 0; 0 where it has none.
        200 => policy_parameter: F64;
        /// Texels whose area interval is empty, so that the interval of the centre holds.
        208 => edge_texels: U64;
        /// Texels whose lattice interval was empty and was widened to one value.
        216 => thin_texels: U64;
        /// Leaf nodes.
        224 => leaf_nodes: U64;
        /// Inner nodes with a value.
        232 => inner_nodes: U64;
        /// Inner nodes without a value of their own.
        240 => empty_nodes: U64;
        /// Triangles of the source.
        248 => triangles: U64;
        /// 1 mh, 2 mmh, 3 vector, 4 mh-stack, 5 mmh-stack, 6 stack, 7 quads.
        256 => kind: U32;
        /// 1 orthographic.
        260 => projection: U32;
        /// What lies behind a surface. Of geometry: 1 closed, 2 one-sided, 3 thickness, 4 second-surface, 5 auto. Of
        /// depth layers, known at texel centres alone: 6 closed, 7 second-surface, 8 one-sided.
        264 => policy: U32;
        /// Of geometry: 1 everywhere, 2 static surfaces only. Of depth layers, on rays through texel centres alone:
        /// 3 every receiver (policies 6 and 8), 4 static surfaces only (policy 7).
        268 => guarantee: U32;
        /// Roots (cube faces, tiles of a map that is not square), 1 to 65535. Root r has the page of ordinal r.
        272 => root_count: U32;
        /// Pages, shared ones included, at least `root_count + shared_pages`.
        276 => page_count: U32;
        /// Pages at the end of the index that several pages refer to through dependencies and that are nobody's child.
        280 => shared_pages: U32;
        /// Distance that stored values keep from the ends of wide intervals, lattice units of depth.
        284 => depth_guard: U32;
        /// Page records in each index block but the last, at least 1.
        288 => records_per_block: U16;
        /// Index blocks have `1 << index_block_log2` bytes, 12 to 16.
        290 => index_block_log2: u8;
        /// A root has `1 << log2_resolution` texels on a side, 0 to 24.
        291 => log2_resolution: u8;
        /// A texel has `1 << subtexel_bits` lattice steps on a side; at most 48 with `log2_resolution`.
        292 => subtexel_bits: u8;
        /// Zero.
        293 => reserved0: [u8; 27];
        /// Copy of page record 0.
        320 => root_page: PageRecord;
        /// Zero.
        384 => reserved1: [u8; 124];
        /// CRC32 bound to file id and structure number over the bytes before this field.
        508 => crc32: U32;
    }
}

impl StructureRecord {
    /// Bytes of the name's field.
    pub const NAME_BYTES: usize = 64;

    /// CRC of this record as structure `number` of the file.
    pub fn computed_crc(&self, file_id: &FileId, number: u32) -> u32 {
        let bytes = self.as_bytes();
        structure_crc(file_id, number, bytes.get(..Self::BYTES - 4).unwrap_or_default())
    }

    /// Checks everything that one record alone can break. `number` is its place in the section, `offset` its first
    /// byte in the file.
    ///
    /// # Errors
    /// `structure.*`. That names differ is left to the reader, which has all of them.
    pub fn check(&self, file_id: &FileId, number: u32, offset: u64) -> Result<(), FormatError> {
        let place = Place::Structure(number);
        let crc = self.computed_crc(file_id, number);
        FormatError::crc(Rule::StructureCrc, place, offset + 508, crc, self.crc32.get())?;
        let fault = |rule, at: u64, expected, found| Err(FormatError::new(rule, place, offset + at, expected, found));
        if self.name().is_none() {
            return fault(
                Rule::StructureName,
                0,
                Value::Text("UTF-8 padded with zero bytes"),
                Value::Text("other bytes"),
            );
        }
        let within = |rule, at, lo: u64, hi: u64, v: u64| {
            if (lo..=hi).contains(&v) { Ok(()) } else { fault(rule, at, Value::Between(lo, hi), Value::Number(v)) }
        };
        let known = Kind::from_code(self.kind.get()).is_some();
        if !known {
            return fault(Rule::StructureKind, 256, Value::Between(1, 7), Value::Number(self.kind.get().into()));
        }
        within(Rule::StructureProjection, 260, 1, 1, self.projection.get().into())?;
        let Some(policy) = POLICIES.iter().find(|p| p.code == self.policy.get()) else {
            let expected = Value::Between(1, POLICIES.len() as u64);
            return fault(Rule::StructurePolicy, 264, expected, Value::Number(self.policy.get().into()));
        };
        let guarantee = self.guarantee.get();
        if GUARANTEES.iter().all(|g| g.0 != guarantee) {
            let expected = Value::Between(1, GUARANTEES.len() as u64);
            return fault(Rule::StructureGuarantee, 268, expected, Value::Number(guarantee.into()));
        }
        let promised = policy.guarantee.into();
        within(Rule::StructurePromise, 268, promised, promised, guarantee.into())?;
        within(Rule::StructureRoots, 272, 1, u64::from(u16::MAX), self.root_count.get().into())?;
        let fewest = u64::from(self.root_count.get()) + u64::from(self.shared_pages.get());
        within(Rule::StructurePages, 276, fewest, u64::from(u32::MAX), self.page_count.get().into())?;
        let (lo, hi) = (u64::from(*BLOCK_LOG2.start()), u64::from(*BLOCK_LOG2.end()));
        within(Rule::StructureBlock, 290, lo, hi, self.index_block_log2.into())?;
        let most = (self.block_bytes() - BlockHeader::BYTES as u64) / PageRecord::BYTES as u64;
        within(Rule::StructureBlock, 288, 1, most, self.records_per_block.get().into())?;
        within(Rule::StructureResolution, 291, 0, MAX_LOG2_RESOLUTION.into(), self.log2_resolution.into())?;
        let bits = u64::from(MAX_LATTICE_BITS.saturating_sub(self.log2_resolution));
        within(Rule::StructureResolution, 292, 0, bits, self.subtexel_bits.into())?;
        let numbers = self.world_to_lattice.iter().chain(&self.light_direction).chain([
            &self.snap_displacement,
            &self.transform_error,
            &self.policy_parameter,
        ]);
        if let Some(i) = numbers.clone().position(|v| !v.get().is_finite()) {
            return fault(
                Rule::StructureNumber,
                64 + 8 * i as u64,
                Value::Text("a finite number"),
                Value::Text("infinite or NaN"),
            );
        }
        if !invertible(&self.lattice().world_to_lattice) {
            let (expected, found) = (Value::Text("a map that can be inverted"), Value::Text("a singular one"));
            return fault(Rule::StructureTransform, 64, expected, found);
        }
        let [x, y, z] = self.light_direction.map(|c| c.get());
        let squared = (x * x + y * y) + z * z;
        if (squared - 1.0).abs() > LIGHT_TOLERANCE {
            return fault(Rule::StructureLight, 160, Value::Text("a unit vector"), Value::Text("another length"));
        }
        let error = self.transform_error.get();
        if !(0.0..=f64::from(self.depth_guard.get())).contains(&error) {
            let expected = Value::Text("an error from 0 to the guard");
            return fault(Rule::StructureGuard, 192, expected, Value::Text("another number"));
        }
        let parameter = self.policy_parameter.get();
        let fits = if policy.has_parameter { parameter > 0.0 } else { parameter == 0.0 };
        if !fits {
            let expected = Value::Text(if policy.has_parameter { "a number above 0" } else { "0" });
            return fault(Rule::StructureParameter, 200, expected, Value::Text("another number"));
        }
        if let Some((at, byte)) = reserved_fault(self.as_bytes(), Self::RECORD.fields) {
            return fault(Rule::StructureReserved, at, Value::Number(0), Value::Number(byte.into()));
        }
        Ok(())
    }

    /// The name, or `None` where the field is empty, not UTF-8, or has bytes behind the first zero.
    pub fn name(&self) -> Option<&str> {
        let end = self.name.iter().position(|&b| b == 0).unwrap_or(self.name.len());
        let (name, rest) = self.name.split_at_checked(end)?;
        if name.is_empty() || rest.iter().any(|&b| b != 0) {
            return None;
        }
        core::str::from_utf8(name).ok()
    }

    /// Sets the name; `false`, and no change, where it does not fit: empty, over 64 bytes, or with a zero byte.
    pub fn set_name(&mut self, name: &str) -> bool {
        let fits = !name.is_empty() && name.len() <= self.name.len() && !name.bytes().any(|b| b == 0);
        if let (true, Some(field)) = (fits, self.name.get_mut(..name.len())) {
            field.copy_from_slice(name.as_bytes());
            if let Some(rest) = self.name.get_mut(name.len()..) {
                rest.fill(0);
            }
        }
        fits
    }

    /// The kind, `None` where the code is not in the registry.
    pub fn kind(&self) -> Option<Kind> {
        Kind::from_code(self.kind.get())
    }

    /// Whether it comes from depth layers, which say nothing between texel centres.
    pub fn is_from_layers(&self) -> bool {
        (LAYERS_CLOSED..=LAYERS_ONE_SIDED).contains(&self.policy.get())
    }

    /// What lies behind a surface, in words.
    pub fn policy_words(&self) -> &'static str {
        match self.policy.get() {
            1 => "closed",
            2 => "one-sided",
            3 => "thickness",
            4 => "second-surface",
            5 => "auto",
            LAYERS_CLOSED => "depth layers, closed: the second depth is where the solid is left",
            LAYERS_SECOND_SURFACE => "depth layers, second-surface: the second depth is the next surface",
            LAYERS_ONE_SIDED => "depth layers, one-sided: the first depth alone",
            _ => "unknown",
        }
    }

    /// Which receivers get the right answer, in words.
    pub fn guarantee_words(&self) -> &'static str {
        match self.guarantee.get() {
            EVERYWHERE => "every receiver, static or moving",
            STATIC_SURFACES_ONLY => "receivers on the surfaces of the baked scene only",
            CENTRES => "receivers on rays through texel centres only, static or moving",
            STATIC_CENTRES => {
                "receivers on rays through texel centres only, and there on the surfaces of the baked scene only"
            }
            _ => "unknown",
        }
    }

    /// The world-to-lattice map as the projection has it.
    pub fn lattice(&self) -> Lattice {
        let mut rows = [[0.0; 4]; 3];
        for (to, from) in rows.iter_mut().flatten().zip(&self.world_to_lattice) {
            *to = from.get();
        }
        Lattice { world_to_lattice: rows, log2_resolution: self.log2_resolution, subtexel_bits: self.subtexel_bits }
    }

    /// Stores the world-to-lattice map, the resolution and the sub-texel bits.
    pub fn set_lattice(&mut self, lattice: &Lattice) {
        for (to, &from) in self.world_to_lattice.iter_mut().zip(lattice.world_to_lattice.iter().flatten()) {
            *to = from.into();
        }
        self.log2_resolution = lattice.log2_resolution;
        self.subtexel_bits = lattice.subtexel_bits;
    }

    /// Bytes of an index block.
    pub fn block_bytes(&self) -> u64 {
        1 << self.index_block_log2.min(*BLOCK_LOG2.end())
    }

    /// Number of index blocks.
    pub fn block_count(&self) -> u32 {
        self.page_count.get().div_ceil(u32::from(self.records_per_block.get()).max(1))
    }

    /// Pages that belong to the tree: all but the shared ones.
    pub fn tree_pages(&self) -> u32 {
        self.page_count.get().saturating_sub(self.shared_pages.get())
    }
}

/// Whether the linear part of a map of finite numbers has an inverse that is worth something. The order of operations
/// is part of the format, so that every reader decides alike.
fn invertible(rows: &[[f64; 4]; 3]) -> bool {
    let [a, b, c] = rows.map(|[x, y, z, _]| {
        let largest = x.abs().max(y.abs()).max(z.abs());
        // A row of zeros stays one.
        let by = if largest > 0.0 { largest } else { 1.0 };
        [x / by, y / by, z / by]
    });
    let minor = |i: usize, j: usize| match (b.get(i), b.get(j), c.get(i), c.get(j)) {
        (Some(bi), Some(bj), Some(ci), Some(cj)) => bi * cj - bj * ci,
        _ => 0.0,
    };
    let [x, y, z] = a;
    let determinant = (x * minor(1, 2) - y * minor(0, 2)) + z * minor(0, 1);
    determinant.abs() >= LEAST_DETERMINANT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_policies_and_guarantees_rise_from_1() {
        assert!(POLICIES.iter().zip(1..).all(|(p, code)| p.code == code));
        assert!(GUARANTEES.iter().zip(1..).all(|(g, code)| g.0 == code));
        assert!(POLICIES.iter().all(|p| GUARANTEES.iter().any(|g| g.0 == p.guarantee)));
    }

    #[test]
    fn maps_of_any_scale_can_be_inverted_and_flat_ones_cannot() {
        for scale in [1e-300, 1e-30, 1.0, 1e300, f64::MIN_POSITIVE] {
            assert!(invertible(&[[scale, 0.0, 0.0, 9.0], [0.0, 0.0, -scale, 0.0], [scale, scale, 0.0, 0.0]]));
            assert!(!invertible(&[[scale, 0.0, 0.0, 9.0], [0.0, 0.0, 0.0, 1.0], [scale, scale, 0.0, 0.0]]));
        }
        // Rows in one plane, up to rounding.
        assert!(!invertible(&[[0.1, 0.2, 0.3, 0.0], [0.4, 0.5, 0.6, 0.0], [0.7, 0.8, 0.9, 0.0]]));
    }
}
