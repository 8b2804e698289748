//! Lines over numbers, with bands.

use super::content::{Content, Entry, Layer};
use super::options::FigureOptions;
use super::palette::{color, dash, shape};
use super::series::{Averaged, Data, averaged};

/// Up to so many points of a curve have a dot each.
const MOST_DOTS: usize = 24;

pub fn curves(data: &Data, options: &FigureOptions) -> Content {
    let mut content = Content::default();
    let curves: Vec<Vec<Averaged>> =
        data.series.iter().map(|it| averaged(it, options.band)).collect();
    for (group, curve) in curves.iter().enumerate().filter(|it| it.1.iter().any(has_band)) {
        let lower = curve.iter().rev().map(|it| [it.x, it.low]);
        let points = curve.iter().map(|it| [it.x, it.high]).chain(lower).collect();
        content.layers.push(Layer::Area { points, color: color(group), opacity: 0.18 });
    }
    for (group, curve) in curves.iter().enumerate() {
        let points: Vec<[f64; 2]> = curve.iter().map(|it| [it.x, it.mean]).collect();
        let (color, dash, shape) = (color(group), dash(group), shape(group));
        let has_dots = points.len() <= MOST_DOTS;
        content.layers.push(Layer::Line { points: points.clone(), color, width: 1.7, dash });
        if has_dots {
            let (opacity, radius) = (1.0, 3.0);
            content.layers.push(Layer::Dots { points, shape, color, opacity, radius });
        }
        let entry = Entry::new(&data.series[group].name, color);
        content.name(Entry { line: Some(dash), dot: has_dots.then_some(shape), ..entry });
    }
    content
}

fn has_band(point: &Averaged) -> bool {
    point.low < point.high
}
