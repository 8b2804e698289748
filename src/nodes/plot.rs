//! Kind `plot`.

use std::sync::Arc;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Labelled, LabelledInputs, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::pictures::figure::{
    Band, Figure, FigureOptions, Legend, ReferenceLine, Scale, Style, draw_figure,
};
use crate::kernels::table::{Condition, Part, Table, select_rows, stack};

/// Draws the rows of tables as a figure of a paper.
///
/// Columns are given by name; their units go into the labels. Axes that are gathered (`over`) are columns
/// too, to be used as `x` or `group`. Rows of statistics that a `table` added are
/// not drawn, and rows with a missing number are left out and counted in a note. The figure is
/// written as `.svg` (with texts as texts) and `.png` (two pixels a unit), on white.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plot {
    /// The style.
    pub figure: Style,
    /// The column along x: numbers for `curve`, `scatter` and `cdf`, names for `bars` and `box`.
    #[serde(default)]
    pub x: Option<String>,
    /// The column of values along y, or several of one unit. Not for `cdf`.
    #[serde(default)]
    pub y: Names,
    /// A column: one colour for each of its values.
    #[serde(default)]
    pub group: Option<String>,
    /// `curve`, `scatter`, `cdf`: how x is spread.
    #[serde(default)]
    pub x_scale: Scale,
    /// How y is spread. Not for `cdf`.
    #[serde(default)]
    pub y_scale: Scale,
    /// `curve`, `scatter`, `cdf`: the ends of the axis; what is beyond is cut off.
    #[serde(default)]
    pub x_range: Option<(f64, f64)>,
    /// The ends of the upright axis; what is beyond is cut off.
    #[serde(default)]
    pub y_range: Option<(f64, f64)>,
    /// `curve`, `bars`: what is shown about the mean of several rows.
    #[serde(default)]
    pub band: Band,
    /// `scatter`: draws the line with the least squares through the dots of each group, with its slope and
    /// R²; on two logarithmic axes the slope is the exponent.
    #[serde(default)]
    pub fit: bool,
    /// Lines to compare with: `[{ y = 0.021, label = "paper" }]`.
    #[serde(default)]
    pub lines: Vec<ReferenceLine>,
    /// Keeps the rows that have, in every column named here, this value or one of these:
    /// `{ k = 60, shape = ["horse", "cow"] }`.
    #[serde(default, rename = "where")]
    #[schemars(with = "std::collections::BTreeMap<String, Condition>")]
    pub conditions: IndexMap<String, Condition>,
    /// Above the axes.
    #[serde(default)]
    pub title: String,
    /// Instead of the column's name and unit.
    #[serde(default)]
    pub x_label: Option<String>,
    /// Instead of the column's name and unit.
    #[serde(default)]
    pub y_label: Option<String>,
    /// Where the names of the groups are.
    #[serde(default)]
    pub legend: Legend,
    /// Units of the figure: pixels of a screen.
    #[serde(default = "default_width")]
    #[schemars(range(min = 160, max = 4096))]
    pub width: usize,
    /// Units of the figure.
    #[serde(default = "default_height")]
    #[schemars(range(min = 120, max = 4096))]
    pub height: usize,
    /// What the rows of each table are called, to be used as `group` or `x`; several tables have numbers
    /// from 1 if there are none.
    #[serde(default)]
    pub labels: Vec<String>,
    /// The name of the column of labels.
    #[serde(default = "default_label_column")]
    pub label_column: String,
}

/// One name or several.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Names {
    One(String),
    Several(Vec<String>),
}

impl Default for Names {
    fn default() -> Self {
        Self::Several(Vec::new())
    }
}

fn default_width() -> usize {
    FigureOptions::new(Style::Curve).width
}

fn default_height() -> usize {
    FigureOptions::new(Style::Curve).height
}

fn default_label_column() -> String {
    "item".to_owned()
}

impl Plot {
    const ROWS: LabelledInputs<Table> =
        LabelledInputs::new("rows", "the tables; their rows are put together");
    const FIGURE: Output<Figure> = Output::new("figure", "the drawing");

    fn options(&self) -> FigureOptions {
        FigureOptions {
            style: self.figure,
            x: self.x.clone(),
            y: match &self.y {
                Names::One(name) => vec![name.clone()],
                Names::Several(names) => names.clone(),
            },
            group: self.group.clone(),
            x_scale: self.x_scale,
            y_scale: self.y_scale,
            x_range: self.x_range.map(|it| [it.0, it.1]),
            y_range: self.y_range.map(|it| [it.0, it.1]),
            x_label: self.x_label.clone(),
            y_label: self.y_label.clone(),
            title: self.title.clone(),
            band: self.band,
            fit: self.fit,
            lines: self.lines.clone(),
            legend: self.legend,
            width: self.width,
            height: self.height,
        }
    }
}

impl Node for Plot {
    const SPEC: Spec = Spec {
        kind: "plot",
        version: 1,
        inputs: &[Self::ROWS.port()],
        outputs: &[Self::FIGURE.port()],
        cites: &[],
        example: r#"[nodes.errors]
kind = "table_file"
path = "errors.csv"

[nodes.comparison]
kind = "plot"
rows = "@errors"
figure = "bars"
x = "shape"
y = "error"
group = "method"
lines = [{ y = 4.0, label = "paper" }]
"#,
    };

    fn validate(&self) -> Result<(), String> {
        self.options().check()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let gathered = io.get_labelled(Self::ROWS);
        let parts = gathered.iter().map(part).collect();
        let rows = stack(&Part::named(parts, &self.labels, &self.label_column)?)?;
        let drawn = draw_figure(&select_rows(rows, &self.conditions)?, &self.options())?;
        for note in drawn.notes {
            io.note(note);
        }
        io.put(Self::FIGURE, drawn.figure);
        Ok(())
    }
}

/// A gathered table with the items of the axes that it belongs to.
fn part(gathered: &Labelled<Table>) -> Part<'_> {
    let label = |(axis, item): &(Arc<str>, Arc<str>)| (axis.to_string(), item.to_string());
    Part {
        labels: gathered.labels.iter().map(label).collect(),
        table: gathered.value.as_deref().map_err(|why| why.to_string()),
    }
}
