//! Bars side by side, with whiskers.

use super::content::{Content, Entry, Layer};
use super::options::FigureOptions;
use super::palette::{INK, color};
use super::series::{Data, averaged};

/// The part of a category's width that its bars fill.
const FILLED: f64 = 0.78;

pub fn bars(data: &Data, options: &FigureOptions) -> Content {
    let mut content = Content::default();
    let n_groups = data.series.len() as f64;
    let width = FILLED / n_groups;
    for (group, series) in data.series.iter().enumerate() {
        let color = color(group);
        let opacity = pale(group);
        for bar in averaged(series, options.band) {
            let left = bar.x - FILLED / 2.0 + group as f64 * width;
            let (left, right) = (left + 0.03 * width, left + 0.97 * width);
            // On a logarithmic axis zero is far below; bars are cut at the axis.
            let corners = [[left, 0.0], [left, bar.mean], [right, bar.mean], [right, 0.0]];
            content.layers.push(Layer::Area { points: corners.to_vec(), color, opacity });
            content.reach.push([bar.x, bar.mean]);
            if bar.low < bar.high {
                content.reach.extend([[bar.x, bar.low], [bar.x, bar.high]]);
                content.layers.extend(whisker((left + right) / 2.0, bar.low, bar.high, width));
            }
        }
        content.name(Entry { fill: opacity, ..Entry::new(&series.name, color) });
    }
    content.reach.push([0.0, 0.0]);
    content
}

/// The second use of a colour is paler.
fn pale(group: usize) -> f64 {
    [0.88, 0.5, 0.3, 0.18][group / 8 % 4]
}

/// An upright line with a short level one at each end.
fn whisker(x: f64, low: f64, high: f64, width: f64) -> impl Iterator<Item = Layer> {
    let cap = 0.16 * width;
    let line = |points: [[f64; 2]; 2]| Layer::Line {
        points: points.to_vec(),
        color: INK,
        width: 1.0,
        dash: None,
    };
    [
        line([[x, low], [x, high]]),
        line([[x - cap, low], [x + cap, low]]),
        line([[x - cap, high], [x + cap, high]]),
    ]
    .into_iter()
}
