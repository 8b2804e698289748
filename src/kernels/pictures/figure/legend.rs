//! Which group is which.

use super::clip::{Rect, clip_area, clip_line};
use super::content::Entry;
use super::draw::{line, text};
use super::layout::TICK_SIZE;
use super::measure::{fitted, text_width};
use super::palette::INK;
use super::scene::{Anchor, Look, Mark, Point};

/// Where a legend is.
#[derive(Debug, Clone, Copy)]
pub enum Place {
    Inside(Rect),
    /// Beside the axes, so wide, with rows so high.
    Right {
        width: f64,
        row: f64,
    },
}

const ROW: f64 = 15.5;
const SAMPLE: f64 = 20.0;
const PADDING: f64 = 5.0;

/// Width and height.
pub fn legend_size(entries: &[Entry]) -> Point {
    let widths = entries.iter().map(|it| text_width(&it.name, TICK_SIZE));
    let width = widths.fold(0.0, f64::max);
    [width + SAMPLE + 6.0 + 2.0 * PADDING, entries.len() as f64 * ROW + 2.0 * PADDING - 2.0]
}

/// A corner within the axes in which nothing is drawn.
pub fn free_corner([width, height]: Point, within: &Rect, marks: &[&Mark]) -> Option<Rect> {
    let Rect { low: [left, top], high: [right, bottom] } = *within;
    if width + 12.0 > 0.7 * (right - left) || height + 12.0 > 0.8 * (bottom - top) {
        return None;
    }
    let at = |x: f64, y: f64| Rect { low: [x, y], high: [x + width, y + height] };
    let (west, north) = (left + 6.0, top + 4.0);
    let (east, south) = (right - width - 4.0, bottom - height - 6.0);
    [at(east, north), at(west, north), at(east, south), at(west, south)]
        .into_iter()
        .find(|corner| !marks.iter().any(|it| touches(it, corner)))
}

/// Whether any ink of a mark lies within a rectangle, or so near that it looks so.
pub fn touches(mark: &Mark, rect: &Rect) -> bool {
    let near = Rect { low: rect.low.map(|it| it - 3.0), high: rect.high.map(|it| it + 3.0) };
    match &mark.look {
        Look::Dots { .. } | Look::Text { .. } => mark.points.iter().any(|&it| near.contains(it)),
        Look::Line { .. } => !clip_line(&mark.points, &near).is_empty(),
        Look::Area { .. } => clip_area(&mark.points, &near).len() > 2,
    }
}

/// The height of a row of a legend beside the axes, which ends where the figure does; `None` if there are
/// too many rows to be read.
pub fn fitting_row(n_entries: usize, axes: &Rect, height: f64) -> Option<f64> {
    let row = ROW.min((height - axes.low[1] - 2.0 * PADDING) / n_entries as f64);
    (row >= TICK_SIZE + 1.0).then_some(row)
}

pub fn draw_legend(entries: &[Entry], place: Place, axes: &Rect) -> Vec<Mark> {
    let mut marks = Vec::new();
    let row = match place {
        Place::Inside(_) => ROW,
        Place::Right { row, .. } => row,
    };
    let ([left, top], room) = match place {
        Place::Inside(rect) => {
            let ground = Look::Area { color: [255; 3], opacity: 0.85 };
            marks.push(Mark::new(&rect.corners(), ground));
            (rect.low, f64::INFINITY)
        }
        Place::Right { width, .. } => {
            ([axes.high[0] + 8.0, axes.low[1]], width - SAMPLE - 6.0 - 2.0 * PADDING)
        }
    };
    for (index, entry) in entries.iter().enumerate() {
        let middle = top + PADDING + (index as f64 + 0.5) * row - 1.0;
        let start = left + PADDING;
        marks.extend(sample(entry, [start, middle]));
        let at = [start + SAMPLE + 6.0, middle + 0.36 * TICK_SIZE];
        let name = fitted(&entry.name, TICK_SIZE, room + 0.01);
        marks.push(text(name, at, TICK_SIZE, Anchor::Start, INK));
    }
    marks
}

/// A short piece of what is named.
fn sample(entry: &Entry, [x, y]: Point) -> Vec<Mark> {
    let mut marks = Vec::new();
    let color = entry.color;
    if entry.fill > 0.0 {
        let rect = Rect { low: [x + 4.0, y - 5.0], high: [x + SAMPLE - 2.0, y + 5.0] };
        marks.push(Mark::new(&rect.corners(), Look::Area { color, opacity: entry.fill }));
        if entry.fill < 0.5 {
            let corners = rect.corners();
            marks.push(line(&[&corners[..], &corners[..1]].concat(), color, 1.2));
        }
    }
    if let Some(dash) = entry.line {
        let look = Look::Line { color, width: 1.7, dash };
        marks.push(Mark::new(&[[x, y], [x + SAMPLE, y]], look));
    }
    if let Some(shape) = entry.dot {
        let look = Look::Dots { shape, color, opacity: 1.0, radius: 3.0 };
        marks.push(Mark::new(&[[x + SAMPLE / 2.0, y]], look));
    }
    marks
}
