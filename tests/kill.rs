//! The real program, killed at random moments, alone and two at a time: what is there in the end is
//! what an undisturbed run gives, byte for byte. `SINEW_KILLS=5000 cargo test --test kill` for long.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use sinew::kernels::numerics::random::Random;

const TETRAHEDRON: &str =
    "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

/// Small and large results, several outputs, 20 to 40 ms.
fn pipeline() -> String {
    let mut text = "[nodes.shape]\nkind = \"load\"\npath = \"shape.off\"\n\n".to_owned();
    let mut outputs = "[outputs]\n".to_owned();
    for levels in 2..6 {
        text += &format!(
            "[nodes.fine{levels}]\nkind = \"subdivide\"\nmesh = \"@shape.mesh\"\nlevels = {levels}\n\n\
             [nodes.unit{levels}]\nkind = \"normalize\"\nmesh = \"@fine{levels}.mesh\"\n\n\
             [nodes.laplacian{levels}]\nkind = \"laplacian\"\nmesh = \"@unit{levels}.mesh\"\n\n"
        );
        outputs += &format!(
            "\"unit{levels}.ply\" = \"@unit{levels}.mesh\"\n\
             \"deep/laplacian{levels}.npz\" = \"@laplacian{levels}\"\n"
        );
    }
    text + &outputs
}

fn write_pipeline(folder: &Path) {
    fs::write(folder.join("pipeline.toml"), pipeline()).unwrap();
    fs::write(folder.join("shape.off"), TETRAHEDRON).unwrap();
}

fn sinew(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(args).current_dir(folder).env_remove("SINEW_CACHE");
    command.stdout(Stdio::null()).stderr(Stdio::piped()).stdin(Stdio::null());
    command
}

fn start(folder: &Path) -> Child {
    sinew(folder, &["run", "pipeline.toml", "--out", "out", "-j", "2"]).spawn().unwrap()
}

#[track_caller]
fn succeeds(folder: &Path, args: &[&str]) -> String {
    let output = sinew(folder, args).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{args:?}: {stderr}");
    stderr
}

/// All files below a folder with their bytes, by their paths in it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut res = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.is_dir() {
            let inner = contents(&path).into_iter();
            res.extend(inner.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            res.insert(name, fs::read(&path).unwrap());
        }
    }
    res
}

/// Everything is there, equals the undisturbed run's, and nothing else lies about.
fn assert_same(folder: &Path, expected: &Path, context: &str) {
    for part in ["out", "cache/objects"] {
        let (found, wanted) = (contents(&folder.join(part)), contents(&expected.join(part)));
        let names = |it: &BTreeMap<String, Vec<u8>>| it.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&found), names(&wanted), "{context}: {part}");
        assert!(found == wanted, "{context}: other bytes in {part}");
    }
}

#[test]
fn killed_at_any_moment_the_next_run_goes_on() {
    let n_kills = std::env::var("SINEW_KILLS").ok().and_then(|it| it.parse().ok()).unwrap_or(300);
    let expected = tempfile::tempdir().unwrap();
    write_pipeline(expected.path());
    assert!(start(expected.path()).wait().unwrap().success());

    let folder = tempfile::tempdir().unwrap();
    write_pipeline(folder.path());
    let mut random = Random::new(1);
    let (mut killed, mut finished, mut started) = (0, 0, 0);
    while killed < n_kills {
        let n_runs = if random.next_u64().is_multiple_of(4) { 2 } else { 1 };
        let mut runs: Vec<Child> = (0..n_runs).map(|_| start(folder.path())).collect();
        started += n_runs;
        for run in &mut runs {
            thread::sleep(Duration::from_micros(random.next_u64() % 30_000));
            // SIGKILL, unless it has ended by itself.
            if run.try_wait().unwrap().is_none() {
                run.kill().unwrap();
            }
        }
        let mut all_done = true;
        for run in runs {
            let output = run.wait_with_output().unwrap();
            match output.status.code() {
                None => (killed, all_done) = (killed + 1, false),
                Some(0) => {}
                Some(code) => {
                    panic!("ended with {code}: {}", String::from_utf8_lossy(&output.stderr))
                }
            }
        }
        if all_done {
            finished += 1;
            assert_same(folder.path(), expected.path(), &format!("after {killed} kills"));
            // From the beginning, or with the results and without the outputs.
            let part = if finished % 3 == 0 { "out" } else { "cache" };
            fs::remove_dir_all(folder.path().join(part)).unwrap();
        }
    }
    println!("{started} runs, {killed} killed, {finished} times finished");
    succeeds(folder.path(), &["run", "pipeline.toml", "--out", "out"]);
    assert_same(folder.path(), expected.path(), "in the end");
    let again = succeeds(folder.path(), &["run", "pipeline.toml", "--out", "out"]);
    assert!(again.contains("13 nodes up to date"), "{again}");
    succeeds(folder.path(), &["cache", "verify"]);
    succeeds(folder.path(), &["cache", "gc", "--keep-runs", "1"]);
    assert_same(folder.path(), expected.path(), "after housekeeping");
    assert!(contents(&folder.path().join("cache/uses")).is_empty(), "notes of killed runs");
    let again = succeeds(folder.path(), &["run", "pipeline.toml", "--out", "out"]);
    assert!(again.contains("13 nodes up to date"), "{again}");
}
