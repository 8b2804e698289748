//! Kind `download`.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::files::{FileSet, check_relative};

mod fetch;
mod mirror;

use fetch::Fetcher;
use mirror::Mirrors;

/// Fetches files by URL and checks their content.
///
/// Folders named by `SINEW_MIRROR` are searched first, by content: a machine without a network works
/// the same if they hold the files. Give either `url` and `blake3` for one file, or `files` for several.
/// The URLs `data:,` hold their own bytes (percent-encoded).
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Download {
    /// Where the one file is.
    #[serde(default)]
    pub url: Option<String>,
    /// The one file's blake3, 64 hexadecimal digits.
    #[serde(default)]
    pub blake3: Option<String>,
    /// The name of the one file in the set; the last part of its URL if it is not given.
    #[serde(default)]
    pub name: Option<String>,
    /// Several files.
    #[serde(default)]
    pub files: Vec<DownloadFile>,
    /// Put before every URL in `files` that names no protocol.
    #[serde(default)]
    pub base: String,
    /// The licence of the files, for reports.
    #[serde(default)]
    pub licence: Option<String>,
    /// Whom to name, for reports.
    #[serde(default)]
    pub attribution: Option<String>,
}

/// One of several files.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DownloadFile {
    /// Its path in the set, with `/` between folders.
    pub path: String,
    /// Its URL, whole or after `base`; the path if it is not given.
    #[serde(default)]
    pub url: Option<String>,
    /// Its blake3, 64 hexadecimal digits.
    pub blake3: String,
}

/// What is fetched: path in the set, URL, digest.
struct Wanted {
    path: String,
    url: String,
    digest: blake3::Hash,
}

impl Download {
    const FILES: Output<FileSet> = Output::new("files", "the files by their paths");

    /// # Errors
    /// If the parameters do not say what to fetch.
    fn wanted(&self) -> Result<Vec<Wanted>, String> {
        let mut wanted = Vec::new();
        match (&self.url, &self.blake3) {
            (Some(_), _) | (_, Some(_)) if !self.files.is_empty() => {
                return Err("give either `url` and `blake3` or `files`, not both".to_owned());
            }
            (Some(url), Some(digest)) => {
                let last = url.rsplit('/').next().unwrap_or_default().to_owned();
                let path = self.name.clone().unwrap_or(last);
                wanted.push(Wanted { path, url: url.clone(), digest: parse(digest)? });
            }
            (Some(_), None) => return Err("`url` needs a `blake3`".to_owned()),
            (None, Some(_)) => return Err("`blake3` needs a `url`".to_owned()),
            (None, None) if self.files.is_empty() => {
                return Err("give either `url` and `blake3` or `files`".to_owned());
            }
            (None, None) => {}
        }
        for file in &self.files {
            let url = file.url.as_ref().unwrap_or(&file.path);
            let is_whole = url.contains("://") || url.starts_with("data:");
            let url = if is_whole { url.clone() } else { format!("{}{url}", self.base) };
            wanted.push(Wanted { path: file.path.clone(), url, digest: parse(&file.blake3)? });
        }
        let mut paths = std::collections::BTreeSet::new();
        for it in &wanted {
            if it.path.is_empty() {
                return Err(format!("`{}` needs a name in the set", it.url));
            }
            check_relative(&it.path)?;
            if !paths.insert(&it.path) {
                return Err(format!("`files` has `{}` twice", it.path));
            }
        }
        Ok(wanted)
    }
}

fn parse(digest: &str) -> Result<blake3::Hash, String> {
    blake3::Hash::from_hex(digest)
        .map_err(|_| format!("`{digest}` is no blake3 of 64 hexadecimal digits"))
}

impl Node for Download {
    const SPEC: Spec = Spec {
        kind: "download",
        version: 1,
        inputs: &[],
        outputs: &[Self::FILES.port()],
        cites: &[],
        example: r#"[nodes.note]
kind = "download"
url = "data:,hello%20world"
blake3 = "d74981efa70a0c880b8d8c1985d075dbcbf679b99a5f9914e5aaf96b831a9e24"
name = "note.txt"
licence = "CC0-1.0"
"#,
    };

    fn validate(&self) -> Result<(), String> {
        self.wanted().map(drop)
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let wanted = self.wanted().map_err(NodeError::failed)?;
        io.progress(None, &format!("fetching {} files", wanted.len()));
        let surroundings = io.surroundings();
        let mirrors = Mirrors::of(&surroundings.mirrors);
        let fetcher = Fetcher::new(surroundings);
        let fetched: Vec<(Vec<u8>, Option<String>)> = wanted
            .par_iter()
            .map(|it| match mirrors.find(it.digest) {
                mirror::Found::Bytes(bytes) => Ok((bytes, None)),
                mirror::Found::Stale(path) => {
                    let note = format!("`{}` in the mirror has another blake3", path.display());
                    Ok((fetcher.fetch(&it.url, it.digest)?, Some(note)))
                }
                mirror::Found::Nothing => Ok((fetcher.fetch(&it.url, it.digest)?, None)),
            })
            .collect::<Result<_, NodeError>>()?;
        let mut res = FileSet::default();
        for (it, (bytes, note)) in wanted.into_iter().zip(fetched) {
            res.files.insert(it.path, bytes);
            if let Some(note) = note {
                io.note(note);
            }
        }
        if let Some(licence) = &self.licence {
            let by = self.attribution.as_ref().map_or(String::new(), |it| format!(", {it}"));
            io.note(format!("licence: {licence}{by}"));
        }
        io.put(Self::FILES, res);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(toml: &str) -> String {
        toml::from_str::<Download>(toml).unwrap().validate().unwrap_err()
    }

    #[test]
    fn one_file_or_several() {
        let digest = "0".repeat(64);
        assert_eq!(problem(""), "give either `url` and `blake3` or `files`");
        assert_eq!(problem("url = 'http://a/b'"), "`url` needs a `blake3`");
        assert_eq!(
            problem("url = 'http://a/b'\nblake3 = '12'"),
            "`12` is no blake3 of 64 hexadecimal digits"
        );
        let twice = format!("files = [{0}, {0}]", format!("{{ path = 'a', blake3 = '{digest}' }}"));
        assert_eq!(problem(&twice), "`files` has `a` twice");
        assert_eq!(
            problem(&format!("url = 'http://a/'\nblake3 = '{digest}'")),
            "`http://a/` needs a name in the set"
        );
        for path in ["../a", "/etc/passwd", "a/../../b"] {
            let files = format!("files = [{{ path = '{path}', url = 'u', blake3 = '{digest}' }}]");
            assert_eq!(problem(&files), format!("`{path}` is no path below its folder"));
        }
    }

    #[test]
    fn urls_come_after_the_base() {
        let digest = "0".repeat(64);
        let toml = format!(
            "base = 'http://a/'\nfiles = [{{ path = 'b/c', blake3 = '{digest}' }},\n\
             {{ path = 'd', url = 'e', blake3 = '{digest}' }},\n\
             {{ path = 'f', url = 'https://b/f', blake3 = '{digest}' }}]"
        );
        let wanted = toml::from_str::<Download>(&toml).unwrap().wanted().unwrap();
        let urls: Vec<&str> = wanted.iter().map(|it| it.url.as_str()).collect();
        assert_eq!(urls, ["http://a/b/c", "http://a/e", "https://b/f"]);
    }
}
