//! Separated values (RFC 4180) as records of texts.

use super::error::{ReadError, text};

/// One record and the line it begins at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// From 1.
    pub line: usize,
    pub fields: Vec<String>,
}

const FORMAT: &str = "CSV";

/// Reads records; fields in quotes may hold separators, line ends and doubled quotes. Lines end with `\n`
/// or `\r\n`; a byte order mark and empty lines are skipped.
///
/// # Errors
/// If the file is empty or no text, a quote is not closed or stands within a field, or a record has not as
/// many fields as the first.
pub fn read_records(bytes: &[u8], separator: u8) -> Result<Vec<Record>, ReadError> {
    let text = text(FORMAT, bytes)?;
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator)
        .has_headers(false)
        .flexible(true)
        .from_reader(text.as_bytes());
    let mut records: Vec<Record> = Vec::new();
    let mut fields = csv::StringRecord::new();
    let (mut line, mut counted) = (1, 0);
    loop {
        let before = reader.position().byte() as usize;
        let is_more = reader
            .read_record(&mut fields)
            .map_err(|e| ReadError::content(FORMAT, e.to_string()))?;
        if !is_more {
            return Ok(records);
        }
        let end = reader.position().byte() as usize;
        // The reader takes empty lines, and the `\n` of a `\r\n`, for the start of the next record.
        let start = end - text[before..end].trim_start_matches(['\r', '\n']).len();
        line += text[counted..start].matches('\n').count();
        counted = start;
        check_quotes(&text[start..end], &fields, char::from(separator))
            .and_then(|()| check_line_end(&text[..end], &text[end..]))
            .and_then(|()| check_length(fields.len(), records.first()))
            .map_err(|what| ReadError::line(FORMAT, line, what))?;
        records.push(Record { line, fields: fields.iter().map(str::to_owned).collect() });
    }
}

/// Every field stands there as it is, or in quotes. The reader guesses at all else, in its own way.
fn check_quotes(record: &str, fields: &csv::StringRecord, separator: char) -> Result<(), String> {
    let mut rest = record;
    for field in fields {
        let is_quoted = rest.starts_with('"');
        let written = match is_quoted {
            true => format!("\"{}\"", field.replace('"', "\"\"")),
            false if field.contains('"') => {
                return Err(format!("a quote stands within the field `{field}`"));
            }
            false => field.to_owned(),
        };
        let after = rest.strip_prefix(&written);
        match after.filter(|it| it.is_empty() || it.starts_with([separator, '\r', '\n'])) {
            Some(after) => rest = after.strip_prefix(separator).unwrap_or(after),
            None if record.matches('"').count() % 2 == 1 => {
                return Err("a quote is not closed".to_owned());
            }
            None => return Err("text follows a quoted field".to_owned()),
        }
    }
    Ok(())
}

fn check_line_end(before: &str, after: &str) -> Result<(), String> {
    match before.ends_with('\r') && !after.starts_with('\n') {
        true => Err("a carriage return stands without a line end".to_owned()),
        false => Ok(()),
    }
}

fn check_length(found: usize, header: Option<&Record>) -> Result<(), String> {
    match header.map(|it| it.fields.len()).filter(|&it| it != found) {
        Some(expected) => Err(format!("it has {found} fields, but the header has {expected}")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Record>, String> {
        read_records(text.as_bytes(), b',').map_err(|it| it.to_string())
    }

    #[track_caller]
    fn check(text: &str, expected: &[(usize, &[&str])]) {
        let owned = |fields: &[&str]| fields.iter().map(|&it| it.to_owned()).collect();
        let expected: Vec<Record> =
            expected.iter().map(|it| Record { line: it.0, fields: owned(it.1) }).collect();
        assert_eq!(read(text).unwrap(), expected);
    }

    #[test]
    fn fields_are_as_the_standard_says() {
        check("a,b\n1,2\n", &[(1, &["a", "b"]), (2, &["1", "2"])]);
        check("a,b\r\n1,2", &[(1, &["a", "b"]), (2, &["1", "2"])]);
        check("\u{feff}a,\"b\"\n\n,\n", &[(1, &["a", "b"]), (3, &["", ""])]);
        check("\"a,\"\"x\"\"\",b\n1,2\n", &[(1, &["a,\"x\"", "b"]), (2, &["1", "2"])]);
        check("\"a\nb\",c\n1,\"\"\n", &[(1, &["a\nb", "c"]), (3, &["1", ""])]);
        check("a\n\"\"\n", &[(1, &["a"]), (2, &[""])]);
        check("a\r\n\r\n\"1\r\n2\"\r\n\n3\r\n", &[(1, &["a"]), (3, &["1\r\n2"]), (6, &["3"])]);
        check("ä, x \n", &[(1, &["ä", " x "])]);
    }

    #[test]
    fn mistakes_have_lines() {
        let error = |text| read(text).unwrap_err();
        assert_eq!(error(""), "the CSV file is empty");
        assert_eq!(error("\n\r\n"), "the CSV file is empty");
        assert_eq!(
            error("a,b\n1,2\n1,2,3\n"),
            "CSV file, line 3: it has 3 fields, but the header has 2"
        );
        assert_eq!(error("a,b\n1,\"2\n"), "CSV file, line 2: a quote is not closed");
        assert_eq!(
            error("a\r\n1\r\n2,3\r\n"),
            "CSV file, line 3: it has 2 fields, but the header has 1"
        );
        assert_eq!(error("a\n\"1\n2\n"), "CSV file, line 2: a quote is not closed");
        assert_eq!(
            error("a,b\n\"1\"\"\",\"2\"x\"\"\n"),
            "CSV file, line 2: text follows a quoted field"
        );
        assert_eq!(error("a\n\"1\" m\n"), "CSV file, line 2: text follows a quoted field");
        assert_eq!(error("a\n6\"\n"), "CSV file, line 2: a quote stands within the field `6\"`");
        assert_eq!(
            error("a\r1\r"),
            "CSV file, line 1: a carriage return stands without a line end"
        );
    }
}
