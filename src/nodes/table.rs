//! Kind `table`.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Inputs, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::stack_tables::{Best, Statistic, add_statistics, label, mark_best, stack};
use crate::kernels::table::Table;

/// Puts tables below each other: one table of results from many.
///
/// Columns are matched by name; what a table lacks is left empty (NaN).
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableNode {
    /// What the rows of each table are called; numbers from 1 if there are none.
    #[serde(default)]
    pub labels: Vec<String>,
    /// The name of the column of labels.
    #[serde(default = "default_label_column")]
    pub label_column: String,
    /// Rows to add at the end, over all rows above.
    #[serde(default)]
    pub statistics: Vec<Statistic>,
    /// For columns by name, whether the least or the greatest value is marked as the best.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, Best>")]
    pub best: IndexMap<String, Best>,
}

fn default_label_column() -> String {
    "item".to_owned()
}

impl TableNode {
    const ROWS: Inputs<Table> = Inputs::new("rows", "the tables, from top to bottom");
    const TABLE: Output<Table> = Output::new("table", "all rows");
}

impl Node for TableNode {
    const SPEC: Spec = Spec {
        kind: "table",
        version: 1,
        inputs: &[Self::ROWS.port()],
        outputs: &[Self::TABLE.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.error]
kind = "joint_error"
mesh = "@body.mesh"
estimate = "@body.skeleton"
truth = "@body.skeleton"

[nodes.results]
kind = "table"
rows = ["@error.summary", "@error.summary"]
labels = ["first", "second"]
statistics = ["mean", "max"]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let rows = io.get_all(Self::ROWS);
        let tables: Vec<&Table> = rows.iter().map(|it| &**it).collect();
        let mut table = label(stack(&tables)?, &tables, &self.label_column, &self.labels)?;
        for (column, best) in &self.best {
            mark_best(&mut table, column, *best)?;
        }
        add_statistics(&mut table, &self.statistics);
        io.put(Self::TABLE, table);
        Ok(())
    }
}
