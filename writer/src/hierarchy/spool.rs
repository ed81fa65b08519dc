//! Finished pages on their way to the container: in memory while they are few, then in a file without a name.
//!
//! Pages are handed in as they are cut, in any order and from any thread, and come out from the root down, level by
//! level, which is the same order whatever the threads did. For each page its place and its types stay in memory, and for
//! each page of the widest level a place in a queue while they come out.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use umbrage_format::kind::mh;

use super::mh::Span;
use super::page::{Draft, DraftRef, Page};
use crate::container::{Target, WriteError};

/// Words of a stored draft before its own words.
const HEAD: usize = 12;

/// Pages of one tree.
#[derive(Debug, Default)]
pub struct Spool {
    /// The file is made beside this one; none: everything stays in memory.
    target: Option<PathBuf>,
    /// Bytes in memory from which on they go to the file.
    most: usize,
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    /// Where each page begins.
    start: Vec<u64>,
    /// Types of each page's root group.
    masks: Vec<mh::Mask>,
    /// Smallest and largest value of each page and those below.
    spans: Vec<[u32; 2]>,
    file: Option<File>,
    /// Bytes in the file.
    written: u64,
    /// Bytes behind those.
    memory: Vec<u8>,
    nodes: [u64; 3],
    failed: Option<WriteError>,
}

impl Spool {
    /// Holds all pages in memory.
    pub fn in_memory() -> Self {
        Spool::default()
    }

    /// Holds at most `most` bytes of pages in memory; the others go to a nameless file in the folder of `target`.
    pub fn beside(target: &Path, most: usize) -> Self {
        Spool { target: Some(target.to_path_buf()), most, inner: Mutex::default() }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        // nothing in here panics half way
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a page in; returns its number. After a failure numbers mean nothing: see [`failed`](Self::failed).
    pub fn push(&self, draft: &Draft) -> u32 {
        let mut inner = self.inner();
        let number = inner.start.len() as u32;
        let start = inner.written + inner.memory.len() as u64;
        inner.start.push(start);
        inner.masks.push(draft.root_mask);
        inner.spans.push([draft.span.min, draft.span.max]);
        for (sum, n) in inner.nodes.iter_mut().zip(draft.nodes) {
            *sum += n;
        }
        encode(draft, &mut inner.memory);
        if let (Some(target), true) = (&self.target, inner.memory.len() > self.most)
            && let Err(e) = inner.spill(target)
        {
            inner.failed.get_or_insert(e);
        }
        number
    }

    /// Puts all pages into the file, so that only their places stay in memory.
    pub fn put_aside(&self) {
        let mut inner = self.inner();
        if let Some(target) = &self.target
            && let Err(e) = inner.spill(target)
        {
            inner.failed.get_or_insert(e);
        }
        inner.memory.shrink_to_fit();
    }

    /// Types of a page's root group.
    pub fn mask(&self, number: u32) -> mh::Mask {
        self.inner().masks[number as usize]
    }

    /// Smallest and largest value stored in a page and those below.
    pub fn span(&self, number: u32) -> [u32; 2] {
        self.inner().spans[number as usize]
    }

    /// Whether the file could not be written; the work may end.
    pub fn has_failed(&self) -> bool {
        self.inner().failed.is_some()
    }

    /// Why the file could not be written.
    pub fn failed(&self) -> Option<WriteError> {
        self.inner().failed.take()
    }

    /// Pages so far.
    pub fn len(&self) -> u32 {
        self.inner().start.len() as u32
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Leaf, inner and empty nodes so far.
    pub fn nodes(&self) -> [u64; 3] {
        self.inner().nodes
    }

    /// Bytes held in memory.
    pub fn held(&self) -> u64 {
        let inner = self.inner();
        (inner.memory.capacity() + inner.start.capacity() * 8 + inner.masks.capacity() + inner.spans.capacity() * 8)
            as u64
    }

    /// The pages from `root` down, level by level.
    ///
    /// # Errors
    /// Each page may bring an error of the file; nothing comes after one.
    pub fn pages(self, root: u32) -> Pages {
        let inner = self.inner.into_inner().unwrap_or_else(PoisonError::into_inner);
        Pages { target: self.target.unwrap_or_default(), inner, queue: VecDeque::from([(root, None)]), next: 1 }
    }
}

impl Inner {
    fn spill(&mut self, target: &Path) -> Result<(), WriteError> {
        let failed = |e| WriteError::io(target, "write pages to a temporary file beside it", self.written, e);
        let file = match &mut self.file {
            Some(file) => file,
            file => file.insert(Target::nameless(target)?),
        };
        file.write_all(&self.memory).map_err(failed)?;
        self.written += self.memory.len() as u64;
        self.memory.clear();
        Ok(())
    }

    /// Reads `words` words from `at` on.
    fn read(&mut self, at: u64, words: usize) -> std::io::Result<Vec<u32>> {
        let mut bytes = vec![0; words * 4];
        match (at.checked_sub(self.written), &mut self.file) {
            (Some(at), _) => {
                let at = at as usize;
                bytes.copy_from_slice(&self.memory[at..at + words * 4]);
            }
            (None, Some(file)) => {
                file.seek(SeekFrom::Start(at))?;
                file.read_exact(&mut bytes)?;
            }
            (None, None) => return Err(std::io::Error::other("the file is gone")),
        }
        Ok(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    fn draft(&mut self, number: u32) -> std::io::Result<Draft> {
        let start = self.start[number as usize];
        let head = self.read(start, HEAD)?;
        let rest = self.read(start + 4 * HEAD as u64, head[0] as usize + 4 * head[1] as usize)?;
        Ok(decode(&head, &rest))
    }
}

/// Pages in their final order.
pub struct Pages {
    target: PathBuf,
    inner: Inner,
    /// Pages to come, with the value that holds above them.
    queue: VecDeque<(u32, Option<[u32; 2]>)>,
    /// Ordinal of the next page that is met.
    next: u32,
}

impl Iterator for Pages {
    type Item = Result<Page, WriteError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (number, inherited) = self.queue.pop_front()?;
        let draft = match self.inner.draft(number) {
            Ok(draft) => draft,
            Err(e) => {
                self.queue.clear();
                let action = "read pages back from a temporary file beside it";
                return Some(Err(WriteError::io(&self.target, action, self.inner.written, e)));
            }
        };
        let first_child = self.next;
        for r in &draft.refs {
            self.queue.push_back((r.page, r.inherited.or(inherited)));
        }
        self.next += draft.refs.len() as u32;
        Some(Ok(Page { first_child, inherited, draft }))
    }
}

/// Lengths, what is known of the page, its words, and four numbers for each reference.
fn encode(d: &Draft, out: &mut Vec<u8>) {
    let types = u32::from(d.root_mask.0) | u32::from(d.root_level) << 16 | u32::from(d.finest) << 24;
    let Span { low, high, min, max } = d.span;
    let nodes = d.nodes.map(|n| n as u32);
    let head = [d.words.len() as u32, d.refs.len() as u32, types, d.origin[0], d.origin[1], low, high, min, max];
    let refs = d.refs.iter().flat_map(|r| {
        let [a, b] = r.inherited.unwrap_or_default();
        [r.page, u32::from(r.inherited.is_some()), a, b]
    });
    let all = head.into_iter().chain(nodes).chain(d.words.iter().copied()).chain(refs);
    out.extend(all.flat_map(u32::to_le_bytes));
}

fn decode(n: &[u32], rest: &[u32]) -> Draft {
    let (words, refs) = rest.split_at(n[0] as usize);
    let reference = |r: &[u32]| DraftRef { page: r[0], inherited: (r[1] != 0).then_some([r[2], r[3]]) };
    Draft {
        words: words.to_vec(),
        refs: refs.chunks_exact(4).map(reference).collect(),
        root_mask: mh::Mask(n[2] as u8),
        root_level: (n[2] >> 16) as u8,
        finest: (n[2] >> 24) as u8,
        origin: [n[3], n[4]],
        span: Span { low: n[5], high: n[6], min: n[7], max: n[8] },
        nodes: [n[9], n[10], n[11]].map(u64::from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draft(i: u32, refs: Vec<u32>) -> Draft {
        Draft {
            words: (0..2 + i * 7 % 50).map(|w| w * i).collect(),
            refs: refs
                .iter()
                .map(|p| DraftRef { page: *p, inherited: (!p.is_multiple_of(3)).then_some([p * 5, p * 6]) })
                .collect(),
            root_mask: mh::Mask(i as u8 * 3),
            root_level: (i % 20) as u8,
            finest: (i % 7) as u8,
            origin: [i, i * 2],
            span: Span { low: i, high: i + 1, min: i + 2, max: i + 3 },
            nodes: [1, 2, u64::from(i)],
        }
    }

    /// A tree of 40 pages, children before parents: page n has children 2n + 1 and 2n + 2 counted from the last one.
    fn fill(spool: &Spool) -> (u32, Vec<Draft>) {
        let number = |n: u32| 39 - n;
        let drafts: Vec<Draft> = (0..40u32)
            .rev()
            .map(|n| draft(n + 1, [2 * n + 1, 2 * n + 2].into_iter().filter(|c| *c < 40).map(number).collect()))
            .collect();
        let last = drafts.iter().map(|d| spool.push(d)).last().unwrap();
        (last, drafts.into_iter().rev().collect())
    }

    #[test]
    fn pages_come_out_level_by_level_wherever_they_were_held() {
        let folder = std::env::temp_dir().join(format!("umbrage-spool-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let target = folder.join("a.umb");
        let beside = |m| Spool::beside(&target, m);
        // all in memory; all, some and none in the file; and the rest put aside at the end
        let spools = [Spool::in_memory(), beside(0), beside(1000), beside(1 << 20), beside(1000), beside(1 << 20)];
        for (i, spool) in spools.into_iter().enumerate() {
            let (root, drafts) = fill(&spool);
            assert_eq!((spool.len(), spool.nodes(), spool.has_failed()), (40, [40, 80, 820], false));
            assert_eq!(spool.mask(root), drafts[0].root_mask);
            if i >= 4 {
                spool.put_aside();
                assert_eq!(spool.inner().memory.len(), 0);
            }
            assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "the file has no name");
            let mut next = 1;
            for (n, (page, draft)) in spool.pages(root).map(Result::unwrap).zip(&drafts).enumerate() {
                let p = &page.draft;
                assert_eq!(
                    (&p.words, p.origin, p.span, p.nodes),
                    (&draft.words, draft.origin, draft.span, draft.nodes)
                );
                assert_eq!((p.root_mask, p.root_level, p.finest), (draft.root_mask, draft.root_level, draft.finest));
                assert_eq!(page.first_child, next, "page {n}");
                next += p.refs.len() as u32;
                // what a reference leaves open comes from further up
                let mut above = 39 - n as u32;
                while n > 0 && above < 39 && above.is_multiple_of(3) {
                    above = 39 - (39 - above - 1) / 2;
                }
                let inherited = (n > 0 && !above.is_multiple_of(3)).then_some([above * 5, above * 6]);
                assert_eq!(page.inherited, inherited, "page {n}");
            }
            assert_eq!(next, 40);
        }
        std::fs::remove_dir(&folder).unwrap();
    }

    #[test]
    fn a_folder_that_is_gone_is_told() {
        let spool = Spool::beside(Path::new("/nowhere/at/all/a.umb"), 100);
        fill(&spool);
        assert!(spool.has_failed());
        assert!(matches!(spool.failed(), Some(WriteError::NoDirectory(_))));
    }
}
