//! Graphs that were read before: a pipeline whose files have not changed is not read again.
//!
//! A graph of ten thousand nodes takes longer to read, to check and to expand than everything else that
//! a run does that has nothing to do. So it is kept beside the cache, one file a pipeline and profile
//! (`graphs/*.graph`), with all that it was made from. It is believed only if
//!
//! - its bytes have the digest that stands before them,
//! - this very program wrote it, for the same library, settings and current folder,
//! - every text leads to the same place and has the same bytes, every pattern finds the same files, and
//!   every node refers to the same files, all of which are there.
//!
//! In all other cases the pipeline is read as ever. What is kept is the graph alone: keys, results and
//! outputs are looked up in the same way whichever way it came.

mod bytes;
mod decode;
mod encode;

use std::{
    fs,
    path::{Path, PathBuf},
};

use self::bytes::{Reader, Writer};
use super::{
    digest::Digest,
    file_digests,
    graph::{Graph, Instance, Source},
    library::Library,
    pipeline::{self, Diagnostics, Settings},
    store::{Access, Store, StoreError, disk::Disk},
};

const MAGIC: &[u8; 8] = b"SINEWGR1";

/// The folder in that of the store.
pub const FOLDER: &str = "graphs";

/// Pipelines with fewer instances are read as fast as they would be found.
const WORTH_KEEPING: usize = 200;

/// What the command line puts beside the texts of files.
const SETTINGS: [&str; 3] = ["--set", "--only", "--limit"];

/// Reads a pipeline as [`pipeline::load`] does, or takes the graph that was kept.
///
/// # Errors
/// With everything that is wrong.
pub fn load(
    path: &Path,
    library: &Library,
    settings: &Settings,
    store: &Store,
) -> Result<Graph, Diagnostics> {
    if let Some(graph) = find(path, library, settings, store.disk(), store.dir()) {
        return Ok(graph);
    }
    let graph = pipeline::load(path, library, settings)?;
    keep(&graph, path, library, settings, store);
    Ok(graph)
}

/// Keeps a graph that was read and not found, if that is worth it. Trouble with it harms nobody.
pub fn keep(graph: &Graph, path: &Path, library: &Library, settings: &Settings, store: &Store) {
    if graph.looks.is_none() || graph.instances.node_count() < WORTH_KEEPING {
        return;
    }
    if let Err(error) = write(graph, path, library, settings, store) {
        tracing::debug!(%error, "a graph is not kept");
    }
}

/// Writes the file of a graph.
///
/// # Errors
/// If the disk refuses.
pub fn write(
    graph: &Graph,
    path: &Path,
    library: &Library,
    settings: &Settings,
    store: &Store,
) -> Result<(), StoreError> {
    if store.access() == Access::ReadOnly {
        return Ok(());
    }
    let Some(about) = about(path, library, settings) else { return Ok(()) };
    let mut writer = Writer::default();
    writer.digest(&about);
    let written =
        write_sources(graph, &mut writer).and_then(|()| encode::write(graph, &mut writer));
    if written.is_none() {
        return Ok(());
    }
    let body = writer.finish();
    let bytes = [&MAGIC[..], &Digest::of(&body).0, &body].concat();
    store.write_beside(&place(path, settings), &bytes)
}

/// The graph that was kept of a pipeline in the folder of a store, if it is still what reading would give.
pub fn find(
    path: &Path,
    library: &Library,
    settings: &Settings,
    disk: &Disk,
    store: &Path,
) -> Option<Graph> {
    let bytes = disk.read_whole(&store.join(place(path, settings))).ok()?;
    let (digest, body) = bytes.strip_prefix(MAGIC)?.split_first_chunk::<32>()?;
    let mut reader = Reader::new(body)?;
    let is_about_this = reader.digest()? == about(path, library, settings)?;
    if !is_about_this || Digest::of(body) != Digest(*digest) {
        return None;
    }
    let sources = read_sources(&mut reader)?;
    let graph = decode::read(&mut reader, library).filter(|_| reader.is_at_end())?;
    let are_there = graph.instances.node_weights().all(has_same_files);
    are_there.then_some(Graph { sources, ..graph })
}

/// Where a graph is kept, below the folder of the store.
fn place(path: &Path, settings: &Settings) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut hasher = blake3::Hasher::new();
    hasher.update(path.as_os_str().as_encoded_bytes());
    hasher.update(&[0]);
    hasher.update(settings.profile.as_deref().unwrap_or_default().as_bytes());
    let name = Digest(*hasher.finalize().as_bytes()).to_string();
    Path::new(FOLDER).join(format!("{}.graph", &name[..32]))
}

/// Everything but the disk that a graph depends on: the program, its kinds, and what it was asked.
fn about(path: &Path, library: &Library, settings: &Settings) -> Option<Digest> {
    // The file that runs, even if another one has taken its place by now.
    let program = Path::new("/proc/self/exe");
    let program = file_digests::identity(program, &fs::metadata(program).ok()?);
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes()).update(&program.0);
    let mut text = |it: &[u8]| {
        hasher.update(&(it.len() as u64).to_le_bytes()).update(it);
    };
    library.kinds.iter().for_each(|it| text(it.spec.kind.as_bytes()));
    text(std::env::current_dir().ok()?.as_os_str().as_encoded_bytes());
    text(path.as_os_str().as_encoded_bytes());
    text(format!("{settings:?}").as_bytes());
    Some(Digest(*hasher.finalize().as_bytes()))
}

/// `None` if it is not known where the graph comes from.
fn write_sources(graph: &Graph, to: &mut Writer) -> Option<()> {
    let looks = graph.looks.as_ref()?;
    to.number(graph.sources.len());
    for (index, source) in graph.sources.iter().enumerate() {
        encode::write_path(&source.path, to)?;
        let is_file = looks.texts.iter().any(|it| it.2 == index);
        to.flag(is_file);
        if is_file {
            to.digest(&Digest::of(source.text.as_bytes()));
        } else if SETTINGS.iter().any(|it| source.path.as_os_str() == *it) {
            to.text(&source.text);
        } else {
            return None;
        }
    }
    to.number(looks.texts.len());
    for (path, real_path, _) in &looks.texts {
        encode::write_path(path, to)?;
        encode::write_path(real_path, to)?;
    }
    to.number(looks.listings.len());
    for (pattern, found) in &looks.listings {
        to.text(pattern);
        to.digest(found);
    }
    Some(())
}

/// The sources of now; `None` if anything else is found than was then.
fn read_sources(from: &mut Reader<'_>) -> Option<Vec<Source>> {
    let mut sources = Vec::new();
    for _ in 0..from.count()? {
        let path = PathBuf::from(from.text()?);
        let text = match from.flag()? {
            true => {
                let expected = from.digest()?;
                let text = fs::read_to_string(&path).ok()?;
                (Digest::of(text.as_bytes()) == expected).then_some(text)?
            }
            false => from.text()?.to_owned(),
        };
        sources.push(Source { path, text: text.into() });
    }
    for _ in 0..from.count()? {
        let real_path = PathBuf::from(from.text()?).canonicalize().ok()?;
        if real_path.to_str()? != from.text()? {
            return None;
        }
    }
    for _ in 0..from.count()? {
        let found = pipeline::listing(from.text()?)?;
        if found != from.digest()? {
            return None;
        }
    }
    Some(sources)
}

/// Whether an instance still refers to the files that it did, and all of them are there.
fn has_same_files(instance: &Instance) -> bool {
    if instance.files.is_empty() {
        return true;
    }
    let mut found = Vec::new();
    for (_, file) in instance.node.files() {
        found.extend(instance.node.side_files(&file.0));
        found.push(file.0.clone());
    }
    found.sort();
    found.dedup();
    found.iter().eq(instance.files.keys()) && found.iter().all(|it| it.is_file())
}
