//! Tables below each other.

use super::{Column, Table, TableError, Values, statistics::with_text_column};

/// One of the tables that are stacked, or why it is missing.
#[derive(Debug, Clone)]
pub struct Part<'a> {
    /// Names of columns and what stands in them for all rows of the table; the same columns in each
    /// part.
    pub labels: Vec<(String, String)>,
    pub table: Result<&'a Table, String>,
}

impl Part<'_> {
    /// Gives each of several tables a label of its own, in a column of this name. Without labels, tables that
    /// have none yet are numbered from 1, unless there is only one.
    ///
    /// # Errors
    /// If there are some labels, but not one a table.
    pub fn named(
        mut parts: Vec<Self>,
        labels: &[String],
        column: &str,
    ) -> Result<Vec<Self>, StackError> {
        let n_tables = parts.len();
        if !labels.is_empty() && labels.len() != n_tables {
            return Err(StackError::Labels { n_labels: labels.len(), n_tables });
        }
        let are_known = n_tables == 1 || parts.iter().any(|it| !it.labels.is_empty());
        for (index, part) in parts.iter_mut().enumerate() {
            let label = match labels.get(index) {
                None if are_known => continue,
                Some(label) => label.clone(),
                None => (index + 1).to_string(),
            };
            part.labels.push((column.to_owned(), label));
        }
        Ok(parts)
    }
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
    #[error("the tables have a column `{column}` already: name the labels otherwise")]
    LabelColumn { column: String },
    #[error(transparent)]
    Table(#[from] TableError),
}

/// The column that says why a table is missing; it is there only if one is.
const MISSING: &str = "missing";

/// Puts the rows of tables below each other, behind columns of labels. Columns are matched by name and
/// come in the order in which they are met; what a table lacks is NaN or an empty text.
///
/// A missing table gives one row, with its labels and the reason in a last column `missing`. Labels that
/// are all numbers become a column of numbers. Statistics and marks of the tables are left out.
///
/// # Errors
/// If a column differs in type or unit, or is named like a column of labels. Tables count from 1.
pub fn stack(parts: &[Part<'_>]) -> Result<Table, StackError> {
    let mut columns: Vec<Column> = Vec::new();
    let mut counts = Vec::with_capacity(parts.len());
    let mut n_rows = 0;
    for (index, part) in parts.iter().enumerate() {
        let n_own = match &part.table {
            Ok(table) => {
                append(&mut columns, table, index + 1, n_rows)?;
                table.n_data_rows()
            }
            Err(_) => 1,
        };
        n_rows += n_own;
        counts.push(n_own);
        for column in columns.iter_mut().filter(|it| it.len() < n_rows) {
            column.values.extend(column.values.missing(n_rows - column.len()));
        }
    }
    let labels = label_columns(parts, &counts);
    if let Some(column) = labels.iter().find(|it| columns.iter().any(|own| own.name == it.name)) {
        return Err(StackError::LabelColumn { column: column.name.clone() });
    }
    let table = Table::new(labels.into_iter().chain(columns).collect());
    if parts.iter().all(|it| it.table.is_ok()) {
        return Ok(table);
    }
    let reasons = repeated(&counts, |it| parts[it].table.as_ref().err().cloned());
    Ok(with_text_column(table, MISSING, reasons)?)
}

fn append(
    columns: &mut Vec<Column>,
    table: &Table,
    number: usize,
    n_rows: usize,
) -> Result<(), StackError> {
    let rows: Vec<usize> = (0..table.n_data_rows()).collect();
    for column in &table.columns {
        let known = match columns.iter_mut().find(|it| it.name == column.name) {
            Some(known) => known,
            None => {
                columns.push(column.with_values(column.values.missing(n_rows)));
                columns.last_mut().expect("it was just pushed")
            }
        };
        let name = || column.name.clone();
        let (found, expected) = (column.values.what(), known.values.what());
        if found != expected {
            return Err(StackError::Mixed { column: name(), table: number, found, expected });
        }
        if column.unit != known.unit {
            let (found, expected) = (column.unit.clone(), known.unit.clone());
            return Err(StackError::Units { column: name(), table: number, found, expected });
        }
        known.values.extend(column.values.rows(&rows));
    }
    Ok(())
}

/// The columns of labels, in the order in which they are met.
fn label_columns(parts: &[Part<'_>], counts: &[usize]) -> Vec<Column> {
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in parts.iter().flat_map(|it| &it.labels) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let column = |name: &str| {
        let label =
            |part: usize| parts[part].labels.iter().find(|it| it.0 == name).map(|it| it.1.clone());
        let labels: Vec<Option<String>> = (0..parts.len()).map(label).collect();
        let numbers: Option<Vec<f64>> =
            labels.iter().map(|it| it.as_deref().and_then(number)).collect();
        let values = match numbers {
            Some(numbers) => Values::Numbers(
                counts
                    .iter()
                    .zip(&numbers)
                    .flat_map(|(&n, &it)| std::iter::repeat_n(it, n))
                    .collect(),
            ),
            None => Values::Texts(repeated(counts, |it| labels[it].clone())),
        };
        Column::new(name, "", values)
    };
    names.into_iter().map(column).collect()
}

/// A text for every row of every part.
fn repeated(counts: &[usize], text: impl Fn(usize) -> Option<String>) -> Vec<String> {
    let parts = counts.iter().enumerate();
    parts.flat_map(|(part, &n)| std::iter::repeat_n(text(part).unwrap_or_default(), n)).collect()
}

/// The number that a text is, if it is written as one would write a number: `003` is a name.
pub fn number(text: &str) -> Option<f64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let has_zeros = digits.len() > 1 && digits.starts_with('0') && !digits.starts_with("0.");
    let is_plain = digits.starts_with(|it: char| it.is_ascii_digit() || it == '.');
    if has_zeros || !is_plain { None } else { text.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{names, numbers_of, table, texts_of};
    use super::*;

    fn part<'a>(labels: &[(&str, &str)], table: Result<&'a Table, &str>) -> Part<'a> {
        let labels = labels.iter().map(|it| (it.0.to_owned(), it.1.to_owned())).collect();
        Part { labels, table: table.map_err(str::to_owned) }
    }

    #[test]
    fn columns_are_matched_by_name_and_missing_values_are_nan() {
        let (first, second) =
            (table(&[("a", &[1.0])]), table(&[("b", &[2.0, 4.0]), ("a", &[3.0, 5.0])]));
        let parts =
            [part(&[("shape", "adult")], Ok(&first)), part(&[("shape", "child")], Ok(&second))];
        let stacked = stack(&parts).unwrap();
        assert_eq!(names(&stacked), ["shape", "a", "b"]);
        assert_eq!(numbers_of(&stacked, "a"), [1.0, 3.0, 5.0]);
        assert!(numbers_of(&stacked, "b")[0].is_nan());
        assert_eq!(numbers_of(&stacked, "b")[1..], [2.0, 4.0]);
        assert_eq!(texts_of(&stacked, "shape"), ["adult", "child", "child"]);
    }

    #[test]
    fn tables_are_numbered_unless_there_is_only_one() {
        let data = table(&[("a", &[1.0, 2.0])]);
        let stacked = |n: usize, labels: &[&str]| {
            let labels: Vec<String> = labels.iter().map(|&it| it.to_owned()).collect();
            let parts = Part::named(vec![part(&[], Ok(&data)); n], &labels, "item");
            parts.and_then(|it| stack(&it))
        };
        assert_eq!(names(&stacked(1, &[]).unwrap()), ["a"]);
        assert_eq!(numbers_of(&stacked(2, &[]).unwrap(), "item"), [1.0, 1.0, 2.0, 2.0]);
        assert_eq!(texts_of(&stacked(1, &["x"]).unwrap(), "item"), ["x", "x"]);
        let error = stacked(2, &["x"]).unwrap_err().to_string();
        assert_eq!(error, "1 labels for 2 tables");
        let along_axis = vec![part(&[("k", "20")], Ok(&data)), part(&[("k", "40")], Ok(&data))];
        let stacked = stack(&Part::named(along_axis, &[], "item").unwrap()).unwrap();
        assert_eq!(names(&stacked), ["k", "a"], "items of an axis need no numbers");
    }

    #[test]
    fn a_missing_table_is_a_row_that_says_why() {
        let known = table(&[("a", &[1.0, 2.0])]);
        let parts = [
            part(&[("target", "horse"), ("k", "20")], Err("`fmap[horse]` failed")),
            part(&[("target", "cow"), ("k", "40")], Ok(&known)),
        ];
        let stacked = stack(&parts).unwrap();
        assert_eq!(names(&stacked), ["target", "k", "a", "missing"]);
        assert_eq!(texts_of(&stacked, "target"), ["horse", "cow", "cow"]);
        assert_eq!(numbers_of(&stacked, "k"), [20.0, 40.0, 40.0]);
        assert!(numbers_of(&stacked, "a")[0].is_nan());
        assert_eq!(texts_of(&stacked, "missing"), ["`fmap[horse]` failed", "", ""]);
        let nothing = stack(&parts[..1]).unwrap();
        assert_eq!(names(&nothing), ["target", "k", "missing"]);
        assert_eq!(nothing.n_rows(), 1);
    }

    #[test]
    fn only_what_is_written_as_a_number_is_one() {
        for text in ["0", "-3", "0.5", ".5", "1e-3", "20"] {
            assert!(number(text).is_some(), "{text}");
        }
        for text in ["003", "-01", "+1", "nan", "inf", "", "1 m", "-", "0x1", "1_000"] {
            assert_eq!(number(text), None, "{text}");
        }
    }

    #[test]
    fn statistics_of_the_tables_are_no_rows() {
        let mut first = table(&[("a", &[1.0, 2.0, 1.5])]);
        first.n_statistics = 1;
        let stacked = stack(&[part(&[], Ok(&first)), part(&[], Ok(&first))]).unwrap();
        assert_eq!(numbers_of(&stacked, "a"), [1.0, 2.0, 1.0, 2.0]);
        assert_eq!(stacked.n_statistics, 0);
    }

    #[test]
    fn errors_name_the_column_and_both_sides() {
        let in_unit = |unit| Table::new(vec![Column::numbers("a", unit, vec![1.0])]);
        let (metres, first) = (in_unit("m"), in_unit("mm"));
        let texts = Table::new(vec![Column::texts("a", vec!["x".to_owned()])]);
        let error = |second| {
            stack(&[part(&[], Ok(&first)), part(&[], Ok(second))]).unwrap_err().to_string()
        };
        assert_eq!(error(&metres), "column `a` is in `m` in table 2, but in `mm` before");
        assert_eq!(error(&texts), "column `a` holds texts in table 2, but numbers before");
        let error = stack(&[part(&[("a", "1")], Ok(&first))]).unwrap_err().to_string();
        assert_eq!(error, "the tables have a column `a` already: name the labels otherwise");
    }
}
