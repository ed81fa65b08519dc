//! Numbers and quotes in messages.

use std::str::FromStr;

/// How many bytes of a file a message shows.
const SHOWN: usize = 40;

/// `text` on one line: control characters are escaped.
pub fn line(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut line, c| {
        if c.is_control() {
            line.extend(c.escape_default())
        } else {
            line.push(c)
        }
        line
    })
}

/// The start of `bytes` in quotes, on one line.
pub fn quote(bytes: &[u8]) -> String {
    let more = if bytes.len() > SHOWN { "..." } else { "" };
    format!("`{}{more}`", line(&String::from_utf8_lossy(&bytes[..bytes.len().min(SHOWN)])))
}

/// The number that `token` is.
pub fn number<T: FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}
