//! Overlap of what a surface and a frame cover.

use super::correspond::Seen;
use super::target::{Pixel, Target};

/// Gaps in silhouettes up to twice as many pixels wide are closed: sensors drop single pixels.
const GAP: usize = 2;

/// Intersection over union of the silhouettes of a surface and a frame, and over the surface's alone,
/// without small gaps; NaN of what is empty.
pub fn overlaps(target: &Target, seen: &Seen) -> (f64, f64) {
    let width = target.width;
    let own: Vec<bool> = seen.buffer.depths.iter().map(|it| *it > 0.0).collect();
    let other: Vec<bool> = target.pixels.iter().map(|it| *it != Pixel::Nothing).collect();
    let (own, other) = (closed(&own, width), closed(&other, width));
    let count = |of: &dyn Fn(bool, bool) -> bool| {
        own.iter().zip(&other).filter(|it| of(*it.0, *it.1)).count() as f64
    };
    let both = count(&|a, b| a && b);
    (both / count(&|a, b| a || b), both / count(&|a, _| a))
}

/// A morphological closing by a square: grown, then shrunk again; the frame's rim does not shrink.
fn closed(mask: &[bool], width: usize) -> Vec<bool> {
    let grown = spread(mask, width, true);
    spread(&grown, width, false)
}

/// Pixels within [`GAP`] columns and rows of one that is `value` become so.
fn spread(mask: &[bool], width: usize, value: bool) -> Vec<bool> {
    let take = |to: &mut [bool], from: &[bool]| {
        let pairs = to.iter_mut().zip(from);
        match value {
            true => pairs.for_each(|(to, from)| *to |= from),
            false => pairs.for_each(|(to, from)| *to &= from),
        }
    };
    let mut wide = mask.to_vec();
    for (wide, row) in wide.chunks_exact_mut(width).zip(mask.chunks_exact(width)) {
        for step in 1..=GAP.min(width - 1) {
            take(&mut wide[step..], &row[..width - step]);
            take(&mut wide[..width - step], &row[step..]);
        }
    }
    let mut res = wide.clone();
    for step in (1..=GAP).map(|it| it * width).filter(|it| *it < mask.len()) {
        take(&mut res[step..], &wide[..mask.len() - step]);
        take(&mut res[..mask.len() - step], &wide[step..]);
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
