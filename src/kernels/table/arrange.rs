//! The order, names and look of rows and columns.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Table, TableError, Values};

/// The direction of an order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// The least first.
    #[default]
    Ascending,
    /// The greatest first.
    Descending,
}

/// Sorts the rows by columns, the first one first; what is equal keeps its order, and missing values come
/// last. Statistics stay below; marks are dropped.
///
/// # Errors
/// If there is no such column.
pub fn sort(table: &Table, by: &[String], order: Order) -> Result<Table, TableError> {
    let columns: Vec<usize> = by.iter().map(|it| table.find(it)).collect::<Result<_, _>>()?;
    let mut rows: Vec<usize> = (0..table.n_data_rows()).collect();
    for &column in columns.iter().rev() {
        match &table.columns[column].values {
            Values::Numbers(values) => rows.sort_by(|&a, &b| {
                let missing = values[a].is_nan().cmp(&values[b].is_nan());
                missing.then(directed(values[a].total_cmp(&values[b]), order))
            }),
            Values::Texts(values) => rows.sort_by(|&a, &b| {
                let missing = values[a].is_empty().cmp(&values[b].is_empty());
                missing.then(directed(values[a].cmp(&values[b]), order))
            }),
        }
    }
    rows.extend(table.n_data_rows()..table.n_rows());
    let mut res = table.rows(&rows);
    res.n_statistics = table.n_statistics;
    Ok(res)
}

fn directed(ordering: std::cmp::Ordering, order: Order) -> std::cmp::Ordering {
    match order {
        Order::Ascending => ordering,
        Order::Descending => ordering.reverse(),
    }
}

/// Keeps some columns, in this order.
///
/// # Errors
/// If there is no such column, or one is named twice.
pub fn select_columns(table: Table, names: &[String]) -> Result<Table, TableError> {
    let chosen: Vec<usize> = names.iter().map(|it| table.find(it)).collect::<Result<_, _>>()?;
    let columns = chosen.iter().map(|&it| table.columns[it].clone()).collect();
    Table { columns, ..table }.with_distinct_names()
}

/// Gives columns other names.
///
/// # Errors
/// If there is no such column, or two would have the same name.
pub fn rename<'a>(
    mut table: Table,
    names: impl IntoIterator<Item = (&'a String, &'a String)>,
) -> Result<Table, TableError> {
    let names: Vec<(usize, &String)> = names
        .into_iter()
        .map(|(from, to)| Ok((table.find(from)?, to)))
        .collect::<Result<_, TableError>>()?;
    for (index, name) in names {
        table.columns[index].name.clone_from(name);
    }
    table.with_distinct_names()
}

/// Sets how many digits after the point people are shown of a column.
///
/// # Errors
/// If there is no such column, or it holds texts.
pub fn set_decimals(table: &mut Table, column: &str, decimals: u8) -> Result<(), TableError> {
    table.numbers(column, "`decimals`")?;
    let index = table.find(column)?;
    table.columns[index].decimals = Some(decimals);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{names, numbers_of, table, texts, texts_of};
    use super::*;

    fn owned(names: &[&str]) -> Vec<String> {
        names.iter().map(|&it| it.to_owned()).collect()
    }

    #[test]
    fn rows_are_sorted_by_several_columns_and_missing_ones_are_last() {
        let mut data = table(&[("a", &[3.0, f64::NAN, 1.0, 3.0]), ("b", &[2.0, 1.0, 1.0, 1.0])]);
        data.columns.push(texts("c", &["x", "y", "z", "w"]));
        let sorted = |by: &[&str], order| texts_of(&sort(&data, &owned(by), order).unwrap(), "c");
        assert_eq!(sorted(&["a", "b"], Order::Ascending), ["z", "w", "x", "y"]);
        assert_eq!(sorted(&["a"], Order::Descending), ["x", "w", "z", "y"]);
        assert_eq!(sorted(&["c"], Order::Descending), ["z", "y", "x", "w"]);
    }

    #[test]
    fn statistics_stay_below() {
        let mut data = table(&[("a", &[3.0, 1.0, 2.0])]);
        data.n_statistics = 1;
        let res = sort(&data, &owned(&["a"]), Order::Ascending).unwrap();
        assert_eq!((numbers_of(&res, "a"), res.n_statistics), (vec![1.0, 3.0, 2.0], 1));
    }

    #[test]
    fn columns_are_chosen_and_named() {
        let data = table(&[("a", &[1.0]), ("b", &[2.0]), ("c", &[3.0])]);
        let chosen = select_columns(data, &owned(&["c", "a"])).unwrap();
        // Names are looked up before any is changed: two columns may swap theirs.
        let pairs = [("a".to_owned(), "c".to_owned()), ("c".to_owned(), "a".to_owned())];
        let res = rename(chosen, pairs.iter().map(|it| (&it.0, &it.1))).unwrap();
        assert_eq!(names(&res), ["a", "c"]);
        assert_eq!(numbers_of(&res, "a"), [3.0]);
        let error = rename(res, [(&pairs[0].0, &pairs[0].1)]).unwrap_err().to_string();
        assert_eq!(error, "there would be two columns `c`");
    }
}
