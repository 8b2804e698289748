//! The keys that every node may have, whatever its kind: how it is run.

use std::time::Duration;

use super::{
    diagnostic::{Diagnostic, Problems},
    nearest::{nearest, suggest},
    value::{Data, Entry, Value},
};
use crate::engine::settings::{
    Isolation, MAX_RETRIES, NODE_KEYS, NodeSettings, is_node_key, parse_duration, parse_size,
};

/// Settings as far as they are written: the rest is as around the node.
#[derive(Debug, Clone, Default)]
pub struct WrittenSettings {
    retries: Option<u32>,
    backoff: Option<Duration>,
    timeout: Option<Duration>,
    /// Inside: `None` for `isolate = false`.
    isolate: Option<Option<Isolation>>,
}

impl WrittenSettings {
    /// With what is left open filled in by the pipeline node around, and then by the defaults.
    pub fn complete(self) -> NodeSettings {
        let default = NodeSettings::default();
        NodeSettings {
            retries: self.retries.unwrap_or(default.retries),
            backoff: self.backoff.unwrap_or(default.backoff),
            timeout: self.timeout.or(default.timeout),
            isolate: self.isolate.unwrap_or(default.isolate),
        }
    }

    fn or(self, outer: &Self) -> Self {
        Self {
            retries: self.retries.or(outer.retries),
            backoff: self.backoff.or(outer.backoff),
            timeout: self.timeout.or(outer.timeout),
            isolate: self.isolate.or(outer.isolate),
        }
    }
}

/// Takes the settings out of a node's fields; `outer` is what the pipeline node around says.
pub fn take(
    fields: &mut Vec<Entry>,
    outer: &WrittenSettings,
    problems: &mut Problems,
) -> WrittenSettings {
    let mut res = WrittenSettings::default();
    for Entry { key, value } in fields.extract_if(.., |it| is_node_key(&it.key.name)) {
        if value.is_broken() {
            continue;
        }
        if !value.is_constant() {
            let message = format!("`{}` cannot depend on an axis", key.name);
            report::<()>(&value, Err(message), problems);
            continue;
        }
        match &*key.name {
            "retries" => res.retries = report(&value, read_retries(&value), problems),
            "backoff" => {
                res.backoff = report(&value, read_duration("backoff", &value), problems);
            }
            "timeout" => res.timeout = report(&value, read_timeout(&value), problems),
            "isolate" => res.isolate = read_isolate(&value, problems),
            name => unreachable!("`{name}` is a key of every node"),
        }
    }
    res.or(outer)
}

/// Asks for the nearest key: of the node's own ones or of those that every node has. Without a near
/// one only its own are listed.
pub fn suggest_key<'a>(wrong: &str, own: impl Iterator<Item = &'a str>) -> Option<String> {
    let own: Vec<&str> = own.collect();
    let all = own.iter().copied().chain(NODE_KEYS.iter().map(|it| it.name));
    match nearest(wrong, all) {
        Some(name) => Some(format!("did you mean `{name}`?")),
        None => suggest(wrong, own),
    }
}

fn report<T>(value: &Value, read: Result<T, String>, problems: &mut Problems) -> Option<T> {
    let message = match read {
        Ok(res) => return Some(res),
        Err(message) => message,
    };
    problems.push(
        Diagnostic::error(&value.place, message)
            .related(value.origin.as_ref(), "the value is written here"),
    );
    None
}

fn read_retries(value: &Value) -> Result<u32, String> {
    match value.data {
        Data::Integer(n) if (0..=i64::from(MAX_RETRIES)).contains(&n) => Ok(n as u32),
        _ => {
            let what = value.describe();
            Err(format!("`retries` must be an integer from 0 to {MAX_RETRIES}, but is {what}"))
        }
    }
}

fn read_timeout(value: &Value) -> Result<Duration, String> {
    match read_duration("timeout", value)? {
        Duration::ZERO => Err("`timeout` must be above 0".to_owned()),
        duration => Ok(duration),
    }
}

fn read_duration(name: &str, value: &Value) -> Result<Duration, String> {
    let secs = match &value.data {
        Data::Integer(secs) => *secs as f64,
        Data::Float(secs) => *secs,
        Data::Text(text) => {
            return parse_duration(text).map_err(|e| format!("`{name}` is wrong: {e}"));
        }
        _ => {
            let what = value.describe();
            return Err(format!("`{name}` must be seconds or a text like \"10m\", but is {what}"));
        }
    };
    Duration::try_from_secs_f64(secs)
        .map_err(|_| format!("`{name}` must be a number of seconds, but is {secs}"))
}

fn read_isolate(value: &Value, problems: &mut Problems) -> Option<Option<Isolation>> {
    let entries = match &value.data {
        Data::Bool(isolate) => return Some(isolate.then(Isolation::default)),
        Data::Table(entries) => entries,
        _ => {
            let what = value.describe();
            let wanted = "`true`, `false` or a table with a `memory`";
            let message = format!("`isolate` must be {wanted}, but is {what}");
            return report(value, Err(message), problems);
        }
    };
    let mut res = Isolation::default();
    for Entry { key, value } in entries.iter() {
        if &*key.name == "memory" {
            res.memory = report(value, read_memory(value), problems);
        } else {
            let message = format!("`isolate` has no key `{}`", key.name);
            let hint = suggest(&key.name, ["memory"]);
            problems.push(Diagnostic::error(&key.place, message).hint(hint));
        }
    }
    Some(Some(res))
}

fn read_memory(value: &Value) -> Result<u64, String> {
    let bytes = match &value.data {
        Data::Integer(bytes) => u64::try_from(*bytes).unwrap_or(0),
        Data::Text(text) => {
            parse_size(text).map_err(|e| format!("`isolate.memory` is wrong: {e}"))?
        }
        _ => 0,
    };
    if bytes == 0 {
        let what = value.describe();
        return Err(format!("`isolate.memory` must be a size such as \"4 GB\", but is {what}"));
    }
    Ok(bytes)
}
