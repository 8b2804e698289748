//! Wrong input, through the program: one clear message that names the node, the file and the facts,
//! the right exit code, and what was finished stays finished.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::Command,
};

struct Ended {
    code: i32,
    stderr: String,
}

/// A folder with a pipeline and its files.
struct Case {
    folder: tempfile::TempDir,
}

const OK_NODE: &str = "[nodes.fine]\nkind = \"synthesize\"\nn_vertices = 1000\n\n";

impl Case {
    fn new(pipeline: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("pipeline.toml"), pipeline).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn with(self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        fs::write(self.path(name), bytes).unwrap();
        self
    }

    fn sinew(&self, args: &[&str]) -> Ended {
        ended(Command::new(env!("CARGO_BIN_EXE_sinew")).args(args).current_dir(self.folder.path()))
    }

    fn run(&self) -> Ended {
        self.sinew(&["run", "pipeline.toml", "--offline"])
    }

    /// The run fails with this code, says this, and what was finished stays finished.
    #[track_caller]
    fn fails(&self, code: i32, messages: &[&str]) {
        let ended = self.run();
        for message in messages {
            assert!(ended.stderr.contains(message), "`{message}` is not in\n{}", ended.stderr);
        }
        assert_eq!(ended.code, code, "{}", ended.stderr);
        assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
    }
}

fn ended(command: &mut Command) -> Ended {
    let output = command.env_remove("SINEW_MIRROR").env_remove("SINEW_CACHE").output().unwrap();
    Ended {
        code: output.status.code().unwrap_or(-1),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// A pipeline that loads a file beside a node that works.
fn load(file: &str) -> String {
    format!("{OK_NODE}[nodes.shape]\nkind = \"load\"\npath = \"{file}\"\n")
}

#[track_caller]
fn file_fails(name: &str, bytes: impl AsRef<[u8]>, messages: &[&str]) {
    let case = Case::new(&load(name)).with(name, bytes);
    let mut messages = messages.to_vec();
    messages.extend(["FAILED  shape", name, "pipeline.toml:5"]);
    case.fails(1, &messages);
    // The node beside it is kept.
    let again = case.sinew(&["run", "pipeline.toml", "-v"]);
    assert!(again.stderr.contains("cached  fine"), "{}", again.stderr);
}

#[test]
fn files_that_are_no_meshes() {
    file_fails("empty.obj", "", &["empty"]);
    file_fails("empty.glb", "", &["empty"]);
    file_fails("empty.ply", "", &["empty"]);
    file_fails("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", &["vertex 1", "NaN"]);
    file_fails("inf.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 inf 0\n3 0 1 2\n", &["vertex 2", "inf"]);
    file_fails(
        "range.off",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        &["vertex 7", "there are 3"],
    );
    file_fails("truncated.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", &["truncated.off"]);
    file_fails("other.abc", "0 0 0\n", &["abc"]);
    file_fails("words.xyz", "0 0 zero\n", &["words.xyz"]);
}

#[test]
fn a_truncated_glb() {
    let rig = format!(
        "{OK_NODE}[nodes.rig]\nkind = \"rig\"\nmesh = \"@fine.mesh\"\nskeleton = \"@fine.skeleton\"\n\
         weights = \"@fine.weights\"\n\n[outputs]\n\"rig.glb\" = \"@rig\"\n"
    );
    let case = Case::new(&rig);
    let run = case.run();
    assert_eq!(run.code, 0, "{}", run.stderr);
    let whole = fs::read(case.path("rig.glb")).unwrap();
    for length in [3, 11, 40, whole.len() / 2, whole.len() - 1] {
        file_fails("cut.glb", &whole[..length], &["cut.glb"]);
    }
}

/// Two tetrahedra, some distance apart.
const TWO_PARTS: &str = "OFF\n8 8 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n5 0 0\n6 0 0\n5 1 0\n5 0 1\n\
    3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n3 4 6 5\n3 4 5 7\n3 5 6 7\n3 4 7 6\n";

const SPECTRUM: &str = "[nodes.shape]\nkind = \"load\"\npath = \"shape.off\"\n\n\
    [nodes.laplacian]\nkind = \"laplacian\"\nmesh = \"@shape.mesh\"\n\n\
    [nodes.basis]\nkind = \"eigs\"\noperator = \"@laplacian\"\n";

#[test]
fn a_disconnected_mesh_names_its_parts() {
    let case = Case::new(&format!("{SPECTRUM}k = 3\n")).with("shape.off", TWO_PARTS);
    case.fails(1, &["FAILED  basis", "2 connected components", "of 4, 4 vertices"]);
}

#[test]
fn more_eigenpairs_than_vertices() {
    let tetrahedron =
        "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";
    let case = Case::new(&format!("{SPECTRUM}k = 9\n")).with("shape.off", tetrahedron);
    case.fails(1, &["FAILED  basis", "9 eigenpairs are wanted", "4 vertices"]);
}

#[test]
fn a_vertex_without_faces_has_no_area() {
    let shape =
        "OFF\n5 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n9 9 9\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";
    let case = Case::new(&format!("{SPECTRUM}k = 2\n")).with("shape.off", shape);
    case.fails(1, &["FAILED  laplacian", "1 of 5 vertices", "vertex 4"]);
}

/// Three faces on one edge, one of them twice.
const FAN: &str =
    "OFF\n5 4 0\n0 0 0\n0 0 1\n1 0 0\n0 1 0\n-1 0 0\n3 0 1 2\n3 0 1 3\n3 0 1 4\n3 0 1 4\n";

#[test]
fn non_manifold_and_duplicate_faces_are_worked_with_and_told() {
    let case = Case::new(&format!("{SPECTRUM}k = 3\n")).with("shape.off", FAN);
    assert_eq!(case.run().code, 0);
    let clean = "[nodes.shape]\nkind = \"load\"\npath = \"shape.off\"\n\n\
                 [nodes.clean]\nkind = \"clean\"\nmesh = \"@shape.mesh\"\n";
    let case = Case::new(clean).with("shape.off", FAN);
    let run = case.run();
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("1 repeated faces removed"), "{}", run.stderr);
}

#[test]
fn a_file_without_a_rig_says_so_where_one_is_needed() {
    let text = "[nodes.shape]\nkind = \"load\"\npath = \"shape.off\"\n\n\
                [nodes.regressor]\nkind = \"regressor\"\nmesh = \"@shape.mesh\"\n\
                skeleton = \"@shape.skeleton\"\nweights = \"@shape.weights\"\n";
    let case = Case::new(text).with("shape.off", TWO_PARTS);
    case.fails(1, &["FAILED  regressor", "`skeleton` of `shape`, which has none"]);
}

#[test]
fn landmarks_that_do_not_fit() {
    let pair = "[nodes.a]\nkind = \"synthesize\"\nn_vertices = 1000\n\n\
                [nodes.b]\nkind = \"synthesize\"\nn_vertices = 1000\nseed = 2\n\n\
                [nodes.la]\nkind = \"laplacian\"\nmesh = \"@a.mesh\"\n\n\
                [nodes.lb]\nkind = \"laplacian\"\nmesh = \"@b.mesh\"\n\n\
                [nodes.ba]\nkind = \"eigs\"\noperator = \"@la\"\nk = 30\n\n\
                [nodes.bb]\nkind = \"eigs\"\noperator = \"@lb\"\nk = 30\n\n\
                [nodes.few]\nkind = \"landmarks\"\nfile = \"few.txt\"\nmesh = \"@b.mesh\"\n\n\
                [nodes.da]\nkind = \"descriptors\"\nbasis = \"@ba\"\nlandmarks = \"@a.landmarks\"\n\n\
                [nodes.db]\nkind = \"descriptors\"\nbasis = \"@bb\"\nlandmarks = \"@few\"\n\n\
                [nodes.map]\nkind = \"fmap\"\nsource_basis = \"@ba\"\ntarget_basis = \"@bb\"\n\
                source_descriptors = \"@da\"\ntarget_descriptors = \"@db\"\n";
    let case = Case::new(pair).with("few.txt", "1\n2\n3\n");
    case.fails(1, &["FAILED  map", "160 descriptors and the target 80"]);
    let case = Case::new(pair).with("few.txt", "1\n2\n99999\n");
    case.fails(1, &["FAILED  few", "99999", "1000"]);
}

#[test]
fn a_download_of_another_content() {
    let text = format!(
        "{OK_NODE}[nodes.file]\nkind = \"download\"\nurl = \"data:,hello\"\nblake3 = \"{}\"\n",
        "0".repeat(64)
    );
    Case::new(&text)
        .fails(1, &["FAILED  file", &"0".repeat(64), "ea8f163db38682925e4491c5e58d4bb3"]);
}

#[test]
fn a_download_without_a_network() {
    let text = format!(
        "[nodes.file]\nkind = \"download\"\nurl = \"https://example.org/a.obj\"\nblake3 = \"{}\"\n",
        "1".repeat(64)
    );
    Case::new(&text).fails(3, &["FAILED  file", "https://example.org/a.obj", "network is off"]);
}

#[test]
fn a_cache_that_cannot_be_made() {
    let case = Case::new(OK_NODE).with("cache", "a file, no folder");
    case.fails(3, &["cache", "--cache"]);
}

#[test]
fn a_cache_that_cannot_be_written() {
    let case = Case::new(OK_NODE);
    assert_eq!(case.run().code, 0);
    let log = case.path("cache/log");
    fs::set_permissions(&log, fs::Permissions::from_mode(0o555)).unwrap();
    let run = case.sinew(&["run", "pipeline.toml", "--set", "fine.seed=9", "--cache", "cache"]);
    fs::set_permissions(&log, fs::Permissions::from_mode(0o755)).unwrap();
    // Nothing is refused to root; everybody else is told.
    // SAFETY: a plain system call.
    if unsafe { libc::geteuid() } != 0 {
        assert_eq!(run.code, 3, "{}", run.stderr);
    }
    let run = case.sinew(&["run", "pipeline.toml", "--set", "fine.seed=9", "--read-only-cache"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
}

/// Runs with a limit on the size of files: what a full disk looks like to a program.
fn run_with_file_limit(case: &Case, blocks: u32) -> Ended {
    let script = format!(
        "trap '' XFSZ; ulimit -f {blocks}; exec \"{}\" run pipeline.toml --offline",
        env!("CARGO_BIN_EXE_sinew")
    );
    ended(Command::new("bash").args(["-c", &script]).current_dir(case.folder.path()))
}

#[test]
fn a_full_disk_ends_the_run_and_loses_nothing() {
    let text = "[nodes.small]\nkind = \"synthesize\"\nn_vertices = 1000\n\n\
                [nodes.large]\nkind = \"subdivide\"\nmesh = \"@small.mesh\"\nlevels = 3\n";
    let case = Case::new(text);
    let first = case.sinew(&["run", "pipeline.toml", "small"]);
    assert_eq!(first.code, 0, "{}", first.stderr);
    let full = run_with_file_limit(&case, 400);
    assert_eq!(full.code, 3, "{}", full.stderr);
    assert!(full.stderr.contains("cannot write `"), "{}", full.stderr);
    assert!(full.stderr.contains("is kept"), "{}", full.stderr);
    let after = case.sinew(&["run", "pipeline.toml"]);
    assert_eq!(after.code, 0, "{}", after.stderr);
    assert!(after.stderr.contains("1 ran, 1 cached"), "{}", after.stderr);
    let verify = case.sinew(&["cache", "verify"]);
    assert_eq!(verify.code, 0, "{}", verify.stderr);
}

#[test]
fn an_output_that_cannot_be_written() {
    let text = format!("{OK_NODE}[outputs]\n\"taken/body.ply\" = \"@fine.mesh\"\n");
    let case = Case::new(&text).with("taken", "a file where a folder should be");
    case.fails(3, &["FAILED  taken/body.ply", "cannot write `"]);
}

#[test]
fn missing_files_are_mistakes_of_the_pipeline() {
    let case = Case::new(&load("nowhere.obj"));
    let run = case.run();
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(run.stderr.contains("nowhere.obj"), "{}", run.stderr);
    assert!(
        !Path::new(&case.path("cache")).exists(),
        "nothing is made before everything is checked"
    );
}
