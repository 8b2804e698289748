//! Pictures.

/// An 8-bit sRGB picture, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    pub width: usize,
    pub height: usize,
    /// `height * width` pixels.
    pub pixels: Vec<[u8; 3]>,
}
