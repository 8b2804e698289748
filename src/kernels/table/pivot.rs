//! One label down, another across: the form of a paper's table.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{BestIn, Column, Statistic, Table, TableError, Values, group::groups};

/// Which columns become the rows, the columns and the cells of a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pivot {
    /// The column whose values name the rows, such as the method.
    pub rows: String,
    /// The column whose values name the columns, such as the data set.
    pub columns: String,
    /// The column of numbers that fills the cells.
    pub value: String,
    /// What a cell holds, of all values that belong to it.
    #[serde(default = "mean")]
    pub statistic: Statistic,
    /// With `best` of the value: where the best cells are looked for.
    #[serde(default)]
    pub best_in: BestIn,
}

fn mean() -> Statistic {
    Statistic::Mean
}

/// Makes a table with one row for every value of a column and one column for every value of another, both
/// in the order in which they are met.
///
/// Cells without a value are missing. If values are missing, a last column `missing` counts them by row:
/// a mean of what is left does not look whole.
///
/// # Errors
/// If there is no such column, or the cells would be texts, or two columns would have the same name.
pub fn pivot(table: &Table, pivot: &Pivot) -> Result<Table, TableError> {
    let (down, across) = (table.find(&pivot.rows)?, table.find(&pivot.columns)?);
    let values = table.numbers(&pivot.value, "a pivot")?;
    let cell_look = &table.columns[table.find(&pivot.value)?];
    let (down, across) = (groups(table, &[down]), groups(table, &[across]));
    let column_of = places(&across, table.n_data_rows());
    let names = &table.columns[table.find(&pivot.columns)?];
    let head = &table.columns[table.find(&pivot.rows)?];
    let firsts: Vec<usize> = down.iter().map(|it| it[0]).collect();

    let mut columns = vec![head.with_values(head.values.rows(&firsts))];
    for (index, rows) in across.iter().enumerate() {
        let cell = |down: &Vec<usize>| {
            let own = down.iter().filter(|&&row| column_of[row] == index);
            pivot.statistic.of(&own.map(|&row| values[row]).collect::<Vec<_>>())
        };
        let cells = Values::Numbers(down.iter().map(cell).collect());
        let name = names.values.text(rows[0]).into_owned();
        columns.push(Column { name, ..cell_look.with_values(cells) });
    }
    let n_missing: Vec<f64> = down
        .iter()
        .map(|rows| Statistic::Missing.of(&rows.iter().map(|&it| values[it]).collect::<Vec<_>>()))
        .collect();
    if n_missing.iter().any(|&it| it > 0.0) {
        columns.push(Column::numbers("missing", "", n_missing));
    }
    Table::new(columns).with_distinct_names()
}

/// The group of every row.
fn places(groups: &[Vec<usize>], n_rows: usize) -> Vec<usize> {
    let mut res = vec![0; n_rows];
    for (group, rows) in groups.iter().enumerate() {
        for &row in rows {
            res[row] = group;
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{names, numbers_of, table, texts, texts_of};
    use super::*;

    fn by(value: &str) -> Pivot {
        Pivot {
            rows: "method".to_owned(),
            columns: "set".to_owned(),
            value: value.to_owned(),
            statistic: Statistic::Mean,
            best_in: BestIn::Column,
        }
    }

    fn measured(errors: &[f64]) -> Table {
        let mut res = table(&[("error", errors)]);
        res.columns.push(texts("method", &["ours", "ours", "ours", "theirs", "theirs"]));
        res.columns.push(texts("set", &["people", "people", "animals", "animals", "people"]));
        res.columns[0].unit = "%".to_owned();
        res
    }

    #[test]
    fn methods_stand_against_data_sets() {
        let res = pivot(&measured(&[1.0, 3.0, 5.0, 7.0, 9.0]), &by("error")).unwrap();
        assert_eq!(names(&res), ["method", "people", "animals"]);
        assert_eq!(texts_of(&res, "method"), ["ours", "theirs"]);
        assert_eq!(numbers_of(&res, "people"), [2.0, 9.0]);
        assert_eq!(numbers_of(&res, "animals"), [5.0, 7.0]);
        assert_eq!(res.columns[1].unit, "%");
    }

    #[test]
    fn what_is_missing_is_counted() {
        let mut data = measured(&[1.0, f64::NAN, 5.0, 7.0, 9.0]);
        let res = pivot(&data, &by("error")).unwrap();
        assert_eq!(numbers_of(&res, "people"), [1.0, 9.0]);
        assert_eq!(numbers_of(&res, "missing"), [1.0, 0.0]);
        data = data.rows(&[0, 3]);
        let res = pivot(&data, &by("error")).unwrap();
        assert!(numbers_of(&res, "people")[1].is_nan(), "no value at all");
    }

    #[test]
    fn texts_fill_no_cells() {
        let error = pivot(&measured(&[0.0; 5]), &by("set")).unwrap_err().to_string();
        assert_eq!(error, "column `set` holds texts, but a pivot needs numbers");
    }
}
