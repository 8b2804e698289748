//! Two tables side by side: rows are matched by their texts, numbers by their columns.

use std::collections::BTreeMap;

use crate::kernels::table::{Column, Table, Values};

/// What became of the numbers of a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TableDiff {
    /// The columns of texts that rows are matched by; rows go by their numbers if there is none.
    pub matched_by: Vec<String>,
    /// Columns of numbers that both tables have.
    pub columns: Vec<ColumnDiff>,
    /// What only one of the tables has.
    pub only_before: Leftover,
    pub only_after: Leftover,
}

/// Columns and rows that have no counterpart.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Leftover {
    pub columns: Vec<String>,
    pub rows: Vec<String>,
}

/// One column in both tables.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnDiff {
    pub name: String,
    pub unit: String,
    /// In the order of the table before.
    pub pairs: Vec<Pair>,
}

/// One number in both tables; NaN stands for a missing one.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    pub row: String,
    pub before: f64,
    pub after: f64,
}

impl Pair {
    pub fn difference(&self) -> f64 {
        self.after - self.before
    }

    /// The change as a fraction of the size before: 0 if nothing changed, infinite where there was a
    /// zero, NaN where a number came or went.
    pub fn relative(&self) -> f64 {
        relative(self.before, self.after)
    }

    fn is_whole(&self) -> bool {
        !self.before.is_nan() && !self.after.is_nan()
    }
}

/// A change as a fraction of the size before.
pub fn relative(before: f64, after: f64) -> f64 {
    if before == after { 0.0 } else { (after - before) / before.abs() }
}

/// A column's numbers summed up, over the rows that have one in both tables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    pub mean_before: f64,
    pub mean_after: f64,
    pub larger: usize,
    pub smaller: usize,
    pub equal: usize,
    /// Numbers that came or went: they are in no mean.
    pub gone: usize,
    pub come: usize,
}

impl ColumnDiff {
    pub fn summary(&self) -> Summary {
        let whole: Vec<&Pair> = self.pairs.iter().filter(|it| it.is_whole()).collect();
        let n = whole.len() as f64;
        let count = |what: fn(&Pair) -> bool| self.pairs.iter().filter(|it| what(it)).count();
        Summary {
            mean_before: whole.iter().map(|it| it.before).sum::<f64>() / n,
            mean_after: whole.iter().map(|it| it.after).sum::<f64>() / n,
            larger: count(|it| it.after > it.before),
            smaller: count(|it| it.after < it.before),
            equal: count(|it| it.after == it.before),
            gone: count(|it| !it.before.is_nan() && it.after.is_nan()),
            come: count(|it| it.before.is_nan() && !it.after.is_nan()),
        }
    }
}

/// Compares two tables.
pub fn compare(before: &Table, after: &Table) -> TableDiff {
    let is_text = |it: &&Column| matches!(it.values, Values::Texts(_));
    let mut res = TableDiff::default();
    let keys: Vec<&Column> = before.columns.iter().filter(is_text).collect();
    // A column of texts that only one table has cannot match rows.
    let shared = |it: &&Column| after.column(&it.name).as_ref().is_some_and(is_text);
    res.matched_by = keys.into_iter().filter(shared).map(|it| it.name.clone()).collect();
    let rows_before = row_names(before, &res.matched_by);
    let rows_after = row_names(after, &res.matched_by);
    let places: BTreeMap<&str, usize> =
        rows_after.iter().enumerate().map(|(place, name)| (name.as_str(), place)).collect();
    let matches: Vec<(usize, usize)> = rows_before
        .iter()
        .enumerate()
        .filter_map(|(place, name)| Some((place, *places.get(name.as_str())?)))
        .collect();
    for column in &before.columns {
        let other = after.column(&column.name);
        let Values::Numbers(old) = &column.values else {
            if other.is_none() {
                res.only_before.columns.push(column.name.clone());
            }
            continue;
        };
        let Some(Values::Numbers(new)) = other.map(|it| &it.values) else {
            res.only_before.columns.push(column.name.clone());
            continue;
        };
        let pair = |&(from, to): &(usize, usize)| Pair {
            row: rows_before[from].clone(),
            before: old[from],
            after: new[to],
        };
        let pairs = matches.iter().map(pair).collect();
        res.columns.push(ColumnDiff {
            name: column.name.clone(),
            unit: column.unit.clone(),
            pairs,
        });
    }
    let is_new = |it: &&Column| before.column(&it.name).is_none();
    res.only_after.columns =
        after.columns.iter().filter(is_new).map(|it| it.name.clone()).collect();
    res.only_before.rows = left_over(&rows_before, &rows_after);
    res.only_after.rows = left_over(&rows_after, &rows_before);
    res
}

/// A name for every row: its texts, and a number if there are several like it.
fn row_names(table: &Table, keys: &[String]) -> Vec<String> {
    let columns: Vec<&Vec<String>> = keys
        .iter()
        .filter_map(|it| match &table.column(it)?.values {
            Values::Texts(texts) => Some(texts),
            Values::Numbers(_) => None,
        })
        .collect();
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    (0..table.n_rows())
        .map(|row| {
            let texts: Vec<&str> = columns.iter().map(|it| it[row].as_str()).collect();
            let name = texts.join(", ");
            let n = seen.entry(name.clone()).or_default();
            *n += 1;
            match (columns.is_empty(), *n) {
                (true, n) => format!("row {n}"),
                (false, 1) => name,
                (false, n) => format!("{name} ({n})"),
            }
        })
        .collect()
}

fn left_over(rows: &[String], others: &[String]) -> Vec<String> {
    let others: std::collections::BTreeSet<&String> = others.iter().collect();
    rows.iter().filter(|it| !others.contains(it)).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(values: &[&str]) -> Vec<String> {
        values.iter().map(|it| (*it).to_owned()).collect()
    }

    fn table(names: &[&str], errors: &[f64]) -> Table {
        Table::new(vec![
            Column::texts("joint", texts(names)),
            Column::numbers("error", "mm", errors.to_vec()),
        ])
    }

    #[test]
    fn rows_meet_by_their_texts_in_any_order() {
        let before = table(&["hip", "knee", "toe"], &[1.0, 2.0, 0.0]);
        let after = table(&["toe", "hip", "tail"], &[3.0, 0.5, 9.0]);
        let diff = compare(&before, &after);
        assert_eq!(diff.matched_by, ["joint"]);
        let pair = |row: &str, before, after| Pair { row: row.to_owned(), before, after };
        assert_eq!(diff.columns[0].pairs, [pair("hip", 1.0, 0.5), pair("toe", 0.0, 3.0)]);
        assert_eq!(diff.columns[0].pairs[0].relative(), -0.5);
        assert_eq!(diff.columns[0].pairs[1].relative(), f64::INFINITY);
        assert_eq!(
            (&diff.only_before.rows[..], &diff.only_after.rows[..]),
            (&texts(&["knee"])[..], &texts(&["tail"])[..])
        );
    }

    #[test]
    fn a_table_against_itself_has_no_differences() {
        let table = table(&["a", "b", "a"], &[1.0, f64::NAN, 3.0]);
        let diff = compare(&table, &table);
        let summary = diff.columns[0].summary();
        assert_eq!((summary.larger, summary.smaller, summary.equal), (0, 0, 2));
        assert_eq!((summary.gone, summary.come), (0, 0));
        assert_eq!((summary.mean_before, summary.mean_after), (2.0, 2.0));
        assert_eq!((diff.only_before, diff.only_after), (Leftover::default(), Leftover::default()));
    }

    #[test]
    fn missing_numbers_are_counted_and_never_averaged() {
        let diff = compare(&table(&["a", "b"], &[1.0, 2.0]), &table(&["a", "b"], &[5.0, f64::NAN]));
        let summary = diff.columns[0].summary();
        assert_eq!((summary.mean_before, summary.mean_after, summary.gone), (1.0, 5.0, 1));
    }

    #[test]
    fn without_texts_rows_go_by_their_numbers() {
        let one = |values: &[f64]| Table::new(vec![Column::numbers("x", "", values.to_vec())]);
        let diff = compare(&one(&[1.0, 2.0]), &one(&[1.0]));
        assert_eq!(diff.columns[0].pairs[0].row, "row 1");
        assert_eq!(diff.only_before.rows, ["row 2"]);
    }
}
