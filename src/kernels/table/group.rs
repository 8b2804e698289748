//! Rows of equal labels become one.

use indexmap::IndexMap;

use super::{Column, Statistic, Table, TableError, Values};

/// Joins the rows that are equal in the given columns to one row each, in the order in which they are met.
///
/// A column of numbers gives one column for every statistic: under its own name if there is only one,
/// as `error (mean)` if there are several. Where values are missing, `error (missing)` counts them.
/// Other columns of texts are dropped.
///
/// # Errors
/// If there is no such column, or two columns of the result have the same name.
pub fn group(table: &Table, by: &[String], statistics: &[Statistic]) -> Result<Table, TableError> {
    let keys: Vec<usize> = by.iter().map(|it| table.find(it)).collect::<Result<_, _>>()?;
    let groups = groups(table, &keys);
    let firsts: Vec<usize> = groups.iter().map(|it| it[0]).collect();
    let mut columns: Vec<Column> = keys
        .iter()
        .map(|&it| table.columns[it].with_values(table.columns[it].values.rows(&firsts)))
        .collect();
    for (index, column) in table.columns.iter().enumerate() {
        if let Values::Numbers(values) = &column.values
            && !keys.contains(&index)
        {
            columns.extend(grouped(column, values, &groups, statistics));
        }
    }
    Table::new(columns).with_distinct_names()
}

/// The rows of every group: those that are equal in the columns `keys`.
pub(super) fn groups(table: &Table, keys: &[usize]) -> Vec<Vec<usize>> {
    let mut groups: IndexMap<Vec<String>, Vec<usize>> = IndexMap::new();
    for row in 0..table.n_data_rows() {
        let key = keys.iter().map(|&it| table.columns[it].values.text(row).into_owned()).collect();
        groups.entry(key).or_default().push(row);
    }
    groups.into_values().collect()
}

fn grouped(
    column: &Column,
    values: &[f64],
    groups: &[Vec<usize>],
    statistics: &[Statistic],
) -> Vec<Column> {
    let of_groups = |statistic: Statistic| -> Vec<f64> {
        let of = |rows: &Vec<usize>| {
            statistic.of(&rows.iter().map(|&it| values[it]).collect::<Vec<_>>())
        };
        groups.iter().map(of).collect()
    };
    let mut res: Vec<Column> = Vec::new();
    for &statistic in statistics {
        let name = match statistics.len() {
            1 => column.name.clone(),
            _ => format!("{} ({})", column.name, statistic.name()),
        };
        res.push(statistic_column(column, name, statistic, of_groups(statistic)));
    }
    let n_missing = of_groups(Statistic::Missing);
    if n_missing.iter().any(|&it| it > 0.0) && !statistics.contains(&Statistic::Missing) {
        let name = format!("{} (missing)", column.name);
        res.push(statistic_column(column, name, Statistic::Missing, n_missing));
    }
    res
}

/// Counts have no unit, and no digits after the point.
fn statistic_column(
    column: &Column,
    name: String,
    statistic: Statistic,
    values: Vec<f64>,
) -> Column {
    let (unit, decimals) = match statistic.is_count() {
        true => (String::new(), None),
        false => (column.unit.clone(), column.decimals),
    };
    Column { name, unit, decimals, values: Values::Numbers(values), marked: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{names, numbers_of, table, texts, texts_of};
    use super::*;

    fn measured() -> Table {
        let mut res = table(&[
            ("k", &[20.0, 40.0, 20.0, 40.0]),
            ("error", &[1.0, 2.0, 3.0, f64::NAN]),
            ("time", &[5.0, 6.0, 7.0, 10.0]),
        ]);
        res.columns.insert(0, texts("shape", &["horse", "horse", "cow", "cow"]));
        res
    }

    #[test]
    fn one_statistic_keeps_the_names_of_columns() {
        let res = group(&measured(), &["k".to_owned()], &[Statistic::Mean]).unwrap();
        assert_eq!(names(&res), ["k", "error", "error (missing)", "time"]);
        assert_eq!(numbers_of(&res, "k"), [20.0, 40.0]);
        assert_eq!(numbers_of(&res, "error"), [2.0, 2.0]);
        assert_eq!(numbers_of(&res, "error (missing)"), [0.0, 1.0]);
        assert_eq!(numbers_of(&res, "time"), [6.0, 8.0]);
    }

    #[test]
    fn several_statistics_are_several_columns() {
        let by = ["shape".to_owned()];
        let mut data = measured().data();
        data.columns[3].unit = "ms".to_owned();
        data.columns[3].decimals = Some(1);
        let res = group(&data, &by, &[Statistic::Max, Statistic::Count]).unwrap();
        assert_eq!(texts_of(&res, "shape"), ["horse", "cow"]);
        assert_eq!(numbers_of(&res, "time (max)"), [6.0, 10.0]);
        assert_eq!(numbers_of(&res, "error (count)"), [2.0, 1.0]);
        let looks = ["time (max)", "time (count)"]
            .map(|it| (res.column(it).unwrap().unit.as_str(), res.column(it).unwrap().decimals));
        assert_eq!(looks, [("ms", Some(1)), ("", None)]);
    }

    #[test]
    fn groups_of_two_columns_are_their_pairs() {
        let by = ["k".to_owned(), "shape".to_owned()];
        let res = group(&measured(), &by, &[Statistic::Sum]).unwrap();
        assert_eq!(numbers_of(&res, "time"), [5.0, 6.0, 7.0, 10.0]);
        assert!(group(&measured(), &["x".to_owned()], &[Statistic::Sum]).is_err());
    }
}
