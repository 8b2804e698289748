//! "Did you mean".

/// Asks for the nearest name, or lists the names if none is near: `expected `a` or `b``.
pub fn suggest<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let names: Vec<&str> = names.into_iter().collect();
    if let Some(name) = nearest(wrong, names.iter().copied()) {
        return Some(format!("did you mean `{name}`?"));
    }
    match names.len() {
        0 => None,
        1..=12 => Some(format!("expected {}", one_of(names))),
        _ => None,
    }
}

/// The name that differs least, if it differs by a third of its letters at most (and has one in common).
pub fn nearest<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wrong = wrong.to_lowercase();
    let mut best: Option<(usize, &str)> = None;
    for name in names {
        let letters = name.chars().count().max(wrong.chars().count());
        let distance = strsim::damerau_levenshtein(&wrong, &name.to_lowercase());
        if distance <= letters.div_ceil(3)
            && distance < letters
            && best.is_none_or(|it| distance < it.0)
        {
            best = Some((distance, name));
        }
    }
    best.map(|it| it.1)
}

/// `a`, `b` or `c`, in backticks.
pub fn one_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names: Vec<String> = names.into_iter().map(|it| format!("`{it}`")).collect();
    match names.pop() {
        None => "nothing".to_owned(),
        Some(last) if names.is_empty() => last,
        Some(last) => format!("{} or {last}", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_name_is_suggested_and_a_far_one_is_not() {
        let names = ["eigs", "laplacian", "fmap"];
        assert_eq!(nearest("eig", names), Some("eigs"));
        assert_eq!(nearest("Laplacain", names), Some("laplacian"));
        assert_eq!(nearest("transfer", names), None);
        assert_eq!(suggest("transfer", names).unwrap(), "expected `eigs`, `laplacian` or `fmap`");
    }
}
