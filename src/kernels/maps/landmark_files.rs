//! Landmark files: JSON by names, or lists of vertices.

use serde::Deserialize;

use crate::kernels::geometry::landmarks::Landmarks;

/// Why a file holds no landmarks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarkFileError {
    #[error("the landmark file is no JSON of landmarks: {reason}")]
    Json { reason: String },
    #[error("line {line} of the landmark file is `{text}` instead of a vertex index")]
    Line { line: usize, text: String },
    #[error("the landmark file is no text")]
    Encoding,
    #[error("the landmark file holds no landmarks")]
    Empty,
    #[error("the landmark file has no landmark `{name}`; it has {available}")]
    Missing { name: String, available: String },
    #[error("two landmarks have the name `{name}`")]
    SameName { name: String },
}

/// Reads landmarks; `extension` tells the format.
///
/// - `json`: `{"landmarks": {"head_top": {"vertex": 881}, …}}`; other keys are ignored;
/// - others: one landmark a line, `name,vertex` or only `vertex` (named `0`, `1`, …). Commas, tabs and
///   spaces separate; empty lines and those that begin with `#` or `name` are skipped.
///
/// Vertices count from zero. With `wanted` names, these are returned in this order.
///
/// # Errors
/// See [`LandmarkFileError`].
pub fn read_landmarks(
    bytes: &[u8],
    extension: &str,
    wanted: &[String],
) -> Result<Landmarks, LandmarkFileError> {
    let pairs = if extension == "json" { read_json(bytes)? } else { read_lines(bytes)? };
    if pairs.is_empty() {
        return Err(LandmarkFileError::Empty);
    }
    let mut names: Vec<&String> = pairs.iter().map(|it| &it.0).collect();
    names.sort();
    if let Some(pair) = names.windows(2).find(|it| it[0] == it[1]) {
        return Err(LandmarkFileError::SameName { name: pair[0].clone() });
    }
    let pairs = if wanted.is_empty() { pairs } else { select(&pairs, wanted)? };
    let (names, vertices) = pairs.into_iter().unzip();
    Ok(Landmarks { names, vertices })
}

fn select(
    pairs: &[(String, u32)],
    wanted: &[String],
) -> Result<Vec<(String, u32)>, LandmarkFileError> {
    let find = |name: &String| {
        pairs.iter().find(|it| it.0 == *name).cloned().ok_or_else(|| LandmarkFileError::Missing {
            name: name.clone(),
            available: pairs.iter().map(|it| format!("`{}`", it.0)).collect::<Vec<_>>().join(", "),
        })
    };
    wanted.iter().map(find).collect()
}

fn read_json(bytes: &[u8]) -> Result<Vec<(String, u32)>, LandmarkFileError> {
    #[derive(Deserialize)]
    struct File {
        landmarks: serde_json::Map<String, serde_json::Value>,
    }
    #[derive(Deserialize)]
    struct Entry {
        vertex: u32,
    }
    let fail = |e: serde_json::Error| LandmarkFileError::Json { reason: e.to_string() };
    let file: File = serde_json::from_slice(bytes).map_err(fail)?;
    let read = |(name, value)| {
        serde_json::from_value(value).map(|entry: Entry| (name, entry.vertex)).map_err(fail)
    };
    file.landmarks.into_iter().map(read).collect()
}

fn read_lines(bytes: &[u8]) -> Result<Vec<(String, u32)>, LandmarkFileError> {
    let text = std::str::from_utf8(bytes).map_err(|_| LandmarkFileError::Encoding)?;
    let mut res: Vec<(String, u32)> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') || line.starts_with("name") {
            continue;
        }
        let words: Vec<&str> =
            line.split([',', '\t', ' ', ';']).filter(|it| !it.is_empty()).collect();
        let fail = || LandmarkFileError::Line { line: index + 1, text: line.to_owned() };
        let (name, vertex) = match words[..] {
            [vertex] => (res.len().to_string(), vertex),
            [name, vertex] => (name.to_owned(), vertex),
            _ => return Err(fail()),
        };
        res.push((name, vertex.parse().map_err(|_| fail())?));
    }
    Ok(res)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_and_lines_hold_the_same() {
        let json = br#"{"mesh": "a", "landmarks": {"head": {"vertex": 7, "position": [0, 0, 0]},
                        "foot": {"vertex": 2}}}"#;
        let from_json = read_landmarks(json, "json", &[]).unwrap();
        assert_eq!(from_json.names, ["head", "foot"]);
        let from_lines = read_landmarks(b"# two\nname,vertex\nhead,7\nfoot 2\n", "csv", &[]);
        assert_eq!(from_lines.unwrap(), from_json);
        let wanted = ["foot".to_owned(), "head".to_owned()];
        assert_eq!(read_landmarks(json, "json", &wanted).unwrap().vertices, [2, 7]);
        assert_eq!(read_landmarks(b"5\n6\n", "txt", &[]).unwrap().names, ["0", "1"]);
    }

    #[test]
    fn mistakes_are_named() {
        let check = |bytes: &[u8], extension: &str, wanted: &[String], expected: &str| {
            let error = read_landmarks(bytes, extension, wanted).unwrap_err().to_string();
            assert_eq!(error, expected);
        };
        check(
            b"a,1\nb,-2",
            "csv",
            &[],
            "line 2 of the landmark file is `b,-2` instead of a vertex index",
        );
        check(b"", "txt", &[], "the landmark file holds no landmarks");
        check(b"a,1\na,2", "txt", &[], "two landmarks have the name `a`");
        let wanted = ["c".to_owned()];
        check(
            b"a,1\nb,2",
            "txt",
            &wanted,
            "the landmark file has no landmark `c`; it has `a`, `b`",
        );
        check(
            b"{}",
            "json",
            &[],
            "the landmark file is no JSON of landmarks: missing field `landmarks` at line 1 column 2",
        );
        check(&[0xff], "txt", &[], "the landmark file is no text");
    }
}
