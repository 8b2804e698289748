//! A dot a row, and lines through them.

use super::axis::Scale;
use super::content::{Content, Entry, Layer};
use super::fit::{Fit, fit_line};
use super::options::FigureOptions;
use super::palette::{color, shape};
use super::series::Data;
use crate::kernels::io::table_text::short;

pub fn scatter(data: &Data, options: &FigureOptions) -> Content {
    let mut content = Content::default();
    let n_rows: usize = data.series.iter().map(|it| it.rows.len()).sum();
    let (opacity, radius) = if n_rows > 300 { (0.45, 2.2) } else { (0.75, 3.2) };
    for (group, series) in data.series.iter().enumerate() {
        let points: Vec<[f64; 2]> = series.rows.iter().map(|it| [it.place(), it.y]).collect();
        let (color, shape) = (color(group), shape(group));
        let mut entry = Entry { dot: Some(shape), ..Entry::new(&series.name, color) };
        if options.fit {
            let scales = [options.x_scale, options.y_scale];
            match Line::through(&points, scales) {
                Some(line) => {
                    let ends = line.ends.to_vec();
                    let (width, dash) = (1.4, None);
                    content.layers.push(Layer::Line { points: ends, color, width, dash });
                    entry.line = Some(None);
                    entry.name = named(&series.name, &line.short());
                    let x = options.x.as_deref().unwrap_or("x");
                    let y = if let [only] = &options.y[..] { only } else { "y" };
                    let whole = line.whole([x, y]);
                    content.notes.push(named(&series.name, &whole));
                }
                None => {
                    let why = "no line fits points of fewer than two different x";
                    content.notes.push(named(&series.name, why));
                }
            }
        }
        content.layers.push(Layer::Dots { points, shape, color, opacity, radius });
        content.name(entry);
    }
    content
}

fn named(name: &str, text: &str) -> String {
    if name.is_empty() { text.to_owned() } else { format!("{name}: {text}") }
}

/// A line that is straight on the axes as they are.
struct Line {
    fit: Fit,
    scales: [Scale; 2],
    ends: [[f64; 2]; 2],
}

impl Line {
    fn through(points: &[[f64; 2]], scales: [Scale; 2]) -> Option<Self> {
        let forward = |it: &[f64; 2]| [scales[0].forward(it[0]), scales[1].forward(it[1])];
        let places: Vec<[f64; 2]> = points.iter().map(forward).collect();
        let fit = fit_line(&places)?;
        let low = places.iter().map(|it| it[0]).fold(f64::INFINITY, f64::min);
        let high = places.iter().map(|it| it[0]).fold(f64::NEG_INFINITY, f64::max);
        let end =
            |x: f64| [scales[0].backward(x), scales[1].backward(fit.intercept + fit.slope * x)];
        Some(Self { fit, scales, ends: [end(low), end(high)] })
    }

    fn short(&self) -> String {
        let what = match self.scales {
            [Scale::Log, Scale::Log] => "exponent",
            _ => "slope",
        };
        let decades = if self.scales == [Scale::Linear, Scale::Log] { " decades" } else { "" };
        let slope = format!("{what} {}{decades}", figures(self.fit.slope));
        format!("{slope}, R² = {:.3}", self.fit.r_squared)
    }

    /// The equation.
    fn whole(&self, [x, y]: [&str; 2]) -> String {
        let (a, b) = (self.fit.intercept, self.fit.slope);
        let equation = match self.scales {
            [Scale::Linear, Scale::Linear] => format!("{y} = {} + {} · {x}", short(a), short(b)),
            [Scale::Log, Scale::Log] => {
                format!("{y} = {} · ({x})^{}", short(10f64.powf(a)), short(b))
            }
            [Scale::Log, Scale::Linear] => {
                format!("{y} = {} + {} · log10({x})", short(a), short(b))
            }
            [Scale::Linear, Scale::Log] => {
                format!("{y} = {} · 10^({} · {x})", short(10f64.powf(a)), short(b))
            }
        };
        format!("{equation}, R² = {:.4}", self.fit.r_squared)
    }
}

/// Three significant digits.
fn figures(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&size) {
        let decimals = if value == 0.0 { 0 } else { (2 - size.log10().floor() as i32).max(0) };
        return format!("{value:.*}", decimals as usize).replace('-', "−");
    }
    format!("{value:.2e}").replace('-', "−")
}
