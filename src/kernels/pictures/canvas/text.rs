//! Texts in a small stroke font of our own: round pens along polylines, smooth at any size.

use super::{Canvas, color::Color, stroke};

/// Strokes by character, apart by blanks. A stroke is a chain of points `xy` on a grid: the baseline
/// is y = 2, capitals end at 8, small letters at 6, descenders at 0. `~` rounds a stroke's corners.
const GLYPHS: &[(char, &str)] = &[
    ('A', "022842 1434"),
    ('B', "0208 ~083847463505 ~053544433202"),
    ('C', "~4738180703123243"),
    ('D', "0208 ~082846442202"),
    ('E', "48080242 0535"),
    ('F', "480802 0535"),
    ('G', "~4738180703123243 424525"),
    ('H', "0208 4248 0545"),
    ('I', "0208"),
    ('J', "~3833221203"),
    ('K', "0208 4804 1542"),
    ('L', "080242"),
    ('M', "0208244842"),
    ('N', "02084248"),
    ('O', "~28384743321203071828"),
    ('P', "0208 ~083847453404"),
    ('Q', "~28384743321203071828 2442"),
    ('R', "0208 ~083847453404 2442"),
    ('S', "~473818070615354443321203"),
    ('T', "0848 2822"),
    ('U', "~080312324348"),
    ('V', "082248"),
    ('W', "0812263248"),
    ('X', "0248 0842"),
    ('Y', "082548 2522"),
    ('Z', "08480242"),
    ('a', "3632 ~3526160503122233"),
    ('b', "0208 ~0516263533221203"),
    ('c', "~3526160503122233"),
    ('d', "3832 ~3526160503122233"),
    ('e', "0434 ~343526160503122233"),
    ('f', "~28271712 0626"),
    ('g', "~3631201001 ~3526160503122233"),
    ('h', "0208 ~0516263532"),
    ('i', "0206 0808"),
    ('j', "~161100 1818"),
    ('k', "0208 3603 1432"),
    ('l', "0802"),
    ('m', "0206 ~05162522 ~25364542"),
    ('n', "0206 ~0516263532"),
    ('o', "~162635332212030516"),
    ('p', "0600 ~0516263533221203"),
    ('q', "3630 ~3526160503122233"),
    ('r', "0206 ~041626"),
    ('s', "~35261605142433221203"),
    ('t', "~18131222 0626"),
    ('u', "~0603122233 3632"),
    ('v', "062246"),
    ('w', "0612253246"),
    ('x', "0236 0632"),
    ('y', "0622 4610"),
    ('z', "06360232"),
    ('0', "~182837332212030718"),
    ('1', "071812"),
    ('2', "~0718283736250302 0232"),
    ('3', "~07182837362515 ~253433221203"),
    ('4', "22280434"),
    ('5', "380805 ~05253433221203"),
    ('6', "~372818070312223334251504"),
    ('7', "083812"),
    ('8', "~182837362515060718 ~152534332212030415"),
    ('9', "~362515060718283733221203"),
    ('.', "0202"),
    (',', "1201"),
    (':', "0202 0505"),
    (';', "1201 1515"),
    ('!', "0804 0202"),
    ('?', "~071828373624 2222"),
    ('-', "0525"),
    ('–', "0545"),
    ('—', "0565"),
    ('·', "0505"),
    ('×', "0436 0634"),
    ('→', "0545 374533"),
    ('+', "0545 2327"),
    ('=', "0444 0646"),
    ('_', "0141"),
    ('/', "0238"),
    ('\\', "0832"),
    ('(', "~18070312"),
    (')', "~08171302"),
    ('[', "18080212"),
    (']', "08181202"),
    ('{', "~281715041322"),
    ('}', "~081715241302"),
    ('|', "0009"),
    ('%', "0248 ~0818170708 ~3343423233"),
    ('*', "2327 1436 1634"),
    ('<', "370533"),
    ('>', "073503"),
    ('\'', "0806"),
    ('"', "0806 1816"),
    ('#', "1218 3238 0444 0646"),
    ('&', "~420718270403122244"),
    ('@', "~35261605142535 ~354544464838180703123242"),
    ('^', "061826"),
    ('~', "~05163445"),
    ('$', "~473818070615354443321203 2129"),
    ('`', "0817"),
    ('−', "0545"),
    ('±', "0646 2428 0242"),
    ('≤', "380634 0232"),
    ('≥', "083604 0232"),
    ('≈', "~06173546 ~03143243"),
    ('°', "~0818170708"),
    ('•', "1515"),
    ('…', "0202 2222 4242"),
    ('ß', "~0207182837362515 ~15353322"),
    ('Δ', "02284202"),
    ('Σ', "480824 240242"),
    ('Φ', "~174746444313030517 2802"),
    ('Ω', "0212 ~1203071828373322 2232"),
    ('α', "~4622120305162642"),
    ('β', "0007 ~071828372615 ~152534332202"),
    ('γ', "062220 4622"),
    ('δ', "~37281716253433221203041535"),
    ('ε', "~3526160514 1424 ~1403122233"),
    ('θ', "~182837332212030718 0535"),
    ('κ', "0602 3604 0432"),
    ('λ', "081842 2502"),
    ('μ', "~0603122233 3632 0600"),
    ('π', "0646 1612 3632"),
    ('ρ', "0500 ~0516263533221203"),
    ('σ', "~162635332212030516 1646"),
    ('τ', "0636 1612"),
    ('φ', "~163645433212030516 2800"),
    ('ω', "~0603122224 ~2422324346"),
];

/// Characters that are written as another one.
const SAME: &[(char, char)] =
    &[('µ', 'μ'), ('’', '\''), ('‘', '\''), ('“', '"'), ('”', '"'), ('‐', '-'), ('‑', '-')];

/// Small digits above the line, and what they are made from.
const RAISED: (&str, &str) = ("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+");

/// Letters with a mark above, the letters alone, and the mark above a small letter.
const MARKED: &[(&str, &str, &str)] = &[
    ("àèìòùÀÈÌÒÙ", "aeiouAEIOU", "0817"),
    ("áéíóúýÁÉÍÓÚÝ", "aeiouyAEIOUY", "1827"),
    ("âêîôûÂÊÎÔÛ", "aeiouAEIOU", "071827"),
    ("äëïöüÄËÏÖÜ", "aeiouAEIOU", "0808 2828"),
    ("ñãõÑÃÕ", "naoNAO", "~07182738"),
    ("åÅ", "aA", "~1828271718"),
    ("čšžřěČŠŽŘĚ", "cszreCSZRE", "081728"),
];

/// The strokes for what is not in the list.
const UNKNOWN: &str = "0208484202";

/// Grid units from the baseline to a capital's top.
const CAPITAL: f32 = 6.0;
const BLANK_ADVANCE: f32 = 3.0;
const GAP: f32 = 1.9;

type Stroke = Vec<[f32; 2]>;

/// The width of a line of text whose capitals are `height` pixels tall.
pub fn width(text: &str, height: f32) -> f32 {
    let (_, advance) = strokes(text);
    (advance - GAP).max(0.0) * height / CAPITAL
}

/// How a line of text is written.
#[derive(Debug, Clone, Copy)]
pub struct Lettering {
    /// Of capitals, in pixels.
    pub height: f32,
    /// Which part of the line is at its place: 0 is the start, 1 the end.
    pub anchor: f32,
    /// Against the clock.
    pub angle_rad: f32,
    /// The radius of the pen as a part of the height.
    pub pen: f32,
}

/// Writes a line of text, centred at `x`, with its baseline at `y`.
pub fn write_centered(canvas: &mut Canvas, text: &str, at: [f32; 2], height: f32, color: Color) {
    let lettering = Lettering { height, anchor: 0.5, angle_rad: 0.0, pen: 0.085 };
    write(canvas, text, at, lettering, color);
}

/// Writes a line of text; its place is a point of the baseline.
pub fn write(
    canvas: &mut Canvas,
    text: &str,
    [x, y]: [f32; 2],
    lettering: Lettering,
    color: Color,
) {
    let unit = lettering.height / CAPITAL;
    let pen = (lettering.pen * lettering.height).max(0.6);
    let left = -width(text, lettering.height) * lettering.anchor;
    let (sin, cos) = lettering.angle_rad.sin_cos();
    let (strokes, _) = strokes(text);
    for chain in strokes {
        let place = |it: &[f32; 2]| {
            let (along, up) = (left + it[0] * unit, (it[1] - 2.0) * unit);
            [x + along * cos - up * sin, y - along * sin - up * cos]
        };
        let points: Stroke = chain.iter().map(place).collect();
        stroke(canvas, &points, pen, color, 1.0);
    }
}

/// All strokes of a line on the font's grid, and where the next character would begin.
fn strokes(text: &str) -> (Vec<Stroke>, f32) {
    let mut strokes = Vec::new();
    let mut cursor = 0.0;
    for character in text.chars() {
        if character.is_whitespace() {
            cursor += BLANK_ADVANCE;
            continue;
        }
        let glyph = glyph(character);
        let right = glyph.iter().flatten().fold(0.0f32, |res, it| res.max(it[0]));
        for stroke in glyph {
            strokes.push(stroke.iter().map(|it| [it[0] + cursor, it[1]]).collect());
        }
        cursor += right + GAP;
    }
    (strokes, cursor)
}

/// The strokes of one character.
fn glyph(character: char) -> Vec<Stroke> {
    let character = SAME.iter().find(|it| it.0 == character).map_or(character, |it| it.1);
    if let Some(base) = counterpart(character, RAISED.0, RAISED.1) {
        let raised = |it: &[f32; 2]| [0.6 * it[0], 8.4 - 0.6 * (8.0 - it[1])];
        return glyph(base).iter().map(|it| it.iter().map(raised).collect()).collect();
    }
    for (letters, bases, mark) in MARKED {
        if let Some(base) = counterpart(character, letters, bases) {
            // An i has a mark instead of its dot.
            let base_strokes = if base == 'i' { parsed("0206") } else { glyph(base) };
            let right = base_strokes.iter().flatten().fold(0.0f32, |res, it| res.max(it[0]));
            let (lift, shift) = (if base.is_uppercase() { 1.8 } else { 0.0 }, right / 2.0 - 1.0);
            let placed = |it: &[f32; 2]| [(it[0] + shift).max(0.0), it[1] + lift];
            let mark = parsed(mark).into_iter().map(|it| it.iter().map(placed).collect());
            return base_strokes.into_iter().chain(mark).collect();
        }
    }
    parsed(GLYPHS.iter().find(|it| it.0 == character).map_or(UNKNOWN, |it| it.1))
}

/// The character of `bases` at the place where another has this one.
fn counterpart(character: char, all: &str, bases: &str) -> Option<char> {
    let place = all.chars().position(|it| it == character)?;
    bases.chars().nth(place)
}

fn parsed(strokes: &str) -> Vec<Stroke> {
    strokes.split(' ').map(parse).collect()
}

fn parse(stroke: &str) -> Stroke {
    let digits = stroke.trim_start_matches('~').as_bytes();
    let points: Stroke =
        digits.chunks(2).map(|it| [f32::from(it[0] - b'0'), f32::from(it[1] - b'0')]).collect();
    if stroke.starts_with('~') { rounded(rounded(points)) } else { points }
}

/// Cuts every corner at a quarter of its edges (Chaikin 1974); ends stay unless they meet.
fn rounded(points: Stroke) -> Stroke {
    let (first, last) = (points[0], points[points.len() - 1]);
    let mut cut = Vec::with_capacity(2 * points.len());
    for pair in points.windows(2) {
        let at = |t: f32| [0, 1].map(|it| pair[0][it] + t * (pair[1][it] - pair[0][it]));
        cut.extend([at(0.25), at(0.75)]);
    }
    if first == last {
        cut.push(cut[0]);
    } else {
        cut.insert(0, first);
        cut.push(last);
    }
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_ascii_character_has_a_glyph_on_the_grid() {
        for character in '!'..='~' {
            let glyph = GLYPHS.iter().find(|it| it.0 == character);
            let (_, strokes) = glyph.unwrap_or_else(|| panic!("no glyph for `{character}`"));
            for stroke in strokes.split(' ') {
                assert_eq!(stroke.trim_start_matches('~').len() % 2, 0, "`{character}`: {stroke}");
                let points = parse(stroke);
                assert!(points.len() >= 2, "`{character}`: {stroke}");
                assert!(points.iter().all(|it| it[0] <= 6.0 && it[1] <= 9.0), "`{character}`");
            }
        }
    }

    #[test]
    fn marked_and_raised_characters_are_made_from_others() {
        for (letters, bases, _) in MARKED {
            assert_eq!(letters.chars().count(), bases.chars().count(), "{letters}");
        }
        assert_eq!(RAISED.0.chars().count(), RAISED.1.chars().count());
        assert_eq!(glyph('ö').len(), glyph('o').len() + 2);
        assert!(width("10³", 12.0) < width("103", 12.0));
        assert!(glyph('³').iter().flatten().all(|it| it[1] > 4.0), "it stands above the middle");
    }

    #[test]
    fn every_glyph_is_on_the_grid() {
        for (character, strokes) in GLYPHS {
            for stroke in strokes.split(' ') {
                assert_eq!(stroke.trim_start_matches('~').len() % 2, 0, "`{character}`: {stroke}");
                assert!(parse(stroke).len() >= 2, "`{character}`: {stroke}");
            }
        }
    }

    #[test]
    fn text_is_as_wide_as_its_letters() {
        assert_eq!(width("", 12.0), 0.0);
        assert!(width("mm", 12.0) > width("il", 12.0));
        assert_eq!(width("abc", 24.0), 2.0 * width("abc", 12.0));
    }
}
