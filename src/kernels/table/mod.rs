//! Tables of results.

use std::{borrow::Cow, collections::HashSet};

mod arrange;
mod bound;
mod group;
mod marks;
mod pivot;
mod select;
mod stack;
mod statistics;

pub use arrange::{Order, rename, select_columns, set_decimals, sort};
pub use bound::{Bound, BoundError, Checked, check_bound};
pub use group::group;
pub use marks::{Best, BestIn, mark_best, mark_best_in_rows};
pub use pivot::{Pivot, pivot};
pub use select::{Condition, Wanted, select_rows};
pub use stack::{Part, StackError, number, stack};
pub use statistics::{Missing, Statistic, add_statistics, percentile};

/// Named columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    pub columns: Vec<Column>,
    /// So many rows at the end are statistics of the rows above them.
    pub n_statistics: usize,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub name: String,
    /// Shown after the name, `mm` or `%`; empty for none.
    pub unit: String,
    pub values: Values,
    /// Rows to point out (the best ones), ascending.
    pub marked: Vec<usize>,
    /// How many digits after the point people are shown; five significant ones if it is not given.
    pub decimals: Option<u8>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// NaN stands for a missing value.
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

/// Why a table has not what is asked of it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TableError {
    #[error("there is no column `{column}`; there are {known}")]
    NoColumn { column: String, known: String },
    #[error("column `{column}` holds texts, but {purpose} needs numbers")]
    Texts { column: String, purpose: &'static str },
    #[error("there would be two columns `{column}`")]
    Twice { column: String },
    #[error("no row has `{value}` in column `{column}`; there are {known}")]
    NoRow { column: String, value: String, known: String },
    #[error("column `{column}` holds {expected}, but `{value}` is {found}")]
    WrongType { column: String, value: String, found: &'static str, expected: &'static str },
}

impl Values {
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(it) => it.len(),
            Self::Texts(it) => it.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `numbers` or `texts`.
    pub fn what(&self) -> &'static str {
        match self {
            Self::Numbers(_) => "numbers",
            Self::Texts(_) => "texts",
        }
    }

    /// The values of some rows, in their order.
    pub fn rows(&self, rows: &[usize]) -> Self {
        match self {
            Self::Numbers(it) => Self::Numbers(rows.iter().map(|&row| it[row]).collect()),
            Self::Texts(it) => Self::Texts(rows.iter().map(|&row| it[row].clone()).collect()),
        }
    }

    /// Values that stand for nothing, of the same type.
    pub fn missing(&self, n_rows: usize) -> Self {
        match self {
            Self::Numbers(_) => Self::Numbers(vec![f64::NAN; n_rows]),
            Self::Texts(_) => Self::Texts(vec![String::new(); n_rows]),
        }
    }

    /// Appends values of the same type.
    ///
    /// # Panics
    /// If the types differ.
    pub fn extend(&mut self, more: Self) {
        match (self, more) {
            (Self::Numbers(to), Self::Numbers(from)) => to.extend(from),
            (Self::Texts(to), Self::Texts(from)) => to.extend(from),
            _ => panic!("types are compared first"),
        }
    }

    /// The text by which a value is told from others: numbers in full, nothing for a missing one.
    pub fn text(&self, row: usize) -> Cow<'_, str> {
        match self {
            Self::Numbers(it) if it[row].is_nan() => Cow::Borrowed(""),
            Self::Numbers(it) => Cow::Owned(it[row].to_string()),
            Self::Texts(it) => Cow::Borrowed(&it[row]),
        }
    }
}

impl Column {
    pub fn numbers(name: &str, unit: &str, values: Vec<f64>) -> Self {
        Self::new(name, unit, Values::Numbers(values))
    }

    pub fn texts(name: &str, values: Vec<String>) -> Self {
        Self::new(name, "", Values::Texts(values))
    }

    pub fn new(name: &str, unit: &str, values: Values) -> Self {
        let (name, unit) = (name.to_owned(), unit.to_owned());
        Self { name, unit, values, marked: Vec::new(), decimals: None }
    }

    /// A column of the same name, unit and look with other values.
    pub fn with_values(&self, values: Values) -> Self {
        Self { values, marked: Vec::new(), ..self.clone() }
    }

    pub fn len(&self) -> usize {
        self.values.len()
    }

    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The name, and the unit in brackets if there is one.
    pub fn head(&self) -> String {
        match self.unit.as_str() {
            "" => self.name.clone(),
            unit => format!("{} [{unit}]", self.name),
        }
    }
}

impl Table {
    /// # Panics
    /// If the columns differ in length.
    pub fn new(columns: Vec<Column>) -> Self {
        let n_rows = columns.first().map_or(0, Column::len);
        assert!(columns.iter().all(|it| it.len() == n_rows), "columns of one length");
        Self { columns, n_statistics: 0 }
    }

    /// Of data and of statistics.
    pub fn n_rows(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }

    /// The rows above the statistics.
    pub fn n_data_rows(&self) -> usize {
        self.n_rows() - self.n_statistics
    }

    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|it| it.name == name)
    }

    /// The place of a column.
    ///
    /// # Errors
    /// [`TableError::NoColumn`].
    pub fn find(&self, name: &str) -> Result<usize, TableError> {
        self.columns.iter().position(|it| it.name == name).ok_or_else(|| {
            let known: Vec<&str> = self.columns.iter().map(|it| it.name.as_str()).collect();
            TableError::NoColumn { column: name.to_owned(), known: listed(&known) }
        })
    }

    /// The numbers of a column, with those of the statistics.
    ///
    /// # Errors
    /// [`TableError::NoColumn`], [`TableError::Texts`].
    pub fn numbers(&self, name: &str, purpose: &'static str) -> Result<&[f64], TableError> {
        match &self.columns[self.find(name)?].values {
            Values::Numbers(values) => Ok(values),
            Values::Texts(_) => Err(TableError::Texts { column: name.to_owned(), purpose }),
        }
    }

    /// Some rows, in this order; marks are dropped.
    pub fn rows(&self, rows: &[usize]) -> Self {
        let taken = |it: &Column| it.with_values(it.values.rows(rows));
        Self::new(self.columns.iter().map(taken).collect())
    }

    /// The table without its statistics and marks.
    pub fn data(&self) -> Self {
        self.rows(&(0..self.n_data_rows()).collect::<Vec<_>>())
    }

    /// # Errors
    /// [`TableError::Twice`] if two columns have the same name.
    fn with_distinct_names(self) -> Result<Self, TableError> {
        let mut names = HashSet::new();
        match self.columns.iter().find(|it| !names.insert(it.name.as_str())) {
            Some(column) => Err(TableError::Twice { column: column.name.clone() }),
            None => Ok(self),
        }
    }
}

/// Names in backticks, of many only the first ones.
fn listed(names: &[&str]) -> String {
    const MOST: usize = 12;
    let mut res: Vec<String> = names.iter().take(MOST).map(|it| format!("`{it}`")).collect();
    if names.len() > MOST {
        res.push(format!("{} more", names.len() - MOST));
    }
    if res.is_empty() { "none".to_owned() } else { res.join(", ") }
}

#[cfg(test)]
mod test_tables {
    //! Small tables for the tests of this folder.

    use super::{Column, Table, Values};

    /// Columns of numbers without a unit.
    pub fn table(columns: &[(&str, &[f64])]) -> Table {
        let column = |&(name, values): &(&str, &[f64])| Column::numbers(name, "", values.to_vec());
        Table::new(columns.iter().map(column).collect())
    }

    pub fn texts(name: &str, values: &[&str]) -> Column {
        Column::texts(name, values.iter().map(|&it| it.to_owned()).collect())
    }

    #[track_caller]
    pub fn numbers_of(table: &Table, column: &str) -> Vec<f64> {
        match &table.column(column).unwrap_or_else(|| panic!("no column `{column}`")).values {
            Values::Numbers(values) => values.clone(),
            Values::Texts(_) => panic!("`{column}` holds texts"),
        }
    }

    #[track_caller]
    pub fn texts_of(table: &Table, column: &str) -> Vec<String> {
        match &table.column(column).unwrap_or_else(|| panic!("no column `{column}`")).values {
            Values::Texts(values) => values.clone(),
            Values::Numbers(_) => panic!("`{column}` holds numbers"),
        }
    }

    pub fn names(table: &Table) -> Vec<&str> {
        table.columns.iter().map(|it| it.name.as_str()).collect()
    }
}
