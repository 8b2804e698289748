//! A stream as lines.

/// A longer line is cut.
const MAX_LINE: usize = 1 << 20;

/// Puts lines together from what comes of a stream.
#[derive(Debug, Default)]
pub struct Lines {
    /// The start of the next line.
    rest: Vec<u8>,
}

impl Lines {
    /// Calls back with every line that is whole now, without its end.
    pub fn push(&mut self, bytes: &[u8], mut on_line: impl FnMut(&str)) {
        for piece in bytes.split_inclusive(|&it| it == b'\n') {
            self.rest.extend_from_slice(piece);
            if piece.ends_with(b"\n") || self.rest.len() >= MAX_LINE {
                self.end(&mut on_line);
            }
        }
    }

    /// Calls back with what follows the last line end, if anything does.
    pub fn end(&mut self, mut on_line: impl FnMut(&str)) {
        if !self.rest.is_empty() {
            on_line(String::from_utf8_lossy(&self.rest).trim_end_matches(['\r', '\n']));
            self.rest.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_whole_however_they_are_cut() {
        let text = b"one\r\n\ntwo \xff\nrest";
        for length in 1..=text.len() {
            let (mut lines, mut heard) = (Lines::default(), Vec::new());
            for piece in text.chunks(length) {
                lines.push(piece, |it| heard.push(it.to_owned()));
            }
            assert_eq!(heard, ["one", "", "two \u{fffd}"]);
            lines.end(|it| heard.push(it.to_owned()));
            lines.end(|it| panic!("`{it}` comes twice"));
            assert_eq!(heard[3..], ["rest"]);
        }
    }

    #[test]
    fn a_line_without_end_is_cut() {
        let (mut lines, mut n_heard) = (Lines::default(), 0);
        for _ in 0..100 {
            lines.push(&[b'x'; 64 << 10], |_| n_heard += 1);
            assert!(lines.rest.len() < MAX_LINE);
        }
        assert_eq!(n_heard, 100 * (64 << 10) / MAX_LINE);
    }
}
