use serde::{Deserialize, Serialize};

use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::io::table_file::{TABLE_EXTENSIONS, TableFileOptions, read_table};
use crate::kernels::io::table_text::{shown, write_csv, write_json, write_latex, write_markdown};
use crate::kernels::table::{Column, Table, Values};

/// What the header says of one column.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ColumnHead {
    name: String,
    unit: String,
    /// `None` for numbers: they are the next column of the array `numbers`.
    texts: Option<Vec<String>>,
    marked: Vec<usize>,
    decimals: Option<u8>,
}

impl Artifact for Table {
    const TYPE: ArtifactType = ArtifactType {
        name: "table",
        version: 2,
        doc: "Table: `numbers` (columns of numbers x rows), and the columns' names, units and texts.",
    };

    const FORMATS: &'static [Format] = &[
        Format { extension: "csv", doc: "Numbers in full; a missing one is an empty cell." },
        Format { extension: "json", doc: "A list of records." },
        Format { extension: "md", doc: "Markdown, numbers rounded, marked rows bold." },
        Format { extension: "tex", doc: "A LaTeX `tabular` for the package booktabs." },
    ];

    const IMPORTS: &'static [&'static str] = &TABLE_EXTENSIONS;

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let mut numbers = Vec::new();
        let mut heads = Vec::new();
        for column in &self.columns {
            let texts = match &column.values {
                Values::Numbers(values) => {
                    numbers.extend_from_slice(values);
                    None
                }
                Values::Texts(texts) => Some(texts.clone()),
            };
            heads.push(ColumnHead {
                name: column.name.clone(),
                unit: column.unit.clone(),
                texts,
                marked: column.marked.clone(),
                decimals: column.decimals,
            });
        }
        let n_columns = heads.iter().filter(|it| it.texts.is_none()).count();
        to.owned("numbers", &[n_columns, numbers.len() / n_columns.max(1)], numbers);
        to.text("columns", serde_json::to_string(&heads).expect("heads are plain data"));
        to.text("statistics", self.n_statistics.to_string());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let heads: Vec<ColumnHead> = serde_json::from_str(from.text("columns")?)
            .map_err(|e| DecodeError(format!("`columns`: {e}")))?;
        let (n_columns, n_rows, numbers) = from.matrix::<f64>("numbers")?;
        if n_columns != heads.iter().filter(|it| it.texts.is_none()).count() {
            return Err(DecodeError(format!("{n_columns} columns of numbers")));
        }
        let mut next = 0;
        let mut columns = Vec::new();
        for ColumnHead { name, unit, texts, marked, decimals } in heads {
            let values = match texts {
                Some(texts) => Values::Texts(texts),
                None => {
                    next += 1;
                    Values::Numbers(numbers[(next - 1) * n_rows..next * n_rows].to_vec())
                }
            };
            columns.push(Column { name, unit, values, marked, decimals });
        }
        if columns.windows(2).any(|it| it[0].len() != it[1].len()) {
            return Err(DecodeError::new("the columns differ in length"));
        }
        let is_beyond = |it: &Column| it.marked.iter().any(|&row| row >= it.len());
        if let Some(column) = columns.iter().find(|it| is_beyond(it)) {
            return Err(DecodeError(format!("`{}` marks a row it does not have", column.name)));
        }
        let table = Self::new(columns);
        match from.text("statistics")?.parse() {
            Ok(n_statistics) if n_statistics <= table.n_rows() => {
                Ok(Self { n_statistics, ..table })
            }
            _ => Err(DecodeError::new("`statistics` is no number of rows")),
        }
    }

    fn import(extension: &str, bytes: &[u8]) -> Result<Self, String> {
        let options = TableFileOptions::default();
        read_table(extension, bytes, &options).map_err(|e| e.to_string())
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "csv" => Ok(write_csv(self).into_bytes()),
            "json" => Ok(write_json(self).into_bytes()),
            "md" => Ok(write_markdown(self).into_bytes()),
            "tex" => Ok(write_latex(self).into_bytes()),
            _ => Err(format!("a table cannot be written as .{extension}")),
        }
    }

    fn summary(&self) -> Vec<(String, String)> {
        let rows = match self.n_statistics {
            0 => self.n_rows().to_string(),
            n => format!("{} and {n} of statistics", self.n_data_rows()),
        };
        let mut lines = vec![("rows".to_owned(), rows)];
        for column in &self.columns {
            let first: Vec<String> = (0..column.len().min(5)).map(|it| shown(column, it)).collect();
            let more = if column.len() > 5 { ", …" } else { "" };
            lines.push((column.head(), first.join(", ") + more));
        }
        lines
    }
}
