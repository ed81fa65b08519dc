//! Pages of a version that was replaced: those that the new version has unchanged go on where they are.

use std::collections::HashMap;

/// Content of a page: the hash that the index has of it, and its words.
pub type Content = (u64, u32);

/// Pages of replaced versions by what they hold.
#[derive(Debug, Default)]
pub struct Heirs {
    by_content: HashMap<Content, Vec<u32>>,
    /// First place of each replaced version, and the frame at which what is left of it goes.
    versions: Vec<(u32, u64)>,
}

impl Heirs {
    /// Pages of the version at `base`, to be kept until frame `until`.
    pub fn add(&mut self, base: u32, until: u64, pages: impl Iterator<Item = (Content, u32)>) {
        for (content, ordinal) in pages {
            self.by_content.entry(content).or_default().push(ordinal);
        }
        self.versions.push((base, until));
    }

    /// A page that holds this and of which `lives` is true.
    pub fn find(&self, content: Content, lives: impl Fn(u32) -> bool) -> Option<u32> {
        self.by_content.get(&content)?.iter().copied().find(|o| lives(*o))
    }

    /// A version whose time is over at `frame`.
    pub fn over(&mut self, frame: u64) -> Option<u32> {
        let at = self.versions.iter().position(|v| v.1 <= frame)?;
        let (base, _) = self.versions.swap_remove(at);
        if self.versions.is_empty() {
            self.by_content.clear();
        }
        Some(base)
    }

    /// Whether the version at `base` still has pages.
    pub fn has(&self, base: u32) -> bool {
        self.versions.iter().any(|v| v.0 == base)
    }

    /// Whether there is any version left.
    pub fn is_empty(&self) -> bool {
        self.versions.is_empty()
    }
}
