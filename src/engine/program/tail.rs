//! What is kept of a stream: its end.

use std::collections::VecDeque;

/// So many bytes of what a program prints are kept, of each stream.
const KEPT: usize = 256 << 10;

/// So many lines of what a program printed are shown when it fails.
const SHOWN_LINES: usize = 12;

/// The end of a stream of bytes.
#[derive(Debug, Clone, Default)]
pub struct Tail {
    kept: VecDeque<u8>,
    n_bytes: u64,
}

impl Tail {
    pub fn push(&mut self, bytes: &[u8]) {
        self.n_bytes += bytes.len() as u64;
        let bytes = &bytes[bytes.len().saturating_sub(KEPT)..];
        let excess = (self.kept.len() + bytes.len()).saturating_sub(KEPT);
        self.kept.drain(..excess.min(self.kept.len()));
        self.kept.extend(bytes);
    }

    pub fn is_empty(&self) -> bool {
        self.n_bytes == 0
    }

    /// As text. What was cut off is counted in the first line.
    pub fn text(&self) -> String {
        let bytes: Vec<u8> = self.kept.iter().copied().collect();
        if self.n_bytes == bytes.len() as u64 {
            return String::from_utf8_lossy(&bytes).into_owned();
        }
        // From the start of a line, unless the line is longer than all that is kept.
        let start = bytes.iter().position(|&it| it == b'\n').map_or(0, |it| it + 1);
        let n_cut = self.n_bytes - (bytes.len() - start) as u64;
        format!(
            "[{n_cut} bytes before this are not kept]\n{}",
            String::from_utf8_lossy(&bytes[start..])
        )
    }

    /// The last lines, for a message.
    pub fn last_lines(&self, n_lines: usize) -> String {
        let text = self.text();
        let lines: Vec<&str> = text.lines().filter(|it| !it.trim().is_empty()).collect();
        lines[lines.len().saturating_sub(n_lines)..].join("\n")
    }

    /// The last lines, to follow a message.
    pub fn shown_end(&self) -> String {
        match self.last_lines(SHOWN_LINES) {
            lines if lines.is_empty() => lines,
            lines => format!("; it printed:\n{lines}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tail_begins_with_a_line_and_counts_what_is_cut() {
        let mut tail = Tail::default();
        for index in 0..100_000 {
            tail.push(format!("line {index}\n").as_bytes());
        }
        let text = tail.text();
        let (first, rest) = text.split_once('\n').unwrap();
        let n_cut: usize = first[1..].split(' ').next().unwrap().parse().unwrap();
        let whole: String = (0..100_000).map(|it| format!("line {it}\n")).collect();
        assert_eq!(rest, &whole[n_cut..]);
        assert!(rest.starts_with("line ") && rest.len() > KEPT - 20 && rest.len() <= KEPT);
        assert_eq!(tail.last_lines(2), "line 99998\nline 99999");
        let mut short = Tail::default();
        short.push(b"all\xff");
        assert_eq!(short.text(), "all\u{fffd}");
    }
}
