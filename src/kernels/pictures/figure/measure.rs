//! How much room a text needs, whoever draws it.

use crate::kernels::pictures::canvas::text;

/// Of a capital, as a part of a font's size: that of common sans-serif fonts.
pub const CAPITAL: f64 = 0.72;

/// The greater one of the widths in our stroke font and, roughly, in the sans-serif font of a browser.
pub fn text_width(line: &str, size: f64) -> f64 {
    let own = f64::from(text::width(line, (CAPITAL * size) as f32));
    let browser: f64 = line.chars().map(em_width).sum::<f64>() * size;
    own.max(browser)
}

fn em_width(letter: char) -> f64 {
    match letter {
        'i' | 'j' | 'l' | '\'' | '|' => 0.24,
        'f' | 't' | 'r' | 'I' | '.' | ',' | ':' | ';' | '!' | '(' | ')' | '[' | ']' | ' ' => 0.31,
        '⁰'..='⁹' | '¹' | '²' | '³' | '⁻' | '·' => 0.35,
        'm' | 'w' | 'M' | 'W' | '%' | '@' => 0.87,
        'A'..='Z' => 0.70,
        _ => 0.56,
    }
}

/// The text, or its beginning with `…` if it is wider than the room.
pub fn fitted(line: &str, size: f64, room: f64) -> String {
    if text_width(line, size) <= room {
        return line.to_owned();
    }
    let mut letters: Vec<char> = line.chars().collect();
    while let Some(_dropped) = letters.pop() {
        let shorter: String = letters.iter().collect::<String>().trim_end().to_owned() + "…";
        if text_width(&shorter, size) <= room {
            return shorter;
        }
    }
    String::new()
}

/// The text in lines that are no wider than the room, broken at blanks; `None` if a word is wider or there
/// would be too many lines.
pub fn wrapped(text: &str, size: f64, room: f64, most_lines: usize) -> Option<Vec<String>> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let longer = lines.last().map(|it| format!("{it} {word}"));
        match longer.filter(|it| text_width(it, size) <= room) {
            Some(longer) => *lines.last_mut().expect("it was just read") = longer,
            None if text_width(word, size) <= room => lines.push(word.to_owned()),
            None => return None,
        }
    }
    (lines.len() <= most_lines).then_some(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_cut_and_broken_to_their_room() {
        let width = text_width("functional maps", 10.0);
        assert_eq!(fitted("functional maps", 10.0, width), "functional maps");
        let cut = fitted("functional maps", 10.0, 0.7 * width);
        assert!(cut.starts_with("funct") && cut.ends_with('…'), "{cut}");
        assert!(text_width(&cut, 10.0) <= 0.7 * width);
        assert_eq!(fitted("functional maps", 10.0, 1.0), "");
        let lines = wrapped("functional maps", 10.0, 0.7 * width, 2).unwrap();
        assert_eq!(lines, ["functional", "maps"]);
        assert_eq!(wrapped("functional maps", 10.0, 0.7 * width, 1), None);
        assert_eq!(wrapped("functional maps", 10.0, 10.0, 9), None);
    }
}
