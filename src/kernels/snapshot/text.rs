//! Captions in a small stroke font of our own: round pens along polylines, smooth at any size.

use super::Canvas;
use super::colors::Color;

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

/// Writes a line of text, centred at `x`, with its baseline at `y`.
pub fn write(canvas: &mut Canvas, text: &str, [x, y]: [f32; 2], height: f32, color: Color) {
    let unit = height / CAPITAL;
    let pen = (0.085 * height).max(0.6);
    let left = x - width(text, height) / 2.0;
    let (strokes, _) = strokes(text);
    for stroke in strokes {
        let points: Stroke =
            stroke.iter().map(|it| [left + it[0] * unit, y - (it[1] - 2.0) * unit]).collect();
        draw(canvas, &points, pen, color);
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
        let glyph = GLYPHS.iter().find(|it| it.0 == character).map_or(UNKNOWN, |it| it.1);
        let mut right = 0.0f32;
        for stroke in glyph.split(' ') {
            let points = parse(stroke);
            right = points.iter().fold(right, |res, it| res.max(it[0]));
            strokes.push(points.iter().map(|it| [it[0] + cursor, it[1]]).collect());
        }
        cursor += right + GAP;
    }
    (strokes, cursor)
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

/// Draws a chain of segments with a round pen; every pixel by its distance from the whole chain, so
/// that joints are no darker.
fn draw(canvas: &mut Canvas, points: &[[f32; 2]], pen: f32, color: Color) {
    let reach = pen + 1.0;
    let bound = |axis: usize, limit: usize| {
        let low = points.iter().fold(f32::INFINITY, |res, it| res.min(it[axis])) - reach;
        let high = points.iter().fold(f32::NEG_INFINITY, |res, it| res.max(it[axis])) + reach;
        (low.max(0.0) as usize)..(high.max(0.0).ceil() as usize).min(limit)
    };
    for y in bound(1, canvas.height) {
        for x in bound(0, canvas.width) {
            let pixel = [x as f32 + 0.5, y as f32 + 0.5];
            let distance = points
                .windows(2)
                .map(|it| distance_to_segment(pixel, it[0], it[1]))
                .fold(f32::INFINITY, f32::min);
            canvas.blend(x, y, color, (pen + 0.5 - distance).clamp(0.0, 1.0));
        }
    }
}

fn distance_to_segment(point: [f32; 2], from: [f32; 2], to: [f32; 2]) -> f32 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let length2 = along[0] * along[0] + along[1] * along[1];
    let offset = [point[0] - from[0], point[1] - from[1]];
    let t =
        if length2 > 0.0 { (offset[0] * along[0] + offset[1] * along[1]) / length2 } else { 0.0 };
    let t = t.clamp(0.0, 1.0);
    (offset[0] - t * along[0]).hypot(offset[1] - t * along[1])
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
    fn text_is_as_wide_as_its_letters() {
        assert_eq!(width("", 12.0), 0.0);
        assert!(width("mm", 12.0) > width("il", 12.0));
        assert_eq!(width("abc", 24.0), 2.0 * width("abc", 12.0));
    }
}
