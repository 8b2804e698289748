//! Overlap of what a surface and a frame cover.

use super::correspond::Seen;
use super::target::{Pixel, Target};

/// Gaps in silhouettes up to twice as many pixels wide are closed: sensors drop single pixels.
const GAP: usize = 2;

/// Intersection over union of the silhouettes of a surface and a frame, without small gaps; NaN if
/// both are empty.
pub fn iou(target: &Target, seen: &Seen) -> f64 {
    let width = target.width;
    let own: Vec<bool> = seen.buffer.depths.iter().map(|it| *it > 0.0).collect();
    let other: Vec<bool> = target.pixels.iter().map(|it| *it != Pixel::Nothing).collect();
    let (own, other) = (closed(&own, width), closed(&other, width));
    let count = |of: &dyn Fn(bool, bool) -> bool| {
        own.iter().zip(&other).filter(|it| of(*it.0, *it.1)).count() as f64
    };
    count(&|a, b| a && b) / count(&|a, b| a || b)
}

/// A morphological closing by a square: grown, then shrunk again; the frame's rim does not shrink.
fn closed(mask: &[bool], width: usize) -> Vec<bool> {
    let grown = spread(mask, width, true);
    spread(&grown, width, false)
}

/// Pixels within [`GAP`] columns and rows of one that is `value` become so.
fn spread(mask: &[bool], width: usize, value: bool) -> Vec<bool> {
    let height = mask.len() / width;
    let mut wide = mask.to_vec();
    for (pixel, _) in mask.iter().enumerate().filter(|it| *it.1 == value) {
        let (row, column) = (pixel / width, pixel % width);
        let range = column.saturating_sub(GAP)..(column + GAP + 1).min(width);
        wide[row * width..][range].fill(value);
    }
    let mut res = wide.clone();
    for (pixel, _) in wide.iter().enumerate().filter(|it| *it.1 == value) {
        let (row, column) = (pixel / width, pixel % width);
        for other in row.saturating_sub(GAP)..(row + GAP + 1).min(height) {
            res[other * width + column] = value;
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pinholes_close_and_the_outline_stays() {
        let inside = |it: usize| (5..15).contains(&(it % 20)) && (5..15).contains(&(it / 20));
        let square: Vec<bool> = (0..400).map(inside).collect();
        let mut holed = square.clone();
        holed[10 * 20 + 10] = false;
        holed[8 * 20 + 7] = false;
        assert_eq!(closed(&holed, 20), square);
        assert_eq!(closed(&square, 20), square);
    }
}
