//! Reads plain TOML fast: what nearly all pipelines are made of.
//!
//! It is one pass from the text to [`Entry`]s, without a tree in between, and knows tables with simple
//! keys, one-line texts without escapes, decimal numbers, truth values, lists and inline tables.
//! Whatever else it meets, a mistake above all, it leaves to the full parser: it never reports
//! anything, and what it returns is what the full parser would have made of the same text.

use std::{collections::HashMap, ops::Range, sync::Arc};

use super::value::{Data, Entry, Key, Value};
use crate::engine::graph::Place;

/// The entries of a text in its order; `None` if it is not plain.
pub fn read(text: &str, source: usize) -> Option<Vec<Entry>> {
    let mut reader =
        Reader { text, bytes: text.as_bytes(), at: 0, depth: 0, source, names: Vec::new() };
    let mut file = File::default();
    loop {
        reader.skip_blank_lines()?;
        match reader.peek() {
            None => {
                file.close_table()?;
                return Some(file.root);
            }
            Some(b'[') => {
                file.close_table()?;
                let (keys, place) = reader.header()?;
                file.open_table(&keys, &place, text)?;
            }
            Some(_) => {
                let (name, place) = reader.key()?;
                reader.expect_equals()?;
                let value = reader.value()?;
                reader.end_line()?;
                let key = Key { name: reader.shared(name), place };
                push(&mut file.current, Entry { key, value })?;
            }
        }
    }
}

/// A name and where it stands.
type Name<'t> = (&'t str, Place);

/// The sections of a file so far.
#[derive(Default)]
struct File<'t> {
    root: Vec<Entry>,
    /// By section: where its entries are, by name. There may be many.
    index: Vec<HashMap<&'t str, usize>>,
    /// Where the table is that is being read.
    path: Vec<usize>,
    /// Its entries so far.
    current: Vec<Entry>,
}

/// A table that has more entries, and is no section, is left to the full parser.
const MANY: usize = 200;

impl<'t> File<'t> {
    /// Begins `[a.b]`, which must not be there yet; `a` may.
    fn open_table(&mut self, keys: &[Name<'t>], place: &Place, text: &'t str) -> Option<()> {
        self.path.clear();
        let mut table = &mut self.root;
        for (depth, (name, key_place)) in keys.iter().enumerate() {
            let is_last = depth + 1 == keys.len();
            let index = (depth == 1).then(|| &mut self.index[self.path[0]]);
            let known = match &index {
                Some(index) if !index.is_empty() => index.get(name).copied(),
                _ => table.iter().position(|it| *it.key.name == **name),
            };
            let position = match known {
                Some(_) if is_last => return None,
                Some(position) => position,
                None => {
                    let key = Key { name: (*name).into(), place: key_place.clone() };
                    // A table that only a longer name speaks of stands where it is named first.
                    let value_place = if is_last { place } else { key_place };
                    let value = Value::new(Data::Table(Arc::default()), value_place.clone());
                    if let Some(index) = index {
                        if index.is_empty() {
                            if keys[0].0 == "nodes" {
                                // As many as there can be.
                                let n_tables = text.matches("\n[").count();
                                index.reserve(n_tables);
                                table.reserve(n_tables);
                            }
                            let known = table.iter().enumerate();
                            index.extend(known.map(|(at, it)| (name_in(text, it), at)));
                        }
                        index.insert(name, table.len());
                    }
                    if depth == 0 {
                        self.index.push(HashMap::new());
                    }
                    table.push(Entry { key, value });
                    table.len() - 1
                }
            };
            self.path.push(position);
            table = entries_of(&mut table[position])?;
        }
        Some(())
    }

    /// Puts the entries that were read into their table.
    fn close_table(&mut self) -> Option<()> {
        let mut table = &mut self.root;
        for &position in &self.path {
            table = entries_of(&mut table[position])?;
        }
        *table = self.current.drain(..).collect();
        if self.path.is_empty() {
            self.index.resize_with(self.root.len(), HashMap::new);
        }
        Some(())
    }
}

/// The name of an entry where it is written.
fn name_in<'t>(text: &'t str, entry: &Entry) -> &'t str {
    let written = &text[entry.key.place.span()];
    match written.as_bytes() {
        [b'"' | b'\'', ..] => &written[1..written.len() - 1],
        _ => written,
    }
}

/// The entries of a table that nobody shares yet; `None` if it is none.
fn entries_of(entry: &mut Entry) -> Option<&mut Vec<Entry>> {
    match &mut entry.value.data {
        Data::Table(entries) => Arc::get_mut(entries),
        _ => None,
    }
}

/// Adds an entry; `None` if its name is taken.
fn push(table: &mut Vec<Entry>, entry: Entry) -> Option<()> {
    let is_taken = table.iter().any(|it| it.key.name == entry.key.name);
    table.push(entry);
    (!is_taken && table.len() <= MANY).then_some(())
}

struct Reader<'t> {
    text: &'t str,
    bytes: &'t [u8],
    at: usize,
    /// Of lists and tables in each other, around what is read.
    depth: usize,
    source: usize,
    /// Names that nodes share: most have the same few keys.
    names: Vec<Arc<str>>,
}

/// Values in more lists and tables are left to the full parser, which refuses what is too deep.
const DEEP: usize = 32;

/// So many names are looked through to share one.
const SHARED_NAMES: usize = 16;

impl<'t> Reader<'t> {
    fn shared(&mut self, name: &str) -> Arc<str> {
        if let Some(found) = self.names.iter().find(|it| ***it == *name) {
            return Arc::clone(found);
        }
        let name: Arc<str> = name.into();
        if self.names.len() < SHARED_NAMES {
            self.names.push(Arc::clone(&name));
        }
        name
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn take(&mut self, byte: u8) -> Option<()> {
        let found = self.peek() == Some(byte);
        self.at += usize::from(found);
        found.then_some(())
    }

    fn place(&self, span: Range<usize>) -> Place {
        Place::new(self.source, span)
    }

    fn skip_while(&mut self, skips: impl Fn(u8) -> bool) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|it| !skips(*it)).unwrap_or(rest.len());
    }

    fn skip_spaces(&mut self) {
        self.skip_while(|it| it == b' ' || it == b'\t');
    }

    /// Skips a comment, if there is one, up to the end of its line.
    fn skip_comment(&mut self) -> Option<()> {
        if self.peek() == Some(b'#') {
            self.skip_while(|it| !is_control(it));
        }
        Some(())
    }

    /// The end of a line or of the text.
    fn line_break(&mut self) -> Option<()> {
        match self.bytes[self.at..] {
            [] => {}
            [b'\n', ..] => self.at += 1,
            [b'\r', b'\n', ..] => self.at += 2,
            _ => return None,
        }
        Some(())
    }

    fn end_line(&mut self) -> Option<()> {
        self.skip_spaces();
        self.skip_comment()?;
        self.line_break()
    }

    /// Everything up to the next thing on any line.
    fn skip_blank_lines(&mut self) -> Option<()> {
        loop {
            self.skip_spaces();
            match self.peek() {
                Some(b'#' | b'\n' | b'\r') => self.end_line()?,
                _ => return Some(()),
            }
        }
    }

    fn expect_equals(&mut self) -> Option<()> {
        self.skip_spaces();
        self.take(b'=')?;
        self.skip_spaces();
        Some(())
    }

    /// A bare key, or a quoted one without escapes.
    fn key(&mut self) -> Option<Name<'t>> {
        let start = self.at;
        let name = match self.peek()? {
            b'"' | b'\'' => self.text()?,
            _ => {
                self.skip_while(|it| it.is_ascii_alphanumeric() || it == b'_' || it == b'-');
                let name = &self.text[start..self.at];
                (!name.is_empty()).then_some(name)?
            }
        };
        Some((name, self.place(start..self.at)))
    }

    /// `[a.b]`
    fn header(&mut self) -> Option<(Vec<Name<'t>>, Place)> {
        let start = self.at;
        self.take(b'[')?;
        let mut keys = Vec::with_capacity(2);
        loop {
            self.skip_spaces();
            keys.push(self.key()?);
            self.skip_spaces();
            if self.take(b'.').is_none() {
                break;
            }
        }
        self.take(b']')?;
        let place = self.place(start..self.at);
        self.end_line()?;
        Some((keys, place))
    }

    fn value(&mut self) -> Option<Value> {
        let start = self.at;
        let data = match self.peek()? {
            b'"' | b'\'' => Data::Text(self.text()?.into()),
            b'[' => self.nested(Self::list)?,
            b'{' => self.nested(Self::inline_table)?,
            b't' => self.word("true", true)?,
            b'f' => self.word("false", false)?,
            _ => self.number()?,
        };
        Some(Value::new(data, self.place(start..self.at)))
    }

    fn nested(&mut self, read: impl FnOnce(&mut Self) -> Option<Data>) -> Option<Data> {
        if self.depth == DEEP {
            return None;
        }
        self.depth += 1;
        let data = read(self);
        self.depth -= 1;
        data
    }

    /// A text on one line without escapes.
    fn text(&mut self) -> Option<&'t str> {
        let quote = self.peek()?;
        let start = self.at + 1;
        self.at = start;
        self.skip_while(|it| it != quote && it != b'\\' && !is_control(it));
        let text = &self.text[start..self.at];
        self.take(quote)?;
        // Three quotes begin another kind of text.
        let is_plain = !(text.is_empty() && self.peek() == Some(quote));
        is_plain.then_some(text)
    }

    fn word(&mut self, word: &str, value: bool) -> Option<Data> {
        let rest = self.text[self.at..].strip_prefix(word)?;
        self.at += word.len();
        is_end(rest.as_bytes().first().copied()).then_some(Data::Bool(value))
    }

    fn number(&mut self) -> Option<Data> {
        let start = self.at;
        self.skip_while(|it| it.is_ascii_alphanumeric() || matches!(it, b'+' | b'-' | b'.'));
        if !is_end(self.peek()) {
            return None;
        }
        let written = &self.text[start..self.at];
        let digits = written.strip_prefix('-').unwrap_or(written);
        let (whole, rest) = digits.split_at(digits.bytes().take_while(u8::is_ascii_digit).count());
        if whole.is_empty() || (whole.len() > 1 && whole.starts_with('0')) {
            return None;
        }
        if rest.is_empty() {
            return written.parse().ok().map(Data::Integer);
        }
        let number = is_fraction(rest).then(|| written.parse::<f64>().ok())??;
        number.is_finite().then_some(Data::Float(number))
    }

    fn list(&mut self) -> Option<Data> {
        self.take(b'[')?;
        let mut items = Vec::new();
        loop {
            self.skip_blank_lines()?;
            if self.take(b']').is_some() {
                return Some(Data::List(items.into()));
            }
            items.push(self.value()?);
            self.skip_blank_lines()?;
            if self.take(b',').is_none() {
                self.take(b']')?;
                return Some(Data::List(items.into()));
            }
        }
    }

    fn inline_table(&mut self) -> Option<Data> {
        self.take(b'{')?;
        let mut entries = Vec::new();
        self.skip_spaces();
        if self.take(b'}').is_some() {
            return Some(Data::Table(entries.into()));
        }
        loop {
            self.skip_spaces();
            let (name, place) = self.key()?;
            self.expect_equals()?;
            let value = self.value()?;
            push(&mut entries, Entry { key: Key { name: name.into(), place }, value })?;
            self.skip_spaces();
            if self.take(b',').is_none() {
                self.take(b'}')?;
                return Some(Data::Table(entries.into()));
            }
        }
    }
}

/// Whether a byte is none that may stand in a text or in a comment.
fn is_control(byte: u8) -> bool {
    (byte < b' ' && byte != b'\t') || byte == 0x7f
}

/// Whether a number or a word ends before this byte.
fn is_end(byte: Option<u8>) -> bool {
    byte.is_none_or(|it| matches!(it, b' ' | b'\t' | b'\n' | b'\r' | b',' | b']' | b'}' | b'#'))
}

/// `.5`, `.5e-3`, `e6`: what follows the whole part of a number.
fn is_fraction(rest: &str) -> bool {
    let all_digits = |it: &str| !it.is_empty() && it.bytes().all(|it| it.is_ascii_digit());
    let (fraction, exponent) = match rest.split_once(['e', 'E']) {
        Some((fraction, exponent)) => (fraction, Some(exponent)),
        None => (rest, None),
    };
    let is_sound = |it: &str| all_digits(it.strip_prefix(['+', '-']).unwrap_or(it));
    (fraction.is_empty() || fraction.strip_prefix('.').is_some_and(all_digits))
        && exponent.is_none_or(is_sound)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use toml::de::DeTable;

    use super::*;
    use crate::engine::pipeline::value;

    /// What the full parser makes of a text; `None` if it complains.
    fn full(text: &str) -> Option<Vec<Entry>> {
        let (table, errors) = DeTable::parse_recoverable(text);
        let mut problems = Vec::new();
        let entries = value::entries(table.into_inner(), 3, &mut problems);
        (errors.is_empty() && problems.is_empty()).then_some(entries)
    }

    /// Whether a text is plain; if so, the full parser must make the same of it.
    fn is_plain(text: &str) -> bool {
        let Some(found) = read(text, 3) else { return false };
        let expected = full(text).unwrap_or_else(|| panic!("it is no TOML:\n{text}"));
        assert_eq!(format!("{found:#?}"), format!("{expected:#?}"), "{text}");
        true
    }

    const PIPELINE: &str = "# A comment with ü.\n[pipeline]\ntitle = \"Größe\" # why\n\n\
        [params]\nk = 120\nnone = 0\ndown = -7\r\nx = 0.5\ny = -1.5e-3\nz=2E6\non = true\n  off\t= false\n\
        [axes.shape]\nfiles = ['a/*.off', \"b/*.off\"]\n\
        [axes.seed]\nrange = { from = 1, to = 10 }\nempty = {}\n\
        [nodes.first]\nkind = \"number\"\nlist = [\n  1, # one\n  [2, 3],\n\n  { a = 1, b = [] },\n]\n\
        [nodes.first.inner]\nvalue = \"\"\n[ nodes . second-1 ]\nkind = ''\n\
        [outputs]\n\"out/${shape}.txt\" = \"@first\"\n'b c' = \"@second-1\"\n";

    #[test]
    fn pipelines_are_plain() {
        assert!(is_plain(PIPELINE));
        assert!(is_plain(""));
        assert!(is_plain("a = 1"));
        let many: String = (0..30).map(|it| format!("[nodes.n{it}]\nkind = \"a\"\n")).collect();
        assert!(is_plain(&many));
        assert!(!is_plain(&format!("{many}[nodes.n17]\n")));
        assert!(is_plain("[a]\n'\"b\"' = 1\nc = 2\n[a.b]\n[a.'\"d\"']\n"));
        assert!(!is_plain("[a]\n'\"b\"' = 1\nc = 2\n[a.d]\n[a.'\"b\"']\n"));
    }

    #[test]
    fn what_is_not_plain_is_left_to_the_full_parser() {
        for text in [
            "a = \"\\n\"",
            "a = \"\"\"x\"\"\"",
            "a = '''x'''",
            "a = 1_000",
            "a = 0x10",
            "a = +1",
            "a = 01",
            "a = 1.",
            "a = .5",
            "a = nan",
            "a = 1e999",
            "a = 99999999999999999999",
            "a = 1979-05-27",
            "a.b = 1",
            "a = { b.c = 1 }",
            "[[a]]\nb = 1",
            "[a.b]\n[a]\nc = 1",
            "a = 1\na = 2",
            "a = 1\n[a]",
            "a = 1 b = 2",
            "a = [1 2]",
            "a = [1",
            "a = {",
            "a = \"x",
            "a = truer",
            "[a",
            "a",
            "\u{feff}a = 1",
            "a = 1 # \u{1}",
            "a = \"\u{7f}\"",
            "a = 1\rb = 2",
        ] {
            assert!(!is_plain(text), "{text}");
        }
        let nested = |depth: usize| format!("a = {}{}", "[".repeat(depth), "]".repeat(depth));
        assert!(is_plain(&nested(DEEP)) && !is_plain(&nested(DEEP + 1)));
        assert!(!is_plain(&nested(100_000)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn no_text_is_read_in_two_ways(
            edits in prop::collection::vec(
                (0..PIPELINE.len(), 0..3_usize, prop::sample::select(
                    "\"'\\[]{}=.,#-+_eE019 \t\n\rabtf\u{1}ü$@".chars().collect::<Vec<char>>()
                )),
                1..4,
            )
        ) {
            let mut text: Vec<char> = PIPELINE.chars().collect();
            for (at, n_removed, new) in edits {
                let at = at.min(text.len());
                let end = (at + n_removed).min(text.len());
                text.splice(at..end, [new]);
            }
            is_plain(&text.into_iter().collect::<String>());
        }
    }
}
