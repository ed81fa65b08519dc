//! What was written is read back and answers as the naive tree does.

use std::io;
use std::sync::Arc;

use umbrage_format::Kind;
use umbrage_format::projection::UNCOVERED;
use umbrage_reader::query::Map;
use umbrage_reader::query::mh::{PageView, descend};
use umbrage_reader::query::{Visibility, is_lit};
use umbrage_reader::{Container, FileSource, Limits, ReaderError, Source};
use umbrage_writer::container::{ContainerOptions, ContainerWriter};

use crate::tree::{Dice, Folder, ID, Naive, grow, open, pages, small, structure, write};

/// Every texel at every level, lazily and resident, against the naive tree.
fn compare(tree: &Naive, log2: u8, map: &Map) {
    let resident = map.preload().unwrap();
    for level in 0..=log2 + 1 {
        for (x, y) in (0..1u32 << log2).flat_map(|y| (0..1u32 << log2).map(move |x| (x, y))) {
            let expected = tree.lookup(log2, x, y, level);
            let answer = map.texel(x, y, level).unwrap();
            assert_eq!(answer.value, expected, "texel {x} {y} level {level}");
            assert!(answer.level >= level.min(log2));
            assert_eq!(resident.value(x, y, level), expected, "texel {x} {y} level {level}");
        }
    }
    assert_eq!(resident.value(1 << log2, 0, 0), UNCOVERED);
    assert!(matches!(map.texel(0, 1 << log2, 0), Err(ReaderError::OutOfRange { .. })));
}

#[test]
fn trees_of_all_sizes_answer_as_the_naive_tree() {
    for (seed, log2, cuts) in [(1, 0, &[][..]), (2, 1, &[1]), (3, 4, &[4, 2]), (4, 6, &[5, 4, 1]), (5, 10, &[7, 4, 2])]
    {
        let tree = grow(&mut Dice(seed), log2, true, if log2 > 6 { 7 } else { 6 });
        let pages = pages(&tree, log2, cuts);
        let count = pages.len();
        let bytes = write(
            &format!("trees-{seed}"),
            ContainerOptions::new(ID),
            &[(structure("sun", Kind::Mh, log2, count), pages)],
        );
        let file = open(bytes).unwrap();
        let map = Map::new(file.structure_named("sun").unwrap()).unwrap();
        compare(&tree, log2, &map);
        let summary = file.verify(|e| panic!("{e}"));
        assert_eq!((summary.pages, summary.faults), (count as u64, 0));
    }
}

#[test]
fn file_map_and_memory_give_the_same_answers() {
    let (tree, bytes) = small("sources");
    let folder = Folder::new("sources-read");
    let path = folder.0.join("map.umb");
    std::fs::write(&path, &bytes).unwrap();
    // SAFETY: the file is ours and nobody writes to it while it is mapped.
    #[allow(unsafe_code)]
    let mapped = unsafe { umbrage_reader::MapSource::map(&path) }.unwrap();
    let sources: [Arc<dyn Source>; 2] = [Arc::new(FileSource::open(&path).unwrap()), Arc::new(mapped)];
    compare(&tree, 3, &Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap());
    for source in sources {
        let file = Container::open(source, Limits::default()).unwrap();
        compare(&tree, 3, &Map::new(file.structure(0).unwrap()).unwrap());
        assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
    }
}

#[test]
fn several_structures_in_one_file_and_the_same_bytes_each_time() {
    let trees: Vec<_> = (0..3u8).map(|i| grow(&mut Dice(i.into()), 3 + i, true, 6)).collect();
    let parts: Vec<_> = trees
        .iter()
        .zip(3u8..)
        .map(|(t, log2)| {
            let pages = pages(t, log2, &[3, 1]);
            (structure(&format!("light {log2}"), Kind::Mh, log2, pages.len()), pages)
        })
        .collect();
    for alignment_log2 in [2, 6, 12] {
        let options = ContainerOptions { alignment_log2, ..ContainerOptions::new(ID) };
        let bytes = write("several", options, &parts);
        assert_eq!(bytes, write("several-again", options, &parts));
        let file = open(bytes).unwrap();
        assert_eq!(file.verify(|e| panic!("{e}")).faults, 0);
        for (tree, log2) in trees.iter().zip(3u8..) {
            let map = Map::new(file.structure_named(&format!("light {log2}")).unwrap()).unwrap();
            compare(tree, log2, &map);
        }
        let error = file.structure_named("moon").unwrap_err().to_string();
        assert!(error.contains("'moon'") && error.contains("light 3, light 4, light 5"), "{error}");
    }
}

#[test]
fn the_first_answer_takes_two_reads_and_64_kib() {
    let tree = grow(&mut Dice(11), 9, true, 8);
    let pages = pages(&tree, 9, &[6, 3]);
    assert!(pages.len() > 63, "several index blocks");
    let bytes = write("first", ContainerOptions::new(ID), &[(structure("sun", Kind::Mh, 9, pages.len()), pages)]);
    let folder = Folder::new("first-read");
    let path = folder.0.join("map.umb");
    std::fs::write(&path, &bytes).unwrap();
    let file = Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default()).unwrap();
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    assert_eq!(map.texel(100, 200, 6).unwrap().value, tree.lookup(9, 100, 200, 6));
    let counters = file.counters();
    assert_eq!((counters.reads, counters.pages), (2, 1));
    assert!(counters.bytes <= 64 << 10);
    // Deeper: the nearest ancestor answers, and names what is missing.
    let missing = (0..512).find_map(|x| map.nearest(x, 7, 0).missing.map(|m| (x, m)));
    let (x, ordinal) = missing.expect("a texel below the root page");
    assert_eq!(map.nearest(x, 7, 0).value, tree.lookup(9, x, 7, map.nearest(x, 7, 0).level));
    map.page(ordinal).unwrap();
    assert_ne!(map.nearest(x, 7, 0).missing, Some(ordinal));
}

#[test]
fn long_checks_stop_when_asked() {
    let (_, bytes) = small("stop");
    let file = open(bytes).unwrap();
    let count = u64::from(file.structure(0).unwrap().page_count());
    assert!(count > 2);
    for stop in [0, 1, 2, count] {
        let mut asked = 0;
        let summary = file.verify_while(
            |e| panic!("{e}"),
            |seen| {
                assert_eq!(seen, asked);
                asked += 1;
                seen < stop
            },
        );
        assert_eq!(summary.pages, stop);
    }
    let map = Map::new(file.structure(0).unwrap()).unwrap();
    assert!(matches!(map.preload_while(&|| false), Err(ReaderError::Stopped { .. })));
    assert!(map.preload_while(&|| true).is_ok());
}

#[test]
fn nothing_resident_is_lit_and_names_the_root() {
    let d = descend(|_| None::<PageView<'_>>, 0, 5, 3, 3, 0);
    assert_eq!((d.value, d.missing), (UNCOVERED, Some(0)));
}

#[test]
fn world_points_are_held_against_the_texel() {
    let (tree, bytes) = small("world");
    let map = Map::new(open(bytes).unwrap().structure(0).unwrap()).unwrap();
    let resident = map.preload().unwrap();
    let value = tree.lookup(3, 5, 2, 0);
    for depth in [f64::from(value) - 0.5, f64::from(value), f64::from(value) + 0.5] {
        let v = map.visibility([5.5, 2.5, depth], 0).unwrap();
        assert_eq!(v, Visibility { lit: is_lit(depth, value), inside: true, value });
        assert_eq!(v, resident.visibility([5.5, 2.5, depth], 0));
        assert_eq!(v.lit, depth <= f64::from(value));
    }
    assert_eq!(map.visibility([8.0, 2.5, 9.0], 0).unwrap(), Visibility::OUTSIDE);
    assert_eq!(resident.visibility([-0.1, 2.5, 9.0], 0), Visibility::OUTSIDE);
}

/// A page that the writer puts behind 4 GiB, in a sparse file. A reader's test of the same is in `hostile`.
#[test]
fn the_writer_goes_beyond_4_gib() {
    let flat = |refs: u16, tag: u32| {
        let mut p = crate::later::page(umbrage_format::page::TAG_FLAT, 0, refs, 0, &[tag]);
        p.record.page_type = umbrage_format::index::FORM_FLAT;
        p
    };
    let count = 66_001usize;
    let folder = Folder::new("sparse");
    let path = folder.0.join("big.umb");
    let options = ContainerOptions { alignment_log2: 16, ..ContainerOptions::new(ID) };
    let mut writer = ContainerWriter::create(&path, options, vec![structure("q", Kind::Quads, 0, count)]).unwrap();
    for i in 0..count {
        let refs = [60_000, 6_000].get(i).copied().unwrap_or(0);
        writer.push(&flat(refs, i as u32)).unwrap();
    }
    assert!(writer.finish().unwrap().bytes > 1 << 32);
    let file = Container::open(Arc::new(FileSource::open(&path).unwrap()), Limits::default()).unwrap();
    let page = file.structure(0).unwrap().page_bytes(count as u32 - 1).unwrap();
    assert!(page.record().offset.get() > 1 << 32);
    assert_eq!(page.check_frame().unwrap().words()[2], count as u32 - 1);
}

#[test]
fn a_source_that_is_too_short_is_an_error_of_the_system() {
    struct Short;
    impl Source for Short {
        fn len(&self) -> u64 {
            1 << 20
        }
        fn read_at(&self, _: u64, _: &mut [u8]) -> io::Result<()> {
            Err(io::ErrorKind::UnexpectedEof.into())
        }
    }
    assert!(matches!(Container::open(Arc::new(Short), Limits::default()), Err(ReaderError::Io { .. })));
}
