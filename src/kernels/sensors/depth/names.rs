//! What the names of pictures say about their order.

use std::cmp::Ordering;

/// Orders names by their texts and, where both have digits, by the numbers of these.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    loop {
        let order = match (chunk(left), chunk(right)) {
            (None, None) => return a.cmp(b),
            (Some(_), None) => return Ordering::Greater,
            (None, Some(_)) => return Ordering::Less,
            (Some(own), Some(other)) => {
                (left, right) = (&left[own.len()..], &right[other.len()..]);
                match (is_number(own), is_number(other)) {
                    (true, true) => {
                        let [own, other] = [own, other].map(|it| it.trim_start_matches('0'));
                        own.len().cmp(&other.len()).then(own.cmp(other))
                    }
                    _ => own.cmp(other),
                }
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// The digits at the beginning of a text, or what comes before the first ones.
fn chunk(text: &str) -> Option<&str> {
    let starts = is_number(text.get(..1).unwrap_or_default());
    let end = text.find(|it: char| it.is_ascii_digit() != starts).unwrap_or(text.len());
    (end > 0).then(|| &text[..end])
}

fn is_number(chunk: &str) -> bool {
    chunk.bytes().next().is_some_and(|it| it.is_ascii_digit())
}

/// Says where the numbers at the ends of names, in their order, have gaps.
pub fn missing_pictures<'a>(names: impl Iterator<Item = &'a str>) -> Option<String> {
    let numbered: Vec<(&str, u64)> =
        names.map(|it| Some((it, last_number(it)?))).collect::<Option<_>>()?;
    let steps = || numbered.windows(2).map(|it| it[1].1.saturating_sub(it[0].1));
    let usual = steps().min().filter(|it| *it > 0)?;
    let (gap, _) = numbered.windows(2).zip(steps()).find(|it| it.1 > usual)?;
    let n_missing: u64 = steps().map(|it| it / usual - 1).sum();
    Some(format!(
        "{n_missing} pictures are missing by their numbers, first between `{}` and `{}`; those that \
         are there count as frames at equal times",
        gap[0].0, gap[1].0
    ))
}

/// The number that a file's name ends with, before its extension.
fn last_number(name: &str) -> Option<u64> {
    let stem = name.rsplit_once('.').map_or(name, |it| it.0);
    let start = stem.trim_end_matches(|it: char| it.is_ascii_digit()).len();
    stem[start..].parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = [
            "f10.png", "f9.png", "f009.png", "f.png", "e100.png", "f9a.png", "é2.png", "10", "9",
            "",
        ];
        names.sort_by(|a, b| natural_order(a, b));
        let expected = [
            "", "9", "10", "e100.png", "f009.png", "f9.png", "f9a.png", "f10.png", "f.png",
            "é2.png",
        ];
        assert_eq!(names, expected);
        let long = "1".repeat(60);
        assert_eq!(natural_order(&long, &format!("{long}0")), Ordering::Less);
    }

    #[test]
    fn gaps_in_the_numbers_of_pictures_are_told() {
        let note = |names: &[&str]| missing_pictures(names.iter().copied());
        assert_eq!(note(&["a1.png", "a2.png", "a3.png"]), None);
        assert_eq!(note(&["0000.png", "0010.png", "0020.png"]), None, "every tenth");
        assert_eq!(note(&["front.png", "side.png", "x9.png"]), None);
        assert_eq!(note(&["one.png"]), None);
        let told = note(&["f_01.exr", "f_02.exr", "f_05.exr", "f_06.exr", "f_08.exr"]).unwrap();
        assert!(told.starts_with("3 pictures are missing"), "{told}");
        assert!(told.contains("between `f_02.exr` and `f_05.exr`"), "{told}");
    }
}
