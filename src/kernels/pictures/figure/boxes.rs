//! Boxes of quartiles.

use super::content::{Content, Entry, Layer};
use super::palette::{INK, color};
use super::scene::Shape;
use super::series::Data;
use crate::kernels::table::percentile;

/// The part of a category's width that its boxes fill.
const FILLED: f64 = 0.72;

/// Tukey's five numbers, and what lies beyond the whiskers.
#[derive(Debug, Clone, PartialEq)]
pub struct Quartiles {
    pub low_whisker: f64,
    pub low: f64,
    pub median: f64,
    pub high: f64,
    pub high_whisker: f64,
    pub outliers: Vec<f64>,
}

impl Quartiles {
    /// Whiskers end at the farthest values within 1.5 heights of the box (Tukey 1977). Not of no values.
    pub fn of(values: &[f64]) -> Self {
        let [low, median, high] = [25.0, 50.0, 75.0].map(|it| percentile(values, it));
        let reach = 1.5 * (high - low);
        let is_near = |it: &f64| (low - reach..=high + reach).contains(it);
        let near = values.iter().copied().filter(is_near);
        let mut outliers: Vec<f64> = values.iter().copied().filter(|it| !is_near(it)).collect();
        outliers.sort_by(f64::total_cmp);
        Self {
            // A whisker never ends within the box, as interpolated quartiles could have it.
            low_whisker: near.clone().fold(low, f64::min),
            low,
            median,
            high,
            high_whisker: near.fold(high, f64::max),
            outliers,
        }
    }
}

pub fn boxes(data: &Data) -> Content {
    let mut content = Content::default();
    let width = FILLED / data.series.len() as f64;
    for (group, series) in data.series.iter().enumerate() {
        let color = color(group);
        for category in 0..data.categories.len() {
            let middle = category as f64 + 0.5;
            let own = series.rows.iter().filter(|it| it.place() == middle);
            let values: Vec<f64> = own.map(|it| it.y).collect();
            if !values.is_empty() {
                let x = middle - FILLED / 2.0 + (group as f64 + 0.5) * width;
                draw(&mut content, &Quartiles::of(&values), x, width.min(0.5), color);
            }
        }
        content.name(Entry { fill: 0.35, ..Entry::new(&series.name, color) });
    }
    content
}

fn draw(content: &mut Content, of: &Quartiles, x: f64, width: f64, color: [u8; 3]) {
    let (left, right) = (x - 0.4 * width, x + 0.4 * width);
    let mut line = |points: &[[f64; 2]], width: f64, color: [u8; 3]| {
        content.layers.push(Layer::Line { points: points.to_vec(), color, width, dash: None });
    };
    for (from, to) in [(of.low, of.low_whisker), (of.high, of.high_whisker)] {
        line(&[[x, from], [x, to]], 1.0, INK);
        line(&[[x - 0.2 * width, to], [x + 0.2 * width, to]], 1.0, INK);
    }
    let corners = [[left, of.low], [right, of.low], [right, of.high], [left, of.high]];
    // White below the colour hides the grid.
    for (color, opacity) in [([255; 3], 1.0), (color, 0.35)] {
        content.layers.push(Layer::Area { points: corners.to_vec(), color, opacity });
    }
    let mut line = |points: &[[f64; 2]], width: f64| {
        content.layers.push(Layer::Line { points: points.to_vec(), color, width, dash: None });
    };
    line(&[&corners[..], &corners[..1]].concat(), 1.2);
    line(&[[left, of.median], [right, of.median]], 2.2);
    if !of.outliers.is_empty() {
        let points = of.outliers.iter().map(|&y| [x, y]).collect();
        let (shape, opacity, radius) = (Shape::Circle, 0.75, 2.0);
        content.layers.push(Layer::Dots { points, shape, color, opacity, radius });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_and_whiskers_have_their_known_values() {
        // numpy.percentile gives 3.25, 5.5, 7.75; the reach is 6.75 to each side.
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 30.0];
        let expected = Quartiles {
            low_whisker: 1.0,
            low: 3.25,
            median: 5.5,
            high: 7.75,
            high_whisker: 9.0,
            outliers: vec![30.0],
        };
        assert_eq!(Quartiles::of(&values), expected);
        let one = Quartiles::of(&[2.0]);
        assert_eq!((one.low_whisker, one.median, one.high_whisker), (2.0, 2.0, 2.0));
        assert!(one.outliers.is_empty());
    }
}
