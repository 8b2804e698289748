//! How groups are told apart, also by eyes that see few colours.

use super::scene::{Rgb, Shape};

/// Colours that differ for all common kinds of colour blindness (Okabe & Ito 2008), without the yellow that
/// is lost on white; the last one is a darker brown of ours.
const COLORS: [Rgb; 8] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [40, 40, 40],
    [120, 94, 60],
];

const SHAPES: [Shape; 4] = [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond];

/// Strokes and gaps of lines, after all colours have been used once.
const DASHES: [Option<[f64; 2]>; 4] = [None, Some([6.0, 4.5]), Some([1.5, 4.0]), Some([11.0, 4.5])];

/// More groups are not told apart.
pub const MOST_GROUPS: usize = COLORS.len() * DASHES.len();

pub const INK: Rgb = [38, 42, 48];
/// Of lines that only help the eye.
pub const GRID: Rgb = [228, 230, 233];
pub const AXIS: Rgb = [90, 95, 102];
/// Of what is compared with.
pub const REFERENCE: Rgb = [110, 115, 122];

pub fn color(group: usize) -> Rgb {
    COLORS[group % COLORS.len()]
}

pub fn shape(group: usize) -> Shape {
    SHAPES[group % SHAPES.len()]
}

pub fn dash(group: usize) -> Option<[f64; 2]> {
    DASHES[group / COLORS.len() % DASHES.len()]
}
