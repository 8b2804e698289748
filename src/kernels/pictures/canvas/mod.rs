//! A picture in the making: smooth lines, areas and letters.

pub mod color;
mod fill;
mod stroke;
pub mod text;

use rayon::prelude::*;

use self::color::{Color, mix, srgb_from_linear};
use crate::kernels::image::Image;

pub use fill::{fill_circle, fill_polygon};
pub use stroke::stroke;

/// Pixels that are blended as they are: in linear light, or, where a picture is to look like a browser's,
/// in sRGB.
#[derive(Debug, Clone)]
pub struct Canvas {
    pub width: usize,
    pub height: usize,
    pixels: Vec<Color>,
}

impl Canvas {
    pub fn white(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[1.0; 3]; width * height] }
    }

    pub fn blend(&mut self, x: usize, y: usize, color: Color, alpha: f32) {
        let pixel = &mut self.pixels[y * self.width + x];
        *pixel = mix(*pixel, color, alpha);
    }

    /// The pixels, row by row from the top.
    pub fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Color]> {
        self.pixels.par_chunks_exact_mut(self.width)
    }

    /// The picture of pixels in linear light.
    pub fn into_image(self) -> Image {
        self.image_of(|it| srgb_from_linear(it.clamp(0.0, 1.0)))
    }

    /// The picture of pixels in sRGB.
    pub fn into_image_of_srgb(self) -> Image {
        self.image_of(|it| it.clamp(0.0, 1.0))
    }

    fn image_of(self, srgb: impl Fn(f32) -> f32 + Sync) -> Image {
        let byte = |it: f32| (srgb(it) * 255.0).round() as u8;
        let white = [1.0; 3];
        let bytes = |it: &Color| if *it == white { [255; 3] } else { it.map(byte) };
        let pixels = self.pixels.par_iter().map(bytes).collect();
        Image { width: self.width, height: self.height, pixels }
    }
}

/// The pixels of a row or a column that a thing between two places may touch.
fn pixels_between(low: f32, high: f32, limit: usize) -> std::ops::Range<usize> {
    (low.max(0.0) as usize).min(limit)..(high.max(0.0).ceil() as usize).min(limit)
}
