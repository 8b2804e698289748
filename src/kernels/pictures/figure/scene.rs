//! What a figure is made of: few kinds of marks in a plane, y downwards.

use serde::{Deserialize, Serialize};

/// A drawing of lines, areas, dots and texts on white; one unit is a pixel of a screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub title: String,
    pub width: usize,
    pub height: usize,
    /// From back to front.
    pub marks: Vec<Mark>,
}

/// Places and what is drawn there.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// In hundredths of a unit, so that a figure has the same bytes wherever it is drawn. A text has one
    /// place: the anchor on its baseline.
    pub points: Vec<Point>,
    pub look: Look,
}

pub type Point = [f64; 2];

/// sRGB.
pub type Rgb = [u8; 3];

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Look {
    /// A chain of segments with round ends and corners.
    Line {
        color: Rgb,
        width: f64,
        /// The lengths of a stroke and of the gap behind it; solid without.
        dash: Option<[f64; 2]>,
    },
    /// A polygon that does not cross itself.
    Area {
        color: Rgb,
        opacity: f64,
    },
    /// A small shape at each point.
    Dots {
        shape: Shape,
        color: Rgb,
        opacity: f64,
        radius: f64,
    },
    Text {
        text: String,
        size: f64,
        anchor: Anchor,
        angle_deg: f64,
        color: Rgb,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// Which end of a text its place is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Anchor {
    Start,
    Middle,
    End,
}

impl Mark {
    pub fn new(points: &[Point], look: Look) -> Self {
        // Adding zero turns a negative zero into a plain one.
        let rounded = |it: f64| (it * 100.0).round() / 100.0 + 0.0;
        Self { points: points.iter().map(|it| it.map(rounded)).collect(), look }
    }
}

impl Shape {
    /// The corners about a place; none for a circle. All shapes look equally large.
    pub fn corners(self, [x, y]: Point, radius: f64) -> Vec<Point> {
        let at = |dx: f64, dy: f64| [x + dx * radius, y + dy * radius];
        match self {
            Self::Circle => Vec::new(),
            Self::Square => vec![at(-0.9, -0.9), at(0.9, -0.9), at(0.9, 0.9), at(-0.9, 0.9)],
            Self::Triangle => vec![at(0.0, -1.3), at(1.15, 0.75), at(-1.15, 0.75)],
            Self::Diamond => vec![at(0.0, -1.3), at(1.3, 0.0), at(0.0, 1.3), at(-1.3, 0.0)],
        }
    }
}

/// How large the parts of a figure may be: what is beyond comes from damaged bytes.
const LARGEST: f64 = 100_000.0;

impl Figure {
    /// The least and the greatest width and height.
    pub const SIZES: std::ops::RangeInclusive<usize> = 64..=4096;

    /// Whether every number can be drawn.
    ///
    /// # Errors
    /// What cannot.
    pub fn check(&self) -> Result<(), String> {
        for (name, size) in [("width", self.width), ("height", self.height)] {
            if !Self::SIZES.contains(&size) {
                return Err(format!("the {name} is {size}"));
            }
        }
        let is_sound = |it: &f64| (-LARGEST..=LARGEST).contains(it);
        for (index, mark) in self.marks.iter().enumerate() {
            let sizes = match &mark.look {
                Look::Line { width, dash, .. } => {
                    let [stroke, gap] = dash.unwrap_or([1.0; 2]);
                    vec![*width, stroke - 0.2, gap - 0.2]
                }
                Look::Area { opacity, .. } => vec![*opacity, 1.0 - opacity],
                Look::Dots { opacity, radius, .. } => vec![*opacity, 1.0 - opacity, *radius],
                Look::Text { size, angle_deg, .. } => vec![*size, 200.0 - size, angle_deg.abs()],
            };
            let is_text = matches!(mark.look, Look::Text { .. });
            let is_whole = !is_text || mark.points.len() == 1;
            let are_sound = sizes.iter().all(|it| is_sound(it) && *it >= 0.0);
            if !is_whole || !are_sound || !mark.points.iter().flatten().all(is_sound) {
                return Err(format!("mark {index} cannot be drawn"));
            }
        }
        Ok(())
    }

    /// All texts, from back to front.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        self.marks.iter().filter_map(|it| match &it.look {
            Look::Text { text, .. } => Some(text.as_str()),
            _ => None,
        })
    }
}
