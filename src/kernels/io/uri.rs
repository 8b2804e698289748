//! The parts of URIs that files refer to each other with.

/// The bytes that a percent-encoded text stands for; `None` where a `%` has no two digits.
pub fn percent_decoded(text: &str) -> Option<Vec<u8>> {
    let mut bytes = text.bytes();
    let mut res = Vec::with_capacity(text.len());
    while let Some(byte) = bytes.next() {
        res.push(if byte == b'%' {
            let mut digit = || char::from(bytes.next()?).to_digit(16);
            (digit()? * 16 + digit()?) as u8
        } else {
            byte
        });
    }
    Some(res)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_need_two_digits() {
        assert_eq!(percent_decoded("a%20b%2F").as_deref(), Some(&b"a b/"[..]));
        assert_eq!(percent_decoded("a%2"), None);
        assert_eq!(percent_decoded("a%zz"), None);
    }
}
