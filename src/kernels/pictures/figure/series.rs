//! From the rows of a table to groups of points.

use indexmap::IndexMap;

use super::options::{Band, FigureError, FigureOptions};
use super::palette::MOST_GROUPS;
use crate::kernels::table::{Column, Statistic, Table, Values};

/// The rows of one group: one curve, one colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Empty if there is only one group.
    pub name: String,
    pub rows: Vec<Row>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub x: X,
    pub y: f64,
}

/// A number, or the place of a name in a list of categories.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum X {
    Number(f64),
    Category(usize),
}

impl Row {
    /// The place along x; categories are a unit apart and begin at zero.
    pub fn place(&self) -> f64 {
        match self.x {
            X::Number(x) => x,
            X::Category(index) => index as f64 + 0.5,
        }
    }
}

/// Everything that a figure shows of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Data {
    /// Groups in the order in which they are met; none is empty.
    pub series: Vec<Series>,
    /// Names along x, if it is not an axis of numbers.
    pub categories: Vec<String>,
    /// What was left out.
    pub notes: Vec<String>,
}

/// Which columns are read.
pub struct Wanted<'a> {
    /// Values along x; with `categories`, names.
    pub x: Option<&'a str>,
    pub categories: bool,
    /// Columns of values; each is a group of its own if there are several.
    pub y: Vec<&'a str>,
}

/// Reads the rows that can be drawn, and says which cannot.
///
/// # Errors
/// If a column is missing, holds texts instead of numbers, or differs in unit; if nothing is left, or there
/// are too many groups.
pub fn read(
    table: &Table,
    wanted: &Wanted<'_>,
    options: &FigureOptions,
) -> Result<Data, FigureError> {
    let table = table.data();
    let n_rows = table.n_rows();
    check_units(&table, &wanted.y)?;
    let (x, categories) = match wanted.x {
        Some(column) if wanted.categories => categories(&table, column)?,
        Some(column) => {
            let numbers = table.numbers(column, "an axis of numbers")?;
            (numbers.iter().map(|&it| X::Number(it)).collect(), Vec::new())
        }
        None => (vec![X::Category(0); n_rows], vec![String::new()]),
    };
    let group = options.group.as_deref().map(|it| table.find(it)).transpose()?;
    let mut notes = Vec::new();
    let mut groups: IndexMap<String, Vec<Row>> = IndexMap::new();
    for &column in &wanted.y {
        let values = table.numbers(column, "a figure")?;
        let mut n_left_out = 0;
        for row in 0..n_rows {
            let group = group.map(|it| group_name(&table.columns[it], row));
            let name = match (group, wanted.y.len()) {
                (Some(group), 1) => group,
                (Some(group), _) => format!("{group}, {column}"),
                (None, 1) => String::new(),
                (None, _) => column.to_owned(),
            };
            let rows = groups.entry(name).or_default();
            let has_x = match x[row] {
                X::Number(x) => options.x_scale.shows(x),
                X::Category(_) => true,
            };
            if has_x && options.y_scale.shows(values[row]) {
                rows.push(Row { x: x[row], y: values[row] });
            } else {
                n_left_out += 1;
            }
        }
        if n_left_out > 0 {
            let why = "a number is missing or has no place on its axis";
            notes.push(format!("{n_left_out} of {n_rows} rows of `{column}` are not drawn: {why}"));
        }
    }
    groups.retain(|_, rows| !rows.is_empty());
    if groups.is_empty() {
        let columns: Vec<String> = (wanted.x.iter().filter(|_| !wanted.categories))
            .chain(&wanted.y)
            .map(|it| format!("`{it}`"))
            .collect();
        return Err(FigureError::Nothing { columns: columns.join(" and ") });
    }
    if groups.len() > MOST_GROUPS {
        return Err(FigureError::TooManyGroups { n_groups: groups.len(), most: MOST_GROUPS });
    }
    let series = groups.into_iter().map(|(name, rows)| Series { name, rows }).collect();
    Ok(Data { series, categories, notes })
}

/// A text by itself; a number with what it is a number of.
fn group_name(column: &Column, row: usize) -> String {
    let text = column.values.text(row);
    match &column.values {
        Values::Texts(_) => text.into_owned(),
        Values::Numbers(values) if values[row].is_nan() => format!("no {}", column.name),
        Values::Numbers(_) if column.unit.is_empty() => format!("{} = {text}", column.name),
        Values::Numbers(_) => format!("{} = {text} {}", column.name, column.unit),
    }
}

fn check_units(table: &Table, columns: &[&str]) -> Result<(), FigureError> {
    let units: Vec<(&str, &str)> = columns
        .iter()
        .map(|it| Ok((*it, table.columns[table.find(it)?].unit.as_str())))
        .collect::<Result<_, FigureError>>()?;
    match units.iter().find(|it| it.1 != units[0].1) {
        Some(&(second, second_unit)) => Err(FigureError::Units {
            first: units[0].0.to_owned(),
            first_unit: units[0].1.to_owned(),
            second: second.to_owned(),
            second_unit: second_unit.to_owned(),
        }),
        None => Ok(()),
    }
}

/// The names in a column, and the place of each row's name among them.
fn categories(table: &Table, column: &str) -> Result<(Vec<X>, Vec<String>), FigureError> {
    let column = &table.columns[table.find(column)?];
    let mut names: IndexMap<String, ()> = IndexMap::new();
    let of_row = |row: usize| {
        let name = match &column.values {
            Values::Numbers(values) if values[row].is_nan() => "missing".to_owned(),
            values => values.text(row).into_owned(),
        };
        X::Category(names.insert_full(name, ()).0)
    };
    let rows = (0..table.n_rows()).map(of_row).collect();
    Ok((rows, names.into_keys().collect()))
}

/// Rows of one place: the place, their mean, and the ends of a band about it (at the mean without one).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Averaged {
    pub x: f64,
    pub mean: f64,
    pub low: f64,
    pub high: f64,
    pub n: usize,
}

/// The rows of a series, averaged by place, from left to right.
pub fn averaged(series: &Series, band: Band) -> Vec<Averaged> {
    let mut rows: Vec<(f64, f64)> = series.rows.iter().map(|it| (it.place(), it.y)).collect();
    // A stable sort: equal places keep the order of the table, and the sum is the same.
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let average = |rows: &[(f64, f64)]| {
        let values: Vec<f64> = rows.iter().map(|it| it.1).collect();
        let mean = Statistic::Mean.of(&values);
        let (low, high) = match band {
            Band::Range => (Statistic::Min.of(&values), Statistic::Max.of(&values)),
            Band::Std if values.len() > 1 => {
                let std = Statistic::Std.of(&values);
                (mean - std, mean + std)
            }
            Band::Std | Band::None => (mean, mean),
        };
        Averaged { x: rows[0].0, mean, low, high, n: values.len() }
    };
    rows.chunk_by(|a, b| a.0 == b.0).map(average).collect()
}
