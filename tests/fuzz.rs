//! Garbage: mutated pipelines, artifacts and mesh files are refused or read, without a panic and
//! without more memory than their size explains. Seeds are fixed; `SINEW_FUZZ=600` goes on for so
//! many seconds with others.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use sinew::{
    LIBRARY,
    engine::{
        artifact::AnyArtifact,
        digest::Digest,
        events::{Event, Observer},
        graph::Graph,
        node::Surroundings,
        pipeline::{self, Settings},
        run::{self, RunOptions},
        store::{Access, Store},
    },
    kernels::{
        io::{gltf::GltfOptions, read::read_character},
        maps::landmark_files::read_landmarks,
        numerics::random::Random,
        text::Text,
    },
};

// ---- memory -------------------------------------------------------------------------------------

/// Counts what each thread has allocated.
struct Counting;

thread_local! {
    static BYTES: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(change: isize) {
    // A thread that ends may free what it no longer counts.
    let _ = BYTES.try_with(|bytes| {
        bytes.set(bytes.get() + change);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(bytes.get())));
    });
}

// SAFETY: everything is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Whatever the input, this much may be used; and so much for every byte of it.
const FREE_BYTES: usize = 64 << 20;
const BYTES_PER_BYTE: usize = 200;

/// Runs something on an input and checks the memory that it took.
#[track_caller]
fn bounded<T>(input: &[u8], what: &str, run: impl FnOnce() -> T) -> T {
    let before = BYTES.get();
    PEAK.set(before);
    let res = run();
    let used = (PEAK.get() - before) as usize;
    let allowed = FREE_BYTES + BYTES_PER_BYTE * input.len();
    assert!(used <= allowed, "{what}: {used} bytes for {} bytes", input.len());
    res
}

// ---- mutations ------------------------------------------------------------------------------------

/// What numbers in texts are replaced with.
const NUMBERS: [&str; 12] = [
    "0",
    "1",
    "2",
    "-1",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "1e308",
    "999999999999",
];

struct Mutator(Random);

impl Mutator {
    fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    fn mutate(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut res = bytes.to_vec();
        for _ in 0..=self.below(3) {
            self.step(&mut res);
        }
        res
    }

    fn step(&mut self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let at = self.below(bytes.len());
        match self.below(8) {
            0 => bytes[at] ^= 1 << self.below(8),
            1 => bytes[at] = self.below(256) as u8,
            2 => bytes.truncate(at),
            3 => {
                let end = (at + self.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => {
                let end = (at + self.below(40)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                let into = self.below(bytes.len());
                bytes.splice(into..into, copy);
            }
            5 => {
                let words = [0, 1, u32::MAX, 1 << 31, f32::NAN.to_bits(), f32::INFINITY.to_bits()];
                let word = words[self.below(words.len())].to_le_bytes();
                let end = (at + 4).min(bytes.len());
                bytes[at..end].copy_from_slice(&word[..end - at]);
            }
            _ => self.replace_number(bytes, at),
        }
    }

    /// Replaces the next number written in digits.
    fn replace_number(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let Some(start) = (at..bytes.len()).find(|&it| bytes[it].is_ascii_digit()) else { return };
        let n = bytes[start..].iter().take_while(|it| it.is_ascii_digit()).count();
        let number = NUMBERS[self.below(NUMBERS.len())];
        bytes.splice(start..start + n, number.bytes());
    }
}

/// Runs `once` with so many mutators, and then for as long as `SINEW_FUZZ` says.
fn fuzz(n: u64, mut once: impl FnMut(&mut Mutator)) {
    (0..n).for_each(|seed| once(&mut Mutator(Random::new(seed))));
    let secs = std::env::var("SINEW_FUZZ").ok().and_then(|it| it.parse().ok()).unwrap_or(0);
    let (start, mut seed) = (Instant::now(), n);
    while start.elapsed() < Duration::from_secs(secs) {
        once(&mut Mutator(Random::new(seed)));
        seed += 1;
    }
    if secs > 0 {
        println!("{seed} inputs");
    }
}

// ---- artifacts --------------------------------------------------------------------------------------

#[derive(Default)]
struct Outputs(BTreeMap<&'static str, BTreeMap<u64, Digest>>);

impl Observer for Outputs {
    fn event(&mut self, graph: &Graph, event: &Event<'_>) {
        let Event::Finished { instance, outputs: Some(outputs), .. } = event else { return };
        for port in graph.instances[*instance].kind.spec.outputs {
            if let Some(info) = outputs.artifacts.get(port.name) {
                self.0.entry(port.ty.name).or_default().insert(info.bytes, info.digest);
            }
        }
    }
}

/// The smallest artifact of every type that the kinds' own examples make.
fn artifacts() -> BTreeMap<&'static str, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("tetrahedron.off"), OFF).unwrap();
    fs::write(folder.path().join("errors.csv"), ERRORS).unwrap();
    let store = Store::open(&folder.path().join("cache"), Access::ReadWrite).unwrap();
    let mut outputs = Outputs::default();
    for kind in LIBRARY.kinds {
        let all = LIBRARY.types.iter().all(|it| outputs.0.contains_key(it.ty.name));
        let is_new = kind.spec.outputs.iter().any(|it| !outputs.0.contains_key(it.ty.name));
        if all || !is_new {
            continue;
        }
        let file = folder.path().join("example.toml");
        fs::write(&file, kind.spec.example).unwrap();
        // Some examples need files that are not here; every type is checked for below.
        let Ok(graph) = pipeline::load(&file, &LIBRARY, &Settings::default()) else { continue };
        let options = RunOptions {
            threads: 2,
            surroundings: Surroundings { offline: true, ..Surroundings::default() },
            output_dir: folder.path().join("out"),
            run_id: "fuzz".to_owned(),
            ..RunOptions::default()
        };
        run::run(&graph, &LIBRARY, &store, &options, &mut outputs);
    }
    let read = |kind: &sinew::engine::artifact::ArtifactKind| {
        let (_, digest) = outputs.0.get(kind.ty.name)?.first_key_value()?;
        Some((kind.ty.name, store.object(kind.ty, digest).unwrap().to_vec()))
    };
    let mut res: BTreeMap<_, _> = LIBRARY.types.iter().filter_map(read).collect();
    // Only programs and scripts of the user make texts.
    let text = AnyArtifact::encode(Text("two\nlines\n".to_owned()));
    res.entry(text.0.ty().name).or_insert_with(|| text.1.to_vec());
    res
}

#[test]
fn mutated_artifacts_are_refused_or_read() {
    let samples = artifacts();
    for kind in LIBRARY.types {
        let bytes = samples.get(kind.ty.name).unwrap_or_else(|| panic!("no {}", kind.ty.name));
        let n_header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let n = (40_000_000 / (bytes.len() as u64 + 20_000)).min(400);
        fuzz(n, |mutator| {
            // Half of the time only the header, with its length put right.
            let mutated = if mutator.below(2) == 0 {
                let header = mutator.mutate(&bytes[8..n_header]);
                let length = (header.len() as u64).to_le_bytes();
                [&length[..], &header, &bytes[n_header..]].concat()
            } else {
                mutator.mutate(bytes)
            };
            let artifact = bounded(&mutated, kind.ty.name, || kind.decode(&mutated, None));
            if let Ok(artifact) = artifact {
                bounded(&mutated, kind.ty.name, || artifact.summary());
            }
        });
    }
}

// ---- files ------------------------------------------------------------------------------------------

const OFF: &str = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

/// What the examples of the kinds for tables read.
const ERRORS: &str = "method,shape,joints,error [%]\nours,horse,33,5.0\nours,fox,42,3.9\n\
    ours,woman,31,0.96\nnearest,horse,33,7.5\nnearest,fox,42,6.25\nnearest,woman,31,2.5\n";

/// A strip with two joints and a clip, in one file.
const GLTF: &str = r#"{ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
"nodes": [{ "mesh": 0, "skin": 0, "children": [1] }, { "children": [2] },
  { "translation": [0, 1, 0] }],
"meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3 },
  "indices": 1 }] }],
"skins": [{ "joints": [1, 2] }],
"animations": [{ "channels": [{ "sampler": 0, "target": { "node": 2, "path": "rotation" } }],
  "samplers": [{ "input": 4, "output": 5 }] }],
"buffers": [{ "byteLength": 148, "uri": "data:application/octet-stream;base64,DATA" }],
"bufferViews": [{ "buffer": 0, "byteOffset": 0, "byteLength": 36 },
  { "buffer": 0, "byteOffset": 36, "byteLength": 12 },
  { "buffer": 0, "byteOffset": 48, "byteLength": 12 },
  { "buffer": 0, "byteOffset": 60, "byteLength": 48 },
  { "buffer": 0, "byteOffset": 108, "byteLength": 8 },
  { "buffer": 0, "byteOffset": 116, "byteLength": 32 }],
"accessors": [
  { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0],
    "max": [1, 1, 0] },
  { "bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR" },
  { "bufferView": 2, "componentType": 5121, "count": 3, "type": "VEC4" },
  { "bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC4" },
  { "bufferView": 4, "componentType": 5126, "count": 2, "type": "SCALAR" },
  { "bufferView": 5, "componentType": 5126, "count": 2, "type": "VEC4" }] }"#;

fn gltf() -> String {
    let mut bytes = Vec::new();
    for it in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        bytes.extend(it.to_le_bytes());
    }
    [0u32, 1, 2].iter().for_each(|it| bytes.extend(it.to_le_bytes()));
    bytes.extend([0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0]);
    let weights = [0.5f32, 0.5, 0.0, 0.0].map(f32::to_le_bytes).concat();
    bytes.extend(weights.repeat(3));
    let clip = [0.0f32, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    clip.iter().for_each(|it| bytes.extend(it.to_le_bytes()));
    GLTF.replace("DATA", &base64(&bytes))
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut res = String::new();
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |word, &it| word << 8 | u32::from(it));
        let word = word << (8 * (3 - chunk.len()));
        for letter in 0..=chunk.len() {
            res.push(char::from(LETTERS[(word >> (18 - 6 * letter)) as usize & 63]));
        }
    }
    res
}

fn mesh_files() -> Vec<(&'static str, Vec<u8>)> {
    let mesh = read_character("off", OFF.as_bytes(), &|_| None, GltfOptions::default()).unwrap();
    let mesh = AnyArtifact::encode(mesh.mesh).0;
    let mut res = vec![
        ("off", OFF.as_bytes().to_vec()),
        ("gltf", gltf().into_bytes()),
        (
            "ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
              property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
              end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
                .to_vec(),
        ),
        (
            "stl",
            b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
              vertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
                .to_vec(),
        ),
    ];
    for extension in ["obj", "ply", "stl", "glb"] {
        res.push((extension, mesh.export(extension).unwrap()));
    }
    res
}

#[test]
fn mutated_mesh_files_are_refused_or_read() {
    for (extension, bytes) in mesh_files() {
        let read =
            |bytes: &[u8]| read_character(extension, bytes, &|_| None, GltfOptions::default());
        let whole = read(&bytes);
        assert!(whole.is_ok(), "{extension}: {:?}", whole.err());
        fuzz(1500, |mutator| {
            let mutated = mutator.mutate(&bytes);
            let _ = bounded(&mutated, extension, || read(&mutated));
        });
    }
}

#[test]
fn mutated_landmark_files_are_refused_or_read() {
    let json = br#"{"landmarks": {"head_top": {"vertex": 881}, "foot": {"vertex": 3}}}"#;
    for (extension, bytes) in [("json", &json[..]), ("csv", b"name,vertex\na,1\nb,2\n3\n")] {
        assert!(read_landmarks(bytes, extension, &[]).is_ok());
        fuzz(1500, |mutator| {
            let mutated = mutator.mutate(bytes);
            let _ = bounded(&mutated, extension, || read_landmarks(&mutated, extension, &[]));
        });
    }
}

#[test]
fn a_gltf_names_no_file_outside_of_its_folder() {
    for uri in
        ["../../etc/passwd", "/etc/passwd", "file:///etc/passwd", "a/%2e%2e/%2e%2e/b", "..%2Fb"]
    {
        let start = gltf().find("data:").unwrap();
        let end = start + gltf()[start..].find('"').unwrap();
        let text = format!("{}{uri}{}", &gltf()[..start], &gltf()[end..]);
        let asked = Cell::new(false);
        let side_file = |_: &str| {
            asked.set(true);
            Some(vec![0; 148])
        };
        let read = read_character("gltf", text.as_bytes(), &side_file, GltfOptions::default());
        let error = read.unwrap_err().to_string();
        assert!(error.contains("is no path below its folder"), "{uri}: {error}");
        assert!(!asked.get(), "{uri} is not even asked for");
        let names = sinew::kernels::io::gltf::external_buffers(text.as_bytes());
        assert!(names.is_empty(), "{uri}: {names:?}");
    }
}

// ---- pipelines ----------------------------------------------------------------------------------------

/// The pipelines of the repository and the examples of all kinds.
fn pipelines() -> Vec<String> {
    let mut res: Vec<String> = LIBRARY.kinds.iter().map(|it| it.spec.example.to_owned()).collect();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|it| it == "toml") {
                res.push(fs::read_to_string(&path).unwrap());
            }
        }
    }
    res.sort();
    res
}

const WORDS: [&str; 24] = [
    "[",
    "]",
    "[[",
    "{",
    "}",
    "=",
    "\"",
    "\"\"\"",
    "'",
    "@",
    "${",
    "}",
    "$",
    ".",
    "..",
    "#",
    "\n",
    "nodes",
    "inputs",
    "outputs",
    "params",
    "kind",
    "\u{feff}",
    "\u{202e}é",
];

/// Loading ends with a graph, or with mistakes that can be shown.
fn check_pipeline(text: &str, folder: &Path) {
    let load = || pipeline::load_text(text, folder.to_owned(), &LIBRARY, &Settings::default());
    if let Err(diagnostics) = bounded(text.as_bytes(), "pipeline", load) {
        assert!(!diagnostics.list.is_empty(), "refused without a reason:\n{text}");
        assert!(!diagnostics.render(false).is_empty());
        diagnostics.to_json();
    }
}

#[test]
fn mutated_pipelines_are_refused_with_reasons_or_read() {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let texts = pipelines();
    fuzz(1500, |mutator| {
        let text = &texts[mutator.below(texts.len())];
        let mutated = if mutator.below(2) == 0 {
            String::from_utf8_lossy(&mutator.mutate(text.as_bytes())).into_owned()
        } else {
            let mut words: Vec<&str> =
                text.split_inclusive(|it: char| !it.is_alphanumeric()).collect();
            for _ in 0..=mutator.below(4) {
                let (at, other) = (mutator.below(words.len()), mutator.below(words.len()));
                match mutator.below(4) {
                    0 => words[at] = WORDS[mutator.below(WORDS.len())],
                    1 => words.insert(at, WORDS[mutator.below(WORDS.len())]),
                    2 => words.swap(at, other),
                    _ => words[at] = words[other],
                }
            }
            words.concat()
        };
        check_pipeline(&mutated, &folder);
    });
}

#[test]
fn deeply_nested_pipelines_do_not_overflow_the_stack() {
    for (open, close) in [("[", "]"), ("{a=", "}"), ("a.", "a"), ("${", "}")] {
        for quote in ["", "\""] {
            let value = format!("{}{}", open.repeat(50_000), close.repeat(50_000));
            check_pipeline(&format!("[nodes.a]\nkind = {quote}{value}{quote}\n"), Path::new("."));
            check_pipeline(&format!("[params]\na = {quote}{value}{quote}\n"), Path::new("."));
        }
    }
    let nested = "[".repeat(50_000);
    let header = [&(nested.len() as u64).to_le_bytes()[..], nested.as_bytes()].concat();
    for kind in LIBRARY.types {
        assert!(kind.decode(&header, None).is_err());
    }
    assert!(read_character("gltf", nested.as_bytes(), &|_| None, GltfOptions::default()).is_err());
}
