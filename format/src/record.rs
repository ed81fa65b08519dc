//! The macro that declares a record of the file once, and the tables of fields that come from it.
//!
//! One declaration yields the struct, assertions of its size and of every offset at compile time, and a table of
//! [`Field`]s. `dump`, the tables of the spec, the offsets of the shaders and the mutations of the fuzzers are made
//! from [`RECORDS`], so that no second description of the bytes exists.

use crate::le::{F64, U16, U32, U64};

/// How the bytes of a field are read. All are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// One byte.
    U8,
    /// Unsigned, 2 bytes.
    U16,
    /// Unsigned, 4 bytes.
    U32,
    /// Unsigned, 8 bytes.
    U64,
    /// IEEE 754 binary64.
    F64,
    /// A whole [`crate::PageRecord`].
    PageRecord,
}

/// One field of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name of the field; `reserved…` must be zero.
    pub name: &'static str,
    /// First byte, counted from the start of the record.
    pub offset: usize,
    /// Bytes of the whole field.
    pub bytes: usize,
    /// Type of one element.
    pub scalar: Scalar,
    /// Number of elements, 1 unless the field is an array.
    pub count: usize,
    /// Meaning, unit and range.
    pub doc: &'static str,
}

impl Field {
    /// Whether the field is reserved and must be zero.
    pub fn is_reserved(&self) -> bool {
        self.name.starts_with("reserved")
    }
}

/// A record and all its fields in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Name of the Rust struct.
    pub name: &'static str,
    /// Size in bytes.
    pub bytes: usize,
    /// Fields by rising offset, without gaps.
    pub fields: &'static [Field],
}

/// Every record of the file, in the order in which a reader meets them.
pub const RECORDS: &[Record] = &[
    crate::header::Header::RECORD,
    crate::section::SectionRecord::RECORD,
    crate::structure::StructureRecord::RECORD,
    crate::index::BlockHeader::RECORD,
    crate::index::PageRecord::RECORD,
];

/// A type that may stand in a record.
pub(crate) trait Wire {
    const SCALAR: Scalar;
    const COUNT: usize;
    /// Natural alignment: offsets are multiples of it, so that mapped records need no unaligned loads.
    const ALIGN: usize;
}

macro_rules! wire {
    ($($ty:ty => $scalar:ident, $align:literal;)*) => { $(
        impl Wire for $ty {
            const SCALAR: Scalar = Scalar::$scalar;
            const COUNT: usize = 1;
            const ALIGN: usize = $align;
        }
    )* };
}
wire! {
    u8 => U8, 1;
    U16 => U16, 2;
    U32 => U32, 4;
    U64 => U64, 8;
    F64 => F64, 8;
    crate::index::PageRecord => PageRecord, 8;
}

impl<T: Wire, const N: usize> Wire for [T; N] {
    const SCALAR: Scalar = T::SCALAR;
    const COUNT: usize = N;
    const ALIGN: usize = T::ALIGN;
}

/// Whether an offset is a multiple of the natural alignment.
pub(crate) const fn is_aligned(offset: usize, align: usize) -> bool {
    offset.is_multiple_of(align)
}

/// Offset, relative to `bytes`, of the first byte of a reserved field that is not zero.
pub(crate) fn reserved_fault(bytes: &[u8], fields: &[Field]) -> Option<(u64, u8)> {
    fields.iter().filter(|f| f.is_reserved()).find_map(|f| {
        let field = bytes.get(f.offset..f.offset + f.bytes)?;
        let at = field.iter().position(|&b| b != 0)?;
        Some(((f.offset + at) as u64, *field.get(at)?))
    })
}

/// Declares a record: `offset => name: type;` with the doc comment of each field.
macro_rules! record {
    (
        $(#[doc = $doc:literal])+
        $name:ident: $bytes:literal bytes {
            $( $(#[doc = $fdoc:literal])+ $offset:literal => $field:ident: $ty:ty; )+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(
            Clone, Copy, Debug, PartialEq, zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable,
            zerocopy::KnownLayout, zerocopy::Unaligned,
        )]
        #[repr(C)]
        pub struct $name {
            $( $(#[doc = $fdoc])+ pub $field: $ty, )+
        }

        impl $name {
            /// Size in bytes.
            pub const BYTES: usize = $bytes;
            /// Name, size and fields, for tools.
            pub const RECORD: $crate::record::Record = $crate::record::Record {
                name: stringify!($name),
                bytes: $bytes,
                fields: &[ $( $crate::record::Field {
                    name: stringify!($field),
                    offset: $offset,
                    bytes: size_of::<$ty>(),
                    scalar: <$ty as $crate::record::Wire>::SCALAR,
                    count: <$ty as $crate::record::Wire>::COUNT,
                    doc: concat!($($fdoc),+).trim_ascii(),
                }, )+ ],
            };

            /// All bytes zero.
            pub fn zeroed() -> Self {
                <Self as zerocopy::FromZeros>::new_zeroed()
            }
        }

        const _: () = {
            assert!(size_of::<$name>() == $bytes);
            $(
                assert!(core::mem::offset_of!($name, $field) == $offset);
                assert!($crate::record::is_aligned($offset, <$ty as $crate::record::Wire>::ALIGN));
            )+
        };
    };
}
pub(crate) use record;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_cover_every_byte_once() {
        for record in RECORDS {
            let mut at = 0;
            for field in record.fields {
                assert_eq!(field.offset, at, "{}.{}", record.name, field.name);
                assert!(!field.doc.is_empty());
                at += field.bytes;
            }
            assert_eq!(at, record.bytes, "{}", record.name);
        }
    }
}
