//! Kind `check`.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::table::{Bound, Condition, Statistic, Table, check_bound};

/// Fails if numbers of a table leave their bounds, so that a run that got worse does not pass.
///
/// The table goes through unchanged; whatever reads it from here is not made unless the bounds hold.
/// Rows of statistics that a `table` added do not count. A missing value breaks every bound.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Check {
    /// The column whose numbers are bounded.
    pub column: String,
    /// Bounds this number of all rows together; each row by itself if it is not given.
    #[serde(default)]
    pub statistic: Option<Statistic>,
    /// Checks only the rows that have, in every column named here, this value or one of these:
    /// `{ shape = ["horse", "cow"] }`.
    #[serde(default, rename = "where")]
    #[schemars(with = "std::collections::BTreeMap<String, Condition>")]
    pub conditions: IndexMap<String, Condition>,
    /// The least allowed value.
    #[serde(default)]
    pub min: Option<f64>,
    /// The greatest allowed value.
    #[serde(default)]
    pub max: Option<f64>,
    /// Leaves missing values out instead of failing.
    #[serde(default)]
    pub allow_missing: bool,
    /// What a failure means; it is told before the facts.
    #[serde(default)]
    pub message: Option<String>,
}

impl Check {
    const INPUT: Input<Table> = Input::new("rows", "the table that is checked");
    const TABLE: Output<Table> = Output::new("table", "the same table");
}

impl Node for Check {
    const SPEC: Spec = Spec {
        kind: "check",
        version: 1,
        inputs: &[Self::INPUT.port()],
        outputs: &[Self::TABLE.port()],
        cites: &[],
        example: r#"[nodes.errors]
kind = "table_file"
path = "errors.csv"

[nodes.good_enough]
kind = "check"
rows = "@errors"
column = "error"
statistic = "mean"
where = { method = "ours" }
max = 4.0
message = "our method got worse"
"#,
    };

    fn validate(&self) -> Result<(), String> {
        match (self.min, self.max) {
            (None, None) => Err("one of `min` and `max` is needed".to_owned()),
            (Some(min), Some(max)) if min > max => {
                Err(format!("`min` is {min}, but `max` is {max}: no value lies between"))
            }
            _ => Ok(()),
        }
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let table = io.get(Self::INPUT);
        let bound = Bound {
            column: &self.column,
            statistic: self.statistic,
            conditions: self.conditions.iter().collect(),
            min: self.min,
            max: self.max,
            allow_missing: self.allow_missing,
        };
        let checked = check_bound(&table, &bound).map_err(|error| match &self.message {
            Some(message) => NodeError::failed(format!("{message}: {error}")),
            None => error.into(),
        })?;
        io.note(checked.fact);
        io.put(Self::TABLE, Table::clone(&table));
        Ok(())
    }
}
