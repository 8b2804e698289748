//! Tables below each other, with statistics.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::table::{Column, Table, Values};

/// A number that stands for a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    Mean,
    Median,
    Min,
    Max,
    /// The standard deviation of a sample (divided by n - 1).
    Std,
}

/// Which value of a column is the best one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Best {
    Min,
    Max,
}

/// Why tables cannot be stacked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StackError {
    #[error("{n_labels} labels for {n_tables} tables")]
    Labels { n_labels: usize, n_tables: usize },
    #[error("column `{column}` holds {found} in table {table}, but {expected} before")]
    Mixed { column: String, table: usize, found: &'static str, expected: &'static str },
    #[error("column `{column}` is in `{found}` in table {table}, but in `{expected}` before")]
    Units { column: String, table: usize, found: String, expected: String },
    #[error("there is no column `{column}` to mark the best of; there are {known}")]
    NoColumn { column: String, known: String },
    #[error("column `{column}` holds texts; none of them is the best")]
    BestOfTexts { column: String },
    #[error("the tables have a column `{column}` already: name the labels otherwise")]
    LabelColumn { column: String },
}

/// Puts the rows of tables below each other. Columns are matched by name and come in the order in which
/// they are met; what a table lacks is NaN or an empty text.
///
/// # Errors
/// If a column differs in type or unit.
pub fn stack(tables: &[&Table]) -> Result<Table, StackError> {
    let mut columns: Vec<Column> = Vec::new();
    let mut n_rows = 0;
    for (index, table) in tables.iter().enumerate() {
        for column in &table.columns {
            match columns.iter_mut().find(|it| it.name == column.name) {
                Some(known) => append(known, column, index, n_rows)?,
                None => {
                    let mut first = column.clone();
                    first.values = missing(&column.values, n_rows);
                    first.marked.clear();
                    extend(&mut first.values, &column.values);
                    columns.push(first);
                }
            }
        }
        n_rows += table.n_rows();
        for column in columns.iter_mut().filter(|it| it.len() < n_rows) {
            let blanks = missing(&column.values, n_rows - column.len());
            extend(&mut column.values, &blanks);
        }
    }
    Ok(Table::new(columns))
}

fn append(
    known: &mut Column,
    column: &Column,
    table: usize,
    n_rows: usize,
) -> Result<(), StackError> {
    let name = || column.name.clone();
    let what = |values: &Values| match values {
        Values::Numbers(_) => "numbers",
        Values::Texts(_) => "texts",
    };
    let (found, expected) = (what(&column.values), what(&known.values));
    if found != expected {
        return Err(StackError::Mixed { column: name(), table, found, expected });
    }
    if column.unit != known.unit {
        let (found, expected) = (column.unit.clone(), known.unit.clone());
        return Err(StackError::Units { column: name(), table, found, expected });
    }
    debug_assert_eq!(known.len(), n_rows, "every column is filled up after each table");
    extend(&mut known.values, &column.values);
    Ok(())
}

fn missing(like: &Values, n_rows: usize) -> Values {
    match like {
        Values::Numbers(_) => Values::Numbers(vec![f64::NAN; n_rows]),
        Values::Texts(_) => Values::Texts(vec![String::new(); n_rows]),
    }
}

fn extend(values: &mut Values, more: &Values) {
    match (values, more) {
        (Values::Numbers(to), Values::Numbers(from)) => to.extend_from_slice(from),
        (Values::Texts(to), Values::Texts(from)) => to.extend_from_slice(from),
        _ => unreachable!("types are compared first"),
    }
}

/// Puts a column of labels in front: one label for all rows of each table, numbers from 1 if there are
/// none.
///
/// # Errors
/// If there are some labels, but not one a table; or if there is a column of this name.
pub fn label(
    stacked: Table,
    tables: &[&Table],
    column: &str,
    labels: &[String],
) -> Result<Table, StackError> {
    if !labels.is_empty() && labels.len() != tables.len() {
        return Err(StackError::Labels { n_labels: labels.len(), n_tables: tables.len() });
    }
    if stacked.column(column).is_some() {
        return Err(StackError::LabelColumn { column: column.to_owned() });
    }
    let texts = tables.iter().enumerate().flat_map(|(index, table)| {
        let label = labels.get(index).cloned().unwrap_or_else(|| (index + 1).to_string());
        std::iter::repeat_n(label, table.n_rows())
    });
    let mut columns = vec![Column::texts(column, texts.collect())];
    columns.extend(stacked.columns);
    Ok(Table::new(columns))
}

/// Marks the best rows of a column; all of them if several are equal. NaN is never the best.
///
/// # Errors
/// If there is no such column, or it holds texts.
pub fn mark_best(table: &mut Table, column: &str, best: Best) -> Result<(), StackError> {
    let Some(found) = table.columns.iter_mut().find(|it| it.name == column) else {
        let known: Vec<String> = table.columns.iter().map(|it| format!("`{}`", it.name)).collect();
        return Err(StackError::NoColumn { column: column.to_owned(), known: known.join(", ") });
    };
    let Values::Numbers(values) = &found.values else {
        return Err(StackError::BestOfTexts { column: column.to_owned() });
    };
    let known = values.iter().copied().filter(|it| !it.is_nan());
    let best = match best {
        Best::Min => known.reduce(f64::min),
        Best::Max => known.reduce(f64::max),
    };
    found.marked = (0..values.len()).filter(|&row| Some(values[row]) == best).collect();
    Ok(())
}

/// Adds a row for every statistic; its name goes into the first column.
///
/// Statistics leave NaN out. Text columns stay empty.
pub fn add_statistics(table: &mut Table, statistics: &[Statistic]) {
    for (index, column) in table.columns.iter_mut().enumerate() {
        match &mut column.values {
            Values::Numbers(values) => {
                let known: Vec<f64> = values.iter().copied().filter(|it| !it.is_nan()).collect();
                values.extend(statistics.iter().map(|it| it.of(&known)));
            }
            Values::Texts(texts) => texts.extend(
                statistics
                    .iter()
                    .map(|it| if index == 0 { it.name().to_owned() } else { String::new() }),
            ),
        }
    }
}

impl Statistic {
    pub fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Median => "median",
            Self::Min => "min",
            Self::Max => "max",
            Self::Std => "std",
        }
    }

    /// NaN where there are too few values.
    pub fn of(self, values: &[f64]) -> f64 {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        match self {
            Self::Mean => mean,
            Self::Median => median(values),
            Self::Min => values.iter().copied().reduce(f64::min).unwrap_or(f64::NAN),
            Self::Max => values.iter().copied().reduce(f64::max).unwrap_or(f64::NAN),
            Self::Std if values.len() < 2 => f64::NAN,
            Self::Std => {
                (values.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
            }
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[middle],
        _ => (sorted[middle - 1] + sorted[middle]) / 2.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(columns: &[(&str, &[f64])]) -> Table {
        let column =
            |&(name, values): &(&str, &[f64])| Column::numbers(name, "mm", values.to_vec());
        Table::new(columns.iter().map(column).collect())
    }

    fn numbers(table: &Table, column: &str) -> Vec<f64> {
        match &table.column(column).unwrap().values {
            Values::Numbers(values) => values.clone(),
            Values::Texts(_) => panic!("`{column}` holds texts"),
        }
    }

    #[test]
    fn columns_are_matched_by_name_and_missing_values_are_nan() {
        let (first, second) =
            (table(&[("a", &[1.0])]), table(&[("b", &[2.0, 4.0]), ("a", &[3.0, 5.0])]));
        let stacked = stack(&[&first, &second]).unwrap();
        assert_eq!(numbers(&stacked, "a"), [1.0, 3.0, 5.0]);
        assert!(numbers(&stacked, "b")[0].is_nan());
        assert_eq!(numbers(&stacked, "b")[1..], [2.0, 4.0]);
        let labels = ["adult".to_owned(), "child".to_owned()];
        let labelled = label(stacked, &[&first, &second], "shape", &labels).unwrap();
        let texts = ["adult", "child", "child"].map(str::to_owned).to_vec();
        assert_eq!(labelled.columns[0].values, Values::Texts(texts));
    }

    #[test]
    fn statistics_leave_missing_values_out_and_are_never_the_best() {
        let mut stacked = table(&[("a", &[2.0, f64::NAN, 4.0, 2.0])]);
        mark_best(&mut stacked, "a", Best::Min).unwrap();
        add_statistics(&mut stacked, &[Statistic::Mean, Statistic::Min, Statistic::Std]);
        let values = numbers(&stacked, "a");
        assert!((values[4] - 8.0 / 3.0).abs() < 1e-12);
        assert_eq!(values[5], 2.0);
        assert!((values[6] - (4.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(stacked.columns[0].marked, [0, 3]);
        assert_eq!(Statistic::Median.of(&[3.0, 1.0, 2.0, 10.0]), 2.5);
        assert!(Statistic::Std.of(&[1.0]).is_nan() && Statistic::Mean.of(&[]).is_nan());
    }

    #[test]
    fn errors_name_the_column_and_both_sides() {
        let (metres, texts) = (
            Table::new(vec![Column::numbers("a", "m", vec![1.0])]),
            Table::new(vec![Column::texts("a", vec!["x".to_owned()])]),
        );
        let first = table(&[("a", &[1.0])]);
        let error = stack(&[&first, &metres]).unwrap_err().to_string();
        assert_eq!(error, "column `a` is in `m` in table 1, but in `mm` before");
        let error = stack(&[&first, &texts]).unwrap_err().to_string();
        assert_eq!(error, "column `a` holds texts in table 1, but numbers before");
        let error = mark_best(&mut first.clone(), "b", Best::Min).unwrap_err().to_string();
        assert_eq!(error, "there is no column `b` to mark the best of; there are `a`");
    }
}
