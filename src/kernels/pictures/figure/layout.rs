//! Where the axes and their labels are.

use super::axis::{Axis, Ticks};
use super::clip::Rect;
use super::measure::{fitted, text_width, wrapped};
use super::options::FigureError;
use super::scene::Point;

/// Sizes of letters.
pub const TICK_SIZE: f64 = 10.5;
pub const LABEL_SIZE: f64 = 11.5;
pub const TITLE_SIZE: f64 = 13.0;

/// From the axis to the labels of its ticks.
pub const TICK_GAP: f64 = 7.0;
/// From one line of labels to the next.
pub const LINE: f64 = 12.5;
const MARGIN: f64 = 12.0;
const SLANT_DEG: f64 = 35.0;

/// What surrounds the axes.
#[derive(Debug, Clone)]
pub struct Surroundings<'a> {
    pub width: f64,
    pub height: f64,
    pub has_title: bool,
    pub x_label: &'a str,
    pub y_label: &'a str,
    /// Names along x, if it is not an axis of numbers.
    pub categories: &'a [String],
    /// Room for a legend beside the axes; none if it is zero.
    pub legend_width: f64,
}

/// The axes in their place.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Within the axes.
    pub rect: Rect,
    pub x: Axis,
    pub y: Axis,
    pub x_ticks: Ticks,
    pub y_ticks: Ticks,
    /// The names along x, with the places of their middles.
    pub names: Names,
    /// From the upright axis to the left end of its labels.
    pub y_labels_width: f64,
    /// From the level axis to the lower end of its labels.
    pub x_labels_height: f64,
}

/// The names of categories as they are written.
#[derive(Debug, Clone, Default)]
pub struct Names {
    /// In lines; the place along x in pixels.
    pub list: Vec<(f64, Vec<String>)>,
    /// Zero for level names.
    pub angle_deg: f64,
}

impl Layout {
    /// # Errors
    /// [`FigureError::TooSmall`] if nothing is left for the axes.
    pub fn of(around: &Surroundings<'_>, x: Axis, y: Axis) -> Result<Self, FigureError> {
        let mut layout = Self::with_right_margin(around, x, y, MARGIN)?;
        // The last label is centred at its tick and may stand out.
        let ends = layout
            .x_ticks
            .list
            .iter()
            .map(|it| layout.x_place(it.value) + text_width(&it.label, TICK_SIZE) / 2.0);
        let end = ends.fold(0.0, f64::max);
        let most = around.width - around.legend_width - 4.0;
        if end > most {
            layout = Self::with_right_margin(around, x, y, MARGIN + end - most)?;
        }
        Ok(layout)
    }

    fn with_right_margin(
        around: &Surroundings<'_>,
        x: Axis,
        y: Axis,
        margin: f64,
    ) -> Result<Self, FigureError> {
        let label_height = |label: &str| if label.is_empty() { 0.0 } else { LABEL_SIZE + 5.0 };
        let title_height = if around.has_title { TITLE_SIZE + 9.0 } else { 0.0 };
        let right = around.width - margin - around.legend_width;
        let (x_label_height, y_label_width) =
            (label_height(around.x_label), label_height(around.y_label));
        let plain_bottom = around.height - 8.0 - x_label_height - TICK_GAP - LINE;
        let fit_y = |top: f64, bottom: f64| y.ticks(((bottom - top) / 27.0) as usize);
        let mut y_ticks = fit_y(MARGIN + title_height, plain_bottom);
        let top = MARGIN + title_height + if y_ticks.factor.is_empty() { 0.0 } else { LINE };
        let widths = y_ticks.list.iter().map(|it| text_width(&it.label, TICK_SIZE));
        let y_labels_width = TICK_GAP + widths.fold(0.0, f64::max);
        let left = 8.0 + y_label_width + y_labels_width;
        let too_small = || FigureError::TooSmall {
            width: around.width as usize,
            height: around.height as usize,
        };
        if right - left < 40.0 {
            return Err(too_small());
        }
        let (x_ticks, names, labels_height) = if around.categories.is_empty() {
            (fitting_ticks(&x, right - left), Names::default(), LINE)
        } else {
            let (names, height) = place_names(around.categories, left, right, around.height);
            (Ticks::default(), names, height)
        };
        let bottom = plain_bottom + LINE - labels_height;
        if bottom - top < 40.0 {
            return Err(too_small());
        }
        if labels_height > LINE {
            let fewer = fit_y(top, bottom);
            // A coarser step has no longer labels, but may have lost the factor: the room stays.
            y_ticks = fewer;
        }
        let rect = Rect { low: [left, top], high: [right, bottom] };
        let x_labels_height = TICK_GAP + labels_height;
        Ok(Self { rect, x, y, x_ticks, y_ticks, names, y_labels_width, x_labels_height })
    }

    pub fn x_place(&self, value: f64) -> f64 {
        self.rect.low[0] + self.x.place(value) * (self.rect.high[0] - self.rect.low[0])
    }

    pub fn y_place(&self, value: f64) -> f64 {
        self.rect.high[1] - self.y.place(value) * (self.rect.high[1] - self.rect.low[1])
    }

    pub fn place(&self, point: Point) -> Point {
        [self.x_place(point[0]), self.y_place(point[1])]
    }
}

/// As many ticks as have room for their labels.
fn fitting_ticks(axis: &Axis, room: f64) -> Ticks {
    let fits = |ticks: &Ticks| {
        ticks.list.windows(2).all(|pair| {
            let apart = (axis.place(pair[1].value) - axis.place(pair[0].value)) * room;
            let widths = pair.iter().map(|it| text_width(&it.label, TICK_SIZE));
            apart >= widths.sum::<f64>() / 2.0 + 9.0
        })
    };
    let most = (room / 38.0).max(2.0) as usize;
    let found = (2..=most).rev().map(|it| axis.ticks(it)).find(fits);
    found.unwrap_or_else(|| {
        let mut ticks = axis.ticks(2);
        ticks.list.truncate(1);
        ticks
    })
}

/// Names below their categories, level if they fit, in several lines, slanted, or upright; and the height
/// that they need.
fn place_names(categories: &[String], left: f64, right: f64, height: f64) -> (Names, f64) {
    let slot = (right - left) / categories.len() as f64;
    let middle = |index: usize| left + (index as f64 + 0.5) * slot;
    let lines: Option<Vec<Vec<String>>> =
        categories.iter().map(|it| wrapped(it, TICK_SIZE, slot - 5.0, 3)).collect();
    if let Some(lines) = lines {
        let n_lines = lines.iter().map(Vec::len).max().unwrap_or(0).max(1);
        let list = lines.into_iter().enumerate().map(|(i, it)| (middle(i), it)).collect();
        return (Names { list, angle_deg: 0.0 }, n_lines as f64 * LINE);
    }
    let (sin, cos) = SLANT_DEG.to_radians().sin_cos();
    let is_slanted = slot * sin >= TICK_SIZE + 1.0;
    let (angle_deg, sin, cos) = if is_slanted { (SLANT_DEG, sin, cos) } else { (90.0, 1.0, 0.0) };
    // Where even upright names have no room, only some of them are written.
    let every = if is_slanted { 1 } else { ((TICK_SIZE + 1.5) / slot).ceil().max(1.0) as usize };
    let list: Vec<(f64, Vec<String>)> = (0..categories.len())
        .step_by(every)
        .map(|index| {
            let beside = if cos > 0.0 { (middle(index) - 4.0) / cos } else { f64::INFINITY };
            let room = beside.min(0.4 * height / sin);
            (middle(index), vec![fitted(&categories[index], TICK_SIZE, room)])
        })
        .collect();
    let widths = list.iter().map(|it| text_width(&it.1[0], TICK_SIZE));
    let needed = widths.fold(0.0, f64::max) * sin + TICK_SIZE * cos;
    (Names { list, angle_deg }, needed.max(LINE))
}

#[cfg(test)]
mod tests {
    use super::super::axis::Scale;
    use super::*;
    use crate::kernels::numerics::random::Random;

    fn around<'a>(width: f64, categories: &'a [String]) -> Surroundings<'a> {
        Surroundings {
            width,
            height: 320.0,
            has_title: true,
            x_label: "time [s]",
            y_label: "error [mm]",
            categories,
            legend_width: 0.0,
        }
    }

    #[test]
    fn labels_of_ticks_never_overlap_and_stay_inside() {
        let mut random = Random::new(11);
        let mut uniform = move || random.next_u64() as f64 / u64::MAX as f64;
        for _ in 0..3000 {
            let scale = if uniform() < 0.5 { Scale::Linear } else { Scale::Log };
            let low = 10f64.powf(uniform() * 16.0 - 8.0);
            let axis = Axis { scale, low, high: low * (1.01 + uniform() * 1e4) };
            let width = 160.0 + 800.0 * uniform();
            let layout = Layout::of(&around(width, &[]), axis, axis).unwrap();
            let spans: Vec<[f64; 2]> = (layout.x_ticks.list.iter())
                .map(|it| (layout.x_place(it.value), text_width(&it.label, TICK_SIZE) / 2.0))
                .map(|(middle, half)| [middle - half, middle + half])
                .collect();
            let place = format!("{axis:?} on {width}: {:?}", layout.x_ticks);
            assert!(!spans.is_empty(), "{place}");
            assert!(spans.windows(2).all(|it| it[0][1] < it[1][0]), "{place}");
            assert!(spans.iter().all(|it| it[0] >= 0.0 && it[1] <= width), "{place}");
            let rows: Vec<f64> =
                layout.y_ticks.list.iter().map(|it| layout.y_place(it.value)).collect();
            assert!(rows.windows(2).all(|it| it[0] - it[1] > TICK_SIZE), "{place}");
        }
    }

    #[test]
    fn long_names_are_broken_then_slanted_then_upright() {
        let axis = |n: usize| Axis { scale: Scale::Linear, low: 0.0, high: n as f64 };
        let y = Axis { scale: Scale::Linear, low: 0.0, high: 5.0 };
        let angle = |name: &str, n: usize| {
            let names = vec![name.to_owned(); n];
            let layout = Layout::of(&around(480.0, &names), axis(n), y).unwrap();
            let n_lines = layout.names.list[0].1.len();
            (layout.names.angle_deg, n_lines, layout.names.list.len())
        };
        assert_eq!(angle("horse", 4), (0.0, 1, 4));
        assert_eq!(angle("functional maps with landmarks", 4), (0.0, 2, 4));
        assert_eq!(angle("functional maps with landmarks", 12), (35.0, 1, 12));
        assert_eq!(angle("functional maps", 30), (90.0, 1, 30));
        assert_eq!(angle("functional maps", 60), (90.0, 1, 30));
    }

    #[test]
    fn too_little_room_is_told() {
        let axis = Axis { scale: Scale::Linear, low: 0.0, high: 1.0 };
        let error = Layout::of(&around(80.0, &[]), axis, axis).unwrap_err();
        assert_eq!(error, FigureError::TooSmall { width: 80, height: 320 });
    }
}
