//! `{in:mesh.ply}`, `{out:map.safetensors}`, `{file:script}`: places in the arguments of a program where
//! the path of a file comes.

/// A part of an argument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Part {
    Plain(String),
    Slot(Slot),
}

/// What the path leads to.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// An input, written in the format of the extension; a folder if there is none.
    Input { port: String, extension: String },
    /// Where the program writes an output.
    Output { port: String, extension: String },
    /// A declared file.
    File { name: String },
}

/// Cuts a text into its parts. Braces that do not begin with `{in:`, `{out:` or `{file:` are plain.
///
/// # Errors
/// If a slot is not closed, or is none.
pub fn parse(text: &str) -> Result<Vec<Part>, String> {
    let mut parts = Vec::new();
    let mut rest = text;
    while let Some((start, kind)) = next_slot(rest) {
        if start > 0 {
            parts.push(Part::Plain(rest[..start].to_owned()));
        }
        let inner = &rest[start + 1..];
        let Some(end) = inner.find('}') else {
            return Err(format!("`{}` has no `}}`", &rest[start..]));
        };
        parts.push(Part::Slot(slot(kind, &inner[kind.len() + 1..end])?));
        rest = &inner[end + 1..];
    }
    if !rest.is_empty() {
        parts.push(Part::Plain(rest.to_owned()));
    }
    Ok(parts)
}

const KINDS: [&str; 3] = ["in", "out", "file"];

fn next_slot(text: &str) -> Option<(usize, &'static str)> {
    text.match_indices('{').find_map(|(start, _)| {
        let inner = &text[start + 1..];
        let is_kind = |it: &&&str| inner.strip_prefix(**it).is_some_and(|it| it.starts_with(':'));
        Some((start, *KINDS.iter().find(is_kind)?))
    })
}

fn slot(kind: &str, path: &str) -> Result<Slot, String> {
    let (name, extension) = path.split_once('.').unwrap_or((path, ""));
    let is_name = |it: &str| it.chars().all(|it| it.is_ascii_alphanumeric() || "_-".contains(it));
    if name.is_empty() || !is_name(name) || !is_name(extension) {
        return Err(format!("`{{{kind}:{path}}}` must hold a name, or a name and an extension"));
    }
    let (port, extension) = (name.to_owned(), extension.to_lowercase());
    match kind {
        "in" => Ok(Slot::Input { port, extension }),
        "out" => Ok(Slot::Output { port, extension }),
        _ if extension.is_empty() => Ok(Slot::File { name: port }),
        _ => Err(format!("`{{file:{path}}}` must hold the name of a declared file only")),
    }
}

impl std::fmt::Display for Slot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let dot = |extension: &str| if extension.is_empty() { "" } else { "." };
        match self {
            Self::Input { port, extension } => {
                write!(f, "{{in:{port}{}{extension}}}", dot(extension))
            }
            Self::Output { port, extension } => {
                write!(f, "{{out:{port}{}{extension}}}", dot(extension))
            }
            Self::File { name } => write!(f, "{{file:{name}}}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_found_among_other_braces() {
        let shown = |text: &str| {
            let parts = parse(text).unwrap();
            let show = |it: &Part| match it {
                Part::Plain(text) => format!("'{text}'"),
                Part::Slot(slot) => slot.to_string(),
            };
            parts.iter().map(show).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(shown("--mesh={in:a.PLY}"), "'--mesh=' {in:a.ply}");
        assert_eq!(shown("{in:a.ply}{out:b}"), "{in:a.ply} {out:b}");
        assert_eq!(shown("{print $1} {} {file:s}"), "'{print $1} {} ' {file:s}");
        assert_eq!(shown("{ink:a} {int x}"), "'{ink:a} {int x}'");
        assert_eq!(shown(""), "");
    }

    #[test]
    fn a_slot_cannot_leave_its_folder() {
        for text in ["{in:../a.ply}", "{out:/etc/passwd}", "{out:a.ply/../b}", "{in:}", "{out:a b}"]
        {
            assert!(parse(text).is_err(), "{text}");
        }
        assert_eq!(parse("x{in:a").unwrap_err(), "`{in:a` has no `}`");
        assert!(parse("{file:a.py}").is_err());
    }
}
