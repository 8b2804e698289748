//! By how much two shapes around a bone are turned against each other.

use super::rectangle::Rectangle;

/// How many angles are tried.
const N_SHIFTS: usize = 16;

/// Rows that are compared.
const N_ROWS: usize = 8;

/// By how much more another angle must fit before it is taken.
const GAIN: f64 = 0.1;

/// The shift in turns, of [`N_SHIFTS`] even ones, at which the radii around two bones correlate best:
/// `target(u, v)` is like `source(u, v + shift)`. Zero unless another fits clearly better.
///
/// Both hold the radius as their only channel. Means of rows are taken off, so that only what is not
/// round counts.
pub fn best_shift(source: &Rectangle, target: &Rectangle) -> f64 {
    let fit = |shift: usize| {
        let (mut product, mut squares) = (0.0, [0.0; 2]);
        for row in 0..N_ROWS {
            let along = (row as f64 + 0.5) / N_ROWS as f64;
            let turn = |it: usize| (it as f64 + 0.5) / N_SHIFTS as f64;
            let a = row_of(|it| source.sample(along, turn((it + shift) % N_SHIFTS))[0]);
            let b = row_of(|it| target.sample(along, turn(it))[0]);
            product += a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>();
            squares[0] += a.iter().map(|it| it * it).sum::<f64>();
            squares[1] += b.iter().map(|it| it * it).sum::<f64>();
        }
        let scale = (squares[0] * squares[1]).sqrt();
        if scale > 0.0 { product / scale } else { 0.0 }
    };
    let fits: Vec<f64> = (0..N_SHIFTS).map(fit).collect();
    let best = (0..N_SHIFTS).fold(0, |best, it| if fits[it] > fits[best] { it } else { best });
    if fits[best] > fits[0] + GAIN { best as f64 / N_SHIFTS as f64 } else { 0.0 }
}

/// Values around a bone over their mean, less one.
fn row_of(value: impl Fn(usize) -> f64) -> [f64; N_SHIFTS] {
    let values: [f64; N_SHIFTS] = std::array::from_fn(value);
    let mean = values.iter().sum::<f64>() / N_SHIFTS as f64;
    values.map(|it| if mean > 0.0 { it / mean - 1.0 } else { 0.0 })
}
