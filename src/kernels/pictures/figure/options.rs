//! What is drawn of a table, and how.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::axis::Scale;
use crate::kernels::table::TableError;

/// The styles of figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// Lines of `y` over numbers `x`. Rows of one `x` are averaged, with a band about the mean.
    Curve,
    /// For every value of `x`, the share of rows that have at most this value.
    Cdf,
    /// Bars of `y` for each value of `x`. Rows of one `x` are averaged, with a whisker.
    Bars,
    /// A dot a row at `x` and `y`.
    Scatter,
    /// The quartiles of `y` for each value of `x`: box and median, whiskers to the farthest values within
    /// 1.5 heights of the box, dots beyond.
    Box,
}

/// What is shown about the mean of several rows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// From the least to the greatest value.
    #[default]
    Range,
    /// One standard deviation to each side.
    Std,
    /// Nothing.
    None,
}

/// Where the names of the groups are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Legend {
    /// In a corner that is free, or else beside the axes.
    #[default]
    Auto,
    /// Beside the axes.
    Right,
    /// Nowhere.
    None,
}

/// A line at a known value, such as a paper's number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceLine {
    /// The value, for an upright line.
    #[serde(default)]
    pub x: Option<f64>,
    /// The value, for a level line.
    #[serde(default)]
    pub y: Option<f64>,
    /// Written at the line.
    #[serde(default)]
    pub label: String,
}

#[derive(Debug, Clone)]
pub struct FigureOptions {
    pub style: Style,
    /// Names of columns.
    pub x: Option<String>,
    pub y: Vec<String>,
    pub group: Option<String>,
    pub x_scale: Scale,
    pub y_scale: Scale,
    pub x_range: Option<[f64; 2]>,
    pub y_range: Option<[f64; 2]>,
    /// Instead of the columns' names and units.
    pub x_label: Option<String>,
    pub y_label: Option<String>,
    pub title: String,
    pub band: Band,
    /// A line through the dots of each group.
    pub fit: bool,
    pub lines: Vec<ReferenceLine>,
    pub legend: Legend,
    pub width: usize,
    pub height: usize,
}

impl FigureOptions {
    pub fn new(style: Style) -> Self {
        Self {
            style,
            x: None,
            y: Vec::new(),
            group: None,
            x_scale: Scale::default(),
            y_scale: Scale::default(),
            x_range: None,
            y_range: None,
            x_label: None,
            y_label: None,
            title: String::new(),
            band: Band::default(),
            fit: false,
            lines: Vec::new(),
            legend: Legend::default(),
            width: 480,
            height: 320,
        }
    }

    /// Checks what can be known without a table.
    ///
    /// # Errors
    /// What is missing, or belongs to another style; the parameters in backticks.
    pub fn check(&self) -> Result<(), String> {
        let style = self.style.name();
        let is = |styles: &[Style]| styles.contains(&self.style);
        let by_number = is(&[Style::Curve, Style::Cdf, Style::Scatter]);
        let needs_x = !is(&[Style::Box]);
        let needs_y = !is(&[Style::Cdf]);
        if needs_x && self.x.is_none() {
            return Err(format!("figure \"{style}\" needs `x`, the name of a column"));
        }
        if needs_y && self.y.is_empty() {
            return Err(format!("figure \"{style}\" needs `y`, the name of a column"));
        }
        let strangers = [
            (!needs_y && !self.y.is_empty(), "y"),
            (!by_number && self.x_scale != Scale::Linear, "x_scale"),
            (!by_number && self.x_range.is_some(), "x_range"),
            (!needs_y && self.y_scale != Scale::Linear, "y_scale"),
            (self.fit && self.style != Style::Scatter, "fit"),
            (self.band != Band::default() && !is(&[Style::Curve, Style::Bars]), "band"),
        ];
        if let Some((_, name)) = strangers.iter().find(|it| it.0) {
            return Err(format!("`{name}` does not belong to the figure \"{style}\""));
        }
        check_range("x", self.x_range, self.x_scale)?;
        check_range("y", self.y_range, self.y_scale)?;
        for (index, line) in self.lines.iter().enumerate() {
            let scale = match (line.x, line.y) {
                (Some(x), None) if by_number => (x, self.x_scale),
                (None, Some(y)) => (y, self.y_scale),
                (Some(_), None) => {
                    return Err(format!(
                        "`lines[{index}].x`: figure \"{style}\" has no numbers at x"
                    ));
                }
                _ => return Err(format!("`lines[{index}]` needs either `x` or `y`")),
            };
            if !scale.1.shows(scale.0) {
                return Err(format!("`lines[{index}]`: {} has no place on the axis", scale.0));
            }
        }
        Ok(())
    }
}

fn check_range(axis: &str, range: Option<[f64; 2]>, scale: Scale) -> Result<(), String> {
    match range {
        Some([low, high]) if low >= high || !(high - low).is_finite() => {
            Err(format!("`{axis}_range` goes from {low} to {high}"))
        }
        Some([low, _]) if !scale.shows(low) => {
            Err(format!("`{axis}_range` begins at {low}, which a logarithmic axis cannot show"))
        }
        _ => Ok(()),
    }
}

impl Style {
    pub fn name(self) -> &'static str {
        match self {
            Self::Curve => "curve",
            Self::Cdf => "cdf",
            Self::Bars => "bars",
            Self::Scatter => "scatter",
            Self::Box => "box",
        }
    }
}

/// Why there is no figure.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FigureError {
    #[error(transparent)]
    Table(#[from] TableError),
    #[error("there is nothing to draw: no row has numbers in {columns}")]
    Nothing { columns: String },
    #[error(
        "`{first}` is in `{first_unit}`, but `{second}` in `{second_unit}`: one axis cannot show both"
    )]
    Units { first: String, first_unit: String, second: String, second_unit: String },
    #[error("{n_groups} groups are too many to be told apart: a figure shows {most}")]
    TooManyGroups { n_groups: usize, most: usize },
    #[error("{width} x {height} is too small for this figure's axes, labels and legend")]
    TooSmall { width: usize, height: usize },
    #[error("{what} of a figure is {size}, not from {least} to {most}")]
    Size { what: &'static str, size: usize, least: usize, most: usize },
}
