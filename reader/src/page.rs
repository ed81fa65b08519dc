//! The steps of a page: bytes whose CRC holds, then a frame that agrees with the index, then nodes that are safe to
//! walk. Each step takes the one before, so that an unchecked page can't be queried or uploaded.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation
)]

use std::ops::Range;
use std::sync::Arc;

use umbrage_format::checksum::content_hash;
use umbrage_format::cold;
use umbrage_format::kind::tree::{self, PageCounts};
use umbrage_format::page::{FrameHead, PageContext, check_frame};
use umbrage_format::{FormatError, PageRecord, Place, Rule, Value};
use zerocopy::{FromBytes, IntoBytes};

use crate::container::Shared;
use crate::{ReaderError, Source, Structure};

/// Words of a page: in the source's memory where they lie there in host order, else a copy.
#[derive(Clone)]
enum Words {
    Owned(Arc<[u32]>),
    Borrowed { source: Arc<dyn Source>, range: Range<usize> },
}

impl Words {
    /// Borrows where the source lends its bytes, they are aligned, and the host is little-endian.
    fn borrow(source: &Arc<dyn Source>, offset: u64, length: usize) -> Option<Self> {
        let start = usize::try_from(offset).ok()?;
        let range = start..start.checked_add(length)?;
        let words = <[u32]>::ref_from_bytes(source.bytes()?.get(range.clone())?);
        (cfg!(target_endian = "little") && words.is_ok()).then(|| Self::Borrowed { source: source.clone(), range })
    }

    fn get(&self) -> &[u32] {
        match self {
            Self::Owned(words) => words,
            // Held to be aligned and inside when it was made.
            Self::Borrowed { source, range } => source
                .bytes()
                .and_then(|b| b.get(range.clone()))
                .and_then(|b| <[u32]>::ref_from_bytes(b).ok())
                .unwrap_or_default(),
        }
    }
}

/// A page whose stored bytes match their CRC; nothing is known of their meaning.
#[derive(Clone)]
pub struct PageBytes {
    structure: Structure,
    ordinal: u32,
    record: PageRecord,
    /// The file's bytes, not yet turned to host order.
    words: Words,
}

impl PageBytes {
    pub(crate) fn read(
        structure: &Structure,
        shared: &Shared,
        ordinal: u32,
        record: PageRecord,
    ) -> Result<Self, ReaderError> {
        let place = Place::Page { structure: structure.number(), ordinal };
        let (offset, count) = (record.offset.get(), usize::from(record.stored_words()));
        let words = match Words::borrow(&shared.source, offset, count * 4) {
            Some(words) => words,
            None => {
                let mut words = vec![0u32; count];
                shared.read(offset, words.as_mut_bytes())?;
                Words::Owned(words.into())
            }
        };
        let crc = structure.page_crc().of(ordinal, words.get().as_bytes());
        FormatError::crc(Rule::PageCrc, place, offset, crc, record.crc32.get()).map_err(|e| structure.fault(e))?;
        Ok(Self { structure: structure.clone(), ordinal, record, words })
    }

    /// The page as stored.
    pub fn bytes(&self) -> &[u8] {
        self.words.get().as_bytes()
    }

    /// Its record.
    pub fn record(&self) -> &PageRecord {
        &self.record
    }

    /// Its ordinal.
    pub fn ordinal(&self) -> u32 {
        self.ordinal
    }

    /// Whether the page is stored in its cold form.
    pub fn is_cold(&self) -> bool {
        self.record.cold_words.get() != 0
    }

    /// Holds the content hash against the bytes; the CRC has found damage already, this finds a wrong index. That of a cold
    /// page is of what it decodes to, and [`check_frame`](Self::check_frame) holds it.
    ///
    /// # Errors
    /// `page.hash`.
    pub fn check_hash(&self) -> Result<(), ReaderError> {
        if self.is_cold() { Ok(()) } else { self.hold_hash(self.bytes()) }
    }

    /// Holds the content hash against the bytes of the page as it is queried.
    fn hold_hash(&self, bytes: &[u8]) -> Result<(), ReaderError> {
        let (computed, stored) = (content_hash(bytes), self.record.content_hash.get());
        if computed == stored {
            return Ok(());
        }
        let place = Place::Page { structure: self.structure.number(), ordinal: self.ordinal };
        let (expected, found) = (Value::Hex(computed), Value::Hex(stored));
        let error = FormatError::new(Rule::PageHash, place, self.record.offset.get(), expected, found);
        Err(self.structure.fault(error))
    }

    /// The words of a cold page, in host order. Their hash is held always: the CRC is of the bytes as stored, and a model
    /// of another structure may decode these to another page.
    fn decode(&self) -> Result<Words, ReaderError> {
        let cx = context(&self.structure, self.ordinal, &self.record);
        let fault = |expected, found| self.structure.fault(cx.fault(Rule::PageCold, 0, expected, found));
        let model = self.structure.cold_model()?;
        let model = model.ok_or_else(|| fault(Value::Text("a model of cold pages"), Value::Text("none")))?;
        let words = cold::decode(&model, self.bytes(), self.record.hot_words.get())
            .ok_or_else(|| fault(Value::Text("the numbers of a page"), Value::Text("other bytes")))?;
        if cfg!(target_endian = "little") {
            self.hold_hash(words.as_bytes())?;
        } else {
            let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
            self.hold_hash(&bytes)?;
        }
        Ok(Words::Owned(words.into()))
    }

    /// Next step: a cold page is decoded; then the frame against the index.
    ///
    /// # Errors
    /// `page.*`; of a cold page also what [`Structure::cold_model`] brings.
    pub fn check_frame(self) -> Result<FrameChecked, ReaderError> {
        let decoded = if self.is_cold() { Some(self.decode()?) } else { None };
        let Self { structure, ordinal, record, words } = self;
        let words = if let Some(words) = decoded {
            words
        } else if cfg!(target_endian = "little") {
            words
        } else {
            Words::Owned(words.get().iter().map(|&w| u32::from_le(w)).collect())
        };
        let cx = context(&structure, ordinal, &record);
        let head = check_frame(words.get(), &cx).map_err(|e| structure.fault(e))?;
        Ok(FrameChecked { structure, ordinal, record, head, words })
    }
}

/// A page whose frame agrees with the index.
#[derive(Clone)]
pub struct FrameChecked {
    structure: Structure,
    ordinal: u32,
    record: PageRecord,
    head: FrameHead,
    words: Words,
}

impl FrameChecked {
    /// The words, frame included, in host order.
    pub fn words(&self) -> &[u32] {
        self.words.get()
    }

    /// The frame's two words.
    pub fn head(&self) -> &FrameHead {
        &self.head
    }

    /// Its record.
    pub fn record(&self) -> &PageRecord {
        &self.record
    }

    /// Its ordinal.
    pub fn ordinal(&self) -> u32 {
        self.ordinal
    }

    /// Last step: the words by the rules of the kind.
    ///
    /// # Errors
    /// A rule of the kind, or [`ReaderError::UnsupportedKind`] where this version has none for it.
    pub fn check_kind(self) -> Result<CheckedPage, ReaderError> {
        let Self { structure, ordinal, record, head, words } = self;
        let cx = context(&structure, ordinal, &record);
        let Some(counts) = tree::check(words.get(), &head, &cx) else {
            return Err(ReaderError::UnsupportedKind {
                file: structure.file().clone(),
                structure: structure.name().to_string(),
                kind: structure.kind(),
            });
        };
        let counts = counts.map_err(|e| structure.fault(e))?;
        let dependencies = match record.dep_count.get() {
            0 => Arc::from([]),
            _ => structure.dependencies(ordinal)?.into(),
        };
        Ok(CheckedPage { ordinal, dependencies, record, head, words, counts })
    }
}

/// A page that is safe to walk and to upload.
#[derive(Clone)]
pub struct CheckedPage {
    ordinal: u32,
    dependencies: Arc<[u32]>,
    record: PageRecord,
    head: FrameHead,
    words: Words,
    counts: PageCounts,
}

impl CheckedPage {
    /// The words, frame included, in host order.
    pub fn words(&self) -> &[u32] {
        self.words.get()
    }

    /// The frame's two words.
    pub fn head(&self) -> &FrameHead {
        &self.head
    }

    /// Its record.
    pub fn record(&self) -> &PageRecord {
        &self.record
    }

    /// Its ordinal.
    pub fn ordinal(&self) -> u32 {
        self.ordinal
    }

    /// Ordinals of the shared pages that it depends on.
    pub fn dependencies(&self) -> &[u32] {
        &self.dependencies
    }

    /// Its nodes by type and the range of its values.
    pub fn counts(&self) -> &PageCounts {
        &self.counts
    }
}

/// What a page of `structure` is checked against.
pub(crate) fn context<'a>(structure: &'a Structure, ordinal: u32, record: &'a PageRecord) -> PageContext<'a> {
    PageContext { structure: structure.number(), ordinal, page: record, record: structure.record() }
}

macro_rules! debug_by_ordinal {
    ($($name:ident)*) => { $(
        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.debug_struct(stringify!($name)).field("ordinal", &self.ordinal).field("record", &self.record).finish()
            }
        }
    )* };
}
debug_by_ordinal!(PageBytes FrameChecked CheckedPage);
