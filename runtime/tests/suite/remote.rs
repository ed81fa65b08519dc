//! Files on a web server: how many requests a picture takes, and what becomes of answers from a server that stalls, cuts,
//! lies, fails or has another file by now.

use std::io::ErrorKind;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use umbrage_reader::query::Map;
use umbrage_reader::source::{HttpSource, Patience};
use umbrage_reader::{Container, Limits, MemorySource, ReaderError, Source, Structure};
use umbrage_runtime::stream::{Streamer, StructureId};

use crate::server::*;
use crate::several::{Cpu, versions};
use crate::support::{opened, random_tree, shared_city};
use crate::tree::Dice;

const TAGGED: &str = "etag: \"one\"\r\nlast-modified: Sat, 01 Aug 2026 10:00:00 GMT\r\n";

fn open(server: &Server) -> Result<Arc<HttpSource>, ReaderError> {
    let patience = Patience { connect: Duration::from_millis(500), answer: Duration::from_millis(400) };
    HttpSource::open(&server.url, patience).map(Arc::new)
}

fn structure(source: Arc<dyn Source>) -> Result<Structure, ReaderError> {
    Container::open(source, Limits::default())?.structure(0)
}

fn streamer(structure: &Structure) -> (Cpu, StructureId) {
    let cpu = Cpu::new(Streamer::new(structure, 16 << 20, 16 << 20, 2).unwrap());
    let id = cpu.streamer.structures().next().unwrap();
    (cpu, id)
}

/// Asks at random and holds what is exact: how many answers were coarse.
fn hold(cpu: &mut Cpu, id: StructureId, map: &Map, dice: &mut Dice, count: usize) -> usize {
    let side = 1 << map.structure().record().log2_resolution;
    let ask = |_| {
        let (x, y) = (dice.roll(side), dice.roll(side));
        let Some((value, _, exact)) = cpu.ask(id, [x, y, 0, 0]) else { return 1 };
        assert!(!exact || value == map.texel(x, y, 0).unwrap().value);
        usize::from(!exact)
    };
    (0..count).map(ask).sum()
}

/// Counts reads.
struct Counting(MemorySource, Arc<Mutex<Vec<(u64, usize)>>>);

impl Source for Counting {
    fn len(&self) -> u64 {
        self.0.len()
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        self.1.lock().unwrap().push((offset, out.len()));
        self.0.read_at(offset, out)
    }
}

/// Frames until the root answers.
fn first_picture(cpu: &mut Cpu, id: StructureId) {
    for _ in 0..500 {
        cpu.frame();
        if cpu.streamer.is_ready(id) {
            return;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("no picture");
}

#[test]
fn the_first_picture_takes_two_reads_or_three_requests() {
    let bytes = shared_city();
    let reads = Arc::new(Mutex::new(Vec::new()));
    let local = structure(Arc::new(Counting(MemorySource::new(bytes.clone(), "memory"), reads.clone()))).unwrap();
    let root = local.page_record(0).unwrap();
    let (mut cpu, id) = streamer(&local);
    first_picture(&mut cpu, id);
    // The root's page is the second; what the index says of its children comes behind, in one.
    let reads: Vec<(u64, usize)> = reads.lock().unwrap().clone();
    let of_root = reads.iter().position(|r| r.0 == root.offset.get()).unwrap();
    assert!(of_root <= 1 && reads.len() <= 3, "{reads:?}");

    let server = Server::new(bytes.clone(), TAGGED);
    let source = open(&server).unwrap();
    assert_eq!((source.len(), server.count()), (bytes.len() as u64, 1));
    let remote = structure(source.clone()).unwrap();
    let (mut cpu, id) = streamer(&remote);
    first_picture(&mut cpu, id);
    eprintln!("first picture: {} reads, {} requests", of_root + 1, server.count());
    assert!(server.count() <= 3, "{}", server.count());
    // The rest: far fewer requests than pages, and little that nobody asked for.
    let map = Map::new(opened(bytes.clone())).unwrap();
    let mut dice = Dice(5);
    while hold(&mut cpu, id, &map, &mut dice, 20_000) != 0 {
        cpu.whole_frame();
    }
    let stats = cpu.streamer.stats();
    let (requests, read) = (source.requests(), source.bytes_read());
    eprintln!("{} pages in {requests} requests, {read} of {} bytes", stats.resident, bytes.len());
    assert!(requests * 8 < u64::from(stats.resident) && read < bytes.len() as u64 * 3 / 2);
    assert_eq!(u64::from(server.count()), requests);
}

#[test]
fn a_server_that_stalls_cuts_lies_or_fails_costs_detail_and_nothing_else() {
    let (_, bytes) = random_tree("remote-faults", 5, 10, &[8, 6, 4]);
    let map = Map::new(opened(bytes.clone())).unwrap();
    let server = Server::new(bytes, TAGGED);
    let mut dice = Dice(4);
    for (fault, text) in [
        (STALLS, "in time"),
        (CUTS, ""),
        (OTHER_RANGE, "expected bytes"),
        (OTHER_BYTES, "page.crc"),
        (WHOLE, "whole file"),
        (BUSY, "status 503"),
        (CLOSES, ""),
    ] {
        server.set(WELL);
        let source = open(&server).unwrap();
        let remote = structure(source.clone()).unwrap();
        let (mut cpu, id) = streamer(&remote);
        first_picture(&mut cpu, id);
        server.set(fault);
        let mut coarse = 0;
        let mut slowest = Duration::ZERO;
        for _ in 0..25 {
            let start = Instant::now();
            cpu.frame();
            slowest = slowest.max(start.elapsed());
            coarse += hold(&mut cpu, id, &map, &mut dice, 300);
            std::thread::sleep(Duration::from_millis(if fault == STALLS { 40 } else { 4 }));
        }
        server.set(WELL);
        while cpu.streamer.is_loading() {
            cpu.streamer.wait(Duration::from_millis(50));
        }
        let failures = cpu.streamer.take_failures();
        let told = failures.first().map(|f| f.error.to_string()).unwrap_or_default();
        eprintln!("fault {fault}: {coarse} coarse answers, slowest frame {slowest:?}, {} told: {told}", failures.len());
        assert!(coarse > 0 && !failures.is_empty() && told.contains(text), "fault {fault}: {told}");
        assert!(slowest < Duration::from_millis(200), "no frame waits for a server");
        assert!(!source.is_changed() || fault == OTHER_RANGE);
        if source.is_changed() {
            continue;
        }
        let healed = (0..1500).any(|_| {
            cpu.whole_frame();
            hold(&mut cpu, id, &map, &mut dice, 3000) == 0
        });
        assert!(healed, "fault {fault}: {:?}", cpu.streamer.stats());
    }
}

#[test]
fn a_file_that_was_replaced_is_noticed_and_the_new_one_goes_on() {
    let [(old, _), (new, _)] = versions("remote-versions", 3, 10, &[8, 6, 4]);
    let maps = [&old, &new].map(|b| Map::new(opened(b.clone())).unwrap());
    let longer = [&new[..], &[0; 64]].concat();
    const OTHER_TAG: &str = "etag: \"two\"\r\nlast-modified: Sat, 01 Aug 2026 10:00:00 GMT\r\n";
    const OTHER_DATE: &str = "etag: \"one\"\r\nlast-modified: Sat, 01 Aug 2026 10:00:01 GMT\r\n";
    for (bytes, headers) in [(&new, OTHER_TAG), (&new, OTHER_DATE), (&longer, TAGGED)] {
        let server = Server::new(old.clone(), TAGGED);
        let source = open(&server).unwrap();
        let (mut cpu, id) = streamer(&structure(source.clone()).unwrap());
        first_picture(&mut cpu, id);
        let mut dice = Dice(6);
        hold(&mut cpu, id, &maps[0], &mut dice, 100);
        cpu.whole_frame();
        *server.file.lock().unwrap() = File { bytes: Arc::new(bytes.clone()), headers };
        for _ in 0..30 {
            hold(&mut cpu, id, &maps[0], &mut dice, 300);
            cpu.whole_frame();
        }
        let failures = cpu.streamer.take_failures();
        assert!(source.is_changed() && !failures.is_empty());
        let text = failures[0].error.to_string();
        assert!(text.contains("another one") && text.contains("open it anew") && text.contains(&server.url), "{text}");
        // Nothing is asked of the server any more.
        let before = server.count();
        assert_eq!(
            source.read_at(bytes.len() as u64 / 2, &mut [0; 8]).unwrap_err().kind(),
            ErrorKind::StaleNetworkFileHandle
        );
        assert_eq!(server.count(), before);
        if bytes.len() != new.len() {
            continue;
        }
        let anew = open(&server).unwrap();
        // A page table with room for one: the new version begins with a streamer of its own.
        let (mut cpu, id) = streamer(&structure(anew).unwrap());
        while !cpu.streamer.is_ready(id) || hold(&mut cpu, id, &maps[1], &mut dice, 3000) != 0 {
            cpu.whole_frame();
        }
    }
    // Without anything that tells versions apart: the file's id is in every CRC.
    let (_, other) = random_tree("remote-other", 77, 10, &[8, 6, 4]);
    let server = Server::new(old.clone(), "");
    let source = open(&server).unwrap();
    let (mut cpu, id) = streamer(&structure(source.clone()).unwrap());
    first_picture(&mut cpu, id);
    let mut bytes = other.clone();
    bytes.resize(old.len(), 0);
    *server.file.lock().unwrap() = File { bytes: Arc::new(bytes), headers: "" };
    let mut dice = Dice(6);
    for _ in 0..30 {
        hold(&mut cpu, id, &maps[0], &mut dice, 300);
        cpu.whole_frame();
    }
    let failures = cpu.streamer.take_failures();
    assert!(!source.is_changed() && !failures.is_empty());
    let rules: Vec<_> = failures.iter().filter_map(|f| f.error.rule()).map(|r| r.id()).collect();
    assert!(rules.iter().any(|r| *r == "page.crc" || r.starts_with("block.") || r.starts_with("index.")), "{rules:?}");
}

#[test]
fn nobody_waits_for_a_server_that_stalls_when_a_streamer_goes() {
    let server = Server::new(shared_city(), TAGGED);
    let patience = Patience { connect: Duration::from_secs(5), answer: Duration::from_secs(30) };
    let source = HttpSource::open(&server.url, patience).map(Arc::new).unwrap();
    let (mut cpu, id) = streamer(&structure(source).unwrap());
    first_picture(&mut cpu, id);
    while cpu.streamer.is_loading() {
        cpu.streamer.wait(Duration::from_millis(20));
    }
    server.set(STALLS);
    (1..200).for_each(|o| cpu.streamer.request(o, 1));
    cpu.streamer.begin(&[]);
    std::thread::sleep(Duration::from_millis(50));
    assert!(cpu.streamer.is_loading());
    let start = Instant::now();
    drop(cpu);
    assert!(start.elapsed() < Duration::from_millis(300), "{:?}", start.elapsed());
}

#[test]
fn what_can_not_be_opened_says_why() {
    let server = Server::new(shared_city(), TAGGED);
    for (fault, kind, text) in [
        (GONE, ErrorKind::NotFound, "no such file"),
        (WHOLE, ErrorKind::Unsupported, "serves ranges"),
        (STALLS, ErrorKind::TimedOut, "in time"),
        (BUSY, ErrorKind::Other, "503"),
        (OTHER_RANGE, ErrorKind::InvalidData, "expected bytes 0 to"),
    ] {
        server.set(fault);
        let start = Instant::now();
        let error = open(&server).unwrap_err();
        let ReaderError::Io { source, .. } = &error else { panic!("{error}") };
        assert_eq!(source.kind(), kind, "{error}");
        assert!(error.to_string().contains(text) && start.elapsed() < Duration::from_secs(5), "{error}");
    }
    let nobody = "http://127.0.0.1:1/city.umb";
    let error = HttpSource::open(nobody, Patience::default()).unwrap_err();
    assert!(error.to_string().to_lowercase().contains("refused"), "{error}");
    for bad in ["city.umb", "ftp://127.0.0.1/city.umb", "http://", "http://127.0.0.1:99999/x"] {
        assert!(HttpSource::open(bad, Patience::default()).is_err(), "{bad}");
    }
    // Shorter than a header, and not a file of ours.
    for bytes in [b"short".to_vec(), vec![7; 9000]] {
        let server = Server::new(bytes, "");
        let error = structure(open(&server).unwrap()).unwrap_err();
        assert!(error.rule().is_some(), "{error}");
    }
}
