//! A run over more data than its memory budget stays within it. The run is a process of its own, so
//! that its peak can be read.

use std::{fmt::Write, fs, path::Path, process::Command};

use sinew::engine::{
    events::Silent,
    pipeline::{self, Settings},
    run::{self, RunOptions},
    store::{Access, Store},
    toy::TOY,
};

const N_TEXTS: usize = 96;
const TEXT_BYTES: usize = 1 << 20;
const BUDGET: u64 = 24 << 20;

/// Texts, all of which are read by a count each: texts have the longer path, so all of them would
/// be made before the first is counted.
fn write_pipeline(folder: &Path, n: usize) {
    let mut text = String::new();
    let mut terms = Vec::new();
    for index in 0..n {
        let name = format!("text{index}.txt");
        let line = format!("{index:07}\n");
        fs::write(folder.join(&name), line.repeat(TEXT_BYTES / line.len())).unwrap();
        let _ = write!(
            text,
            "[nodes.t{index}]\nkind = \"text_file\"\npath = \"{name}\"\n\n\
             [nodes.c{index}]\nkind = \"count\"\ntext = \"@t{index}\"\n\n"
        );
        terms.push(format!("\"@c{index}\""));
    }
    let _ = write!(text, "[nodes.sum]\nkind = \"add\"\nterms = [{}]\n\n", terms.join(", "));
    text += "[outputs]\n\"sum.txt\" = \"@sum\"\n";
    for index in 0..n {
        let _ = writeln!(text, "\"copy{index}.txt\" = \"@t{index}\"");
    }
    fs::write(folder.join("pipeline.toml"), text).unwrap();
}

/// Not a test by itself: what [`peak`] starts.
#[test]
fn child() {
    let Some(folder) = std::env::var_os("SINEW_MEMORY_CHILD") else { return };
    let folder = Path::new(&folder);
    let graph = pipeline::load(&folder.join("pipeline.toml"), &TOY, &Settings::default())
        .unwrap_or_else(|e| panic!("{}", e.render(false)));
    let store = Store::open(&folder.join("cache"), Access::ReadWrite).unwrap();
    let options = RunOptions {
        memory: BUDGET,
        output_dir: folder.join("out"),
        run_id: "memory".to_owned(),
        ..RunOptions::default()
    };
    let report = run::run(&graph, &TOY, &store, &options, &mut Silent);
    assert!(report.succeeded());
}

/// The peak of a process that runs over so many texts, in bytes.
fn peak(n: usize) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    write_pipeline(folder.path(), n);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "child"]).env("SINEW_MEMORY_CHILD", folder.path());
    let child = command.stdout(std::process::Stdio::null()).spawn().unwrap();
    let peak = wait_for_peak(child);
    let sum = fs::read_to_string(folder.path().join("out/sum.txt")).unwrap();
    assert_eq!(sum.trim(), (n * TEXT_BYTES).to_string());
    for index in 0..n {
        let read = |name: String| fs::read(folder.path().join(name)).unwrap();
        let same = read(format!("out/copy{index}.txt")) == read(format!("text{index}.txt"));
        assert!(same, "copy {index}");
    }
    peak
}

/// Waits for a process to end; the most memory that it had resident.
fn wait_for_peak(child: std::process::Child) -> u64 {
    let mut status = 0;
    // SAFETY: the struct is plain numbers, and the call fills it; the child is ours, and nobody else
    // waits for it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        libc::wait4(child.id() as i32, &raw mut status, 0, &raw mut usage);
        usage
    };
    assert_eq!(status, 0, "the run failed");
    usage.ru_maxrss as u64 * 1024
}

#[test]
fn a_run_over_more_than_its_memory_stays_within_the_budget() {
    // What the program, and one text in the making, take in any case.
    let base = peak(1);
    let found = peak(N_TEXTS);
    println!("base {base}, with {N_TEXTS} texts {found}, budget {BUDGET}");
    let (allowed, total) = (base + BUDGET * 11 / 10, (N_TEXTS * TEXT_BYTES) as u64);
    assert!(found <= allowed, "{found} bytes of {total}, with {base} + 110 % of {BUDGET} allowed");
}
