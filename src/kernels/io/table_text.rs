//! Tables as text: CSV, JSON records, Markdown, LaTeX.

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
    let mut write_line = |cells: Vec<String>| {
        // An empty line would be no record.
        let is_blank = cells.len() == 1 && cells[0].is_empty();
        let line = if is_blank { "\"\"".to_owned() } else { cells.join(",") };
        writeln!(out, "{line}").expect("strings take all");
    };
    write_line(table.columns.iter().map(|it| quoted(&it.head())).collect());
    for row in 0..table.n_rows() {
        write_line(table.columns.iter().map(|it| quoted(&it.values.text(row))).collect());
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

/// Writes a Markdown table; numbers have the decimals of their columns or five significant digits and
/// stand to the right, marked ones are bold, missing ones a dash.
pub fn write_markdown(table: &Table) -> String {
    let columns: Vec<(bool, Vec<String>)> = table
        .columns
        .iter()
        .map(|column| {
            let is_number = matches!(column.values, Values::Numbers(_));
            let mut cells: Vec<String> =
                (0..column.len()).map(|row| escaped_markdown(&shown(column, row))).collect();
            for &row in &column.marked {
                cells[row] = format!("**{}**", cells[row]);
            }
            let head = escaped_markdown(&column.head());
            (is_number, std::iter::once(head).chain(cells).collect())
        })
        .collect();
    let width =
        |cells: &[String]| cells.iter().map(|it| it.chars().count()).max().unwrap_or(0).max(3);
    let widths: Vec<usize> = columns.iter().map(|it| width(&it.1)).collect();
    let mut out = String::new();
    for row in 0..=table.n_rows() {
        for ((is_number, cells), &width) in columns.iter().zip(&widths) {
            let cell = &cells[row];
            let text = if *is_number {
                format!("| {cell:>width$} ")
            } else {
                format!("| {cell:<width$} ")
            };
            out += &text;
        }
        out += "|\n";
        if row == 0 {
            for ((is_number, _), width) in columns.iter().zip(&widths) {
                let dashes = "-".repeat(width - 1);
                out += &if *is_number { format!("| {dashes}: ") } else { format!("| {dashes}- ") };
            }
            out += "|\n";
        }
    }
    out
}

/// Escapes what would be markup. An underscore within a word is none.
fn escaped_markdown(text: &str) -> String {
    let letters: Vec<char> = text.chars().collect();
    let is_word = |at: Option<usize>| {
        at.and_then(|it| letters.get(it)).is_some_and(|it| it.is_alphanumeric())
    };
    let mut res = String::new();
    for (at, &letter) in letters.iter().enumerate() {
        match letter {
            '\n' | '\r' => res.push(' '),
            '|' | '*' | '`' | '<' | '\\' => res.extend(['\\', letter]),
            '_' if !(is_word(at.checked_sub(1)) && is_word(Some(at + 1))) => res += "\\_",
            _ => res.push(letter),
        }
    }
    res
}

/// Writes a LaTeX `tabular` with the rules of the package booktabs; marked numbers are bold, missing ones a
/// dash, and a rule stands above the statistics.
pub fn write_latex(table: &Table) -> String {
    let letter = |it: &Column| if matches!(it.values, Values::Numbers(_)) { 'r' } else { 'l' };
    let letters: String = table.columns.iter().map(letter).collect();
    let mut out = format!("\\begin{{tabular}}{{{letters}}}\n  \\toprule\n");
    let mut write_line = |cells: Vec<String>, rule: &str| {
        writeln!(out, "  {} \\\\{rule}", cells.join(" & ")).expect("strings take all");
    };
    let rule = |is_here: bool| if is_here { "\n  \\midrule" } else { "" };
    let heads = table.columns.iter().map(|it| escaped_latex(&it.head())).collect();
    write_line(heads, rule(table.n_rows() > 0));
    for row in 0..table.n_rows() {
        let cells = table.columns.iter().map(|it| latex_cell(it, row)).collect();
        let is_last_data = table.n_statistics > 0 && row + 1 == table.n_data_rows();
        write_line(cells, rule(is_last_data));
    }
    out + "  \\bottomrule\n\\end{tabular}\n"
}

fn latex_cell(column: &Column, row: usize) -> String {
    let text = shown(column, row);
    let is_marked = column.marked.contains(&row);
    let bold = |it: String| if is_marked { format!("\\textbf{{{it}}}") } else { it };
    let Values::Numbers(values) = &column.values else { return bold(escaped_latex(&text)) };
    if values[row].is_nan() {
        return "--".to_owned();
    }
    let text = text.replace("inf", "\\infty");
    match text.split_once('e') {
        Some((digits, exponent)) => bold(format!("${digits}\\cdot10^{{{exponent}}}$")),
        None if text.starts_with('-') || text.contains('\\') => bold(format!("${text}$")),
        None => bold(text),
    }
}

fn escaped_latex(text: &str) -> String {
    let mut res = String::new();
    for letter in text.chars() {
        match letter {
            '\n' | '\r' => res.push(' '),
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => res.extend(['\\', letter]),
            '\\' => res += "\\textbackslash{}",
            '~' => res += "\\textasciitilde{}",
            '^' => res += "\\textasciicircum{}",
            '–' => res += "--",
            '²' => res += "$^2$",
            '³' => res += "$^3$",
            // At the start of a row it would be an option of the line break before.
            '[' if res.is_empty() => res += "{[}",
            _ => res.push(letter),
        }
    }
    res
}

/// A cell as people read it.
pub fn shown(column: &Column, row: usize) -> String {
    match (&column.values, column.decimals) {
        (Values::Texts(texts), _) => texts[row].clone(),
        (Values::Numbers(values), _) if values[row].is_nan() => "–".to_owned(),
        (Values::Numbers(values), Some(decimals)) if values[row].is_finite() => {
            without_negative_zero(format!("{:.*}", usize::from(decimals), values[row]))
        }
        (Values::Numbers(values), _) => short(values[row]),
    }
}

fn without_negative_zero(text: String) -> String {
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|it| it == '0' || it == '.') => rest.to_owned(),
        _ => text,
    }
}

/// Five significant digits without needless zeros.
pub fn short(value: f64) -> String {
    let size = value.abs();
    if value.fract() == 0.0 && size < 1e15 {
        return without_negative_zero(format!("{value:.0}"));
    }
    if !size.is_finite() {
        return value.to_string();
    }
    if !(1e-4..1e15).contains(&size) {
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

    /// With marks, decimals, infinities and statistics.
    fn paper_table() -> Table {
        let names = ["a_b", "_c_", "50 % & more", "mean"].map(str::to_owned).to_vec();
        let mut errors = Column::numbers("error", "m²", vec![0.126, -2.0, f64::NAN, -0.0001]);
        errors.decimals = Some(2);
        errors.marked = vec![1];
        let rest = vec![1.5e-7, f64::NEG_INFINITY, 3.0, f64::INFINITY];
        let columns = vec![Column::texts("name", names), errors, Column::numbers("p*", "", rest)];
        Table { n_statistics: 1, ..Table::new(columns) }
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
                        | with, \"quotes\" |          – |\n\
                        | a\\|b           |      12346 |\n";
        assert_eq!(write_markdown(&table()), expected);
    }

    #[test]
    fn a_blank_cell_is_a_record_of_its_own() {
        let table = Table::new(vec![Column::numbers("a", "", vec![f64::NAN, 1.0])]);
        assert_eq!(write_csv(&table), "a\n\"\"\n1\n");
    }

    #[test]
    fn infinite_numbers_are_told_from_missing_ones_where_the_format_can() {
        let (csv, json) = (write_csv(&paper_table()), write_json(&paper_table()));
        assert!(csv.contains("_c_,-2,-inf\n"), "{csv}");
        let rows: Vec<Value> = serde_json::from_str(&json).unwrap();
        assert_eq!(rows[1], serde_json::json!({ "name": "_c_", "error": -2.0, "p*": null }));
    }

    #[test]
    fn markdown_marks_and_escapes() {
        let expected = "| name        | error [m²] |       p\\* |\n\
                        | ----------- | ---------: | --------: |\n\
                        | a_b         |       0.13 | 1.5000e-7 |\n\
                        | \\_c\\_       |  **-2.00** |      -inf |\n\
                        | 50 % & more |          – |         3 |\n\
                        | mean        |       0.00 |       inf |\n";
        assert_eq!(write_markdown(&paper_table()), expected);
    }

    #[test]
    fn latex_has_the_rules_of_booktabs() {
        let expected = "\\begin{tabular}{lrr}\n  \\toprule\n  \
                        name & error [m$^2$] & p* \\\\\n  \\midrule\n  \
                        a\\_b & 0.13 & $1.5000\\cdot10^{-7}$ \\\\\n  \
                        \\_c\\_ & \\textbf{$-2.00$} & $-\\infty$ \\\\\n  \
                        50 \\% \\& more & -- & 3 \\\\\n  \\midrule\n  \
                        mean & 0.00 & $\\infty$ \\\\\n  \\bottomrule\n\\end{tabular}\n";
        assert_eq!(write_latex(&paper_table()), expected);
        assert_eq!(
            escaped_latex("[x] {^~\\"),
            "{[}x] \\{\\textasciicircum{}\\textasciitilde{}\\textbackslash{}"
        );
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
