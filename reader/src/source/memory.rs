//! Bytes in memory.

use std::io;

use super::{Source, copy_from};

/// A container that is in memory already.
#[derive(Debug, Clone)]
pub struct MemorySource {
    bytes: Vec<u8>,
    name: String,
}

impl MemorySource {
    /// Takes the bytes; `name` stands in messages for the path.
    pub fn new(bytes: Vec<u8>, name: &str) -> Self {
        Self { bytes, name: name.to_string() }
    }
}

impl Source for MemorySource {
    fn len(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        copy_from(&self.bytes, offset, out)
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(&self.bytes)
    }

    fn name(&self) -> &str {
        &self.name
    }
}
