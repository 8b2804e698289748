//! Kind `table`.

use std::sync::Arc;

use indexmap::{IndexMap, IndexSet};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Labelled, LabelledInputs, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::table::{
    Best, BestIn, Condition, Missing, Order, Part, Pivot, Statistic, Table, TableError,
    add_statistics, group, mark_best, mark_best_in_rows, pivot, rename, select_columns,
    select_rows, set_decimals, sort, stack,
};

/// Puts tables below each other and makes a paper's table of them.
///
/// Columns are matched by name; what a table lacks is missing: it is shown as `–`, left out of every
/// statistic, and counted. Axes that are gathered (`over`) give a column of labels each, and with
/// `missing = "show"` an item that failed is a row that says why. Parameters act in the order in which
/// they stand here; each knows the columns by the names that they have by then.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableNode {
    /// What the rows of each table are called; several tables have numbers from 1 if there are none.
    #[serde(default)]
    pub labels: Vec<String>,
    /// The name of the column of labels.
    #[serde(default = "default_label_column")]
    pub label_column: String,
    /// Keeps the rows that have, in every column named here, this value or one of these:
    /// `{ k = 60, shape = ["horse", "cow"] }`.
    #[serde(default, rename = "where")]
    #[schemars(with = "std::collections::BTreeMap<String, Condition>")]
    pub conditions: IndexMap<String, Condition>,
    /// Joins the rows that are equal in these columns; the others hold `statistics` of each group, its
    /// mean if there are none.
    #[serde(default)]
    pub group_by: Vec<String>,
    /// Puts one label down, another across, and a statistic of the values that belong to both into the
    /// cells: `{ rows = "method", columns = "set", value = "error", statistic = "mean" }`.
    #[serde(default)]
    pub pivot: Option<Pivot>,
    /// Sorts the rows by these columns, the first one first. Missing values come last.
    #[serde(default)]
    pub sort_by: Vec<String>,
    /// Which rows come first.
    #[serde(default)]
    pub order: Order,
    /// For columns by name, whether the least or the greatest value is marked as the best. With `pivot`,
    /// the name of its `value` stands for all columns of cells.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, Best>")]
    pub best: IndexMap<String, Best>,
    /// Without `group_by`: rows to add at the end, over all rows above, and one that counts missing
    /// values if there are any. Labels have no statistics.
    #[serde(default)]
    pub statistics: Vec<Statistic>,
    /// For columns by name, how many digits people are shown after the point; five significant ones in
    /// others. Files for machines keep all.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, u8>")]
    pub decimals: IndexMap<String, u8>,
    /// The columns to keep, in this order; all if there are none.
    #[serde(default)]
    pub columns: Vec<String>,
    /// Other names for columns.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, String>")]
    pub rename: IndexMap<String, String>,
}

fn default_label_column() -> String {
    "item".to_owned()
}

impl TableNode {
    const ROWS: LabelledInputs<Table> =
        LabelledInputs::new("rows", "the tables, from top to bottom");
    const TABLE: Output<Table> = Output::new("table", "all rows");

    /// The rows in their order, with the best ones marked, and the columns that hold labels.
    fn arranged(&self, mut table: Table, mut labels: Vec<String>) -> Result<Arranged, TableError> {
        let mut cells = Vec::new();
        if !self.group_by.is_empty() {
            table = group(&table, &self.group_by, self.group_statistics())?;
            labels.clone_from(&self.group_by);
        }
        if let Some(by) = &self.pivot {
            table = pivot(&table, by)?;
            labels = vec![by.rows.clone(), COUNTED.to_owned()];
            let names = table.columns.iter().map(|it| it.name.clone());
            cells = names.filter(|it| !labels.contains(it)).collect();
        }
        table = sort(&table, &self.sort_by, self.order)?;
        for (column, &best) in &self.best {
            match self.pivot.as_ref().filter(|it| it.value == *column) {
                Some(by) if by.best_in == BestIn::Row => {
                    mark_best_in_rows(&mut table, &cells, best)?;
                }
                Some(_) => cells.iter().try_for_each(|it| mark_best(&mut table, it, best))?,
                None => mark_best(&mut table, column, best)?,
            }
        }
        Ok(Arranged { table, labels })
    }

    fn group_statistics(&self) -> &[Statistic] {
        if self.statistics.is_empty() { &[Statistic::Mean] } else { &self.statistics }
    }

    /// With statistics, and columns as they are to be called.
    fn finished(&self, arranged: Arranged) -> Result<Table, TableError> {
        let Arranged { mut table, labels } = arranged;
        if self.group_by.is_empty() {
            let labels: Vec<&str> = labels.iter().map(String::as_str).collect();
            table = add_statistics(table, &self.statistics, &labels)?;
        }
        if !self.columns.is_empty() {
            table = select_columns(table, &self.columns)?;
        }
        rename(table, &self.rename)
    }

    /// Sets the decimals of those columns that are there; returns the others.
    fn set_decimals<'a>(
        &self,
        table: &mut Table,
        columns: impl IntoIterator<Item = &'a String>,
    ) -> Result<Vec<&'a String>, TableError> {
        let (here, others): (Vec<_>, Vec<_>) =
            columns.into_iter().partition(|it| table.column(it).is_some());
        for column in here {
            set_decimals(table, column, self.decimals[column])?;
        }
        Ok(others)
    }
}

/// The column in which a pivot counts what is missing.
const COUNTED: &str = "missing";

struct Arranged {
    table: Table,
    labels: Vec<String>,
}

impl Node for TableNode {
    const SPEC: Spec = Spec {
        kind: "table",
        version: 2,
        inputs: &[Self::ROWS.port()],
        outputs: &[Self::TABLE.port()],
        cites: &[],
        example: r#"[nodes.errors]
kind = "table_file"
path = "errors.csv"

[nodes.results]
kind = "table"
rows = "@errors"
pivot = { rows = "method", columns = "shape", value = "error" }
statistics = ["mean", "max"]
best = { error = "min" }
decimals = { error = 2 }
"#,
    };

    fn validate(&self) -> Result<(), String> {
        if !self.group_by.is_empty() && self.pivot.is_some() {
            return Err("`group_by` and `pivot` exclude each other".to_owned());
        }
        Ok(())
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let gathered = io.get_labelled(Self::ROWS);
        let parts = gathered.iter().map(part).collect();
        let parts = Part::named(parts, &self.labels, &self.label_column)?;
        let labels = parts.iter().flat_map(|it| &it.labels).map(|it| it.0.clone());
        let labels: Vec<String> = labels.collect::<IndexSet<_>>().into_iter().collect();
        let mut table = select_rows(stack(&parts)?, &self.conditions)?;
        for missing in Missing::of(&table) {
            io.note(missing.to_string());
        }
        let later = self.set_decimals(&mut table, self.decimals.keys())?;
        let mut arranged = self.arranged(table, labels)?;
        // Columns that grouping made have names of their own.
        let unknown = self.set_decimals(&mut arranged.table, later)?;
        for column in unknown {
            arranged.table.find(column)?;
        }
        io.put(Self::TABLE, self.finished(arranged)?);
        Ok(())
    }
}

/// A gathered table with the items of the axes that it belongs to.
fn part(gathered: &Labelled<Table>) -> Part<'_> {
    let label = |(axis, item): &(Arc<str>, Arc<str>)| (axis.to_string(), item.to_string());
    Part {
        labels: gathered.labels.iter().map(label).collect(),
        table: gathered.value.as_deref().map_err(|why| why.to_string()),
    }
}
