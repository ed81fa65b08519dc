//! Pages of kinds that have no kernel yet: they go through loader, residency, pool and table as they are.

use umbrage_format::index::{FORM_FLAT, SHARED};
use umbrage_format::page::{FrameHead, TAG_FLAT};
use umbrage_format::{Kind, PageRecord};
use umbrage_reader::{Container, Limits, MemorySource};
use umbrage_runtime::query::pool::NOT_RESIDENT;
use umbrage_runtime::{GpuStreamer, RuntimeError};
use umbrage_writer::container::{ContainerOptions, PageInput};

use crate::support::device;
use crate::tree::{ID, structure, write};

fn page(tag: u8, root_mask: u8, child_refs: u16, level: u8, body: &[u32]) -> PageInput {
    let head = FrameHead { tag, root_mask, child_refs, words: 2 + body.len() as u16, root_level: level };
    let mut record = PageRecord::zeroed();
    (record.log2_x, record.log2_y, record.level_coarsest) = (level, level, level);
    record.max_depth = u32::MAX.into();
    PageInput { words: [&head.encode()[..], body].concat(), record, dependencies: Vec::new() }
}

fn shared(body: &[u32], level: u8, dependencies: &[u32]) -> PageInput {
    let mut p = page(Kind::MmhStack.tag(), 0, 0, level, body);
    p.record.page_type |= SHARED;
    (p.record.min_depth, p.record.max_depth) = (u32::MAX.into(), 0.into());
    (p.record.log2_x, p.record.log2_y) = (0, 0);
    p.dependencies = dependencies.to_vec();
    p
}

#[test]
fn adaptive_shared_stack_and_flat_pages_pass_unchanged() {
    let leaves: Vec<u32> = (0..300).map(|i| 0x4000_0000 ^ (i * 77)).collect();
    let adaptive = page(Kind::Stack.tag(), 0, 0, 4, &leaves);
    let mut mmh = page(Kind::MmhStack.tag(), 0, 0, 4, &[0x0000_02E4, 0x1000_0000, 0x0001_0000, 0xFFFF_FFFF]);
    mmh.dependencies = vec![1, 2];
    let mut mmh_record = structure("mmh", Kind::MmhStack, 4, 3);
    mmh_record.shared_pages = 2.into();
    (mmh_record.records_per_block, mmh_record.index_block_log2) = (2.into(), 12);
    let mut stack = page(Kind::MhStack.tag(), 0, 1, 4, &[0x0000_E41B, 0x2000_0000, 0x0000_0001]);
    stack.record.log2_l = 4;
    let mut child = page(Kind::MhStack.tag(), 0, 0, 2, &[0x0000_5555, 1, 2, 3, 4, 5, 6, 7, 8]);
    (child.record.log2_x, child.record.log2_y, child.record.log2_l) = (3, 3, 3);
    (child.record.origin_x, child.record.origin_l) = (8.into(), 8.into());
    let quads = [2, 0x3F80_0000, 0x4000_0000, 0, 1, 0x3F00_0000, 0xBF80_0000, 1, 0];
    let mut quads = page(TAG_FLAT, 0, 0, 0, &quads);
    quads.record.page_type = FORM_FLAT;
    (quads.record.log2_x, quads.record.log2_y) = (4, 4);

    let parts = vec![
        (structure("adaptive", Kind::Stack, 4, 1), vec![adaptive]),
        (mmh_record, vec![mmh, shared(&[5, 0xFFFF_FFFB], 2, &[2]), shared(&[7], 0, &[])]),
        (structure("stack", Kind::MhStack, 4, 2), vec![stack, child]),
        (structure("quads", Kind::Quads, 4, 1), vec![quads]),
    ];
    let bytes = write("runtime-later", ContainerOptions::new(ID), &parts);
    let file = Container::open(std::sync::Arc::new(MemorySource::new(bytes, "later")), Limits::default()).unwrap();
    let headless = device();
    for (record, pages) in &parts {
        let structure = file.structure_named(record.name().unwrap()).unwrap();
        let mut gpu = GpuStreamer::new(&headless.device, &headless.queue, &structure, 2 << 20).unwrap();
        for _ in 0..20 {
            gpu.streamer_mut().wait(std::time::Duration::from_millis(20));
            (0..structure.page_count()).for_each(|o| gpu.streamer_mut().request(o, 1));
            gpu.begin(&[]);
            let mut encoder = headless.device.create_command_encoder(&Default::default());
            gpu.record(&mut encoder);
            gpu.end(&mut encoder);
            headless.queue.submit([encoder.finish()]);
        }
        let (words, table) = gpu.read_back().unwrap();
        assert_eq!(table.len(), pages.len());
        for (ordinal, page) in pages.iter().enumerate() {
            let [at, first_child, ..] = table[ordinal];
            assert_ne!(at, NOT_RESIDENT, "{} page {ordinal}", structure.name());
            assert_eq!(&words[at as usize..][..page.words.len()], page.words);
            assert_eq!(first_child, structure.page_record(ordinal as u32).unwrap().first_child.get());
            assert_eq!(gpu.streamer().residency().entry(ordinal as u32), table[ordinal]);
        }
        let refused = gpu.answer(0, &[[0; 4]]);
        assert!(matches!(refused, Err(RuntimeError::UnsupportedKind(k)) if k == structure.kind()));
    }
}
