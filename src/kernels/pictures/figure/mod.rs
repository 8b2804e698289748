//! Figures of papers, drawn from tables.
//!
//! A figure is made in three steps: the rows of a table become groups of points (`series`); a style makes
//! layers of them in the units of the data (its own file each); axes, labels and legend are laid out around
//! these, and everything becomes a scene of few kinds of marks. SVG and PNG are both drawn from the scene.

mod axis;
mod bars;
mod boxes;
mod cdf;
mod clip;
mod content;
mod curve;
mod draw;
mod fit;
mod layout;
mod legend;
mod measure;
mod options;
mod palette;
mod png;
mod scatter;
mod scene;
mod series;
mod svg;

pub use axis::Scale;
pub use options::{Band, FigureError, FigureOptions, Legend, ReferenceLine, Style};
pub use png::draw_png;
pub use scene::{Figure, Look, Mark, Point};
pub use svg::write_svg;

use self::content::Content;
use self::draw::{Labels, draw};
use self::series::{Data, Wanted};
use crate::kernels::table::{Table, TableError};

/// A figure, and what its reader should know: rows that were left out, fitted lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    pub figure: Figure,
    pub notes: Vec<String>,
}

/// Draws the rows of a table. Rows of statistics are left out.
///
/// # Errors
/// See [`FigureError`]. Options are to be checked before ([`FigureOptions::check`]).
pub fn draw_figure(table: &Table, options: &FigureOptions) -> Result<Drawn, FigureError> {
    for (what, size) in [("width", options.width), ("height", options.height)] {
        if !Figure::SIZES.contains(&size) {
            let (least, most) = (*Figure::SIZES.start(), *Figure::SIZES.end());
            return Err(FigureError::Size { what, size, least, most });
        }
    }
    let data = series::read(table, &wanted(options), options)?;
    let content = content(&data, options);
    let labels = labels(table, options)?;
    let (figure, more) = draw(&data, &content, &labels, options)?;
    let notes = [data.notes, content.notes, more].concat();
    Ok(Drawn { figure, notes })
}

fn wanted(options: &FigureOptions) -> Wanted<'_> {
    let x = options.x.as_deref();
    let y = options.y.iter().map(String::as_str);
    match options.style {
        Style::Curve | Style::Scatter => Wanted { x, categories: false, y: y.collect() },
        // Its values lie along x, and every row has the same height.
        Style::Cdf => Wanted { x: None, categories: true, y: x.into_iter().collect() },
        Style::Bars | Style::Box => Wanted { x, categories: true, y: y.collect() },
    }
}

fn content(data: &Data, options: &FigureOptions) -> Content {
    match options.style {
        Style::Curve => curve::curves(data, options),
        Style::Cdf => cdf::cdfs(data),
        Style::Bars => bars::bars(data, options),
        Style::Scatter => scatter::scatter(data, options),
        Style::Box => boxes::boxes(data),
    }
}

/// Names with units, where no other label is given.
fn labels(table: &Table, options: &FigureOptions) -> Result<Labels, TableError> {
    let head = |name: &str| Ok(table.columns[table.find(name)?].head());
    let x = match (&options.x_label, &options.x) {
        (Some(label), _) => label.clone(),
        (None, Some(name)) => head(name)?,
        (None, None) => String::new(),
    };
    let y = match (&options.y_label, &options.y[..]) {
        (Some(label), _) => label.clone(),
        (None, [name]) => head(name)?,
        (None, []) => "share of rows [%]".to_owned(),
        (None, [first, ..]) => match table.columns[table.find(first)?].unit.as_str() {
            "" => String::new(),
            unit => format!("[{unit}]"),
        },
    };
    Ok(Labels { x, y })
}

#[cfg(test)]
mod tests;
