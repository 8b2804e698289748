//! Tables from files: CSV, TSV, TOML.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use super::{
    csv::{Record, read_records},
    error::{ReadError, text},
};
use crate::kernels::table::{Column, Table, Values, number};

/// What a file does not say of itself.
#[derive(Debug, Clone, Default)]
pub struct TableFileOptions {
    /// Columns that hold texts though they look like numbers.
    pub texts: Vec<String>,
    /// Texts that stand for a missing value, beside the empty one.
    pub missing: Vec<String>,
    /// TOML: the name of the array of tables; the only one without.
    pub list: Option<String>,
}

/// The extensions that can be read, in lower case.
pub const TABLE_EXTENSIONS: [&str; 3] = ["csv", "toml", "tsv"];

/// Reads a table; the extension (in lower case, without dot) decides.
///
/// A column is one of numbers if all that is not missing in it is written as a number (`003` is not). A unit
/// may follow the name in brackets: `error [mm]`.
///
/// # Errors
/// See [`read_records`]; if there are no columns, a name is empty or given twice, or a TOML value is no
/// number or text.
pub fn read_table(
    extension: &str,
    bytes: &[u8],
    options: &TableFileOptions,
) -> Result<Table, ReadError> {
    let table = match extension {
        "csv" => from_records(&read_records(bytes, b',')?, options),
        "tsv" => from_records(&read_records(bytes, b'\t')?, options),
        "toml" => from_toml(text("TOML", bytes)?, options),
        _ => {
            return Err(ReadError::Unknown {
                extension: extension.to_owned(),
                known: TABLE_EXTENSIONS.map(|it| format!("`.{it}`")).join(", "),
            });
        }
    }?;
    match options.texts.iter().find(|it| table.column(it).is_none()) {
        Some(name) => {
            let what = format!("there is no column `{name}` to take as texts");
            Err(ReadError::content("table", what))
        }
        None => Ok(table),
    }
}

fn from_records(records: &[Record], options: &TableFileOptions) -> Result<Table, ReadError> {
    let [header, rows @ ..] = records else { return Err(ReadError::Empty { format: "CSV" }) };
    let mut heads: Vec<(&str, &str)> = Vec::new();
    for field in &header.fields {
        let head = name_and_unit(field);
        check_name(head.0, heads.iter().any(|it| it.0 == head.0))
            .map_err(|what| ReadError::line("CSV", header.line, what))?;
        heads.push(head);
    }
    let column = |(index, &(name, unit)): (usize, &(&str, &str))| {
        let fields: Vec<&str> = rows.iter().map(|it| it.fields[index].as_str()).collect();
        Column::new(name, unit, values(name, &fields, options))
    };
    Ok(Table::new(heads.iter().enumerate().map(column).collect()))
}

/// Numbers if all texts are numbers or missing, and one is there.
fn values(name: &str, fields: &[&str], options: &TableFileOptions) -> Values {
    let is_missing = |it: &str| {
        it.trim().is_empty() || options.missing.iter().any(|missing| missing == it.trim())
    };
    let parsed = |it: &&str| match it.trim() {
        it if is_missing(it) => Some(f64::NAN),
        "inf" | "Infinity" => Some(f64::INFINITY),
        "-inf" | "-Infinity" => Some(f64::NEG_INFINITY),
        it => number(it),
    };
    let numbers: Option<Vec<f64>> = fields.iter().map(parsed).collect();
    match numbers {
        Some(numbers) if !options.texts.iter().any(|it| it == name) => Values::Numbers(numbers),
        _ => {
            let known = |it: &&str| if is_missing(it) { String::new() } else { (*it).to_owned() };
            Values::Texts(fields.iter().map(known).collect())
        }
    }
}

/// `error [mm]` is the name `error` and the unit `mm`.
fn name_and_unit(head: &str) -> (&str, &str) {
    let head = head.trim();
    let split = head.strip_suffix(']').and_then(|it| it.rsplit_once(" ["));
    split.map_or((head, ""), |(name, unit)| (name.trim(), unit))
}

fn check_name(name: &str, is_known: bool) -> Result<(), String> {
    match name {
        "" => Err("a column has no name".to_owned()),
        _ if is_known => Err(format!("there are two columns `{name}`")),
        _ => Ok(()),
    }
}

/// A TOML value and where it is.
type Place<'a> = (&'a DeValue<'a>, usize);

fn from_toml(text: &str, options: &TableFileOptions) -> Result<Table, ReadError> {
    let line = |span: Range<usize>| text[..span.start.min(text.len())].matches('\n').count() + 1;
    let document = DeTable::parse(text).map_err(|error| {
        let line = line(error.span().unwrap_or(0..0));
        ReadError::line("TOML", line, error.message().lines().collect::<Vec<_>>().join(", "))
    })?;
    let rows = rows_of(document.get_ref(), options)?;
    let mut columns: Vec<(String, Vec<Option<Place<'_>>>)> = Vec::new();
    for (index, row) in rows.iter().enumerate() {
        let DeValue::Table(row) = row.get_ref() else { unreachable!("rows are tables") };
        let mut row: Vec<_> = row.iter().collect();
        // Columns come in the order of the file, not of the alphabet.
        row.sort_by_key(|it| it.0.span().start);
        for (key, value) in row {
            let name: &str = key.get_ref();
            let column = match columns.iter().position(|it| it.0 == name) {
                Some(known) => known,
                None => {
                    columns.push((name.to_owned(), Vec::new()));
                    columns.len() - 1
                }
            };
            columns[column].1.resize(index, None);
            columns[column].1.push(Some((value.get_ref(), line(value.span()))));
        }
    }
    let mut res: Vec<Column> = Vec::new();
    for (head, mut cells) in columns {
        cells.resize(rows.len(), None);
        let (name, unit) = name_and_unit(&head);
        check_name(name, res.iter().any(|it| it.name == name))
            .map_err(|what| ReadError::content("TOML", what))?;
        res.push(Column::new(name, unit, toml_values(name, &cells, options)?));
    }
    Ok(Table::new(res))
}

/// The array of tables that is read.
fn rows_of<'a>(
    document: &'a DeTable<'a>,
    options: &TableFileOptions,
) -> Result<&'a [toml::Spanned<DeValue<'a>>], ReadError> {
    let mut lists: Vec<(&str, &[toml::Spanned<DeValue<'_>>])> = Vec::new();
    for (name, value) in document {
        if let DeValue::Array(items) = value.get_ref()
            && !items.is_empty()
            && items.iter().all(|it| matches!(it.get_ref(), DeValue::Table(_)))
        {
            lists.push((name.get_ref(), items));
        }
    }
    let names: Vec<String> = lists.iter().map(|it| format!("`{}`", it.0)).collect();
    let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    match &options.list {
        Some(wanted) => lists.iter().find(|it| it.0 == wanted).map(|it| it.1).ok_or_else(|| {
            let what = format!("there is no array of tables `{wanted}`; there are {names}");
            ReadError::content("TOML", what)
        }),
        None if lists.len() == 1 => Ok(lists[0].1),
        None => {
            let what = format!("one array of tables is needed, but there are {names}");
            Err(ReadError::content("TOML", what))
        }
    }
}

fn toml_values(
    name: &str,
    cells: &[Option<Place<'_>>],
    options: &TableFileOptions,
) -> Result<Values, ReadError> {
    let mut texts: Vec<&str> = Vec::with_capacity(cells.len());
    let mut is_text = options.texts.iter().any(|it| it == name);
    let mut first_number = None;
    let mut first_text = None;
    for cell in cells {
        let Some((value, line)) = cell else {
            texts.push("");
            continue;
        };
        match value {
            DeValue::String(it) => {
                is_text = true;
                first_text = first_text.or(Some(*line));
                texts.push(it);
            }
            DeValue::Integer(it) => {
                first_number = first_number.or(Some(*line));
                texts.push(it.as_str());
            }
            DeValue::Float(it) => {
                first_number = first_number.or(Some(*line));
                texts.push(it.as_str());
            }
            DeValue::Boolean(it) => {
                is_text = true;
                texts.push(if *it { "true" } else { "false" });
            }
            _ => {
                let what = format!("`{name}` is neither a number nor a text");
                return Err(ReadError::line("TOML", *line, what));
            }
        }
    }
    if let (Some(number), Some(text)) = (first_number, first_text) {
        let what = format!("`{name}` is a number, but a text in line {text}");
        return Err(ReadError::line("TOML", number, what));
    }
    if is_text {
        return Ok(Values::Texts(texts.into_iter().map(str::to_owned).collect()));
    }
    let parsed = |it: &str| {
        let plain = it.trim_start_matches('+').replace('_', "");
        if it.is_empty() { Some(f64::NAN) } else { plain.parse().ok() }
    };
    let numbers: Option<Vec<f64>> = texts.iter().map(|it| parsed(it)).collect();
    numbers.map(Values::Numbers).ok_or_else(|| {
        ReadError::content("TOML", format!("`{name}` holds a number that cannot be read"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::io::table_text::write_csv;

    fn read(extension: &str, text: &str) -> Result<Table, String> {
        let options =
            TableFileOptions { missing: vec!["NA".to_owned()], ..TableFileOptions::default() };
        read_table(extension, text.as_bytes(), &options).map_err(|it| it.to_string())
    }

    #[test]
    fn columns_are_numbers_or_texts() {
        let table =
            read("csv", "id,error [mm],note\n003,0.5,\n004,NA,x\n005,1e-3,\"a,b\"\n").unwrap();
        let texts = |it: &[&str]| Values::Texts(it.iter().map(|&it| it.to_owned()).collect());
        assert_eq!(table.columns[0].values, texts(&["003", "004", "005"]));
        assert_eq!(table.columns[1].head(), "error [mm]");
        let Values::Numbers(errors) = &table.columns[1].values else { panic!("texts") };
        assert!(errors[0] == 0.5 && errors[1].is_nan() && errors[2] == 1e-3);
        assert_eq!(table.columns[2].values, texts(&["", "x", "a,b"]));
    }

    #[test]
    fn what_is_written_reads_back() {
        let names = ["plain", "with, \"quotes\"", " two\nlines "].map(str::to_owned).to_vec();
        let table = Table::new(vec![
            Column::texts("name", names),
            Column::numbers("error", "mm", vec![0.1 + 0.2, f64::NEG_INFINITY, 1e300]),
        ]);
        assert_eq!(read("csv", &write_csv(&table)).unwrap(), table);
        let one = Table::new(vec![Column::numbers("a", "", vec![1.0, f64::NAN])]);
        assert_eq!(read("csv", &write_csv(&one)).unwrap().n_rows(), 2);
    }

    #[test]
    fn toml_rows_may_lack_keys() {
        let text = "title = \"x\"\n[[rows]]\nname = \"a\"\nerror = 1\n\n[[rows]]\nerror = 2.5\n\
                    \"time [ms]\" = 1_000\nok = true\n";
        let table = read("toml", text).unwrap();
        let heads: Vec<String> = table.columns.iter().map(Column::head).collect();
        assert_eq!(heads, ["name", "error", "time [ms]", "ok"]);
        assert_eq!(table.columns[0].values, Values::Texts(vec!["a".to_owned(), String::new()]));
        assert_eq!(table.columns[1].values, Values::Numbers(vec![1.0, 2.5]));
        assert_eq!(table.columns[2].values.text(1), "1000");
        let inline = read("toml", "rows = [{ a = 1 }, { a = -2 }]\n").unwrap();
        assert_eq!(inline.columns[0].values, Values::Numbers(vec![1.0, -2.0]));
    }

    #[test]
    fn mistakes_have_places() {
        let check = |extension: &str, text: &str, expected: &str| {
            assert_eq!(read(extension, text).unwrap_err(), expected);
        };
        check("csv", "a,a\n1,2\n", "CSV file, line 1: there are two columns `a`");
        check("csv", "a,\n1,2\n", "CSV file, line 1: a column has no name");
        check("csv", "a [m],a [mm]\n1,2\n", "CSV file, line 1: there are two columns `a`");
        check("xls", "", "no reader for `.xls` files (there are `.csv`, `.toml`, `.tsv`)");
        check("toml", "a = 1\n", "TOML file: one array of tables is needed, but there are none");
        check(
            "toml",
            "[[a]]\nx = 1\n[[b]]\nx = 1\n",
            "TOML file: one array of tables is needed, but there are `a`, `b`",
        );
        check(
            "toml",
            "[[a]]\nx = 1\n[[a]]\nx = \"one\"\n",
            "TOML file, line 2: `x` is a number, but a text in line 4",
        );
        check(
            "toml",
            "[[a]]\n\nx = [1]\n",
            "TOML file, line 3: `x` is neither a number nor a text",
        );
        let error = read("toml", "[[a]]\nx = \n").unwrap_err();
        assert!(error.starts_with("TOML file, line 2: "), "{error}");
        assert!(read_table("csv", &[b'a', 0xff], &TableFileOptions::default()).is_err());
    }

    #[test]
    fn a_header_alone_is_a_table_without_rows() {
        let table = read("csv", "a,b\n").unwrap();
        assert_eq!((table.columns.len(), table.n_rows()), (2, 0));
    }
}
