//! What a program sees of the machine: its environment, and where programs are.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    fs,
    io::Read,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

/// The environment of a program: what every program needs, and what is declared.
///
/// Of the user's variables only `PATH` and `HOME` are passed on. Language and time zone are fixed, and
/// numerical libraries use one thread unless it is declared otherwise: with more, the last bits of a sum
/// depend on the machine.
pub fn environment(
    declared: &BTreeMap<String, String>,
    temporary: &Path,
) -> BTreeMap<String, OsString> {
    let users = ["HOME", "PATH"].into_iter().filter_map(|it| Some((it, std::env::var_os(it)?)));
    let fixed = FIXED.iter().map(|(name, value)| (*name, OsString::from(value)));
    let temporary = [("TMPDIR", temporary.into())];
    let defaults =
        users.chain(fixed).chain(temporary).map(|(name, value)| (name.to_owned(), value));
    let declared = declared.iter().map(|(name, value)| (name.clone(), value.into()));
    defaults.chain(declared).collect()
}

/// Variables that every program gets unless they are declared otherwise.
pub const FIXED: [(&str, &str); 8] = [
    ("LANG", "C.UTF-8"),
    ("TZ", "UTC"),
    ("PYTHONHASHSEED", "0"),
    ("OMP_NUM_THREADS", "1"),
    ("OPENBLAS_NUM_THREADS", "1"),
    ("MKL_NUM_THREADS", "1"),
    ("NUMBA_NUM_THREADS", "1"),
    ("RAYON_NUM_THREADS", "1"),
];

/// Where a program may be: a path as it is, a name in each folder of `PATH`.
fn candidates(name: &str, environment: &BTreeMap<String, OsString>) -> Vec<PathBuf> {
    if name.contains('/') {
        return vec![name.into()];
    }
    let path = environment.get("PATH").cloned().unwrap_or_default();
    std::env::split_paths(&path).filter(|it| it.is_absolute()).map(|it| it.join(name)).collect()
}

/// The program that was found for a name, behind the places where another would have come before it.
pub fn candidates_up_to(
    found: &Path,
    name: &str,
    environment: &BTreeMap<String, OsString>,
) -> Vec<PathBuf> {
    let mut candidates = candidates(name, environment);
    let n_before = candidates.iter().position(|it| it == found).unwrap_or_default();
    candidates.truncate(n_before + 1);
    candidates
}

/// Where a program is: the first candidate that can be started.
///
/// # Errors
/// With a message for the user.
pub fn find(name: &str, environment: &BTreeMap<String, OsString>) -> Result<PathBuf, String> {
    let found = candidates(name, environment).into_iter().find(|it| is_program(it));
    found.ok_or_else(|| match name.contains('/') {
        true => format!("there is no program `{name}`"),
        false => {
            format!(
                "there is no program `{name}` in `PATH`: install it, or add its folder to `PATH`"
            )
        }
    })
}

fn is_program(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|it| it.is_file() && it.permissions().mode() & 0o111 != 0)
}

/// Whether a program is machine code, and no script that may do anything.
pub fn is_binary(path: &Path) -> bool {
    let mut magic = [0; 4];
    fs::File::open(path).and_then(|mut it| it.read_exact(&mut magic)).is_ok()
        && magic == *b"\x7fELF"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_found_where_its_environment_says() {
        let folder = tempfile::tempdir().unwrap();
        let tool = folder.path().join("tool");
        fs::write(&tool, "#!/bin/sh\n").unwrap();
        let path = BTreeMap::from([("PATH".to_owned(), folder.path().into())]);
        let message = find("tool", &path).unwrap_err();
        assert!(message.starts_with("there is no program `tool` in `PATH`"), "{message}");
        fs::set_permissions(&tool, fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(find("tool", &path).as_ref(), Ok(&tool));
        assert!(!is_binary(&tool) && is_binary(Path::new("/proc/self/exe")));
        assert_eq!(find("/none", &path).unwrap_err(), "there is no program `/none`");
    }
}
