//! What runs are called, and where their records are.

use std::{
    fs,
    path::{Path, PathBuf},
    time::SystemTime,
};

use crate::engine::{clock, digest::Digest};

/// A name for a run that starts now: its time, and something that tells it from others.
///
/// The newest run always has the greatest name. If the clock was turned back, or two runs start in
/// one second, a number that is one greater than that of the newest run tells which came later.
pub fn new_run_id(store: &Path) -> String {
    let now = SystemTime::now();
    let salt = format!("{now:?} {}", std::process::id());
    let salt = &Digest::of(salt.as_bytes()).to_string()[..4];
    let newest = list(store).first().map(|it| name(it)).unwrap_or_default();
    next_name(&clock::compact_utc(now), salt, &newest)
}

/// The name for a time that sorts after the newest one.
fn next_name(time: &str, salt: &str, newest: &str) -> String {
    let is_time = |it: &&str| it.bytes().all(|it| it.is_ascii_digit() || it == b'-');
    let newest_time = newest.get(..time.len()).filter(is_time).filter(|it| *it >= time);
    let Some(newest_time) = newest_time else { return format!("{time}-{salt}") };
    // `x` sorts after the hexadecimal digits of a salt.
    let counted = newest[time.len()..].strip_prefix("-x").and_then(|it| it.split('-').next());
    let number = counted.and_then(|it| it.parse::<u32>().ok()).unwrap_or(0) + 1;
    format!("{newest_time}-x{number:04}-{salt}")
}

/// The name of the run that a record tells of.
pub fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The paths of all records in a store's folder, newest first.
///
/// By name: names grow ([`new_run_id`]), while files may be copied, touched, or come from a machine
/// with another clock.
pub fn list(store: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(store.join("runs")).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|it| it.path())
        .filter(|it| it.extension().is_some_and(|e| e == "jsonl"))
        .collect();
    paths.sort();
    paths.reverse();
    paths
}

/// The record of a run: `last` (or `latest`), `last~2` for the second one before it, or the beginning
/// of a name that no other run shares.
///
/// # Errors
/// With the runs that could be meant.
pub fn find(store: &Path, name: &str) -> Result<PathBuf, FindError> {
    let paths = list(store);
    let (base, back) = name.split_once('~').unwrap_or((name, "0"));
    if let ("last" | "latest", Ok(back)) = (base, back.parse::<usize>()) {
        return paths.get(back).cloned().ok_or_else(|| none(name, &paths));
    }
    let mut found: Vec<&PathBuf> =
        paths.iter().filter(|it| self::name(it).starts_with(name)).collect();
    if let Some(exact) = found.iter().find(|it| self::name(it) == name) {
        return Ok((*exact).clone());
    }
    found.truncate(6);
    match found[..] {
        [] => Err(none(name, &paths)),
        [one] => Ok(one.clone()),
        _ => Err(FindError::Several {
            name: name.to_owned(),
            runs: found.iter().map(|it| self::name(it)).collect(),
        }),
    }
}

/// Why a name names no run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FindError {
    #[error("there is no run `{name}`{}", hint(.runs))]
    None { name: String, runs: Vec<String> },
    #[error("there are several runs `{name}…`: `{}`", .runs.join("`, `"))]
    Several { name: String, runs: Vec<String> },
}

fn hint(runs: &[String]) -> String {
    match runs {
        [] => ": there is none at all".to_owned(),
        runs => format!(": the last ones are `{}`", runs.join("`, `")),
    }
}

fn none(name: &str, paths: &[PathBuf]) -> FindError {
    let runs = paths.iter().take(4).map(|it| self::name(it)).collect();
    FindError::None { name: name.to_owned(), runs }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_runs_grow_whatever_the_clock_does() {
        let times = [
            "20260101-000000",
            "20260101-000000",
            "20260101-000000",
            "20991231-235959",
            "20260101-000001",
            "20260101-000002",
        ];
        let mut names = vec![String::new()];
        for (index, time) in times.iter().enumerate() {
            // Salts that do not help: the later, the smaller.
            let salt = format!("{:04x}", 0xffff - index);
            names.push(next_name(time, &salt, names.last().unwrap()));
        }
        assert!(names.is_sorted_by(|a, b| a < b), "{names:?}");
        assert_eq!(names[1], "20260101-000000-ffff");
        assert_eq!(
            next_name("20260101-000000", "abcd", "zz-not-named-by-us"),
            "20260101-000000-abcd"
        );
    }
}
