//! A web server of one file, which a test makes ill and well.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// What the server does.
pub const WELL: u32 = 0;
pub const STALLS: u32 = 1;
pub const CUTS: u32 = 2;
pub const OTHER_RANGE: u32 = 3;
pub const OTHER_BYTES: u32 = 4;
pub const WHOLE: u32 = 5;
pub const BUSY: u32 = 6;
pub const GONE: u32 = 7;
pub const CLOSES: u32 = 8;

/// A file as a server has it.
#[derive(Clone)]
pub struct File {
    pub bytes: Arc<Vec<u8>>,
    pub headers: &'static str,
}

/// A server of one file.
pub struct Server {
    pub url: String,
    state: Arc<AtomicU32>,
    requests: Arc<AtomicU32>,
    pub file: Arc<Mutex<File>>,
    closed: Arc<AtomicBool>,
}

impl Server {
    pub fn new(bytes: Vec<u8>, headers: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/maps/city.umb", listener.local_addr().unwrap());
        let (state, requests) = (Arc::new(AtomicU32::new(WELL)), Arc::new(AtomicU32::new(0)));
        let file = Arc::new(Mutex::new(File { bytes: Arc::new(bytes), headers }));
        let closed = Arc::new(AtomicBool::new(false));
        let this = Self { url, state, requests, file, closed };
        let (state, requests, file, closed) =
            (this.state.clone(), this.requests.clone(), this.file.clone(), this.closed.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if closed.load(Ordering::Relaxed) {
                    break;
                }
                let (state, requests, file) = (state.clone(), requests.clone(), file.clone());
                // A client that goes away ends its thread.
                std::thread::spawn(move || stream.map(|s| serve(s, &state, &requests, &file)));
            }
        });
        this
    }

    pub fn set(&self, state: u32) {
        self.state.store(state, Ordering::Relaxed);
    }

    pub fn count(&self) -> u32 {
        self.requests.load(Ordering::Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        // Wakes it.
        let _ = TcpStream::connect(self.url.trim_start_matches("http://").split('/').next().unwrap_or_default());
    }
}

/// Answers requests of a connection until it is closed.
fn serve(stream: TcpStream, state: &AtomicU32, requests: &AtomicU32, file: &Mutex<File>) -> std::io::Result<()> {
    let mut out = stream.try_clone()?;
    let mut lines = BufReader::new(stream);
    loop {
        let mut range = None;
        let mut first = String::new();
        if lines.read_line(&mut first)? == 0 {
            return Ok(());
        }
        loop {
            let mut line = String::new();
            lines.read_line(&mut line)?;
            let line = line.trim().to_ascii_lowercase();
            if line.is_empty() {
                break;
            }
            if let Some(r) = line.strip_prefix("range: bytes=") {
                let (a, b) = r.split_once('-').unwrap();
                range = Some((a.parse::<usize>().unwrap(), b.parse::<usize>().unwrap()));
            }
        }
        assert!(first.starts_with("GET /maps/city.umb "), "{first}");
        requests.fetch_add(1, Ordering::Relaxed);
        let File { bytes, headers } = file.lock().unwrap().clone();
        let state = state.load(Ordering::Relaxed);
        let (from, last) = range.expect("a range");
        if from >= bytes.len() {
            write!(out, "HTTP/1.1 416 No\r\ncontent-length: 0\r\n\r\n")?;
            continue;
        }
        let last = last.min(bytes.len() - 1);
        let mut body = bytes[from..=last].to_vec();
        let mut said = format!("bytes {from}-{last}/{}", bytes.len());
        match state {
            BUSY | GONE => {
                let status = if state == BUSY { "503 Busy" } else { "404 None" };
                write!(out, "HTTP/1.1 {status}\r\ncontent-length: 0\r\n\r\n")?;
                continue;
            }
            WHOLE => {
                write!(out, "HTTP/1.1 200 OK\r\n{headers}content-length: {}\r\n\r\n", bytes.len())?;
                out.write_all(&bytes)?;
                continue;
            }
            CLOSES => return Ok(()),
            OTHER_RANGE => said = format!("bytes {}-{}/{}", from + 1, last + 1, bytes.len() + 1),
            OTHER_BYTES => body.iter_mut().step_by(97).for_each(|b| *b ^= 4),
            _ => {}
        }
        let head = format!("content-range: {said}\r\ncontent-length: {}\r\n", body.len());
        write!(out, "HTTP/1.1 206 Partial\r\n{headers}{head}\r\n")?;
        match state {
            STALLS => {
                out.write_all(&body[..body.len() / 2])?;
                std::thread::sleep(Duration::from_millis(900));
                out.write_all(&body[body.len() / 2..])?;
            }
            CUTS => {
                out.write_all(&body[..body.len() / 2])?;
                return Ok(());
            }
            _ => out.write_all(&body)?,
        }
    }
}
