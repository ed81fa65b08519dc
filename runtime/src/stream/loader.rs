//! Threads that read and check pages, so that no frame waits for a disk or a checksum.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use umbrage_format::{Kind, PageRecord};
use umbrage_reader::query::Bounds;
use umbrage_reader::{ReaderError, Structure};

use crate::residency::{Child, LoadedPage};

/// What became of a page.
pub type Outcome = (u32, Result<LoadedPage, ReaderError>);

/// Orders that no thread has taken yet, in the order in which they were given.
#[derive(Debug, Default)]
struct Orders {
    waiting: VecDeque<u32>,
    closed: bool,
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

    /// The next order; none where no more will come.
    fn next(&self) -> Option<u32> {
        let mut orders = self.orders();
        loop {
            if orders.closed {
                return None;
            }
            if let Some(ordinal) = orders.waiting.pop_front() {
                return Some(ordinal);
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
    threads: Vec<JoinHandle<()>>,
}

impl Loader {
    /// Starts `threads` threads, at least one.
    pub fn start(structure: &Structure, threads: usize) -> Self {
        let desk = Arc::new(Desk::default());
        let (outgoing, outcomes) = mpsc::channel();
        let threads = (0..threads.max(1))
            .map(|_| {
                let (structure, desk, outgoing) = (structure.clone(), desk.clone(), outgoing.clone());
                std::thread::spawn(move || work(&structure, &desk, &outgoing))
            })
            .collect();
        Self { desk, outcomes, threads }
    }

    /// Asks for a page; returns at once.
    pub fn order(&self, ordinal: u32) {
        self.desk.orders().waiting.push_back(ordinal);
        self.desk.changed.notify_one();
    }

    /// Takes an order back; `false` where a thread has begun with it already.
    pub fn cancel(&self, ordinal: u32) -> bool {
        let mut orders = self.desk.orders();
        let before = orders.waiting.len();
        orders.waiting.retain(|o| *o != ordinal);
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
        self.desk.orders().closed = true;
        self.desk.changed.notify_all();
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so already.
            let _ = thread.join();
        }
    }
}

fn work(structure: &Structure, desk: &Desk, outgoing: &Sender<Outcome>) {
    while let Some(ordinal) = desk.next() {
        // A source of the caller's may panic: then this page has failed, and the thread lives on.
        let outcome = catch_unwind(AssertUnwindSafe(|| load(structure, ordinal))).unwrap_or_else(|_| {
            let source = Arc::new(std::io::Error::other("the source panicked"));
            Err(ReaderError::Io { file: structure.file().clone(), action: "read", source })
        });
        if outgoing.send((ordinal, outcome)).is_err() {
            return;
        }
    }
}

/// Reads a page and checks it as far as this version knows its kind: CRC and frame always, nodes where the kind has a
/// layout. With it comes what the index says of its children.
pub fn load(structure: &Structure, ordinal: u32) -> Result<LoadedPage, ReaderError> {
    let frame = structure.page_bytes(ordinal)?.check_frame()?;
    let record = *frame.record();
    let dependencies = if record.dep_count.get() == 0 { Vec::new() } else { structure.dependencies(ordinal)? };
    let words: Arc<[u32]> = match structure.kind() {
        // Walks find the list behind the words; the check of the kind sees to it that both fit a slot.
        Kind::Mmh => [frame.check_kind()?.words(), &dependencies].concat().into(),
        kind if kind.has_layout() => frame.check_kind()?.words().into(),
        _ => frame.words().into(),
    };
    // The children's records stand together. Where they can't be read, the children can't be loaded either, and say why.
    let children = record.first_child.get()..record.children_end();
    let told = |r: PageRecord| {
        let list = if structure.kind() == Kind::Mmh { r.dep_count.get() } else { 0 };
        Child { bounds: Bounds::of(&r), words: u32::from(r.hot_words.get()) + u32::from(list) }
    };
    let children: Result<Vec<Child>, ReaderError> = children.map(|o| structure.page_record(o).map(told)).collect();
    Ok(LoadedPage {
        ordinal,
        first_child: record.first_child.get(),
        child_count: record.child_count.get(),
        children: children.unwrap_or_default().into(),
        dependencies,
        words,
    })
}
