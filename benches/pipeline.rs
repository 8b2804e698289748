//! What reading and checking a pipeline costs: 1,000 trivial nodes, 10 layers of 100, each reading 3
//! of the layer before. `cargo bench --bench pipeline [-- N]`
//!
//! - `first`: the first load of a process, schemas and all
//! - `again`: the median of 50 more
//! - `inner`: as many nodes, but in 100 uses of one inner pipeline

use std::{
    fmt::Write,
    fs,
    path::Path,
    time::{Duration, Instant},
};

use sinew::engine::{
    pipeline::{self, Settings},
    toy::TOY,
};

const LAYERS: usize = 10;

fn main() {
    let n = std::env::args().skip(1).find_map(|it| it.parse().ok()).unwrap_or(1000);
    let folder = tempfile::tempdir().expect("a writable folder");
    let file = folder.path().join("pipeline.toml");
    fs::write(&file, layers(n / LAYERS)).expect("a writable folder");
    println!("{n} nodes: first {:.2?}, again {:.2?}", load(&file), median(&file));
    fs::write(folder.path().join("inner.toml"), chain()).expect("a writable folder");
    fs::write(&file, uses(n / LAYERS)).expect("a writable folder");
    println!("{n} nodes: inner {:.2?}", median(&file));
}

fn median(file: &Path) -> Duration {
    let mut times: Vec<Duration> = (0..50).map(|_| load(file)).collect();
    times.sort();
    times[times.len() / 2]
}

/// The time of one load, without dropping the graph. It is of one thread, so CPU time as well.
fn load(file: &Path) -> Duration {
    let start = Instant::now();
    let graph = pipeline::load(file, &TOY, &Settings::default());
    let time = start.elapsed();
    graph.unwrap_or_else(|e| panic!("{}", e.render(false)));
    time
}

fn layers(width: usize) -> String {
    let mut text = String::new();
    for i in 0..width {
        let _ = writeln!(text, "[nodes.n0_{i}]\nkind = \"number\"\nvalue = {i}");
    }
    for layer in 1..LAYERS {
        for i in 0..width {
            let terms: Vec<String> = [i, i + 1, i + 7]
                .iter()
                .map(|it| format!("\"@n{}_{}\"", layer - 1, it % width))
                .collect();
            let terms = terms.join(", ");
            let _ = writeln!(text, "[nodes.n{layer}_{i}]\nkind = \"add\"\nterms = [{terms}]");
        }
    }
    text
}

fn chain() -> String {
    let mut text =
        "[params]\nvalue = 1\n[nodes.s0]\nkind = \"number\"\nvalue = \"${value}\"\n".to_owned();
    for i in 1..LAYERS {
        let _ = writeln!(text, "[nodes.s{i}]\nkind = \"add\"\nterms = [\"@s{}\"]", i - 1);
    }
    text + &format!("[outputs]\nlast = \"@s{}\"\n", LAYERS - 1)
}

fn uses(n: usize) -> String {
    let one =
        |i| format!("[nodes.u{i}]\nkind = \"pipeline\"\nfile = \"inner.toml\"\nvalue = {i}\n");
    (0..n).map(one).collect()
}
