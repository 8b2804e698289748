//! Which rows of a table are pointed out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Table, TableError};

/// Which value of a column is the best one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Best {
    Min,
    Max,
}

/// Among which cells of a pivot the best one is looked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BestIn {
    /// Those of each column.
    #[default]
    Column,
    /// Those of each row.
    Row,
}

/// Marks the best of some columns' values in each row; all of them if several are equal.
///
/// # Errors
/// If there is no such column, or it holds texts.
pub fn mark_best_in_rows(
    table: &mut Table,
    columns: &[String],
    best: Best,
) -> Result<(), TableError> {
    let n_rows = table.n_data_rows();
    let indices: Vec<usize> = columns.iter().map(|it| table.find(it)).collect::<Result<_, _>>()?;
    let values: Vec<Vec<f64>> = columns
        .iter()
        .map(|it| Ok(table.numbers(it, "the best of it")?[..n_rows].to_vec()))
        .collect::<Result<_, TableError>>()?;
    for row in 0..n_rows {
        let found = best.of(values.iter().map(|it| it[row]));
        for (&index, _) in indices.iter().zip(&values).filter(|it| Some(it.1[row]) == found) {
            table.columns[index].marked.push(row);
        }
    }
    Ok(())
}

impl Best {
    /// The best of all values but the missing ones.
    fn of(self, values: impl Iterator<Item = f64>) -> Option<f64> {
        let known = values.filter(|it| !it.is_nan());
        match self {
            Self::Min => known.reduce(f64::min),
            Self::Max => known.reduce(f64::max),
        }
    }
}

/// Marks the best rows of a column; all of them if several are equal. Neither NaN nor a statistic is the
/// best.
///
/// # Errors
/// If there is no such column, or it holds texts.
pub fn mark_best(table: &mut Table, column: &str, best: Best) -> Result<(), TableError> {
    let n_rows = table.n_data_rows();
    let values = &table.numbers(column, "the best of it")?[..n_rows];
    let found = best.of(values.iter().copied());
    let marked = (0..n_rows).filter(|&row| Some(values[row]) == found).collect();
    let index = table.find(column)?;
    table.columns[index].marked = marked;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::table;
    use super::*;

    #[test]
    fn the_best_of_each_row_may_be_in_any_column() {
        let nan = f64::NAN;
        let mut data = table(&[("a", &[2.0, nan, 4.0, nan]), ("b", &[1.0, 3.0, 4.0, nan])]);
        let columns = ["a".to_owned(), "b".to_owned()];
        mark_best_in_rows(&mut data, &columns, Best::Min).unwrap();
        assert_eq!(data.columns[0].marked, [2]);
        assert_eq!(data.columns[1].marked, [0, 1, 2]);
    }

    #[test]
    fn all_equal_rows_are_the_best_and_statistics_never() {
        let mut data = table(&[("a", &[2.0, f64::NAN, 4.0, 2.0, 1.0])]);
        data.n_statistics = 1;
        mark_best(&mut data, "a", Best::Min).unwrap();
        assert_eq!(data.columns[0].marked, [0, 3]);
        mark_best(&mut data, "a", Best::Max).unwrap();
        assert_eq!(data.columns[0].marked, [2]);
        let error = mark_best(&mut data, "b", Best::Max).unwrap_err().to_string();
        assert_eq!(error, "there is no column `b`; there are `a`");
    }
}
