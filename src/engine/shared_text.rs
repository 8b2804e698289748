//! Parts of one long text.

use std::{
    ops::{Deref, Range},
    sync::Arc,
};

/// A text of its own, or a part of one that many share, so that ten thousand texts are one copy.
#[derive(Debug, Clone)]
pub struct SharedText {
    whole: Arc<str>,
    start: u32,
    end: u32,
}

impl SharedText {
    /// A part of a text.
    ///
    /// # Panics
    /// If it is none, or lies behind the fourth gigabyte.
    pub fn part(whole: &Arc<str>, range: Range<usize>) -> Self {
        assert!(whole.get(range.clone()).is_some(), "{range:?} is a part of the text");
        let small = |it: usize| u32::try_from(it).expect("texts are shorter than 4 GB");
        Self { whole: Arc::clone(whole), start: small(range.start), end: small(range.end) }
    }
}

impl From<String> for SharedText {
    fn from(text: String) -> Self {
        let whole = Arc::from(text);
        Self::part(&whole, 0..whole.len())
    }
}

impl Deref for SharedText {
    type Target = str;

    fn deref(&self) -> &str {
        &self.whole[self.start as usize..self.end as usize]
    }
}
