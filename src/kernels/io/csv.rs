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
pub fn read_records(bytes: &[u8], separator: char) -> Result<Vec<Record>, ReadError> {
    let text = text(FORMAT, bytes)?;
    let mut reader = Reader { rest: text, line: 1, separator };
    let mut records: Vec<Record> = Vec::new();
    while !reader.rest.is_empty() {
        if reader.take_line_end() {
            continue;
        }
        let record = reader.record()?;
        let (found, expected) = (record.fields.len(), records.first().map(|it| it.fields.len()));
        if let Some(expected) = expected.filter(|&it| it != found) {
            let what = format!("it has {found} fields, but the header has {expected}");
            return Err(ReadError::line(FORMAT, record.line, what));
        }
        records.push(record);
    }
    Ok(records)
}

struct Reader<'a> {
    rest: &'a str,
    line: usize,
    separator: char,
}

impl Reader<'_> {
    fn record(&mut self) -> Result<Record, ReadError> {
        let line = self.line;
        let mut fields = Vec::new();
        loop {
            fields.push(match self.rest.strip_prefix('"') {
                Some(rest) => {
                    self.rest = rest;
                    self.quoted()?
                }
                None => self.plain()?,
            });
            if let Some(rest) = self.rest.strip_prefix(self.separator) {
                self.rest = rest;
            } else if self.rest.is_empty() || self.take_line_end() {
                return Ok(Record { line, fields });
            } else {
                return Err(self.error("text follows a quoted field"));
            }
        }
    }

    /// A field without quotes around it; a quote within is refused, because readers differ about it.
    fn plain(&mut self) -> Result<String, ReadError> {
        let is_end = |it: char| it == self.separator || it == '\n' || it == '\r';
        let (field, rest) = self.rest.split_at(self.rest.find(is_end).unwrap_or(self.rest.len()));
        if field.contains('"') {
            return Err(self.error(format!("a quote stands within the field `{field}`")));
        }
        self.rest = rest;
        if rest.starts_with('\r') && !rest.starts_with("\r\n") {
            return Err(self.error("a carriage return stands without a line end"));
        }
        Ok(field.to_owned())
    }

    /// The rest of a field whose first quote has been read.
    fn quoted(&mut self) -> Result<String, ReadError> {
        let mut field = String::new();
        loop {
            let Some(end) = self.rest.find('"') else {
                return Err(self.error("a quote is not closed"));
            };
            let (part, rest) = (&self.rest[..end], &self.rest[end + 1..]);
            field += part;
            match rest.strip_prefix('"') {
                Some(rest) => {
                    field.push('"');
                    self.rest = rest;
                }
                None => {
                    self.rest = rest;
                    self.line += field.matches('\n').count();
                    return Ok(field);
                }
            }
        }
    }

    fn take_line_end(&mut self) -> bool {
        let rest = self.rest.strip_prefix("\r\n").or_else(|| self.rest.strip_prefix('\n'));
        self.line += usize::from(rest.is_some());
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn error(&self, what: impl Into<String>) -> ReadError {
        ReadError::line(FORMAT, self.line, what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Record>, String> {
        read_records(text.as_bytes(), ',').map_err(|it| it.to_string())
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
        assert_eq!(error("a\n\"1\" m\n"), "CSV file, line 2: text follows a quoted field");
        assert_eq!(error("a\n6\"\n"), "CSV file, line 2: a quote stands within the field `6\"`");
        assert_eq!(
            error("a\r1\r"),
            "CSV file, line 1: a carriage return stands without a line end"
        );
    }
}
