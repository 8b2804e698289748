//! Artifacts are files that others open: the real safetensors package reads them.

use std::{fs, process::Command};

/// Whether this machine's Python has the packages; says so if not.
fn has_packages() -> bool {
    let found = Command::new("python3").args(["-c", "import numpy, safetensors"]).output();
    let found = found.is_ok_and(|it| it.status.success());
    if !found {
        eprintln!("skipped: python3 with numpy and safetensors is not there");
    }
    found
}

const PIPELINE: &str = r#"
[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.laplacian]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@laplacian"
k = 30

[outputs]
"basis.safetensors" = "@basis"
"basis.npz" = "@basis"
"#;

/// What a user would write: no code of ours, only the packages.
const SCRIPT: &str = r#"
import glob, numpy
from safetensors import safe_open
from safetensors.numpy import load_file

basis = load_file("basis.safetensors")
phi, values, mass = basis["eigenvectors"], basis["eigenvalues"], basis["mass"]
assert phi.dtype == numpy.float64 and phi.shape == (len(mass), 30), phi.shape
gram = phi.T @ (mass[:, None] * phi)
assert abs(gram - numpy.eye(30)).max() < 1e-8, "orthonormal, so rows and columns are in place"
assert values[0] == 0 and (numpy.diff(values) >= 0).all()

archive = numpy.load("basis.npz")
assert set(archive.files) == set(basis)
for name in basis:
    assert (archive[name] == basis[name]).all(), name

# Large artifacts are such files in the cache itself.
stored = glob.glob("cache/objects/*/*.safetensors")
assert stored
for path in stored:
    with safe_open(path, "numpy") as file:
        assert file.metadata()["sinew.type"]
        for name in file.keys():
            assert file.get_tensor(name) is not None
print("read", len(stored))
"#;

#[test]
fn a_python_user_reads_a_basis_without_any_code_of_ours() {
    if !has_packages() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("pipeline.toml"), PIPELINE).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "pipeline.toml", "--cache", "cache"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let read =
        Command::new("python3").args(["-c", SCRIPT]).current_dir(folder.path()).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
}
