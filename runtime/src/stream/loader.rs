//! Threads that read and check pages, so that no frame waits for a disk or a checksum.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use umbrage_format::Kind;
use umbrage_reader::{ReaderError, Structure};

use crate::residency::LoadedPage;

/// What became of a page.
pub type Outcome = (u32, Result<LoadedPage, ReaderError>);

/// The threads and the channels to them.
#[derive(Debug)]
pub struct Loader {
    orders: Option<Sender<u32>>,
    outcomes: Receiver<Outcome>,
    threads: Vec<JoinHandle<()>>,
}

impl Loader {
    /// Starts `threads` threads, at least one.
    pub fn start(structure: &Structure, threads: usize) -> Self {
        let (orders, incoming) = mpsc::channel();
        let (outgoing, outcomes) = mpsc::channel();
        let incoming = Arc::new(Mutex::new(incoming));
        let threads = (0..threads.max(1))
            .map(|_| {
                let (structure, incoming, outgoing) = (structure.clone(), incoming.clone(), outgoing.clone());
                std::thread::spawn(move || work(&structure, &incoming, &outgoing))
            })
            .collect();
        Self { orders: Some(orders), outcomes, threads }
    }

    /// Asks for a page; returns at once.
    pub fn order(&self, ordinal: u32) {
        if let Some(orders) = &self.orders {
            // Fails only where every thread has died; then nothing comes, and ancestors answer.
            let _ = orders.send(ordinal);
        }
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
        self.orders = None;
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so already.
            let _ = thread.join();
        }
    }
}

fn work(structure: &Structure, incoming: &Mutex<Receiver<u32>>, outgoing: &Sender<Outcome>) {
    loop {
        let order = incoming.lock().unwrap_or_else(|e| e.into_inner()).recv();
        let Ok(ordinal) = order else { return };
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
/// layout.
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
    Ok(LoadedPage {
        ordinal,
        first_child: record.first_child.get(),
        child_count: record.child_count.get(),
        dependencies,
        words,
    })
}
