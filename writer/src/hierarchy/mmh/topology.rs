//! Shapes of subtrees: a hash of the types of all their nodes, bottom-up (Scandolo 2019, algorithm 4).
//!
//! Departure from the paper: its hash multiplies by hashes that were shifted left, so that a few levels up nothing but
//! zeros is left of it. Here the same numbers (types of the children, size and hash of each, its place among them) go
//! through a multiplication that loses nothing. Equal hashes are taken as a hint: [`same`] decides.

/// Hash of a group without children below it.
fn leaves(mask: u8) -> u64 {
    mix(0x9E37_79B9_7F4A_7C15 ^ u64::from(mask))
}

/// Hash of a group from its types and, for each child that has some, the words and the hash of the group below.
pub fn hash(mask: u8, below: &[Option<(u32, u64)>; 4]) -> u64 {
    let mut hash = leaves(mask);
    for (place, (words, child)) in (1u32..).zip(below).filter_map(|(i, b)| b.map(|b| (i, b))) {
        hash = mix(hash.wrapping_add(u64::from(words) << place)) ^ child.rotate_left(place);
    }
    mix(hash)
}

/// The finalizer of SplitMix64 (Steele, Lea and Flood 2014): a bijection.
fn mix(mut v: u64) -> u64 {
    v = (v ^ v >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    v = (v ^ v >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    v ^ v >> 31
}

/// Whether two subtrees have the same shape: the types of their groups in preorder. With the types of every group known,
/// preorder leaves one tree.
pub fn same(a: &[u8], b: &[u8]) -> bool {
    a == b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_and_the_shape_of_a_child_count() {
        let (leaf, other) = ((2, leaves(0x05)), (2, leaves(0x11)));
        let of = |below: [Option<(u32, u64)>; 4]| hash(0xFF, &below);
        let all = [
            of([Some(leaf), None, None, None]),
            of([None, Some(leaf), None, None]),
            of([None, None, None, Some(leaf)]),
            of([Some(other), None, None, None]),
            of([Some(leaf), Some(other), None, None]),
            of([Some(other), Some(leaf), None, None]),
            hash(0xFE, &[Some(leaf), None, None, None]),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[i + 1..].iter().all(|b| a != b), "{i}");
        }
        assert_eq!(of([Some(leaf), None, None, None]), all[0]);
    }

    /// The paper's own hash is 0 for every deep tree; this one tells deep trees apart by one leaf at their bottom.
    #[test]
    fn deep_trees_that_differ_at_the_bottom_differ() {
        let tower =
            |bottom: u8| (0..24).fold((1, leaves(bottom)), |b, i| (i + 2, hash(3, &[Some(b), None, None, None])));
        assert_ne!(tower(0x01), tower(0x04));
    }
}
