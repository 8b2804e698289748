//! What a figure shows, in the units of its axes.

use super::scene::{Point, Rgb, Shape};

/// Layers in the coordinates of the data. They are cut at the axes.
#[derive(Debug, Clone, Default)]
pub struct Content {
    /// From back to front.
    pub layers: Vec<Layer>,
    pub legend: Vec<Entry>,
    /// Values that the axes have to reach, beside those of the layers.
    pub reach: Vec<Point>,
    pub notes: Vec<String>,
}

#[derive(Debug, Clone)]
pub enum Layer {
    Line { points: Vec<Point>, color: Rgb, width: f64, dash: Option<[f64; 2]> },
    Area { points: Vec<Point>, color: Rgb, opacity: f64 },
    Dots { points: Vec<Point>, shape: Shape, color: Rgb, opacity: f64, radius: f64 },
}

/// A name and how what it names looks.
#[derive(Debug, Clone)]
pub struct Entry {
    pub name: String,
    pub color: Rgb,
    pub line: Option<Option<[f64; 2]>>,
    pub dot: Option<Shape>,
    /// Of a filled square; none if it is zero.
    pub fill: f64,
}

impl Layer {
    pub fn points(&self) -> &[Point] {
        match self {
            Self::Line { points, .. } | Self::Area { points, .. } | Self::Dots { points, .. } => {
                points
            }
        }
    }
}

impl Entry {
    pub fn new(name: &str, color: Rgb) -> Self {
        Self { name: name.to_owned(), color, line: None, dot: None, fill: 0.0 }
    }
}

impl Content {
    /// Names a group, if there are several.
    pub fn name(&mut self, entry: Entry) {
        if !entry.name.is_empty() {
            self.legend.push(entry);
        }
    }
}
