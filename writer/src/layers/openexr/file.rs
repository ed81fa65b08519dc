//! One OpenEXR file: which channels it has, and the pixels of a few of them.
//!
//! In: a path. Out: [`File`] (what the headers say, checked against the file's length before anything is allocated),
//! then [`Plane`]s. Scan lines and tiles, the compressions that the crate `exr` reads, half, float and uint.

use std::cell::Cell;
use std::collections::HashSet;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use exr::block::BlockIndex;
use exr::block::reader::{ChunksReader, Reader};
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;

use crate::layers::LayersError;
use crate::scene::load::text::line;

/// No compression of the format makes pixels smaller by more (zip: 1032), and small files may.
const MOST_INFLATION: u64 = 2048;
const SMALL: u64 = 64 << 20;
const MAGIC: [u8; 4] = [0x76, 0x2F, 0x31, 0x01];

/// What can be wrong with an OpenEXR file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExrError {
    /// Can't be read at all.
    #[error("{}: {source}; give an OpenEXR file", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Other bytes.
    #[error("{}: not an OpenEXR file; expected the bytes 76 2f 31 01 at its start", file.display())]
    Magic {
        /// The file.
        file: PathBuf,
    },
    /// Cut, damaged, or of a part of the format that is not supported.
    #[error("{}: {what}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
    /// No channel, or several that could be meant.
    #[error("{}: expected {wanted}; found the channels {}; name them with --channels FIRST[,SECOND]", file.display(), found.join(", "))]
    Channel {
        /// The file.
        file: PathBuf,
        /// What was looked for.
        wanted: String,
        /// Every channel, with the name of its layer.
        found: Vec<String>,
    },
}

/// A channel of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Name of its layer and its own, joined by a dot.
    pub name: String,
    header: usize,
    channel: usize,
}

/// The pixels of one channel, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Plane {
    /// Half and float.
    Float(Vec<f32>),
    /// Uint.
    Uint(Vec<u32>),
}

impl Plane {
    fn new(kind: SampleType, pixels: usize) -> Option<Plane> {
        fn zeros<T: Clone + Default>(n: usize) -> Option<Vec<T>> {
            let mut v = Vec::new();
            v.try_reserve_exact(n).ok()?;
            v.resize(n, T::default());
            Some(v)
        }
        Some(match kind {
            SampleType::U32 => Plane::Uint(zeros(pixels)?),
            _ => Plane::Float(zeros(pixels)?),
        })
    }

    /// The depth at an index; infinite from `far` on and at the largest uint.
    pub fn depth(&self, index: usize, far: f64) -> f64 {
        let depth = match self {
            Plane::Float(v) => f64::from(v[index]),
            Plane::Uint(v) if v[index] == u32::MAX => f64::INFINITY,
            Plane::Uint(v) => f64::from(v[index]),
        };
        if depth >= far { f64::INFINITY } else { depth }
    }

    /// Bytes for so many pixels; all types are held in four each.
    pub fn bytes(pixels: u64) -> u64 {
        pixels * 4
    }

    fn set_row(&mut self, at: usize, kind: SampleType, bytes: &[u8]) {
        match (self, kind) {
            (Plane::Float(v), SampleType::F16) => {
                let samples = bytes.chunks_exact(2).map(|b| f16::from_ne_bytes([b[0], b[1]]).to_f32());
                v[at..].iter_mut().zip(samples).for_each(|(to, s)| *to = s);
            }
            (Plane::Float(v), _) => {
                let samples = bytes.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]));
                v[at..].iter_mut().zip(samples).for_each(|(to, s)| *to = s);
            }
            (Plane::Uint(v), _) => {
                let samples = bytes.chunks_exact(4).map(|b| u32::from_ne_bytes([b[0], b[1], b[2], b[3]]));
                v[at..].iter_mut().zip(samples).for_each(|(to, s)| *to = s);
            }
        }
    }
}

/// A file whose headers have been read.
pub struct File {
    path: PathBuf,
    length: u64,
    reader: Reader<BufReader<std::fs::File>>,
}

impl File {
    /// Reads the headers.
    ///
    /// # Errors
    /// Not readable, not OpenEXR, cut inside the headers.
    pub fn open(path: &Path) -> Result<File, ExrError> {
        let io = |source| ExrError::Io { file: path.to_path_buf(), source };
        let regular = |about: std::fs::Metadata| match about.is_file() {
            true => Ok(about.len()),
            false => Err(io(std::io::Error::other("not a regular file"))),
        };
        // By its name, so that no pipe is opened, which would wait for its writer; by its handle, since a name may mean
        // another file by then.
        regular(std::fs::metadata(path).map_err(io)?)?;
        let mut file = std::fs::File::open(path).map_err(io)?;
        let length = regular(file.metadata().map_err(io)?)?;
        let mut magic = [0; 4];
        let whole = file.read_exact(&mut magic).is_ok();
        if !whole || magic != MAGIC {
            return Err(ExrError::Magic { file: path.to_path_buf() });
        }
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        let reader = guarded(path, || exr::block::read(BufReader::new(file), false))?;
        Ok(File { path: path.to_path_buf(), length, reader })
    }

    fn fault(&self, what: String) -> ExrError {
        ExrError::Content { file: self.path.clone(), what: line(&what) }
    }

    /// A missing or ambiguous channel.
    pub fn no_channel(&self, wanted: String) -> ExrError {
        let found = self.channels().iter().map(|c| line(&c.name)).collect();
        ExrError::Channel { file: self.path.clone(), wanted: line(&wanted), found }
    }

    /// All channels of all layers.
    pub fn channels(&self) -> Vec<Channel> {
        let mut all = Vec::new();
        for (header, h) in self.reader.headers().iter().enumerate() {
            let layer = h.own_attributes.layer_name.as_ref().map(|n| n.to_string()).filter(|n| !n.is_empty());
            for (channel, c) in h.channels.list.iter().enumerate() {
                let name = c.name.to_string();
                let name = layer.as_ref().map_or(name.clone(), |l| format!("{l}.{name}"));
                all.push(Channel { name, header, channel });
            }
        }
        all
    }

    /// The header of a channel.
    pub fn header(&self, channel: &Channel) -> &Header {
        &self.reader.headers()[channel.header]
    }

    /// Pixels on a side of a channel's data window.
    ///
    /// # Errors
    /// Not square, no power of two, deep or subsampled pixels, or more of them than the file could hold.
    pub fn side(&self, channel: &Channel) -> Result<u64, ExrError> {
        let header = self.header(channel);
        let (width, height) = (header.layer_size.x() as u64, header.layer_size.y() as u64);
        if width != height || !width.is_power_of_two() || width > 1 << 24 {
            let what = "expected a square whose side is a power of two up to 16777216";
            return Err(self.fault(format!("data window of {width} x {height} pixels: {what}; render or crop it so")));
        }
        if header.deep {
            return Err(self.fault("deep pixels are not supported; flatten it to first and second depth".to_string()));
        }
        if let Some(c) = header.channels.list.iter().find(|c| c.sampling.x() != 1 || c.sampling.y() != 1) {
            return Err(self.fault(format!("channel {} is subsampled; expected every pixel", c.name)));
        }
        let declared = self.reader.headers().iter().map(|h| {
            let pixel: u128 = h.channels.list.iter().map(|c| c.sample_type.bytes_per_sample() as u128).sum();
            pixel * h.layer_size.x() as u128 * h.layer_size.y() as u128
        });
        let (declared, most) = (declared.sum::<u128>(), self.length.saturating_mul(MOST_INFLATION).max(SMALL));
        if declared > u128::from(most) {
            return Err(self.fault(format!(
                "its headers declare {declared} bytes of pixels, but it has only {} bytes; fetch it again",
                self.length
            )));
        }
        Ok(width)
    }

    /// Reads the pixels of channels; all of them have this side. `keep_on` is asked before each block.
    ///
    /// # Errors
    /// Cut or damaged, no memory, or stopped.
    pub fn read(self, channels: &[Channel], side: u64, keep_on: &dyn Fn() -> bool) -> Result<Vec<Plane>, LayersError> {
        let (path, length) = (self.path, self.length);
        let fault = |what: String| LayersError::File(ExrError::Content { file: path.clone(), what });
        let side = side as usize;
        let kind = |c: &Channel, headers: &[Header]| headers[c.header].channels.list[c.channel].sample_type;
        let mut planes = Vec::new();
        for c in channels {
            let plane = Plane::new(kind(c, self.reader.headers()), side * side);
            planes.push(plane.ok_or_else(|| {
                fault(format!(
                    "no memory for {side} x {side} pixels; use a machine that has {} MiB for them",
                    Plane::bytes((side * side) as u64).div_ceil(1 << 20)
                ))
            })?);
        }
        let wanted = |layer: usize| channels.iter().any(|c| c.header == layer);
        let level_0 = |block: &BlockIndex| block.level.x() == 0 && block.level.y() == 0;
        let reader = self.reader;
        let chunks =
            guarded(&path, || reader.filter_chunks(false, |_, _, block| wanted(block.layer) && level_0(&block)))?;
        let headers: Vec<Header> = chunks.headers().to_vec();
        let mut seen = HashSet::new();
        let mut pixels = 0;
        let mut blocks = chunks.sequential_decompressor(false);
        while let Some(block) = guarded(&path, || blocks.next().transpose())? {
            if !keep_on() {
                return Err(LayersError::Stopped);
            }
            let (position, size) = (block.index.pixel_position, block.index.pixel_size);
            let header = headers.get(block.index.layer).filter(|_| wanted(block.index.layer));
            let inside = |at: usize, n: usize| at.checked_add(n).is_some_and(|end| end <= side);
            let fits = inside(position.x(), size.x()) && inside(position.y(), size.y());
            let once = seen.insert((block.index.layer, position.x(), position.y()));
            let (Some(header), true, true) = (header, fits, once) else {
                return Err(fault("a block of pixels has a wrong place; fetch the file again".to_string()));
            };
            let row = header.channels.list.iter().map(|c| c.sample_type.bytes_per_sample() * size.x()).sum::<usize>();
            if row == 0 || block.data.len() != row * size.y() {
                return Err(fault("a block of pixels has a wrong length; fetch the file again".to_string()));
            }
            for (c, plane) in channels.iter().zip(&mut planes).filter(|(c, _)| c.header == block.index.layer) {
                let list = &header.channels.list;
                let start: usize = list[..c.channel].iter().map(|c| c.sample_type.bytes_per_sample() * size.x()).sum();
                let kind = list[c.channel].sample_type;
                let bytes = start..start + kind.bytes_per_sample() * size.x();
                for (i, line) in block.data.chunks_exact(row).enumerate() {
                    plane.set_row((position.y() + i) * side + position.x(), kind, &line[bytes.clone()]);
                }
            }
            pixels += size.x() * size.y();
        }
        let layers: HashSet<usize> = channels.iter().map(|c| c.header).collect();
        if pixels != layers.len() * side * side {
            return Err(fault(format!("pixels are missing in its {length} bytes; fetch the file again")));
        }
        Ok(planes)
    }
}

thread_local! {
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is inside the decoder. Its panics are caught and become errors of one line; a panic hook that
/// asks this may keep quiet about them.
pub fn is_decoding() -> bool {
    DECODING.get()
}

/// Calls the decoder. It breaks off over some damaged pixels (B44, exr 1.74) instead of returning an error.
fn guarded<T>(path: &Path, decode: impl FnOnce() -> exr::error::Result<T>) -> Result<T, ExrError> {
    DECODING.set(true);
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode));
    DECODING.set(false);
    match outcome {
        Ok(done) => done.map_err(|e| content(path, &e)),
        Err(_) => Err(ExrError::Content {
            file: path.to_path_buf(),
            what: "damaged OpenEXR file (its pixels can't be decoded); fetch it again".to_string(),
        }),
    }
}

fn content(path: &Path, e: &exr::error::Error) -> ExrError {
    use exr::error::Error as E;
    let what = match e {
        E::NotSupported(what) => format!("OpenEXR feature not supported: {what}; write it as scan lines with zip"),
        E::Io(e) => format!("cut or damaged OpenEXR file ({e}); fetch it again"),
        E::Invalid(what) => format!("cut or damaged OpenEXR file ({what}); fetch it again"),
        E::Aborted => "stopped".to_string(),
    };
    ExrError::Content { file: path.to_path_buf(), what: line(&what.replace('\n', " ")) }
}
