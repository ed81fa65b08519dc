//! Numbers from the bytes of an input; behind the end all are 0.

/// Reads an input from front to back.
pub struct Input<'a>(pub &'a [u8]);

impl Input<'_> {
    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// The next two bytes.
    pub fn pair(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    /// The next four bytes.
    pub fn word(&mut self) -> u32 {
        u32::from(self.pair()) | u32::from(self.pair()) << 16
    }

    /// One byte as a number below `n`, which is at most 256.
    pub fn below(&mut self, n: u32) -> u32 {
        u32::from(self.byte()) % n
    }

    /// Whether all is read.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
