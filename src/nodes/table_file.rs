//! Kind `table_file`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{InputFile, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::io::table_file::{TableFileOptions, read_table};
use crate::kernels::table::Table;

/// Reads a table from a file: the numbers of another program, or of a paper.
///
/// Formats: `.csv` and `.tsv` with a header, and `.toml` with an array of tables (`[[rows]]`). A column is one
/// of numbers if every value in it is written as a number; an empty value is missing. A unit may follow
/// the name in brackets, as in `error [mm]`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableFile {
    /// The file, relative to the pipeline file.
    pub path: InputFile,
    /// Columns that hold texts though they look like numbers.
    #[serde(default)]
    pub texts: Vec<String>,
    /// What stands for a missing value, beside nothing at all.
    #[serde(default = "default_missing")]
    pub missing_values: Vec<String>,
    /// TOML: the name of the array of tables; needed if there are several.
    #[serde(default)]
    pub list: Option<String>,
}

fn default_missing() -> Vec<String> {
    ["NA", "NaN", "nan", "–"].map(str::to_owned).to_vec()
}

impl TableFile {
    const TABLE: Output<Table> = Output::new("table", "the file's rows");
}

impl Node for TableFile {
    const SPEC: Spec = Spec {
        kind: "table_file",
        version: 1,
        inputs: &[],
        outputs: &[Self::TABLE.port()],
        cites: &[],
        example: "[nodes.errors]\nkind = \"table_file\"\npath = \"errors.csv\"\n",
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        vec![("path", &self.path)]
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let options = TableFileOptions {
            texts: self.texts.clone(),
            missing: self.missing_values.clone(),
            list: self.list.clone(),
        };
        let table = read_table(&self.path.extension(), &io.read(&self.path.0)?, &options)?;
        io.put(Self::TABLE, table);
        Ok(())
    }
}
