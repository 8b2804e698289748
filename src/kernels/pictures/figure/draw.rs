//! From layers to marks.

use super::axis::{Axis, Scale};
use super::clip::{Rect, clip_area, clip_line};
use super::content::{Content, Layer};
use super::layout::{LABEL_SIZE, LINE, Layout, Surroundings, TICK_GAP, TICK_SIZE, TITLE_SIZE};
use super::legend::{Place, draw_legend, fitting_row, free_corner, legend_size, touches};
use super::measure::{fitted, text_width};
use super::options::{FigureError, FigureOptions, Legend, ReferenceLine, Style};
use super::palette::{AXIS, GRID, INK, REFERENCE};
use super::scene::{Anchor, Figure, Look, Mark, Point, Rgb};
use super::series::Data;

/// What is written at the axes.
#[derive(Debug, Clone)]
pub struct Labels {
    pub x: String,
    pub y: String,
}

/// The figure, and remarks for its reader.
///
/// # Errors
/// [`FigureError::TooSmall`].
pub fn draw(
    data: &Data,
    content: &Content,
    labels: &Labels,
    options: &FigureOptions,
) -> Result<(Figure, Vec<String>), FigureError> {
    let (x, y) = (x_axis(data, content, options), y_axis(content, options));
    let mut around = Surroundings {
        width: options.width as f64,
        height: options.height as f64,
        has_title: !options.title.is_empty(),
        x_label: &labels.x,
        y_label: &labels.y,
        categories: &data.categories,
        legend_width: 0.0,
    };
    if options.style == Style::Cdf {
        around.categories = &[];
    }
    let names = if options.legend == Legend::None { &[][..] } else { &content.legend[..] };
    let (layout, place) = match inside_legend(&around, x, y, content, options)? {
        Some((layout, rect)) => (layout, Some(Place::Inside(rect))),
        None if names.is_empty() => (Layout::of(&around, x, y)?, None),
        None => {
            // Very long names are cut before they eat the axes.
            let width = legend_size(names)[0].min(0.45 * around.width);
            around.legend_width = width + 6.0;
            let layout = Layout::of(&around, x, y)?;
            let row = fitting_row(names.len(), &layout.rect, around.height)
                .ok_or(FigureError::TooSmall { width: options.width, height: options.height })?;
            (layout, Some(Place::Right { width, row }))
        }
    };
    let mut marks = grid(&layout);
    let layers = drawn_layers(content, &layout);
    let (rules, notes) = drawn_rules(&options.lines, &layout, &layers);
    marks.extend(layers);
    marks.extend(axes(&layout));
    marks.extend(rules);
    marks.extend(texts(&layout, labels, options));
    if let Some(place) = place {
        marks.extend(draw_legend(names, place, &layout.rect));
    }
    let (title, width, height) = (options.title.clone(), options.width, options.height);
    Ok((Figure { title, width, height, marks }, notes))
}

/// The axes without room for a legend beside them, and a corner in which it has room.
fn inside_legend(
    around: &Surroundings<'_>,
    x: Axis,
    y: Axis,
    content: &Content,
    options: &FigureOptions,
) -> Result<Option<(Layout, Rect)>, FigureError> {
    if content.legend.is_empty() || options.legend != Legend::Auto {
        return Ok(None);
    }
    let layout = Layout::of(around, x, y)?;
    let drawn = drawn_layers(content, &layout);
    let (rules, _) = drawn_rules(&options.lines, &layout, &drawn);
    let taken: Vec<&Mark> = drawn.iter().chain(&rules).collect();
    let corner = free_corner(legend_size(&content.legend), &layout.rect, &taken);
    Ok(corner.map(|it| (layout, it)))
}

fn x_axis(data: &Data, content: &Content, options: &FigureOptions) -> Axis {
    if matches!(options.style, Style::Bars | Style::Box) {
        return Axis { scale: Scale::Linear, low: 0.0, high: data.categories.len() as f64 };
    }
    let lines = options.lines.iter().filter_map(|it| it.x);
    Axis::of(options.x_scale, reached(content, 0).chain(lines), options.x_range)
}

fn y_axis(content: &Content, options: &FigureOptions) -> Axis {
    let lines = options.lines.iter().filter_map(|it| it.y);
    let fixed = match options.style {
        Style::Cdf => options.y_range.or(Some([0.0, 100.0])),
        _ => options.y_range,
    };
    Axis::of(options.y_scale, reached(content, 1).chain(lines), fixed)
}

fn reached(content: &Content, axis: usize) -> impl Iterator<Item = f64> + '_ {
    let layers = content.layers.iter().flat_map(|it| it.points());
    layers.chain(&content.reach).map(move |it| it[axis])
}

pub(super) fn line(points: &[Point], color: Rgb, width: f64) -> Mark {
    Mark::new(points, Look::Line { color, width, dash: None })
}

pub(super) fn text(text: String, at: Point, size: f64, anchor: Anchor, color: Rgb) -> Mark {
    Mark::new(&[at], Look::Text { text, size, anchor, angle_deg: 0.0, color })
}

fn grid(layout: &Layout) -> Vec<Mark> {
    let Rect { low: [left, top], high: [right, bottom] } = layout.rect;
    let level = layout.y_ticks.list.iter().map(|it| layout.y_place(it.value));
    let upright = layout.x_ticks.list.iter().map(|it| layout.x_place(it.value));
    level
        .map(|y| line(&[[left, y], [right, y]], GRID, 0.8))
        .chain(upright.map(|x| line(&[[x, top], [x, bottom]], GRID, 0.8)))
        .collect()
}

/// The layers, cut at the axes.
fn drawn_layers(content: &Content, layout: &Layout) -> Vec<Mark> {
    let mut marks = Vec::new();
    for layer in &content.layers {
        let points: Vec<Point> = layer.points().iter().map(|&it| layout.place(it)).collect();
        match layer {
            Layer::Line { color, width, dash, .. } => {
                for piece in clip_line(&sparse(&points), &layout.rect) {
                    let (color, width, dash) = (*color, *width, *dash);
                    marks.push(Mark::new(&piece, Look::Line { color, width, dash }));
                }
            }
            Layer::Area { color, opacity, .. } => {
                let area = clip_area(&points, &layout.rect);
                if area.len() > 2 {
                    let (color, opacity) = (*color, *opacity);
                    marks.push(Mark::new(&area, Look::Area { color, opacity }));
                }
            }
            Layer::Dots { shape, color, opacity, radius, .. } => {
                let seen: Vec<Point> =
                    points.into_iter().filter(|&it| layout.rect.contains(it)).collect();
                if !seen.is_empty() {
                    let (shape, color, opacity) = (*shape, *color, *opacity);
                    let look = Look::Dots { shape, color, opacity, radius: *radius };
                    marks.push(Mark::new(&seen, look));
                }
            }
        }
    }
    marks
}

/// A chain without points that nobody can see: closer than a fifth of a pixel to the last one.
fn sparse(points: &[Point]) -> Vec<Point> {
    let mut res: Vec<Point> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let is_last = index + 1 == points.len();
        let is_far = |it: &Point| (it[0] - point[0]).hypot(it[1] - point[1]) >= 0.2;
        if is_last || res.last().is_none_or(is_far) {
            res.push(*point);
        }
    }
    res
}

/// The two axes and their ticks.
fn axes(layout: &Layout) -> Vec<Mark> {
    let Rect { low: [left, top], high: [right, bottom] } = layout.rect;
    let mut marks = vec![line(&[[left, top], [left, bottom], [right, bottom]], AXIS, 1.0)];
    let mut x_tick = |value: f64, length: f64| {
        let x = layout.x_place(value);
        marks.push(line(&[[x, bottom], [x, bottom + length]], AXIS, 1.0));
    };
    layout.x_ticks.list.iter().for_each(|it| x_tick(it.value, 3.5));
    layout.x_ticks.minor.iter().for_each(|&it| x_tick(it, 2.0));
    let mut y_tick = |value: f64, length: f64| {
        let y = layout.y_place(value);
        marks.push(line(&[[left - length, y], [left, y]], AXIS, 1.0));
    };
    layout.y_ticks.list.iter().for_each(|it| y_tick(it.value, 3.5));
    layout.y_ticks.minor.iter().for_each(|&it| y_tick(it, 2.0));
    marks
}

/// Numbers, names, labels and the title.
fn texts(layout: &Layout, labels: &Labels, options: &FigureOptions) -> Vec<Mark> {
    let Rect { low: [left, top], high: [right, bottom] } = layout.rect;
    let mut marks = Vec::new();
    let below = bottom + TICK_GAP + 0.75 * TICK_SIZE;
    for tick in &layout.x_ticks.list {
        let at = [layout.x_place(tick.value), below];
        marks.push(text(tick.label.clone(), at, TICK_SIZE, Anchor::Middle, INK));
    }
    for (x, lines) in &layout.names.list {
        marks.extend(name_at(*x, lines, layout.names.angle_deg, bottom));
    }
    for tick in &layout.y_ticks.list {
        let at = [left - TICK_GAP, layout.y_place(tick.value) + 0.36 * TICK_SIZE];
        marks.push(text(tick.label.clone(), at, TICK_SIZE, Anchor::End, INK));
    }
    if !layout.y_ticks.factor.is_empty() {
        let factor = layout.y_ticks.factor.clone();
        marks.push(text(factor, [left, top - 5.0], TICK_SIZE, Anchor::Start, INK));
    }
    let label_line = bottom + layout.x_labels_height + LABEL_SIZE + 1.0;
    if !layout.x_ticks.factor.is_empty() {
        let factor = layout.x_ticks.factor.clone();
        marks.push(text(factor, [right, label_line], TICK_SIZE, Anchor::End, INK));
    }
    if !labels.x.is_empty() {
        // The factor stands at the right end of the same line.
        let factor = match layout.x_ticks.factor.as_str() {
            "" => 0.0,
            factor => text_width(factor, TICK_SIZE) + 8.0,
        };
        let label = fitted(&labels.x, LABEL_SIZE, right - left - 2.0 * factor);
        let at = [(left + right) / 2.0, label_line];
        marks.push(text(label, at, LABEL_SIZE, Anchor::Middle, INK));
    }
    if !labels.y.is_empty() {
        let label = fitted(&labels.y, LABEL_SIZE, bottom - top + 20.0);
        let at = [left - layout.y_labels_width - 7.0, (top + bottom) / 2.0];
        marks.push(turned(label, at, LABEL_SIZE, Anchor::Middle, 90.0));
    }
    if !options.title.is_empty() {
        let title = fitted(&options.title, TITLE_SIZE, options.width as f64 - 16.0);
        let middle = (left + right) / 2.0;
        let half = text_width(&title, TITLE_SIZE) / 2.0;
        // Above the axes if it fits there, else in the middle of the figure.
        let fits = middle - half >= 4.0 && middle + half <= options.width as f64 - 4.0;
        let x = if fits { middle } else { options.width as f64 / 2.0 };
        marks.push(text(title, [x, 8.0 + TITLE_SIZE], TITLE_SIZE, Anchor::Middle, INK));
    }
    marks
}

fn turned(text: String, at: Point, size: f64, anchor: Anchor, angle_deg: f64) -> Mark {
    Mark::new(&[at], Look::Text { text, size, anchor, angle_deg, color: INK })
}

/// The name of a category below its place.
fn name_at(x: f64, lines: &[String], angle_deg: f64, bottom: f64) -> Vec<Mark> {
    if angle_deg == 0.0 {
        let line_at = |(index, line): (usize, &String)| {
            let y = bottom + TICK_GAP + 0.75 * TICK_SIZE + index as f64 * LINE;
            text(line.clone(), [x, y], TICK_SIZE, Anchor::Middle, INK)
        };
        return lines.iter().enumerate().map(line_at).collect();
    }
    // The end of the line is at the axis; half of a letter's height beside it.
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let half = 0.36 * TICK_SIZE;
    let at = [x + half * sin, bottom + TICK_GAP - 1.0 + half * cos + 0.2 * TICK_SIZE * cos];
    lines.iter().map(|it| turned(it.clone(), at, TICK_SIZE, Anchor::End, angle_deg)).collect()
}

/// Lines at known values with their labels, and which of them are not within the axes. Labels keep away from
/// what is drawn already, where they can.
fn drawn_rules(
    lines: &[ReferenceLine],
    layout: &Layout,
    drawn: &[Mark],
) -> (Vec<Mark>, Vec<String>) {
    let Rect { low: [left, top], high: [right, bottom] } = layout.rect;
    let (mut marks, mut notes) = (Vec::new(), Vec::new());
    for rule in lines {
        let (ends, name) = match (rule.x, rule.y) {
            (Some(x), _) => {
                let place = layout.x_place(x);
                ([[place, bottom], [place, top]], format!("x = {x}"))
            }
            (None, Some(y)) => {
                let place = layout.y_place(y);
                ([[left, place], [right, place]], format!("y = {y}"))
            }
            (None, None) => continue,
        };
        if !layout.rect.contains(ends[0]) || !layout.rect.contains(ends[1]) {
            notes.push(format!("the line at {name} lies outside of the axes"));
            continue;
        }
        let dash = Some([4.0, 3.6]);
        marks.push(Mark::new(&ends, Look::Line { color: REFERENCE, width: 1.1, dash }));
        if !rule.label.is_empty() {
            marks.extend(rule_label(&rule.label, ends, &layout.rect, drawn));
        }
    }
    (marks, notes)
}

/// Beside a line, at an end and on a side where there is room, on a white ground.
fn rule_label(label: &str, [start, end]: [Point; 2], axes: &Rect, drawn: &[Mark]) -> Vec<Mark> {
    let label = fitted(label, TICK_SIZE, axes.high[0] - axes.low[0] - 8.0);
    let width = text_width(&label, TICK_SIZE);
    let (above, below) = (-4.0, TICK_SIZE + 2.0);
    let places = if start[0] == end[0] {
        let (x, high, low) = (start[0], end[1] + TICK_SIZE, start[1] - 6.0);
        [[x + 4.0, high], [x - 4.0 - width, high], [x + 4.0, low], [x - 4.0 - width, low]]
    } else {
        let (left, right, y) = (start[0] + 4.0, end[0] - 3.0 - width, start[1]);
        [[right, y + above], [left, y + above], [right, y + below], [left, y + below]]
    };
    let ground = |[x, y]: Point| Rect {
        low: [x - 2.0, y - 0.85 * TICK_SIZE],
        high: [x + width + 2.0, y + 0.25 * TICK_SIZE],
    };
    let inside: Vec<Point> = (places.into_iter())
        .filter(|&it| axes.contains(ground(it).low) && axes.contains(ground(it).high))
        .collect();
    let is_free = |it: &&Point| !drawn.iter().any(|mark| touches(mark, &ground(**it)));
    let Some(&at) = inside.iter().find(is_free).or(inside.first()) else { return Vec::new() };
    let white = Look::Area { color: [255; 3], opacity: 0.85 };
    let text = text(label, at, TICK_SIZE, Anchor::Start, REFERENCE);
    vec![Mark::new(&ground(at).corners(), white), text]
}
