//! What a call of a Python function costs beside the function: 30,000 x 120 doubles in, and in and out.
//! `cargo bench --bench python [-- N]` (needs python3 with numpy)
//!
//! - `cold`: the first call of a run, which starts an interpreter and imports numpy
//! - `in`: the median of N more, each with the eigenvectors of a basis as input
//! - `through`: the same, returning them as a new basis
//! - `encoding`: what the output of any kind costs, encoding and digest; part of `through`

use std::{
    fmt::Write,
    fs,
    path::Path,
    process::Command,
    time::{Duration, Instant},
};

use sinew::{
    LIBRARY,
    engine::{
        artifact::AnyArtifact,
        digest::Digest,
        record::Line,
        store::{Access, Store},
    },
    kernels::spectral::basis::Basis,
};

const SCRIPT: &str = "
import numpy

def make():
    vectors = numpy.random.rand(30000, 120)
    return {'eigenvalues': numpy.arange(120.0), 'eigenvectors': vectors, 'mass': numpy.ones(30000)}

def take(basis, n):
    return str(basis.eigenvectors[n, n])

def through(basis, n):
    return dict(basis)
";

fn main() {
    let n = std::env::args().skip(1).find_map(|it| it.parse().ok()).unwrap_or(9);
    let folder = tempfile::tempdir().expect("a writable folder");
    fs::write(folder.path().join("script.py"), SCRIPT).expect("a writable folder");
    let mut pipeline = node("make", "make", "outputs = { basis = \"basis\" }");
    run(folder.path(), &pipeline);
    for (name, ty) in [("take", "text"), ("through", "basis")] {
        for i in 0..=n {
            let rest = format!(
                "inputs = {{ basis = \"@make\" }}\nparams = {{ n = {i} }}\noutputs = {{ res = \"{ty}\" }}"
            );
            pipeline += &node(&format!("{name}_{i}"), name, &rest);
        }
    }
    let times = run(folder.path(), &pipeline);
    let of = |name: &str| {
        let mut times: Vec<Duration> =
            times.iter().filter(|it| it.0.starts_with(name)).map(|it| it.1).collect();
        times.sort();
        times
    };
    let (take, through) = (of("take"), of("through"));
    println!("30,000 x 120 doubles, {n} calls each, one interpreter");
    println!("cold     {:.1?}", take[take.len() - 1].max(through[through.len() - 1]));
    println!("in       {:.1?}", take[take.len() / 2]);
    println!("through  {:.1?}", through[through.len() / 2]);
    println!("encoding {:.1?}", encoding(folder.path(), &times));
}

fn node(name: &str, function: &str, rest: &str) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "[nodes.{name}]\nkind = \"python\"\nscript = \"script.py\"");
    let _ = writeln!(text, "function = \"{function}\"\n{rest}\n");
    text
}

/// Runs a pipeline on one thread; how long each node took, in their order.
fn run(folder: &Path, pipeline: &str) -> Vec<(String, Duration, Vec<Digest>)> {
    fs::write(folder.join("pipeline.toml"), pipeline).expect("a writable folder");
    let output = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "pipeline.toml", "--json", "-j", "1", "--cache", "cache"])
        .current_dir(folder)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).expect("lines of JSON");
    let lines = lines.lines().filter_map(|it| serde_json::from_str::<Line>(it).ok());
    lines
        .filter_map(|it| match it {
            Line::NodeDone(done) => {
                let wall = Duration::from_secs_f64(done.wall_s?);
                Some((done.node, wall, done.out.into_values().collect()))
            }
            _ => None,
        })
        .collect()
}

/// Encoding and digesting the basis.
fn encoding(folder: &Path, times: &[(String, Duration, Vec<Digest>)]) -> Duration {
    let store = Store::open(&folder.join("cache"), Access::ReadOnly).expect("a store");
    let kind = LIBRARY.artifact_kind("basis").expect("a type of ours");
    let outputs = times.iter().flat_map(|it| &it.2);
    let bytes = outputs.filter_map(|it| store.object(kind.ty, it).ok()).next().expect("a basis");
    let basis = kind.decode(&bytes, None).expect("a sound basis").downcast::<Basis>();
    let basis = basis.expect("a basis");
    let mut times: Vec<Duration> = (0..9)
        .map(|_| {
            let copy = Basis::clone(&basis);
            let start = Instant::now();
            std::hint::black_box(AnyArtifact::encode(copy));
            start.elapsed()
        })
        .collect();
    times.sort();
    times[times.len() / 2]
}
