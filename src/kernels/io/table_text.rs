//! Tables as text: CSV, JSON records, Markdown.

use std::fmt::Write as _;

use serde_json::{Map, Value};

use crate::kernels::table::{Column, Table, Values};

/// Writes comma-separated values (RFC 4180) with a header and lines that end with `\n`.
///
/// Numbers are as short as they read back to the same; missing ones are empty. Units follow their
/// names in brackets: `error [mm]`.
pub fn write_csv(table: &Table) -> String {
    let quoted = |it: &str| {
        let special = it.contains(['"', ',', '\n', '\r']) || it.trim() != it;
        if special { format!("\"{}\"", it.replace('"', "\"\"")) } else { it.to_owned() }
    };
    let mut out = String::new();
    let heads: Vec<String> = table.columns.iter().map(|it| quoted(&head(it))).collect();
    writeln!(out, "{}", heads.join(",")).expect("strings take all");
    for row in 0..table.n_rows() {
        let cells: Vec<String> = table
            .columns
            .iter()
            .map(|it| match &it.values {
                Values::Numbers(values) if values[row].is_nan() => String::new(),
                Values::Numbers(values) => values[row].to_string(),
                Values::Texts(texts) => quoted(&texts[row]),
            })
            .collect();
        writeln!(out, "{}", cells.join(",")).expect("strings take all");
    }
    out
}

/// Writes a JSON list with one object a row, keyed by the columns' names without units.
///
/// JSON has no infinite numbers; they become `null`, as missing ones do.
pub fn write_json(table: &Table) -> String {
    let rows: Vec<Value> = (0..table.n_rows())
        .map(|row| {
            let cells = table.columns.iter().map(|it| {
                let value = match &it.values {
                    Values::Numbers(values) => Value::from(values[row]),
                    Values::Texts(texts) => Value::from(texts[row].as_str()),
                };
                (it.name.clone(), value)
            });
            Value::Object(cells.collect::<Map<_, _>>())
        })
        .collect();
    serde_json::to_string_pretty(&rows).expect("tables are plain data") + "\n"
}

/// Writes a Markdown table; numbers have five significant digits and stand to the right, marked ones
/// are bold.
pub fn write_markdown(table: &Table) -> String {
    let escaped = |it: &str| it.replace('|', "\\|").replace(['\n', '\r'], " ");
    let columns: Vec<(bool, Vec<String>)> = table
        .columns
        .iter()
        .map(|column| {
            let (is_number, cells) = match &column.values {
                Values::Numbers(values) => (true, values.iter().map(|&it| short(it)).collect()),
                Values::Texts(texts) => (false, texts.iter().map(|it| escaped(it)).collect()),
            };
            let mut cells: Vec<String> = cells;
            for &row in &column.marked {
                cells[row] = format!("**{}**", cells[row]);
            }
            (is_number, std::iter::once(escaped(&head(column))).chain(cells).collect())
        })
        .collect();
    let width =
        |cells: &[String]| cells.iter().map(|it| it.chars().count()).max().unwrap_or(0).max(3);
    let mut out = String::new();
    for row in 0..=table.n_rows() {
        for (is_number, cells) in &columns {
            let (cell, width) = (&cells[row], width(cells));
            let text = if *is_number {
                format!("| {cell:>width$} ")
            } else {
                format!("| {cell:<width$} ")
            };
            out += &text;
        }
        out += "|\n";
        if row == 0 {
            for (is_number, cells) in &columns {
                let dashes = "-".repeat(width(cells) - 1);
                out += &if *is_number { format!("| {dashes}: ") } else { format!("| {dashes}- ") };
            }
            out += "|\n";
        }
    }
    out
}

fn head(column: &Column) -> String {
    match column.unit.as_str() {
        "" => column.name.clone(),
        unit => format!("{} [{unit}]", column.name),
    }
}

/// Five significant digits without needless zeros; empty for a missing value.
fn short(value: f64) -> String {
    if value.is_nan() {
        return String::new();
    }
    let size = value.abs();
    if value.fract() == 0.0 && size < 1e15 {
        return format!("{value:.0}");
    }
    if !size.is_finite() || !(1e-4..1e15).contains(&size) {
        return format!("{value:.4e}");
    }
    let decimals = (4 - size.log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let names = ["plain", "with, \"quotes\"", "a|b"].map(str::to_owned).to_vec();
        Table::new(vec![
            Column::texts("name", names),
            Column::numbers("error", "mm", vec![0.1 + 0.2, f64::NAN, 12345.678]),
        ])
    }

    #[test]
    fn csv_quotes_and_keeps_every_digit() {
        let expected = "name,error [mm]\nplain,0.30000000000000004\n\
                        \"with, \"\"quotes\"\"\",\na|b,12345.678\n";
        assert_eq!(write_csv(&table()), expected);
    }

    #[test]
    fn json_has_a_record_a_row() {
        let rows: Vec<Value> = serde_json::from_str(&write_json(&table())).unwrap();
        assert_eq!(rows[1], serde_json::json!({ "name": "with, \"quotes\"", "error": null }));
        assert_eq!(rows[2]["error"], 12345.678);
    }

    #[test]
    fn markdown_is_aligned() {
        let expected = "| name           | error [mm] |\n\
                        | -------------- | ---------: |\n\
                        | plain          |        0.3 |\n\
                        | with, \"quotes\" |            |\n\
                        | a\\|b           |      12346 |\n";
        assert_eq!(write_markdown(&table()), expected);
    }

    #[test]
    fn numbers_are_short() {
        let cases =
            [(0.0, "0"), (-3.0, "-3"), (1234567.0, "1234567"), (0.00012345678, "0.00012346")];
        for (value, expected) in cases {
            assert_eq!(short(value), expected);
        }
        assert_eq!(short(1.5e-7), "1.5000e-7");
    }
}
