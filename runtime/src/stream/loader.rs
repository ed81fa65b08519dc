//! Threads that read and check pages, so that no frame waits for a disk or a checksum.

use std::collections::{HashMap, VecDeque};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

use umbrage_format::{Kind, PageRecord};
use umbrage_reader::query::Bounds;
use umbrage_reader::{ReaderError, Structure};

use crate::residency::{Child, Content, LoadedPage};

/// Most pages that are brought at once, so that threads share the work.
const MOST_GATHERED: usize = 32;

/// What a thread did.
#[derive(Debug)]
pub enum Outcome {
    /// What became of the page at a place of the table.
    Page(u32, Result<LoadedPage, ReaderError>),
    /// The same, but what the index says of its children is still to come.
    First(LoadedPage),
    /// That, of the structure of a number and the page at a place.
    Children(u64, u32, Arc<[Child]>),
    /// What a survey of that number found: pages whose words the pool has.
    Survey(u64, Vec<LoadedPage>),
}

/// Something to be read.
#[derive(Debug, Clone)]
pub struct Order {
    /// Of which structure.
    pub structure: Structure,
    /// Its number in the page table, and the place of its first page there.
    pub number: u64,
    /// See above.
    pub base: u32,
    /// What.
    pub what: What,
}

/// What is to be read.
#[derive(Debug, Clone)]
pub enum What {
    /// The page at a place of the table.
    Page(u32),
    /// What the index says of the page at that place: its words are in the pool.
    Kept(u32),
    /// What the index says of pages below the roots that have one of these contents, as far as all between have, too; and a
    /// number for the answer.
    Survey(u64, HashMap<Content, u32>),
}

/// Orders that no thread has taken yet, in the order in which they were given.
#[derive(Debug, Default)]
struct Orders {
    waiting: VecDeque<Order>,
    closed: bool,
}

impl Orders {
    /// With an order of a source for which each read costs a round trip, others of its pages.
    fn gather(&mut self, first: Order) -> Vec<Order> {
        let mut batch = vec![first];
        if !matches!(batch[0].what, What::Page(_)) || !batch[0].structure.gathers() {
            return batch;
        }
        let base = batch[0].base;
        let mut i = 0;
        while i < self.waiting.len() && batch.len() < MOST_GATHERED {
            if self.waiting[i].base == base && matches!(self.waiting[i].what, What::Page(_)) {
                batch.extend(self.waiting.remove(i));
            } else {
                i += 1;
            }
        }
        batch
    }
}

#[derive(Debug, Default)]
struct Desk {
    orders: Mutex<Orders>,
    changed: Condvar,
}

impl Desk {
    fn orders(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// The next orders, mostly one; none where no more will come.
    fn next(&self) -> Option<Vec<Order>> {
        let mut orders = self.orders();
        loop {
            if orders.closed {
                return None;
            }
            if let Some(order) = orders.waiting.pop_front() {
                return Some(orders.gather(order));
            }
            orders = self.changed.wait(orders).unwrap_or_else(|e| e.into_inner());
        }
    }
}

/// The threads and the ways to them.
#[derive(Debug)]
pub struct Loader {
    desk: Arc<Desk>,
    outcomes: Receiver<Outcome>,
}

impl Loader {
    /// Starts `threads` threads, at least one.
    pub fn start(threads: usize) -> Self {
        let desk = Arc::new(Desk::default());
        let (outgoing, outcomes) = mpsc::channel();
        for _ in 0..threads.max(1) {
            let (desk, outgoing) = (desk.clone(), outgoing.clone());
            std::thread::spawn(move || work(&desk, &outgoing));
        }
        Self { desk, outcomes }
    }

    /// Asks for a page; returns at once.
    pub fn order(&self, order: Order) {
        self.desk.orders().waiting.push_back(order);
        self.desk.changed.notify_one();
    }

    /// Takes an order back; `false` where a thread has begun with it already.
    pub fn cancel(&self, ordinal: u32) -> bool {
        let mut orders = self.desk.orders();
        let before = orders.waiting.len();
        orders.waiting.retain(|o| !matches!(o.what, What::Page(p) | What::Kept(p) if p == ordinal));
        orders.waiting.len() < before
    }

    /// A page that has come; `None` at once where there is none.
    pub fn take(&self) -> Option<Outcome> {
        self.outcomes.try_recv().ok()
    }

    /// As [`take`](Self::take), waiting at most `time`. Not for a render thread.
    pub fn wait(&self, time: Duration) -> Option<Outcome> {
        self.outcomes.recv_timeout(time).ok()
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        // Threads end by themselves: one may wait for a server, and nobody waits for it.
        self.desk.orders().closed = true;
        self.desk.changed.notify_all();
    }
}

fn work(desk: &Desk, outgoing: &Sender<Outcome>) {
    while let Some(orders) = desk.next() {
        if let [Order { structure, .. }, _, ..] = &orders[..] {
            let pages = orders.iter().filter_map(|o| match o.what {
                What::Page(ordinal) => Some(ordinal - o.base),
                _ => None,
            });
            // A source that panics here does so again when it is read.
            let _ = guarded(structure, || {
                structure.prefetch(pages);
                Ok(())
            });
        }
        for order in orders {
            if carry_out(order, outgoing).is_none() {
                return;
            }
        }
    }
}

/// Reads what was ordered and sends it; none where nobody takes it any more.
fn carry_out(Order { structure, number, base, what }: Order, outgoing: &Sender<Outcome>) -> Option<()> {
    let outcome = match what {
        What::Page(ordinal) => match guarded(&structure, || read(&structure, base, ordinal - base)) {
            Ok((mut page, record)) => {
                let children = record.first_child.get()..record.children_end();
                if structure.has_records(children.clone()) {
                    page.children = told_of(&structure, children);
                    Outcome::Page(ordinal, Ok(page))
                } else {
                    // It can answer while the index is being read.
                    outgoing.send(Outcome::First(page)).ok()?;
                    let told = guarded(&structure, || Ok(told_of(&structure, children)));
                    Outcome::Children(number, ordinal, told.unwrap_or_default())
                }
            }
            Err(e) => Outcome::Page(ordinal, Err(e)),
        },
        What::Kept(ordinal) => {
            Outcome::Page(ordinal, guarded(&structure, || describe(&structure, base, ordinal - base)))
        }
        // What can't be read is read again as any other page, and fails there.
        What::Survey(number, contents) => {
            let found = guarded(&structure, || Ok(survey(&structure, base, contents)));
            Outcome::Survey(number, found.unwrap_or_default())
        }
    };
    outgoing.send(outcome).ok()
}

/// A source of the caller's may panic: then what was asked for has failed, and the thread lives on.
fn guarded<T>(structure: &Structure, read: impl FnOnce() -> Result<T, ReaderError>) -> Result<T, ReaderError> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let source = Arc::new(std::io::Error::other("the source panicked"));
        Err(ReaderError::Io { file: structure.file().clone(), action: "read", source })
    })
}

/// Pages below the roots that have one of the contents, as often as it is there, with all between; parents first.
fn survey(structure: &Structure, base: u32, mut contents: HashMap<Content, u32>) -> Vec<LoadedPage> {
    let mut open: Vec<u32> = (0..structure.record().root_count.get()).collect();
    let mut found = Vec::new();
    while let Some(page) = open.pop() {
        let Ok(record) = structure.page_record(page) else { continue };
        structure.read_records(record.first_child.get()..record.children_end());
        for child in record.first_child.get()..record.children_end() {
            let Ok(record) = structure.page_record(child) else { continue };
            let left = told(structure, &record).content().and_then(|c| contents.get_mut(&c));
            if let Some(left) = left.filter(|n| **n != 0) {
                *left -= 1;
                let children = told_of(structure, record.first_child.get()..record.children_end());
                found.push(LoadedPage { children, ..indexed(structure, base, child, &record) });
                open.push(child);
            }
        }
    }
    found
}

/// What the index says of a page.
pub fn told(structure: &Structure, record: &PageRecord) -> Child {
    let list = if structure.kind() == Kind::Mmh { record.dep_count.get() } else { 0 };
    Child {
        bounds: Bounds::of(record),
        words: u32::from(record.hot_words.get()) + u32::from(list),
        hash: (record.dep_count.get() == 0).then_some(record.content_hash.get()),
    }
}

/// Reads a page of a structure and checks it as far as this version knows its kind: CRC and frame always, nodes where the
/// kind has a layout. With it comes what the index says of its children. In the answer page `o` of the structure is page
/// `base + o`.
///
/// # Errors
/// The page or its record can't be read, or breaks a rule.
pub fn load(structure: &Structure, base: u32, page: u32) -> Result<LoadedPage, ReaderError> {
    let (page, record) = read(structure, base, page)?;
    let children = told_of(structure, record.first_child.get()..record.children_end());
    Ok(LoadedPage { children, ..page })
}

/// The same without the children, and the page's record.
fn read(structure: &Structure, base: u32, page: u32) -> Result<(LoadedPage, PageRecord), ReaderError> {
    let frame = structure.page_bytes(page)?.check_frame()?;
    let record = *frame.record();
    let mut dependencies = if record.dep_count.get() == 0 { Vec::new() } else { structure.dependencies(page)? };
    // No structure has the place at which this saturates.
    dependencies.iter_mut().for_each(|d| *d = d.saturating_add(base));
    let words: Arc<[u32]> = match structure.kind() {
        // Walks find the list behind the words; the check of the kind sees to it that both fit a slot.
        Kind::Mmh => [frame.check_kind()?.words(), &dependencies].concat().into(),
        kind if kind.has_layout() => frame.check_kind()?.words().into(),
        _ => frame.words().into(),
    };
    Ok((LoadedPage { dependencies, words, ..indexed(structure, base, page, &record) }, record))
}

/// A page without its words, for one that depends on no other.
fn describe(structure: &Structure, base: u32, page: u32) -> Result<LoadedPage, ReaderError> {
    let record = structure.page_record(page)?;
    let children = told_of(structure, record.first_child.get()..record.children_end());
    Ok(LoadedPage { children, ..indexed(structure, base, page, &record) })
}

/// What a record has of its own page.
fn indexed(structure: &Structure, base: u32, page: u32, record: &PageRecord) -> LoadedPage {
    LoadedPage {
        ordinal: base.saturating_add(page),
        first_child: record.first_child.get().saturating_add(base),
        child_count: record.child_count.get(),
        children: Arc::default(),
        dependencies: Vec::new(),
        hash: told(structure, record).hash,
        words: Arc::default(),
    }
}

/// What the index says of children, whose records stand together. Nothing where they can't be read: then the children
/// can't be loaded either, and say why.
fn told_of(structure: &Structure, children: Range<u32>) -> Arc<[Child]> {
    structure.read_records(children.clone());
    let told: Result<Vec<Child>, ReaderError> =
        children.map(|o| structure.page_record(o).map(|r| told(structure, &r))).collect();
    told.unwrap_or_default().into()
}
