//! Graphs that are kept: they are what reading gives, or are not believed.

mod folder;

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use sinew::engine::{
    graph::Graph,
    library::Library,
    pipeline::{self, Settings},
    snapshot,
    store::{
        Access, Store,
        disk::{Disk, Faults, Operation, Verdict},
        gc,
    },
    toy::TOY,
};

use folder::Folder;

/// Nearly all that a pipeline can say: axes of every kind, inner pipelines, profiles, settings, files
/// and those that they refer to, what is missing.
const FILES: [(&str, &str); 6] = [
    (
        "pipeline.toml",
        r#"
[pipeline]
title = "All of it"
cite = ["one2020", "two2021"]

[params]
k = 2
name = "a"

[profiles.fast]
k = 1

[axes.file]
files = "texts/*.txt"

[axes.row]
table = "rows.csv"

[axes.n]
range = { from = 1, to = 4 }

[nodes.text]
kind = "text_file"
path = "${file.path}"
retries = 2
backoff = 0.5
timeout = "10m"
isolate = { memory = "1 GB" }

[nodes.length]
kind = "count"
text = "@text"

[nodes.all]
kind = "gather"
numbers = "@length"
over = "file"
missing = "show"

[nodes.number]
kind = "number"
value = "${row.value}"

[nodes.twice]
kind = "pipeline"
file = "inner.toml"
number = "@number"
factor = "${k}"

[nodes.steps]
kind = "divide"
number = "@twice"
by = "${n}"

[nodes.sum]
kind = "add"
terms = ["@steps[n=2].quotient", "@number", "@steps[n=3].remainder"]
weights = [1, 2, 3]

[nodes.later]
kind = "sleep"
after = "@last"

[nodes.last]
kind = "number"

[outputs]
"out/${row}.txt" = "@sum"
"out/last.txt" = "@last"
"#,
    ),
    (
        "inner.toml",
        "[inputs]\nnumber = \"number\"\n\n[params]\nfactor = 1\n\n\
         [nodes.scaled]\nkind = \"scale\"\nnumber = \"@number\"\nfactor = \"${factor}\"\n\n\
         [outputs]\nres = \"@scaled\"\n",
    ),
    ("rows.csv", "label,value\nx,1\ny,20\n"),
    ("texts/a.txt", "include b.part\nMore.\n"),
    ("texts/b.txt", "Größe"),
    ("texts/b.part", "included\n"),
];

impl Folder {
    fn store(&self) -> Store {
        Store::open(&self.path("cache"), Access::ReadWrite).unwrap()
    }

    fn load(&self, settings: &Settings) -> Graph {
        pipeline::load(&self.path("pipeline.toml"), &TOY, settings)
            .unwrap_or_else(|e| panic!("{}", e.render(false)))
    }

    fn keep(&self, settings: &Settings) -> Graph {
        let graph = self.load(settings);
        snapshot::write(&graph, &self.path("pipeline.toml"), &TOY, settings, &self.store())
            .unwrap();
        graph
    }

    fn find(&self, settings: &Settings) -> Option<Graph> {
        let (file, store) = (self.path("pipeline.toml"), self.path("cache"));
        snapshot::find(&file, &TOY, settings, &Disk::default(), &store)
    }

    /// The file of the kept graph.
    fn kept(&self) -> PathBuf {
        let mut files = fs::read_dir(self.path("cache/graphs")).unwrap();
        let file = files.next().unwrap().unwrap().path();
        assert!(files.next().is_none());
        file
    }
}

/// Everything that a graph holds.
fn show(graph: &Graph) -> String {
    let mut res = format!("{:?} {:?}\n", graph.title, graph.cites);
    for index in graph.instances.node_indices() {
        let it = &graph.instances[index];
        let _ = writeln!(res, "{} {:?} {}", it.id(), it.labels, it.kind.spec.kind);
        let ports = |ports: &[sinew::engine::node::Port]| -> Vec<&str> {
            ports.iter().map(|it| it.name).collect()
        };
        let (inputs, outputs) = (ports(it.kind.spec.inputs), ports(it.kind.spec.outputs));
        let _ = writeln!(res, "  {inputs:?} {outputs:?}");
        let question = it.node.question().map(|it| it.text);
        let _ = writeln!(res, "  {} {} {question:?}", it.node.params(), it.node.key_params());
        let _ = writeln!(res, "  {:?} {:?} {}", it.inputs, it.input_labels, it.shows_missing);
        let _ = writeln!(res, "  {:?} {:?}", it.files, it.settings);
        let _ = writeln!(res, "  {:?} {:?}", it.place, it.field_places);
        let readers: Vec<_> = graph.instances.neighbors(index).collect();
        let _ = writeln!(res, "  {readers:?}");
    }
    for rule in &graph.outputs {
        let _ = writeln!(res, "{:?} {:?} {:?}", rule.path, rule.from, rule.place);
    }
    for source in &graph.sources {
        let _ = writeln!(res, "{source:?}");
    }
    res
}

fn settings() -> [Settings; 4] {
    let texts = |it: &[&str]| it.iter().map(|it| (*it).to_owned()).collect();
    [
        Settings::default(),
        Settings { profile: Some("fast".to_owned()), ..Settings::default() },
        Settings { set: texts(&["k=3", "sum.weights=[3, 2, 1]"]), ..Settings::default() },
        Settings { only: texts(&["file=b"]), limit: texts(&["row=1"]), ..Settings::default() },
    ]
}

#[test]
fn a_kept_graph_is_what_reading_gives() {
    let folder = Folder::new(&FILES);
    for settings in settings() {
        assert!(folder.find(&settings).is_none());
        let graph = folder.keep(&settings);
        let found = folder.find(&settings).expect("nothing has changed");
        assert_eq!(show(&found), show(&graph), "{settings:?}");
        assert_eq!(show(&found), show(&folder.load(&settings)), "{settings:?}");
    }
}

#[test]
fn graphs_of_large_pipelines_are_kept_by_themselves() {
    let folder = Folder::new(&FILES);
    let path = folder.path("pipeline.toml");
    let load = || snapshot::load(&path, &TOY, &Settings::default(), &folder.store()).unwrap();
    let small = show(&load());
    assert_eq!(show(&load()), small);
    assert!(!folder.path("cache/graphs").exists());
    let longer = FILES[0].1.replace("to = 4", "to = 400");
    folder.write("pipeline.toml", &longer);
    let large = show(&load());
    let kept = fs::read(folder.kept()).unwrap();
    assert_eq!(show(&load()), large);
    assert_eq!(fs::read(folder.kept()).unwrap(), kept);
    // A store that is only read may be used, and is not written to.
    folder.write("pipeline.toml", &format!("# New.\n{longer}"));
    let read_only = Store::open(&folder.path("cache"), Access::ReadOnly).unwrap();
    let found = snapshot::load(&path, &TOY, &Settings::default(), &read_only).unwrap();
    assert_ne!(show(&found), large);
    assert_eq!(fs::read(folder.kept()).unwrap(), kept);
    folder.write("pipeline.toml", &longer);
    assert_eq!(
        show(&snapshot::load(&path, &TOY, &Settings::default(), &read_only).unwrap()),
        large
    );
    // Housekeeping removes what may never be asked for again.
    gc::collect(&folder.path("cache"), &gc::GcOptions::default()).unwrap();
    assert_eq!(fs::read_dir(folder.path("cache/graphs")).unwrap().count(), 0);
}

/// Changes something; the kept graph must not be believed, and again when it is changed back.
fn check_change(what: &str, change: impl Fn(&Folder)) {
    let folder = Folder::new(&FILES);
    let settings = Settings::default();
    folder.keep(&settings);
    change(&folder);
    assert!(folder.find(&settings).is_none(), "{what}");
}

#[test]
fn whatever_changes_is_noticed() {
    for (name, text) in FILES.iter().filter(|it| !it.0.contains('/')) {
        check_change(name, |it| it.write(name, &format!("{text}\n")));
    }
    check_change("a file is gone", |it| fs::remove_file(it.path("texts/b.txt")).unwrap());
    check_change("there is another file", |it| it.write("texts/c.txt", ""));
    check_change("a part is gone", |it| fs::remove_file(it.path("texts/b.part")).unwrap());
    check_change("other parts", |it| it.write("texts/a.txt", "include c.part\n"));
    check_change("a folder instead of a file", |it| {
        fs::remove_file(it.path("texts/b.part")).unwrap();
        fs::create_dir(it.path("texts/b.part")).unwrap();
    });
    check_change("a file is a link elsewhere", |it| {
        fs::rename(it.path("inner.toml"), it.path("other.toml")).unwrap();
        std::os::unix::fs::symlink("other.toml", it.path("inner.toml")).unwrap();
    });
    check_change("no text", |it| fs::write(it.path("inner.toml"), b"\xff").unwrap());
    check_change("the graph is gone", |it| fs::remove_file(it.kept()).unwrap());
}

#[test]
fn what_nodes_read_may_change_without_that() {
    let folder = Folder::new(&FILES);
    let settings = Settings::default();
    let graph = folder.keep(&settings);
    folder.write("texts/b.txt", "another text");
    folder.write("texts/a.txt", "include b.part\nOther words.\n");
    assert_eq!(show(&folder.find(&settings).expect("the same files")), show(&graph));
}

#[test]
fn another_question_gets_no_old_answer() {
    static FEWER: Library = Library {
        kinds: {
            let (_, kinds) = TOY.kinds.split_last().expect("there are some");
            kinds
        },
        types: TOY.types,
        common_formats: &[],
    };
    let folder = Folder::new(&FILES);
    folder.keep(&Settings::default());
    for other in &settings()[1..] {
        assert!(folder.find(other).is_none(), "{other:?}");
    }
    let path = folder.path("pipeline.toml");
    let find = |path: &Path, library| {
        let store = folder.path("cache");
        snapshot::find(path, library, &Settings::default(), &Disk::default(), &store)
    };
    assert!(find(&path, &TOY).is_some());
    assert!(find(&path, &FEWER).is_none());
    // The same file by another name is shown by that name.
    let detour = folder.path("texts/../pipeline.toml");
    assert!(find(&detour, &TOY).is_none());
}

#[test]
fn a_damaged_graph_is_not_believed() {
    let folder = Folder::new(&FILES);
    let settings = Settings::default();
    folder.keep(&settings);
    let kept = folder.kept();
    let whole = fs::read(&kept).unwrap();
    for place in (0..whole.len()).step_by(3) {
        let mut damaged = whole.clone();
        damaged[place] ^= 1 << (place % 8);
        fs::write(&kept, &damaged).unwrap();
        assert!(folder.find(&settings).is_none(), "bit at {place}");
    }
    for length in (0..whole.len()).step_by(7) {
        fs::write(&kept, &whole[..length]).unwrap();
        assert!(folder.find(&settings).is_none(), "{length} bytes");
    }
    fs::write(&kept, [&whole[..], b"x"].concat()).unwrap();
    assert!(folder.find(&settings).is_none());
    fs::write(&kept, &whole).unwrap();
    assert!(folder.find(&settings).is_some());
}

/// Fails at the operation with a number.
struct FailAt(usize, Verdict, AtomicUsize);

impl Faults for FailAt {
    fn verdict(&self, _: Operation, _: &Path) -> Verdict {
        let is_it = self.2.fetch_add(1, Ordering::Relaxed) == self.0;
        if is_it { self.1 } else { Verdict::Go }
    }
}

#[test]
fn a_disk_that_fails_costs_the_graph_only() {
    let folder = Folder::new(&FILES);
    let settings = Settings::default();
    let (path, graph) = (folder.path("pipeline.toml"), folder.load(&Settings::default()));
    drop(folder.store());
    let mut n_found = BTreeMap::new();
    let verdicts =
        [Verdict::Fail(libc::ENOSPC), Verdict::Short(0), Verdict::Short(1000), Verdict::Ignore];
    for verdict in verdicts {
        for at in 0..25 {
            let _ = fs::remove_dir_all(folder.path("cache/graphs"));
            let disk = Disk::with_faults(Arc::new(FailAt(at, verdict, AtomicUsize::new(0))));
            let Ok(store) = Store::open_on(&disk, &folder.path("cache"), Access::ReadWrite) else {
                continue;
            };
            // While it is written, or while it is read.
            let written = snapshot::write(&graph, &path, &TOY, &settings, &store);
            let found = snapshot::find(&path, &TOY, &settings, &disk, store.dir());
            for found in found.into_iter().chain(folder.find(&settings)) {
                assert_eq!(show(&found), show(&graph), "{verdict:?} at {at}");
                *n_found.entry(written.is_ok()).or_insert(0) += 1;
            }
        }
    }
    assert!(n_found[&true] > 40, "{n_found:?}");
}
