//! Pixels in memory, PNG files, and small texts that are written alike.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// An sRGB picture, 8 bits per channel, row by row from the upper left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// `width * height` pixels: red, green, blue.
    pub pixels: Vec<[u8; 3]>,
}

/// Why a picture was not written.
#[derive(Debug, Error)]
pub enum ImageError {
    /// A PNG of this size does not exist.
    #[error("{path}: a picture of {width} x {height} pixels ({pixels} given) cannot be a PNG")]
    Size {
        /// Target.
        path: PathBuf,
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// Pixels in memory.
        pixels: usize,
    },
    /// The file system refused.
    #[error("{path}: {step}: {source}")]
    Io {
        /// The file concerned.
        path: PathBuf,
        /// What was being done.
        step: &'static str,
        /// Why it failed.
        source: io::Error,
    },
}

/// Removes the temporary file unless it has been renamed.
struct Temporary {
    path: PathBuf,
    keep: bool,
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.keep {
            // Nothing better can be done on the way out of an error that is already being reported.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Writes a PNG to a temporary file beside `path` and renames it, so that the old file stays until the new one is
/// complete.
///
/// # Errors
/// Names the path and the step. The temporary file is removed, the old target left as it was.
pub fn write_png(path: &Path, image: &RgbImage) -> Result<(), ImageError> {
    let RgbImage { width, height, ref pixels } = *image;
    let legal = |v: u32| (1..=i32::MAX as u32).contains(&v);
    if !(legal(width) && legal(height) && pixels.len() as u64 == u64::from(width) * u64::from(height)) {
        return Err(ImageError::Size { path: path.into(), width, height, pixels: pixels.len() });
    }
    write_whole(path, |out| encode(out, image))
}

/// Writes a text as [`write_png`] writes a picture.
///
/// # Errors
/// As there.
pub fn write_text(path: &Path, text: &str) -> Result<(), ImageError> {
    write_whole(path, |mut out| {
        out.write_all(text.as_bytes())?;
        out.flush()?;
        out.get_ref().sync_all()
    })
}

fn write_whole(path: &Path, write: impl FnOnce(BufWriter<File>) -> io::Result<()>) -> Result<(), ImageError> {
    let failed = |path: &Path, step| {
        let path = path.to_path_buf();
        move |source: io::Error| ImageError::Io { path, step, source }
    };
    let (file, mut temporary) =
        create_beside(path).map_err(failed(path, "cannot create a temporary file beside it"))?;
    write(BufWriter::new(file)).map_err(failed(path, "cannot write its temporary file"))?;
    fs::rename(&temporary.path, path).map_err(failed(path, "cannot put the finished file in place"))?;
    temporary.keep = true;
    Ok(())
}

fn create_beside(path: &Path) -> io::Result<(File, Temporary)> {
    let name = path.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "not the name of a file"))?;
    for attempt in 0.. {
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}-{attempt}.tmp", std::process::id()));
        let beside = path.with_file_name(hidden);
        match OpenOptions::new().write(true).create_new(true).open(&beside) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && attempt < 100 => {}
            Err(e) => return Err(e),
            Ok(file) => return Ok((file, Temporary { path: beside, keep: false })),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

fn encode(mut out: BufWriter<File>, image: &RgbImage) -> io::Result<()> {
    let mut encoder = png::Encoder::new(&mut out, image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.pixels.as_flattened())?;
    writer.finish()?;
    out.flush()?;
    out.get_ref().sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Folder {
            let path = std::env::temp_dir().join(format!("umbrage-render-{name}-{}", std::process::id()));
            fs::create_dir_all(&path).unwrap();
            Folder(path)
        }

        fn names(&self) -> Vec<String> {
            let mut names: Vec<_> =
                fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            fs::remove_dir_all(&self.0).unwrap();
        }
    }

    fn picture() -> RgbImage {
        let pixels = (0..7 * 5).map(|i| [i * 7, 255 - i, i ^ 21].map(|v: u32| v as u8)).collect();
        RgbImage { width: 7, height: 5, pixels }
    }

    #[test]
    fn round_trip() {
        let folder = Folder::new("trip");
        let path = folder.0.join("a.png");
        fs::write(&path, "old").unwrap();
        write_png(&path, &picture()).unwrap();
        let decoder = png::Decoder::new(io::BufReader::new(File::open(&path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height, info.color_type), (7, 5, png::ColorType::Rgb));
        assert_eq!(bytes[..info.buffer_size()], *picture().pixels.as_flattened());
        assert_eq!(folder.names(), ["a.png"], "nothing left beside it");
    }

    #[test]
    fn failures_name_the_path_and_leave_nothing() {
        let folder = Folder::new("fail");
        let missing = folder.0.join("no").join("a.png");
        assert!(write_png(&missing, &picture()).unwrap_err().to_string().contains("no/a.png"));
        // The target is a folder: the rename fails after the temporary file was written.
        let taken = folder.0.join("taken.png");
        fs::create_dir_all(taken.join("inside")).unwrap();
        let error = write_png(&taken, &picture()).unwrap_err().to_string();
        assert!(error.contains("taken.png"), "{error}");
        let wrong = RgbImage { width: 8, ..picture() };
        assert!(matches!(write_png(&folder.0.join("b.png"), &wrong), Err(ImageError::Size { .. })));
        assert_eq!(folder.names(), ["taken.png"]);
    }
}
