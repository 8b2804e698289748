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

/// Marks the best rows of a column; all of them if several are equal. Neither NaN nor a statistic is the
/// best.
///
/// # Errors
/// If there is no such column, or it holds texts.
pub fn mark_best(table: &mut Table, column: &str, best: Best) -> Result<(), TableError> {
    let n_rows = table.n_data_rows();
    let values = &table.numbers(column, "the best of it")?[..n_rows];
    let known = values.iter().copied().filter(|it| !it.is_nan());
    let best = match best {
        Best::Min => known.reduce(f64::min),
        Best::Max => known.reduce(f64::max),
    };
    let marked = (0..n_rows).filter(|&row| Some(values[row]) == best).collect();
    let index = table.find(column)?;
    table.columns[index].marked = marked;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::table;
    use super::*;

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
