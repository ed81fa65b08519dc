//! A file on a web server, read by ranges (feature `remote`).
//!
//! The first request brings the first 64 KiB and tells the length; a container that is opened and drawn once takes three.
//! Every answer is held against the first one: another ETag, date or length means that the file was replaced, and from
//! then on every read fails at once ([`HttpSource::is_changed`]) until it is opened anew. A server without these is found out
//! by the pages' CRCs, which the file's id is part of.

use std::collections::{HashSet, VecDeque};
use std::io::{self, Error, ErrorKind, Read};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::Source;
use crate::ReaderError;

/// Bytes of the first request.
const HEAD_BYTES: u64 = 64 << 10;
/// Ranges that lie no further apart come in one request.
const GAP_BYTES: u64 = 16 << 10;
/// Most bytes of one request that was made ahead.
const MOST_BYTES: u64 = 1 << 20;
/// Most bytes that are kept until they are read.
const KEPT_BYTES: u64 = 4 << 20;

/// How long to wait for a server.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// For a connection.
    pub connect: Duration,
    /// From there to the last byte of an answer.
    pub answer: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self { connect: Duration::from_secs(5), answer: Duration::from_secs(20) }
    }
}

/// What tells a version of the file from another.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Version {
    length: u64,
    etag: Option<String>,
    modified: Option<String>,
}

/// Bytes that were brought ahead.
#[derive(Debug)]
struct Ahead {
    /// Their first place.
    from: u64,
    bytes: Vec<u8>,
    /// Places from which reads began: who reads one again did not like what it got.
    read: HashSet<u64>,
}

/// A file behind a URL.
#[derive(Debug)]
pub struct HttpSource {
    agent: ureq::Agent,
    url: String,
    version: Version,
    head: Vec<u8>,
    ahead: Mutex<VecDeque<Ahead>>,
    changed: AtomicBool,
    requests: AtomicU64,
    bytes: AtomicU64,
}

/// An answer to a request for a range.
struct Part {
    version: Version,
    bytes: Vec<u8>,
}

impl HttpSource {
    /// Asks for the first bytes.
    ///
    /// # Errors
    /// [`ReaderError::Io`]: the server can't be reached, has no such file, or does not serve ranges.
    pub fn open(url: &str, patience: Patience) -> Result<Self, ReaderError> {
        let config = ureq::Agent::config_builder()
            .timeout_connect(Some(patience.connect))
            .timeout_global(Some(patience.answer))
            .http_status_as_error(false)
            .build();
        let mut this = Self {
            agent: config.into(),
            url: url.to_string(),
            version: Version { length: 0, etag: None, modified: None },
            head: Vec::new(),
            ahead: Mutex::default(),
            changed: AtomicBool::new(false),
            requests: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
        };
        let part = this.part(0, HEAD_BYTES).map_err(|e| ReaderError::io(&Arc::from(url), "open", e))?;
        (this.version, this.head) = (part.version, part.bytes);
        Ok(this)
    }

    /// Requests so far.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }

    /// Bytes of answers so far, without their headers.
    pub fn bytes_read(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Whether the server has another version now: to be opened anew.
    pub fn is_changed(&self) -> bool {
        self.changed.load(Ordering::Relaxed)
    }

    /// One request for at most `length` bytes from `offset`; fewer come where the file ends.
    fn part(&self, offset: u64, length: u64) -> io::Result<Part> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        let last = offset.saturating_add(length).saturating_sub(1);
        let range = format!("bytes={offset}-{last}");
        let response = self.agent.get(&self.url).header("Range", &range).call().map_err(said)?;
        let header = |name: &str| response.headers().get(name).and_then(|v| v.to_str().ok()).map(str::to_string);
        let status = response.status().as_u16();
        match status {
            206 => {}
            200 => {
                let text = "the server sends the whole file where a range was asked for; use one that serves ranges";
                return Err(Error::new(ErrorKind::Unsupported, text));
            }
            404 | 410 => {
                return Err(Error::new(ErrorKind::NotFound, format!("the server has no such file ({status})")));
            }
            412 | 416 => return Err(self.replaced(&format!("it has no bytes {offset} to {last} ({status})"))),
            _ => return Err(Error::other(format!("the server answered with status {status}"))),
        }
        let stated = header("content-range").unwrap_or_default();
        let Some((first, end, length)) = content_range(&stated) else {
            let text = format!("expected a content range, found '{stated}'");
            return Err(Error::new(ErrorKind::InvalidData, text));
        };
        let expected = last.min(length.saturating_sub(1)) + 1;
        if (first, end) != (offset, expected) {
            let text = format!("expected bytes {offset} to {expected}, found {first} to {end} of {length}");
            return Err(Error::new(ErrorKind::InvalidData, text));
        }
        let version = Version { length, etag: header("etag"), modified: header("last-modified") };
        let mut bytes = Vec::new();
        let count = end - first;
        // One more than was said: a server that sends it is as wrong as one that stops early.
        let read = response.into_body().into_reader().take(count + 1).read_to_end(&mut bytes);
        self.bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        read.map_err(|e| e.downcast::<ureq::Error>().map_or_else(|e| e, said))?;
        if bytes.len() as u64 != count {
            let text = format!("expected {count} bytes, found {}", bytes.len());
            return Err(Error::new(ErrorKind::UnexpectedEof, text));
        }
        Ok(Part { version, bytes })
    }

    /// The same, held against the version that was opened.
    fn fetch(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        if self.is_changed() {
            return Err(self.replaced("it was replaced before"));
        }
        let part = match self.part(offset, length) {
            // A connection that the server had closed meanwhile: once more, with another one.
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted
                ) =>
            {
                self.part(offset, length)?
            }
            part => part?,
        };
        if part.version != self.version {
            return Err(self.replaced(&format!("expected {:?}, found {:?}", self.version, part.version)));
        }
        Ok(part.bytes)
    }

    fn replaced(&self, what: &str) -> Error {
        self.changed.store(true, Ordering::Relaxed);
        Error::new(
            ErrorKind::StaleNetworkFileHandle,
            format!("the file on the server is another one: {what}; open it anew"),
        )
    }

    fn is_inside(&self, offset: u64, length: u64) -> bool {
        offset.checked_add(length).is_some_and(|end| end <= self.version.length)
    }
}

/// What the client says, as the system would.
fn said(error: ureq::Error) -> Error {
    match error {
        ureq::Error::Io(e) => e,
        ureq::Error::Timeout(what) => {
            Error::new(ErrorKind::TimedOut, format!("the server did not answer in time ({what})"))
        }
        e => Error::other(e.to_string()),
    }
}

/// First byte, the one behind the last, and the length of the file, of `bytes 0-99/1234`.
fn content_range(text: &str) -> Option<(u64, u64, u64)> {
    let (range, length) = text.trim().strip_prefix("bytes ")?.split_once('/')?;
    let (first, last) = range.split_once('-')?;
    let (first, last, length): (u64, u64, u64) = (first.parse().ok()?, last.parse().ok()?, length.parse().ok()?);
    (first <= last && last < length).then(|| (first, last + 1, length))
}

/// Copies a range out of bytes that begin at `from`, where they hold all of it.
fn copy(bytes: &[u8], from: u64, offset: u64, out: &mut [u8]) -> bool {
    let start = offset.checked_sub(from).and_then(|s| usize::try_from(s).ok());
    let held = start.and_then(|s| bytes.get(s..s.checked_add(out.len())?));
    held.is_some_and(|held| {
        out.copy_from_slice(held);
        true
    })
}

impl Source for HttpSource {
    fn len(&self) -> u64 {
        self.version.length
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        if !self.is_inside(offset, out.len() as u64) {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        if out.is_empty() || copy(&self.head, 0, offset, out) {
            return Ok(());
        }
        {
            let mut ahead = self.ahead.lock().unwrap_or_else(PoisonError::into_inner);
            let held = ahead.iter().position(|a| copy(&a.bytes, a.from, offset, out));
            if let Some(i) = held {
                if ahead.get_mut(i).is_some_and(|a| a.read.insert(offset)) {
                    return Ok(());
                }
                ahead.remove(i);
            }
        }
        let bytes = self.fetch(offset, out.len() as u64)?;
        if copy(&bytes, offset, offset, out) { Ok(()) } else { Err(ErrorKind::UnexpectedEof.into()) }
    }

    fn name(&self) -> &str {
        &self.url
    }

    fn gathers(&self) -> bool {
        true
    }

    fn prefetch(&self, ranges: &mut Vec<Range<u64>>) {
        {
            let ahead = self.ahead.lock().unwrap_or_else(PoisonError::into_inner);
            let holds = |a: &Ahead, r: &Range<u64>| a.from <= r.start && r.end <= a.from + a.bytes.len() as u64;
            let held = |r: &Range<u64>| ahead.iter().any(|a| holds(a, r) && !a.read.contains(&r.start));
            let inside =
                |r: &Range<u64>| r.start < r.end && r.end > self.head.len() as u64 && r.end <= self.version.length;
            ranges.retain(|r| inside(r) && !held(r));
        }
        for range in gather(ranges) {
            // What can't be had is asked for again when it is read, and said then.
            let Ok(bytes) = self.fetch(range.start, range.end - range.start) else { return };
            let mut ahead = self.ahead.lock().unwrap_or_else(PoisonError::into_inner);
            ahead.push_back(Ahead { from: range.start, bytes, read: HashSet::new() });
            while ahead.iter().map(|a| a.bytes.len() as u64).sum::<u64>() > KEPT_BYTES {
                ahead.pop_front();
            }
        }
    }
}

/// Ranges that lie together as one.
fn gather(ranges: &mut [Range<u64>]) -> Vec<Range<u64>> {
    ranges.sort_unstable_by_key(|r| (r.start, r.end));
    let mut out: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match out.last_mut() {
            Some(last)
                if range.start <= last.end.saturating_add(GAP_BYTES)
                    && range.end.saturating_sub(last.start) <= MOST_BYTES =>
            {
                last.end = last.end.max(range.end);
            }
            _ => out.push(range.clone()),
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init)]
mod tests {
    use super::*;

    #[test]
    fn content_ranges_are_read_or_refused() {
        assert_eq!(content_range("bytes 0-99/1234"), Some((0, 100, 1234)));
        assert_eq!(content_range(" bytes 5-5/6 "), Some((5, 6, 6)));
        for bad in [
            "",
            "bytes */9",
            "bytes 0-9/*",
            "bytes 9-0/10",
            "bytes 0-10/10",
            "items 0-9/10",
            "bytes -1-9/10",
            "bytes 0-9",
        ] {
            assert_eq!(content_range(bad), None, "{bad}");
        }
    }

    #[test]
    fn ranges_that_lie_together_are_one() {
        let gap = GAP_BYTES;
        let mut ranges = [5 * gap..5 * gap + 7, 0..10, 10..20, 20 + gap..30 + gap, 12..15];
        assert_eq!(gather(&mut ranges), [0..30 + gap, 5 * gap..5 * gap + 7]);
        let long = MOST_BYTES - 5;
        assert_eq!(gather(&mut [0..long, long..long + 6]), [0..long, long..long + 6]);
        assert_eq!(gather(&mut []), []);
    }
}
