//! What the writer does when the target or the pages are no good: a clear error, and nothing left behind.

use std::fs;

use umbrage_format::Kind;
use umbrage_writer::container::{ContainerOptions, ContainerWriter, WriteError};

use crate::tree::{Dice, Folder, ID, grow, pages, structure};

fn create(path: &std::path::Path, pages: usize) -> Result<ContainerWriter, WriteError> {
    ContainerWriter::create(path, ContainerOptions::new(ID), vec![structure("sun", Kind::Mh, 4, pages)])
}

#[test]
fn a_writer_that_is_dropped_leaves_the_old_target() {
    let folder = Folder::new("dropped");
    let path = folder.0.join("map.umb");
    fs::write(&path, b"old").unwrap();
    let tree = grow(&mut Dice(1), 4, true, 7);
    let pages = pages(&tree, 4, &[3]);
    let mut writer = create(&path, pages.len()).unwrap();
    writer.push(&pages[0]).unwrap();
    assert_eq!(folder.entries(), 2);
    drop(writer);
    assert_eq!((folder.entries(), fs::read(&path).unwrap()), (1, b"old".to_vec()));

    let error = create(&path, pages.len()).unwrap().finish().unwrap_err();
    assert!(matches!(error, WriteError::MissingPages { found: 0, .. }), "{error}");
    let mut writer = create(&path, pages.len()).unwrap();
    writer.push_all(pages.iter().cloned().map(Ok)).unwrap();
    assert!(matches!(writer.push(&pages[0]), Err(WriteError::TooManyPages { .. })));
    writer.finish().unwrap();
    assert_eq!(folder.entries(), 1);
    assert_ne!(fs::read(&path).unwrap(), b"old");
}

#[test]
fn a_target_that_is_no_file_is_refused_before_anything_is_made() {
    let folder = Folder::new("refused");
    assert!(matches!(create(&folder.0, 1), Err(WriteError::IsDirectory(_))));
    assert!(matches!(create(&folder.0.join("no/such/map.umb"), 1), Err(WriteError::NoDirectory(_))));
    #[cfg(unix)]
    assert!(matches!(create("/dev/null".as_ref(), 1), Err(WriteError::NotAFile(_))));
    assert_eq!(folder.entries(), 0);
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link() {
    let folder = Folder::new("link");
    let (real, link) = (folder.0.join("real.umb"), folder.0.join("link.umb"));
    fs::write(&real, b"old").unwrap();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    let pages = pages(&grow(&mut Dice(1), 4, true, 7), 4, &[]);
    let mut writer = create(&link, 1).unwrap();
    writer.push(&pages[0]).unwrap();
    writer.finish().unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(&fs::read(&real).unwrap()[1..4], b"UMB");
}

#[test]
fn structures_and_pages_that_break_a_rule_are_refused() {
    let folder = Folder::new("rules");
    let path = folder.0.join("map.umb");
    let sun = structure("sun", Kind::Mh, 4, 1);
    let options = ContainerOptions::new(ID);
    let twice = ContainerWriter::create(&path, options, vec![sun, sun]);
    assert!(matches!(twice, Err(WriteError::NameTwice { .. })));
    assert!(matches!(ContainerWriter::create(&path, options, vec![]), Err(WriteError::StructureCount { found: 0 })));
    let odd = ContainerOptions { alignment_log2: 1, ..options };
    assert!(matches!(ContainerWriter::create(&path, odd, vec![sun]), Err(WriteError::Alignment { found: 1 })));

    // A child page that is not what its parent says: the second and third page in each other's place.
    let tree = grow(&mut Dice(3), 4, true, 8);
    let mut pages = pages(&tree, 4, &[3]);
    let swapped = (2..pages.len()).find(|&i| pages[i].words[0] >> 8 & 0xFF != pages[1].words[0] >> 8 & 0xFF).unwrap();
    pages.swap(1, swapped);
    let mut writer = create(&path, pages.len()).unwrap();
    let error = pages.iter().try_for_each(|p| writer.push(p)).unwrap_err();
    assert!(error.to_string().contains("mh.link"), "{error}");
    drop(writer);
    pages.swap(1, swapped);
    // One that answers more than its parent says.
    pages[0].record.min_depth = (pages[0].record.min_depth.get() + 1).into();
    pages[0].record.max_depth = (pages[0].record.max_depth.get() - 1).into();
    let widest = pages
        .iter()
        .skip(1)
        .fold((u32::MAX, 0), |(min, max), p| (min.min(p.record.min_depth.get()), max.max(p.record.max_depth.get())));
    assert!(widest.0 < pages[0].record.min_depth.get() || widest.1 > pages[0].record.max_depth.get());
    let mut writer = create(&path, pages.len()).unwrap();
    let error = pages.iter().try_for_each(|p| writer.push(p)).unwrap_err();
    assert!(error.to_string().contains("mh.depths"), "{error}");
    drop(writer);
    assert_eq!(folder.entries(), 0);
}
