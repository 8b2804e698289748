//! Shares of rows up to a value.

use super::content::{Content, Entry, Layer};
use super::palette::{color, dash};
use super::series::{Data, Series};

/// The values of a series are its `y`; they are drawn along x.
pub fn cdfs(data: &Data) -> Content {
    let mut content = Content::default();
    let all: Vec<f64> = data.series.iter().flat_map(|it| &it.rows).map(|it| it.y).collect();
    let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    for (group, series) in data.series.iter().enumerate() {
        let (color, dash) = (color(group), dash(group));
        content.layers.push(Layer::Line { points: steps(series, high), color, width: 1.7, dash });
        content.name(Entry { line: Some(dash), ..Entry::new(&series.name, color) });
    }
    content
}

/// Upright at every value, level between them; from 0 % at the least value on, and on to `high` at 100 %.
fn steps(series: &Series, high: f64) -> Vec<[f64; 2]> {
    let mut values: Vec<f64> = series.rows.iter().map(|it| it.y).collect();
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let mut points = vec![[values[0], 0.0]];
    let mut below = 0;
    for equal in values.chunk_by(|a, b| a == b) {
        points.push([equal[0], 100.0 * below as f64 / n]);
        below += equal.len();
        points.push([equal[0], 100.0 * below as f64 / n]);
    }
    points.push([high, 100.0]);
    points.dedup();
    points
}

#[cfg(test)]
mod tests {
    use super::super::series::{Row, X};
    use super::*;

    #[test]
    fn steps_reach_the_share_of_rows_at_every_value() {
        let rows = [3.0, 1.0, 3.0, 2.0].map(|y| Row { x: X::Category(0), y }).to_vec();
        let points = steps(&Series { name: String::new(), rows }, 5.0);
        let expected = [
            [1.0, 0.0],
            [1.0, 25.0],
            [2.0, 25.0],
            [2.0, 50.0],
            [3.0, 50.0],
            [3.0, 100.0],
            [5.0, 100.0],
        ];
        assert_eq!(points, expected);
    }
}
