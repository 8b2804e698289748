//! How a node is run: what its table in a pipeline may say whatever its kind. No result depends on it.

use std::time::Duration;

use serde_json::{Value as Json, json};

use super::clock::{show_bytes, show_duration};

/// How an instance is run.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeSettings {
    /// Further tries after a failure.
    pub retries: u32,
    /// The wait before the second try; each further one waits twice as long.
    pub backoff: Duration,
    /// How long a try may take.
    pub timeout: Option<Duration>,
    /// Whether it runs in a process of its own.
    pub isolate: Option<Isolation>,
}

/// What a process of its own may use.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Isolation {
    /// Bytes of memory.
    pub memory: Option<u64>,
}

/// A key that every node table may have.
pub struct NodeKey {
    pub name: &'static str,
    /// What a person writes there.
    pub values: &'static str,
    pub doc: &'static str,
    pub schema: fn() -> Json,
}

/// The keys of every node. No kind and no inner pipeline has a parameter or an input of such a name.
pub const NODE_KEYS: [NodeKey; 4] = [
    NodeKey {
        name: "retries",
        values: "an integer from 0 to 100; `0`",
        doc: "Further tries when it fails, panics, crashes, or takes too long.",
        schema: || json!({ "type": "integer", "minimum": 0, "maximum": MAX_RETRIES, "default": 0 }),
    },
    NodeKey {
        name: "backoff",
        values: "a duration; `1`",
        doc: "How long to wait before the second try; twice as long before each further one.",
        schema: duration_schema,
    },
    NodeKey {
        name: "timeout",
        values: "a duration; none",
        doc: "How long a try may take, not counting the wait for its turn. Threads cannot be \
              stopped, so a node with a time limit runs in a process of its own like one with \
              `isolate`, unless its kind only waits for a program that it has started.",
        schema: duration_schema,
    },
    NodeKey {
        name: "isolate",
        values: "`true`, `false` or `{ memory = \"4 GB\" }`; `false`",
        doc: "Runs the node in a process of its own: a crash, or more memory than `memory` allows, \
              fails this node only. The result has the same bytes. It costs some milliseconds, and \
              copies of the inputs and outputs.",
        schema: isolate_schema,
    },
];

/// More would only hide that something is broken.
pub const MAX_RETRIES: u32 = 100;

/// No wait between two tries is longer.
const MAX_WAIT: Duration = Duration::from_secs(3600);

impl Default for NodeSettings {
    fn default() -> Self {
        Self { retries: 0, backoff: Duration::from_secs(1), timeout: None, isolate: None }
    }
}

impl NodeSettings {
    /// How long to wait after so many failed tries.
    pub fn wait_after(&self, n_failed: u32) -> Duration {
        let factor = 1_u32.checked_shl(n_failed.saturating_sub(1)).unwrap_or(u32::MAX);
        self.backoff.checked_mul(factor).unwrap_or(MAX_WAIT).min(MAX_WAIT.max(self.backoff))
    }
}

/// Whether a name is that of a key of every node.
pub fn is_node_key(name: &str) -> bool {
    NODE_KEYS.iter().any(|it| it.name == name)
}

/// A duration as it is written in a pipeline: seconds, or a number with `ms`, `s`, `m` or `h`.
///
/// # Errors
/// If it is something else.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let (number, unit) = split_unit(text);
    let factor = match unit {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("`{unit}` is no unit of time: `ms`, `s`, `m` and `h` are")),
    };
    let number: f64 =
        number.parse().map_err(|_| format!("\"{text}\" is no duration, such as \"90s\""))?;
    Duration::try_from_secs_f64(number * factor).map_err(|_| format!("\"{text}\" is too long"))
}

/// A number of bytes: `512M`, `8G`, `1.5 GB`, `4 GiB` or only a number. `K` is 1024.
///
/// # Errors
/// If it is something else.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let (number, unit) = split_unit(text);
    let letter = unit.to_ascii_uppercase();
    let factor = match letter.trim_end_matches('B').trim_end_matches('I') {
        "" => 1u64,
        "K" => 1 << 10,
        "M" => 1 << 20,
        "G" => 1 << 30,
        "T" => 1 << 40,
        _ => return Err(format!("`{unit}` is no unit: K, M, G and T are")),
    };
    let number: f64 = number.parse().map_err(|_| format!("`{text}` is no size, such as 8G"))?;
    Ok((number * factor as f64) as u64)
}

fn split_unit(text: &str) -> (&str, &str) {
    let text = text.trim();
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    (number, unit.trim())
}

/// A time limit as a person would have written it: `10 s`, `0.5 s`, `2m 30s`.
pub fn show_limit(limit: Duration) -> String {
    let secs = limit.as_secs_f64();
    if secs < 60.0 { format!("{secs} s") } else { show_duration(limit) }
}

/// A memory limit, in the units in which it is written.
pub fn show_memory(bytes: u64) -> String {
    let units = [("TB", 40), ("GB", 30), ("MB", 20), ("kB", 10)];
    let whole = units.iter().find(|it| bytes > 0 && bytes.is_multiple_of(1 << it.1));
    whole.map_or_else(|| show_bytes(bytes), |(unit, bits)| format!("{} {unit}", bytes >> bits))
}

fn duration_schema() -> Json {
    json!({
        "anyOf": [
            { "type": "number", "exclusiveMinimum": 0, "description": "Seconds." },
            { "type": "string", "pattern": "^\\s*[0-9.]+\\s*(ms|s|m|min|h)?\\s*$|\\$\\{" },
        ],
    })
}

fn isolate_schema() -> Json {
    let size = json!({
        "anyOf": [
            { "type": "integer", "minimum": 1, "description": "Bytes." },
            { "type": "string", "description": "Such as \"4 GB\"." },
        ],
    });
    json!({
        "anyOf": [
            { "type": "boolean" },
            {
                "type": "object",
                "additionalProperties": false,
                "properties": { "memory": size },
            },
            { "$ref": "#/$defs/template" },
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_seconds_or_have_a_unit() {
        let secs = |text| parse_duration(text).map(|it| it.as_secs_f64());
        assert_eq!(secs("10m"), Ok(600.0));
        assert_eq!(secs(" 1.5 h "), Ok(5400.0));
        assert_eq!(secs("90s"), Ok(90.0));
        assert_eq!(secs("250ms"), Ok(0.25));
        assert_eq!(secs("7"), Ok(7.0));
        assert_eq!(secs("s").unwrap_err(), "\"s\" is no duration, such as \"90s\"");
        let message = "`days` is no unit of time: `ms`, `s`, `m` and `h` are";
        assert_eq!(secs("3 days").unwrap_err(), message);
    }

    #[test]
    fn sizes_count_in_powers_of_two_and_are_shown_as_they_are_written() {
        for text in ["4 GB", "4G", "4GiB", "4096 MB", "4294967296"] {
            assert_eq!(parse_size(text).map(show_memory), Ok("4 GB".to_owned()), "{text}");
        }
        assert!(parse_size("4 GX").is_err() && parse_size("GB").is_err());
        assert_eq!(show_memory(1000), "1.0 kB");
    }

    #[test]
    fn each_wait_is_twice_the_last_up_to_an_hour() {
        let settings = NodeSettings { backoff: Duration::from_secs(2), ..NodeSettings::default() };
        let waits = [1, 2, 3, 11, 12, 99].map(|it| settings.wait_after(it).as_secs());
        assert_eq!(waits, [2, 4, 8, 2048, 3600, 3600]);
        let patient = NodeSettings { backoff: Duration::from_secs(7200), ..settings };
        assert_eq!(patient.wait_after(5).as_secs(), 7200);
    }

    #[test]
    fn limits_are_shown_as_they_are_written() {
        let shown = [500, 10_000, 90_000].map(|it| show_limit(Duration::from_millis(it)));
        assert_eq!(shown, ["0.5 s", "10 s", "1m 30s"]);
    }
}
