//! What every kind must do, shown on its own example: it checks, runs, is cached the second time,
//! gives the same bytes at one and two threads, in another process and in a process for every node;
//! every artifact survives a round trip, and garbage is refused.

use std::{collections::BTreeMap, fs, path::Path, process::Command};

use serde::{Deserialize, Serialize};
use sinew::{
    LIBRARY,
    engine::{
        artifact::{Decoder, Dtype},
        digest::Digest,
        events::{Event, Observer, RunReport},
        graph::Graph,
        node::Surroundings,
        pipeline::{self, Settings},
        record::Line,
        run::{self, RunOptions, WorkerProgram},
        settings::Isolation,
        store::{Access, Store},
    },
};

/// Digests by node and port, with the type's name.
type Outputs = BTreeMap<(String, String), (String, Digest)>;

/// Takes down the outputs of everything that ends.
#[derive(Default)]
struct Outcomes(Outputs);

impl Observer for Outcomes {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        let Event::Finished { instance, outputs: Some(outputs), .. } = event else { return };
        let instance = &graph.instances[*instance];
        for port in instance.kind.spec.outputs {
            if let Some(info) = outputs.artifacts.get(port.name) {
                let key = (instance.id(), port.name.to_owned());
                self.0.insert(key, (port.ty.name.to_owned(), info.digest));
            }
        }
    }
}

fn load(file: &Path) -> Graph {
    pipeline::load(file, &LIBRARY, &Settings::default())
        .unwrap_or_else(|e| panic!("{}", e.render(false)))
}

fn run(graph: &Graph, folder: &Path, cache: &str, threads: usize) -> (RunReport, Outputs) {
    let store = Store::open(&folder.join(cache), Access::ReadWrite).unwrap();
    let options = RunOptions {
        threads,
        surroundings: Surroundings { mirrors: Vec::new(), offline: true, isolated: false },
        output_dir: folder.join("out"),
        run_id: "conformance".to_owned(),
        worker: Some(WorkerProgram {
            path: env!("CARGO_BIN_EXE_sinew").into(),
            args: vec!["worker".to_owned()],
        }),
        ..RunOptions::default()
    };
    let mut outcomes = Outcomes::default();
    let report = run::run(graph, &LIBRARY, &store, &options, &mut outcomes);
    (report, outcomes.0)
}

/// The same graph with a process for every node.
fn isolated(mut graph: Graph) -> Graph {
    for instance in graph.instances.node_weights_mut() {
        instance.settings.isolate = Some(Isolation::default());
    }
    graph
}

fn assert_conforms(kind: &str, example: &str) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("example.toml");
    fs::write(&file, example).unwrap();
    write_example_files(folder.path());
    let graph = load(&file);
    let uses = graph.instances.node_weights().any(|it| it.kind.spec.kind == kind);
    assert!(uses, "the example of `{kind}` does not use it");

    let (report, one) = run(&graph, folder.path(), "one", 1);
    assert!(report.succeeded(), "{kind}: {:?}", report.outcomes);
    let (again, _) = run(&graph, folder.path(), "one", 1);
    assert_eq!(again.counts().ran, 0, "{kind}: a second run computes nothing");
    let (_, two) = run(&isolated(load(&file)), folder.path(), "two", 2);
    assert_eq!(one, two, "{kind}: the same bytes with two threads in processes of their own");
    let process = run_in_process(&graph, folder.path(), &file);
    assert_eq!(one, process, "{kind}: and in another process");
    assert_round_trips(kind, folder.path(), &one);
    assert_golden(kind, &graph, folder.path(), &one);
}

/// A kind's version and the mean magnitudes of the numbers that its example gives.
#[derive(Debug, Serialize, Deserialize)]
struct Golden {
    version: u32,
    /// By `node.port.array`.
    means: BTreeMap<String, f64>,
}

/// Numbers may move by this much without a new version: processors differ in the last bits, and
/// what is discrete (a remeshing) makes more of it.
const GOLDEN_TOLERANCE: f64 = 0.02;

/// Whoever changes a kind's numbers raises its version, or caches keep the old ones. With `UPDATE=1`
/// the file is written anew.
fn assert_golden(kind: &str, graph: &Graph, folder: &Path, outputs: &Outputs) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{kind}.json"));
    let version = LIBRARY.kind(kind).unwrap().spec.version;
    let means = mean_magnitudes(kind, graph, folder, outputs);
    if std::env::var_os("UPDATE").is_some() {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let text = serde_json::to_string_pretty(&Golden { version, means }).unwrap();
        return fs::write(&path, text + "\n").unwrap();
    }
    let text = fs::read_to_string(&path)
        .unwrap_or_else(|e| panic!("{}: {e}; `UPDATE=1 cargo test` writes it", path.display()));
    let golden: Golden = serde_json::from_str(&text).unwrap();
    assert_eq!(golden.version, version, "{kind}: `UPDATE=1 cargo test` writes {}", path.display());
    assert!(golden.means.keys().eq(means.keys()), "{kind}: other outputs, but the same version");
    for (name, mean) in means {
        let before = golden.means[&name];
        let moved = (mean - before).abs() > GOLDEN_TOLERANCE * before.abs();
        assert!(!moved, "{kind}: `{name}` went from {before} to {mean}, but the version stayed");
    }
}

fn mean_magnitudes(
    kind: &str,
    graph: &Graph,
    folder: &Path,
    outputs: &Outputs,
) -> BTreeMap<String, f64> {
    let store = Store::open(&folder.join("one"), Access::ReadOnly).unwrap();
    let mut means = BTreeMap::new();
    for ((node, port), (ty, digest)) in outputs {
        if graph.instances[graph.select(node)[0]].kind.spec.kind != kind {
            continue;
        }
        let bytes = store.object(LIBRARY.artifact_kind(ty).unwrap().ty, digest).unwrap();
        let decoder = Decoder::new(&bytes).unwrap();
        for (name, array) in decoder.arrays().filter(|it| it.1.dtype == Dtype::F64) {
            let values = decoder.array::<f64>(name).unwrap().values;
            let finite = values.iter().filter(|it| it.is_finite());
            let sum: f64 = finite.map(|it| it.abs()).sum();
            let mean = sum / array.shape.iter().product::<usize>().max(1) as f64;
            // Noise about zero is no number to hold.
            let mean = if mean < 1e-12 { 0.0 } else { mean };
            means.insert(format!("{node}.{port}.{name}"), mean);
        }
    }
    means
}

fn run_in_process(graph: &Graph, folder: &Path, file: &Path) -> Outputs {
    let output = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "--json", "--quiet", "--offline", "-j", "2", "--cache"])
        .arg(folder.join("process"))
        .arg(file)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let type_of = |node: &str, port: &str| {
        let outputs = graph.instances[graph.select(node)[0]].kind.spec.outputs;
        outputs.iter().find(|it| it.name == port).unwrap().ty.name.to_owned()
    };
    let mut outputs = Outputs::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        if let Line::NodeDone(node) = serde_json::from_str(line).unwrap() {
            for (port, digest) in node.out {
                let ty = type_of(&node.node, &port);
                outputs.insert((node.node.clone(), port), (ty, digest));
            }
        }
    }
    outputs
}

fn assert_round_trips(kind: &str, folder: &Path, outputs: &Outputs) {
    let store = Store::open(&folder.join("one"), Access::ReadOnly).unwrap();
    for ((node, port), (ty, digest)) in outputs {
        let place = format!("{kind}: `{port}` of `{node}`");
        let codec = LIBRARY.artifact_kind(ty).unwrap_or_else(|| panic!("{place}: no codec"));
        let bytes = store.object(codec.ty, digest).unwrap_or_else(|e| panic!("{place}: {e}"));
        let artifact = codec.decode(&bytes, None).unwrap_or_else(|e| panic!("{place}: {e}"));
        assert_eq!(artifact.digest(), *digest, "{place}");
        assert!(artifact.to_bytes() == bytes[..], "{place}: encoded again it is the same");
        assert!(!artifact.summary().is_empty(), "{place}: it has a summary");
        for length in [0, 7, 8, 9, bytes.len() / 2, bytes.len() - 1] {
            assert!(codec.decode(&bytes[..length], None).is_err(), "{place}: {length} bytes");
        }
        // Whatever byte is damaged, decoding ends: with an error or with a value, not a panic.
        let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let mut damaged = bytes.to_vec();
        for at in (0..header).chain((header..bytes.len()).step_by(bytes.len() / 200 + 1)) {
            damaged[at] ^= 0x15;
            let _ = codec.decode(&damaged, None);
            damaged[at] ^= 0x15;
        }
    }
}

/// Files that examples read.
fn write_example_files(folder: &Path) {
    let tetrahedron =
        "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";
    fs::write(folder.join("tetrahedron.off"), tetrahedron).unwrap();
    let errors = "method,shape,joints,error [%]\nours,horse,33,5.0\nours,fox,42,3.9\n\
                  ours,woman,31,0.96\nnearest,horse,33,7.5\nnearest,fox,42,6.25\n\
                  nearest,woman,31,2.5\n";
    fs::write(folder.join("errors.csv"), errors).unwrap();
    let joints = "name,parent,x,y,z\nknee,hip,0,0.5,0\nhip,,0,1,0\n";
    fs::write(folder.join("joints.csv"), joints).unwrap();
    fs::write(folder.join("nod.bvh"), NOD).unwrap();
    fs::write(folder.join("lengths.py"), LENGTHS).unwrap();
    fs::write(folder.join("kinect.json"), r#"{"fx": 20.0, "fps": 15}"#).unwrap();
    fs::create_dir(folder.join("depth")).unwrap();
    for frame in 0..2 {
        let depths: Vec<f32> = (0..64).map(|it| 1.0 + (it % 8 + frame) as f32 * 0.01).collect();
        let bytes = sinew::kernels::sensors::depth::read::write_depth_png(8, 8, &depths);
        fs::write(folder.join(format!("depth/{frame}.png")), bytes).unwrap();
    }
}

const NOD: &str = "HIERARCHY\nROOT Neck\n{\nOFFSET 0 150 0\nCHANNELS 3 Xrotation Yrotation Zrotation\n\
JOINT Head\n{\nOFFSET 0 15 0\nCHANNELS 3 Xrotation Yrotation Zrotation\nEnd Site\n{\nOFFSET 0 10 0\n}\n}\n}\n\
MOTION\nFrames: 2\nFrame Time: 0.04\n0 0 0 0 0 0\n20 0 0 10 0 0\n";

const LENGTHS: &str = r#"
import numpy

def edge_lengths(mesh, digits):
    edges = numpy.unique(numpy.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
    ends = mesh.vertices[edges]
    return {"length": numpy.round(numpy.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), digits)}
"#;

/// Whether this machine has what the example of a kind needs; says so if not.
fn can_run(kind: &str) -> bool {
    let probe = || Command::new("python3").args(["-c", "import numpy"]).output();
    let can_run = kind != "python" || probe().is_ok_and(|it| it.status.success());
    if !can_run {
        eprintln!("skipped the example of `{kind}`: python3 with numpy is not there");
    }
    can_run
}

macro_rules! by_first_letter {
    ($($name:ident: $range:expr),* $(,)?) => {
        $(
            /// One part of the kinds: the parts run side by side.
            #[test]
            fn $name() {
                for kind in LIBRARY.kinds {
                    let first = kind.spec.kind.chars().next().unwrap();
                    if $range.contains(&first) && can_run(kind.spec.kind) {
                        assert_conforms(kind.spec.kind, kind.spec.example);
                    }
                }
            }
        )*
    };
}

by_first_letter! {
    kinds_from_a_to_d_conform: ('a'..='d'),
    kinds_from_e_to_l_conform: ('e'..='l'),
    kinds_from_m_to_r_conform: ('m'..='r'),
    kinds_from_s_to_z_conform: ('s'..='z'),
}
