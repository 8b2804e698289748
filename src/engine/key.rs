//! Keys: what a result is made from.
//!
//! A key is one readable text, and its digest is the address of the result. `explain` compares the
//! same texts that are hashed, so it cannot disagree with the cache.

use std::{collections::BTreeMap, sync::LazyLock};

use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;

use super::{digest::Digest, facts::Facts, node::Spec};

/// Raise it when the meaning of any field of [`Key`] changes.
const KEY_FORMAT: u32 = 1;

/// Everything that a result depends on, and nothing else: a key's text as it is read.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    pub format: u32,
    pub kind: String,
    pub version: u32,
    /// The class of processors on which floating-point code gives the same bits.
    pub numerics: String,
    /// All parameters, defaults filled in, names sorted.
    pub params: Value,
    /// Contents of files, by parameter (`path`) or by the name of a side file.
    pub files: BTreeMap<String, Digest>,
    /// What the machine answered to the node's question: versions of programs.
    #[serde(default)]
    pub facts: Facts,
    /// Contents of inputs, by port; `None` for an optional output that was left out, and for what is
    /// missing.
    pub inputs: BTreeMap<String, Vec<Option<Digest>>>,
    /// By labelled port: what the items are called that it gathers, as `axis=item` pairs.
    #[serde(default)]
    pub items: BTreeMap<String, Vec<Vec<String>>>,
    /// By labelled port: positions of items that are missing, and why.
    #[serde(default)]
    pub missing: BTreeMap<String, Vec<(usize, String)>>,
}

/// What a key is made from. Ten thousand keys are written for one that is read, so nothing is copied on
/// the way to its text.
#[derive(Debug)]
pub struct KeyParts<'a> {
    spec: &'a Spec,
    /// See [`params_text`].
    params: &'a str,
    pub files: BTreeMap<String, Digest>,
    pub facts: Facts,
    pub inputs: BTreeMap<&'a str, Vec<Option<Digest>>>,
    pub items: BTreeMap<&'a str, Vec<Vec<String>>>,
    pub missing: BTreeMap<&'a str, Vec<(usize, String)>>,
}

impl<'a> KeyParts<'a> {
    /// The parts of a node without inputs, files and facts, from the [`params_text`] of its parameters.
    pub fn new(spec: &'a Spec, params: &'a str) -> Self {
        Self {
            spec,
            params,
            files: BTreeMap::new(),
            facts: Facts::new(),
            inputs: BTreeMap::new(),
            items: BTreeMap::new(),
            missing: BTreeMap::new(),
        }
    }

    /// The canonical text: the fields of [`Key`] in their order, without those that are empty and were
    /// added later.
    pub fn text(&self) -> String {
        let mut text = Vec::with_capacity(self.params.len() + (1 << 9));
        let fixed = [&KEY_FORMAT, &self.spec.version];
        let [format, version] = fixed.map(|it| it.to_string());
        push_raw(&mut text, "{\"format\":", &format);
        push(&mut text, ",\"kind\":", self.spec.kind);
        push_raw(&mut text, ",\"version\":", &version);
        push(&mut text, ",\"numerics\":", NUMERICS.as_str());
        push_raw(&mut text, ",\"params\":", self.params);
        push(&mut text, ",\"files\":", &self.files);
        if !self.facts.is_empty() {
            push(&mut text, ",\"facts\":", &self.facts);
        }
        push(&mut text, ",\"inputs\":", &self.inputs);
        if !self.items.is_empty() {
            push(&mut text, ",\"items\":", &self.items);
        }
        if !self.missing.is_empty() {
            push(&mut text, ",\"missing\":", &self.missing);
        }
        text.push(b'}');
        String::from_utf8(text).expect("JSON is text")
    }
}

fn push_raw(text: &mut Vec<u8>, name: &str, json: &str) {
    text.extend_from_slice(name.as_bytes());
    text.extend_from_slice(json.as_bytes());
}

fn push(text: &mut Vec<u8>, name: &str, value: impl Serialize) {
    text.extend_from_slice(name.as_bytes());
    serde_json::to_writer(text, &value).expect("keys are plain data");
}

/// The part of a key that parameters are: all of them, names sorted, so that moving a field in a struct
/// changes no key.
pub fn params_text(params: &Value) -> String {
    serde_json::to_string(&Sorted(params)).expect("parameters are plain data")
}

impl Key {
    /// Reads a key's text; `None` if it was written by a version with other fields.
    pub fn read(text: &str) -> Option<Self> {
        serde_json::from_str(text).ok()
    }

    /// Why `self` is not `old`, one entry a cause, in the order of the fields.
    pub fn differences(&self, old: &Self) -> Vec<Difference> {
        let mut res = Vec::new();
        let mut field = |what: &str, old: String, new: String| {
            if old != new {
                res.push(Difference { what: what.to_owned(), old, new });
            }
        };
        field("kind", old.kind.clone(), self.kind.clone());
        field("version", old.version.to_string(), self.version.to_string());
        field("key format", old.format.to_string(), self.format.to_string());
        field("numerics", old.numerics.clone(), self.numerics.clone());
        compare("params", &entries(&old.params), &entries(&self.params), &mut field);
        compare("files", &shown(&old.files), &shown(&self.files), &mut field);
        compare("facts", &old.facts, &self.facts, &mut field);
        compare("inputs", &shown_lists(&old.inputs), &shown_lists(&self.inputs), &mut field);
        compare("items", &shown_items(&old.items), &shown_items(&self.items), &mut field);
        compare("missing", &shown_missing(&old.missing), &shown_missing(&self.missing), &mut field);
        res
    }
}

/// One cause for which two keys differ.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Difference {
    /// `params.k`, `inputs.mesh`, `files.path`, `version` …
    pub what: String,
    pub old: String,
    pub new: String,
}

/// Digests of inputs and files are left out: they tell a person nothing.
impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(input) = self.what.strip_prefix("inputs.") {
            return write!(f, "input `{input}` changed");
        }
        if let Some(file) = self.what.strip_prefix("files.") {
            return write!(f, "file `{file}` changed");
        }
        if let Some(port) = self.what.strip_prefix("items.") {
            return write!(f, "`{port}` gathers {}", gained_and_lost(&self.old, &self.new));
        }
        if let Some(port) = self.what.strip_prefix("missing.") {
            return write!(f, "what is missing at `{port}`: {} -> {}", self.old, self.new);
        }
        let group = ["params.", "facts."].iter().find_map(|it| self.what.strip_prefix(it));
        let what = group.unwrap_or(&self.what);
        write!(f, "`{what}`: {} -> {}", self.old, self.new)
    }
}

fn compare(
    group: &str,
    old: &BTreeMap<String, String>,
    new: &BTreeMap<String, String>,
    field: &mut impl FnMut(&str, String, String),
) {
    let names: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let show = |it: &BTreeMap<String, String>| it.get(name).cloned().unwrap_or("none".into());
        field(&format!("{group}.{name}"), show(old), show(new));
    }
}

fn entries(params: &Value) -> BTreeMap<String, String> {
    let fields = params.as_object().into_iter().flatten();
    fields.map(|(name, value)| (name.clone(), value.to_string())).collect()
}

fn shown(files: &BTreeMap<String, Digest>) -> BTreeMap<String, String> {
    files.iter().map(|(name, digest)| (name.clone(), digest.short())).collect()
}

fn shown_lists(inputs: &BTreeMap<String, Vec<Option<Digest>>>) -> BTreeMap<String, String> {
    let show = |it: &Option<Digest>| it.as_ref().map_or("none".to_owned(), Digest::short);
    let list = |it: &Vec<Option<Digest>>| it.iter().map(show).collect::<Vec<_>>().join(" ");
    inputs.iter().map(|(port, digests)| (port.clone(), list(digests))).collect()
}

fn shown_items(items: &BTreeMap<String, Vec<Vec<String>>>) -> BTreeMap<String, String> {
    let list = |it: &[Vec<String>]| it.iter().map(|it| it.join(",")).collect::<Vec<_>>().join("; ");
    items.iter().map(|(port, items)| (port.clone(), list(items))).collect()
}

fn shown_missing(missing: &BTreeMap<String, Vec<(usize, String)>>) -> BTreeMap<String, String> {
    let list = |it: &[(usize, String)]| {
        it.iter().map(|(at, why)| format!("item {at} ({why})")).collect::<Vec<_>>().join(", ")
    };
    missing.iter().map(|(port, items)| (port.clone(), list(items))).collect()
}

/// Which items came and went, the first few of each.
fn gained_and_lost(old: &str, new: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (old.split("; ").collect(), new.split("; ").collect());
    let list = |sign: &str, from: &[&str], than: &[&str]| {
        let than: std::collections::HashSet<&str> = than.iter().copied().collect();
        let mut names: Vec<String> =
            from.iter().filter(|it| !than.contains(*it)).map(|it| format!("{sign}{it}")).collect();
        if names.len() > 3 {
            let n_more = names.len() - 3;
            names.truncate(3);
            names.push(format!("… and {n_more} more"));
        }
        names
    };
    let changes = [list("+", &new, &old), list("-", &old, &new)].concat();
    if changes.is_empty() { "its items in another order".to_owned() } else { changes.join(", ") }
}

/// Written with the names of all objects sorted.
struct Sorted<'a>(&'a Value);

impl Serialize for Sorted<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Object(fields) => {
                let mut fields: Vec<(&String, &Value)> = fields.iter().collect();
                fields.sort_unstable_by_key(|it| it.0);
                serializer.collect_map(fields.into_iter().map(|it| (it.0, Sorted(it.1))))
            }
            Value::Array(items) => serializer.collect_seq(items.iter().map(Sorted)),
            other => other.serialize(serializer),
        }
    }
}

/// Matrix products pick their instructions at run time, and the system's mathematical functions
/// differ between platforms, so results are shared only within a class.
static NUMERICS: LazyLock<String> = LazyLock::new(|| {
    let (arch, os) = (std::env::consts::ARCH, std::env::consts::OS);
    format!("{arch}-{os}-{}", vector_class())
});

#[cfg(target_arch = "x86_64")]
fn vector_class() -> &'static str {
    if is_x86_feature_detected!("avx512f") {
        "avx512"
    } else if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        "avx2"
    } else {
        "sse2"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn vector_class() -> &'static str {
    "base"
}
