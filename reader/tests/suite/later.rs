//! Pages of kinds that come later, written by hand as words: they travel through container, index and frame checks
//! and come back unchanged; this version reads their bytes and refuses to query them.

use umbrage_format::index::FORM_FLAT;
use umbrage_format::page::{FrameHead, TAG_FLAT};
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::ReaderError;
use umbrage_reader::query::Map;
use umbrage_writer::container::{ContainerOptions, ContainerWriter, PageInput, WriteError};

use crate::tree::{Folder, ID, open, structure, write};

/// A page of `body` behind its frame, with the footprint of a whole map of `level` levels.
pub fn page(tag: u8, root_mask: u8, child_refs: u16, level: u8, body: &[u32]) -> PageInput {
    let words = 2 + body.len() as u16;
    let head = FrameHead { tag, root_mask, child_refs, words, root_level: level };
    let mut record = PageRecord::zeroed();
    (record.log2_x, record.log2_y, record.level_coarsest) = (level, level, level);
    record.max_depth = u32::MAX.into();
    PageInput { words: [&head.encode()[..], body].concat(), record, dependencies: Vec::new() }
}

/// A shared page: no footprint, no depths.
fn shared(mut p: PageInput) -> PageInput {
    p.record.page_type |= umbrage_format::index::SHARED;
    (p.record.min_depth, p.record.max_depth) = (u32::MAX.into(), 0.into());
    (p.record.log2_x, p.record.log2_y) = (0, 0);
    p
}

#[test]
fn typed_leaves_dependencies_light_axis_and_lists() {
    // stack: a tree that chooses its axis, its types in words of its own.
    let adaptive = page(Kind::Stack.tag(), 0, 0, 4, &[0x0000_0001, 0x4000_0000, 0x0000_0002, 0x4100_0000, 0x0010_FFF0]);
    // mmh-stack: the root refers to two shared pages by their place in its dependencies, with differences.
    let mut mmh_root = page(Kind::MmhStack.tag(), 0, 0, 4, &[0x0000_02E4, 0x1000_0000, 0x0001_0000, 0xFFFF_FFFF]);
    mmh_root.dependencies = vec![1, 2];
    let mut mmh_first = shared(page(Kind::MmhStack.tag(), 0, 0, 2, &[5, 0xFFFF_FFFB]));
    mmh_first.dependencies = vec![2];
    let mmh_second = shared(page(Kind::MmhStack.tag(), 0, 0, 0, &[7]));
    // mh-stack: 3 axes, 8 children, 16-bit masks; lights 0..16. The child page covers lights 8..16 of a quarter.
    let mut stack = page(Kind::MhStack.tag(), 0, 1, 4, &[0x0000_E41B, 0x2000_0000, 0x0000_0001]);
    stack.record.log2_l = 4;
    let mut stack_child = page(Kind::MhStack.tag(), 0, 0, 2, &[0x0000_5555, 1, 2, 3, 4, 5, 6, 7, 8]);
    (stack_child.record.log2_x, stack_child.record.log2_y, stack_child.record.log2_l) = (3, 3, 3);
    (stack_child.record.origin_x, stack_child.record.origin_l) = (8.into(), 8.into());
    // quads: a flat list.
    let mut quads = page(TAG_FLAT, 0, 0, 0, &[2, 0x3F80_0000, 0x4000_0000, 0, 1, 0x3F00_0000, 0xBF80_0000, 1, 0]);
    quads.record.page_type = FORM_FLAT;
    (quads.record.log2_x, quads.record.log2_y) = (4, 4);

    let mut mmh = structure("mmh", Kind::MmhStack, 4, 3);
    mmh.shared_pages = 2.into();
    (mmh.records_per_block, mmh.index_block_log2) = (2.into(), 12);
    let parts = vec![
        (structure("adaptive", Kind::Stack, 4, 1), vec![adaptive]),
        (mmh, vec![mmh_root, mmh_first, mmh_second]),
        (structure("stack", Kind::MhStack, 4, 2), vec![stack, stack_child]),
        (structure("quads", Kind::Quads, 4, 1), vec![quads]),
    ];
    let file = open(write("later", ContainerOptions::new(ID), &parts)).unwrap();
    let summary = file.verify(|e| panic!("{e}"));
    assert_eq!((summary.pages, summary.unsupported, summary.faults, summary.blocks), (7, 7, 0, 5));
    for (s, pages) in &parts {
        let view = file.structure_named(s.name().unwrap()).unwrap();
        for (ordinal, page) in (0u32..).zip(pages) {
            let bytes = view.page_bytes(ordinal).unwrap();
            assert_eq!(bytes.bytes(), page.words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<_>>());
            assert_eq!(bytes.record().log2_l, page.record.log2_l);
            assert_eq!(view.dependencies(ordinal).unwrap(), page.dependencies);
            let frame = bytes.check_frame().unwrap();
            assert_eq!(frame.words(), page.words);
            let error = frame.check_kind().unwrap_err();
            assert!(matches!(error, ReaderError::UnsupportedKind { .. }));
            let text = error.to_string();
            assert!(
                text.contains(&format!("kind {}", view.kind().name()))
                    && text.contains("not supported by this version")
            );
        }
        assert!(matches!(Map::new(view), Err(ReaderError::UnsupportedKind { .. })));
    }
}

#[test]
fn dependencies_must_have_room_and_point_behind_the_tree() {
    let folder = Folder::new("dependencies");
    let mut s = structure("m", Kind::MmhStack, 0, 2);
    s.shared_pages = 1.into();
    let mut root = page(Kind::MmhStack.tag(), 0, 0, 0, &[9]);
    root.dependencies = vec![1];
    let path = folder.0.join("m.umb");
    let options = ContainerOptions::new(ID);
    let refused = ContainerWriter::create(&path, options, vec![s]).unwrap().push(&root);
    assert!(matches!(refused, Err(WriteError::Dependencies { room: 0, .. })));
    (s.records_per_block, s.index_block_log2) = (1.into(), 12);
    root.dependencies = vec![0];
    let refused = ContainerWriter::create(&path, options, vec![s]).unwrap().push(&root);
    assert!(refused.unwrap_err().to_string().contains("index.dependency"));
    assert_eq!(folder.entries(), 0);
}

#[test]
fn shared_pages_have_no_footprint() {
    let folder = Folder::new("shared");
    let mut s = structure("m", Kind::MmhStack, 0, 2);
    s.shared_pages = 1.into();
    let mut writer = ContainerWriter::create(&folder.0.join("m.umb"), ContainerOptions::new(ID), vec![s]).unwrap();
    writer.push(&page(Kind::MmhStack.tag(), 0, 0, 0, &[9])).unwrap();
    let mut second = shared(page(Kind::MmhStack.tag(), 0, 0, 0, &[9]));
    second.record.max_depth = 9.into();
    assert!(writer.push(&second).unwrap_err().to_string().contains("index.shared"));
}
