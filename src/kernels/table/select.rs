//! Some of a table's rows.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Table, TableError, Values, listed};

/// A value that a row is to have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Wanted {
    Number(f64),
    Text(String),
}

/// What a row is to have in a column: one value, or one of several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Condition {
    One(Wanted),
    AnyOf(Vec<Wanted>),
}

impl Condition {
    fn wanted(&self) -> &[Wanted] {
        match self {
            Self::One(wanted) => std::slice::from_ref(wanted),
            Self::AnyOf(wanted) => wanted,
        }
    }
}

/// The rows that meet all conditions, in their order. Statistics and marks are dropped if there is a
/// condition.
///
/// # Errors
/// If there is no such column, or no row has one of the values: a slip of the pen is no empty table.
pub fn select_rows<'a>(
    table: Table,
    conditions: impl IntoIterator<Item = (&'a String, &'a Condition)>,
) -> Result<Table, TableError> {
    let mut conditions = conditions.into_iter().peekable();
    if conditions.peek().is_none() {
        return Ok(table);
    }
    let mut rows: Vec<usize> = (0..table.n_data_rows()).collect();
    for (column, condition) in conditions {
        let values = &table.columns[table.find(column)?].values;
        for wanted in condition.wanted() {
            let has = |row: usize| has(values, row, wanted);
            check_type(column, values, wanted)?;
            if !(0..table.n_data_rows()).any(has) {
                return Err(no_row(&table, column, values, wanted));
            }
        }
        rows.retain(|&row| condition.wanted().iter().any(|it| has(values, row, it)));
    }
    Ok(table.rows(&rows))
}

fn has(values: &Values, row: usize, wanted: &Wanted) -> bool {
    match (values, wanted) {
        (Values::Numbers(values), Wanted::Number(wanted)) => values[row] == *wanted,
        (Values::Texts(values), Wanted::Text(wanted)) => values[row] == *wanted,
        _ => false,
    }
}

fn check_type(column: &str, values: &Values, wanted: &Wanted) -> Result<(), TableError> {
    let (value, found) = match wanted {
        Wanted::Number(value) => (value.to_string(), "a number"),
        Wanted::Text(value) => (value.clone(), "a text"),
    };
    match (values, wanted) {
        (Values::Numbers(_), Wanted::Number(_)) | (Values::Texts(_), Wanted::Text(_)) => Ok(()),
        _ => {
            let (column, expected) = (column.to_owned(), values.what());
            Err(TableError::WrongType { column, value, found, expected })
        }
    }
}

fn no_row(table: &Table, column: &str, values: &Values, wanted: &Wanted) -> TableError {
    let value = match wanted {
        Wanted::Number(value) => value.to_string(),
        Wanted::Text(value) => value.clone(),
    };
    let mut known: Vec<String> = Vec::new();
    for row in 0..table.n_data_rows() {
        let text = values.text(row);
        if !known.iter().any(|it| *it == text) {
            known.push(text.into_owned());
        }
    }
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    TableError::NoRow { column: column.to_owned(), value, known: listed(&known) }
}

#[cfg(test)]
mod tests {
    use super::super::test_tables::{numbers_of, table, texts};
    use super::*;

    fn measured() -> Table {
        let mut res = table(&[("k", &[20.0, 40.0, 20.0]), ("error", &[1.0, 2.0, 3.0])]);
        res.columns.push(texts("shape", &["horse", "horse", "cow"]));
        res
    }

    fn select(conditions: &[(&str, Condition)]) -> Result<Table, TableError> {
        let named: Vec<(String, Condition)> =
            conditions.iter().map(|it| (it.0.to_owned(), it.1.clone())).collect();
        select_rows(measured(), named.iter().map(|it| (&it.0, &it.1)))
    }

    #[test]
    fn rows_meet_all_conditions() {
        let twenty = ("k", Condition::One(Wanted::Number(20.0)));
        let text = |it: &str| Wanted::Text(it.to_owned());
        let any = ("shape", Condition::AnyOf(vec![text("cow"), text("horse")]));
        assert_eq!(numbers_of(&select(&[twenty.clone(), any]).unwrap(), "error"), [1.0, 3.0]);
        let cow = ("shape", Condition::One(text("cow")));
        assert_eq!(numbers_of(&select(&[twenty, cow]).unwrap(), "error"), [3.0]);
        assert_eq!(select(&[]).unwrap(), measured());
    }

    #[test]
    fn slips_of_the_pen_are_told() {
        let error =
            |column, wanted| select(&[(column, Condition::One(wanted))]).unwrap_err().to_string();
        assert_eq!(
            error("shape", Wanted::Text("hrse".to_owned())),
            "no row has `hrse` in column `shape`; there are `horse`, `cow`"
        );
        assert_eq!(
            error("k", Wanted::Text("20".to_owned())),
            "column `k` holds numbers, but `20` is a text"
        );
        assert_eq!(
            error("kk", Wanted::Number(1.0)),
            "there is no column `kk`; there are `k`, `error`, `shape`"
        );
    }
}
