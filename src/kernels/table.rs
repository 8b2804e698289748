//! Tables of results.

/// Named columns of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    pub columns: Vec<Column>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub name: String,
    /// Shown after the name, `mm` or `%`; empty for none.
    pub unit: String,
    pub values: Values,
    /// Rows to point out (the best ones), ascending.
    pub marked: Vec<usize>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// NaN stands for a missing value.
    Numbers(Vec<f64>),
    Texts(Vec<String>),
}

impl Column {
    pub fn numbers(name: &str, unit: &str, values: Vec<f64>) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            values: Values::Numbers(values),
            marked: Vec::new(),
        }
    }

    pub fn texts(name: &str, values: Vec<String>) -> Self {
        Self {
            name: name.to_owned(),
            unit: String::new(),
            values: Values::Texts(values),
            marked: Vec::new(),
        }
    }

    pub fn len(&self) -> usize {
        match &self.values {
            Values::Numbers(it) => it.len(),
            Values::Texts(it) => it.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Table {
    /// # Panics
    /// If the columns differ in length.
    pub fn new(columns: Vec<Column>) -> Self {
        let n_rows = columns.first().map_or(0, Column::len);
        assert!(columns.iter().all(|it| it.len() == n_rows), "columns of one length");
        Self { columns }
    }

    pub fn n_rows(&self) -> usize {
        self.columns.first().map_or(0, Column::len)
    }

    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|it| it.name == name)
    }
}
