//! The folder of one run of a program: `in/`, `out/`, `files/`, `tmp/`.
//!
//! The program gets paths relative to it, which are the same in every run.

use std::{
    collections::BTreeMap,
    ffi::OsString,
    fs::{self, File},
    io,
    os::unix::fs::PermissionsExt,
    path::{Component, Path, PathBuf},
    process::Stdio,
};

use tempfile::TempDir;

use crate::artifacts;
use crate::engine::artifact::{AnyArtifact, Artifact};
use crate::engine::library;
use crate::engine::node::{InputFile, NodeError, NodeIo};
use crate::engine::program;
use crate::kernels::files::FileSet;

use super::template::{self, Part, Slot};

/// The folder; it is removed with all that is in it.
pub struct Folder {
    dir: TempDir,
}

impl Folder {
    pub fn new() -> Result<Self, NodeError> {
        let dir = tempfile::Builder::new().prefix("sinew-").tempdir().map_err(|e| {
            let parent = std::env::temp_dir();
            NodeError::environment(format!("cannot make a folder in `{}`: {e}", parent.display()))
        })?;
        let res = Self { dir };
        for name in ["in", "out", "files", "tmp"] {
            res.make_folder(&res.path().join(name))?;
        }
        Ok(res)
    }

    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    /// Where the program may put files of its own.
    pub fn temporary(&self) -> PathBuf {
        self.path().join("tmp")
    }

    /// Copies the declared files: a program that writes into one changes only its copy.
    pub fn write_files(
        &self,
        io: &NodeIo<'_>,
        files: &BTreeMap<String, InputFile>,
    ) -> Result<(), NodeError> {
        for (name, file) in files {
            let (from, to) = (io.path(&file.0), self.path().join(file_path(name, file)));
            fs::copy(from, to).map_err(|e| {
                NodeError::environment(format!("cannot copy `{}`: {e}", from.display()))
            })?;
        }
        Ok(())
    }

    /// Writes an input in the format of its slot, and makes the folder of an output that is one.
    pub fn prepare(&self, io: &NodeIo<'_>, slot: &Slot) -> Result<(), NodeError> {
        match slot {
            Slot::Input { port, extension } => {
                for (artifact, path) in artifacts_at(io, port).zip(paths(io, slot)) {
                    self.write_input(io, artifact, &path, extension)?;
                }
                Ok(())
            }
            Slot::Output { port, extension } if extension.is_empty() => {
                self.make_folder(&self.path().join(output_path(port, extension)))
            }
            Slot::Output { .. } | Slot::File { .. } => Ok(()),
        }
    }

    fn write_input(
        &self,
        io: &NodeIo<'_>,
        artifact: &AnyArtifact,
        path: &str,
        extension: &str,
    ) -> Result<(), NodeError> {
        let path = self.path().join(path);
        if let Some(files) = artifact.downcast::<FileSet>().filter(|_| extension.is_empty()) {
            return self.write_file_set(&files, &path);
        }
        let folder = path.parent().expect("it lies in a folder of ours");
        self.make_folder(folder)?;
        if let Some(stored) = io.stored_file(artifact).filter(|_| extension == "safetensors")
            && fs::copy(stored, &path).is_ok()
        {
            // Stored files are read-only for others; this one is the program's own.
            let own = fs::Permissions::from_mode(0o644);
            return fs::set_permissions(&path, own).map_err(|e| cannot_write(&path, &e));
        }
        let bytes = library::export(artifacts::COMMON_FORMATS, artifact, extension)
            .map_err(NodeError::failed)?;
        fs::write(&path, bytes).map_err(|e| cannot_write(&path, &e))
    }

    fn write_file_set(&self, files: &FileSet, to: &Path) -> Result<(), NodeError> {
        self.make_folder(to)?;
        for (name, bytes) in &files.files {
            let is_inside = |it: Component<'_>| matches!(it, Component::Normal(_));
            if name.is_empty() || !Path::new(name).components().all(is_inside) {
                return Err(NodeError::failed(format!("the file `{name}` leaves its folder")));
            }
            let path = to.join(name);
            self.make_folder(path.parent().expect("it lies in a folder of ours"))?;
            fs::write(&path, bytes).map_err(|e| cannot_write(&path, &e))?;
        }
        Ok(())
    }

    fn make_folder(&self, path: &Path) -> Result<(), NodeError> {
        fs::create_dir_all(path).map_err(|e| cannot_write(path, &e))
    }

    /// The texts that stand for one text with slots: one, or as many as a list has items.
    pub fn filled_in(
        &self,
        io: &NodeIo<'_>,
        text: &str,
        files: &BTreeMap<String, InputFile>,
    ) -> Vec<String> {
        let parts = template::parse(text).expect("checked by `validate`");
        let of_slot = |slot: &Slot| match slot {
            Slot::File { name } => vec![file_path(name, &files[name])],
            _ => paths(io, slot),
        };
        if let [Part::Slot(slot)] = &parts[..] {
            return of_slot(slot);
        }
        let texts = parts.iter().map(|it| match it {
            Part::Plain(text) => text.clone(),
            Part::Slot(slot) => of_slot(slot).join(" "),
        });
        vec![texts.collect()]
    }

    /// The path of the program: one of the declared files, or what `PATH` has.
    pub fn program(
        &self,
        name: &str,
        environment: &BTreeMap<String, OsString>,
    ) -> Result<PathBuf, NodeError> {
        if !name.contains('/') || name.starts_with('/') {
            return program::find(name, environment).map_err(NodeError::environment);
        }
        let path = self.path().join(name);
        let mode = fs::metadata(&path).map(|it| it.permissions().mode());
        match mode {
            Ok(mode) if mode & 0o111 == 0 => Err(NodeError::failed(format!(
                "`{name}` cannot be run: its file is not executable (`chmod +x`)"
            ))),
            Ok(_) => Ok(path),
            Err(error) => Err(NodeError::failed(format!("`{name}` cannot be run: {error}"))),
        }
    }

    /// A file to read from.
    pub fn open(&self, path: &str) -> Result<Stdio, NodeError> {
        let path = self.path().join(path);
        File::open(&path)
            .map(Stdio::from)
            .map_err(|e| NodeError::environment(format!("cannot read `{}`: {e}", path.display())))
    }

    /// A file to write to.
    pub fn create(&self, path: &str) -> Result<Stdio, NodeError> {
        let path = self.path().join(path);
        File::create(&path).map(Stdio::from).map_err(|e| cannot_write(&path, &e))
    }

    /// Reads what the program left for an output.
    pub fn collect(&self, io: &mut NodeIo<'_>, slot: &Slot) -> Result<(), String> {
        let Slot::Output { port, extension } = slot else { return Ok(()) };
        let port = io.outputs().iter().find(|it| it.name == port).expect("checked by `validate`");
        let shown = output_path(port.name, extension);
        let path = self.inside(&shown).map_err(|what| {
            let left = self.left();
            format!("output `{}`: `{shown}` {what}; the program left {left}", port.name)
        })?;
        let fail = |message: String| {
            format!("output `{}`: `{shown}` is no `{}`: {message}", port.name, port.ty.name)
        };
        if extension.is_empty() {
            let files = read_file_set(&path).map_err(fail)?;
            io.put_any(port.name, AnyArtifact::encode(files));
            return Ok(());
        }
        let bytes = fs::read(&path).map_err(|e| fail(format!("it cannot be read: {e}")))?;
        let kind = artifacts::kind(port.ty.name).expect("checked types are registered");
        let artifact = artifacts::import(kind, extension, bytes.into()).map_err(fail)?;
        io.put_any(port.name, artifact);
        Ok(())
    }

    /// The real path of something that the program wrote; an error if it is not there, or a link
    /// leads somewhere else.
    fn inside(&self, path: &str) -> Result<PathBuf, String> {
        let full = self.path().join(path);
        let is_link = |it: &Path| fs::symlink_metadata(it).is_ok_and(|it| it.is_symlink());
        let mut links = full.ancestors().take_while(|it| *it != self.path());
        if links.any(is_link) {
            return Err("is or lies behind a symbolic link, and outputs must not".to_owned());
        }
        match fs::symlink_metadata(&full) {
            Ok(meta) if meta.is_file() || meta.is_dir() => {
                let wants_folder = !path.contains('.');
                match (meta.is_dir(), wants_folder) {
                    (true, false) => Err("is a folder, not a file".to_owned()),
                    (false, true) => Err("is a file, not a folder".to_owned()),
                    _ => Ok(full),
                }
            }
            Ok(_) => Err("is no ordinary file".to_owned()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Err("is not there".to_owned()),
            Err(error) => Err(format!("cannot be read: {error}")),
        }
    }

    /// What is in `out/`, for a message.
    fn left(&self) -> String {
        let list = fs::read_dir(self.path().join("out")).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            list.map(|it| format!("`out/{}`", it.file_name().to_string_lossy())).collect();
        names.sort_unstable();
        if names.is_empty() { "nothing in `out/`".to_owned() } else { names.join(", ") }
    }
}

/// Whether a type can be written for a program with this extension; otherwise what can be done.
///
/// # Errors
/// With the rest of a sentence.
pub fn check_export(ty: &str, extension: &str) -> Result<(), String> {
    let is_folder = ty == FileSet::TYPE.name;
    if is_folder && extension.is_empty() {
        return Ok(());
    }
    let own = artifacts::kind(ty).map_or(&[][..], |it| it.formats);
    let formats = own.iter().chain(artifacts::COMMON_FORMATS.iter().map(|it| &it.format));
    let known: Vec<String> = formats.map(|it| it.extension.to_owned()).collect();
    check_extension(ty, "is written", extension, &known, is_folder)
}

/// Whether a type can be read from a program's file with this extension; otherwise what can be done.
///
/// # Errors
/// With the rest of a sentence.
pub fn check_import(ty: &str, extension: &str) -> Result<(), String> {
    let is_folder = ty == FileSet::TYPE.name;
    if is_folder && extension.is_empty() {
        return Ok(());
    }
    let own = artifacts::kind(ty).map_or(&[][..], |it| it.imports);
    let known: Vec<String> =
        own.iter().chain(&artifacts::COMMON_IMPORTS).map(|&it| it.to_owned()).collect();
    check_extension(ty, "is read", extension, &known, is_folder)
}

fn check_extension(
    ty: &str,
    verb: &str,
    extension: &str,
    known: &[String],
    is_folder: bool,
) -> Result<(), String> {
    if known.iter().any(|it| it == extension) {
        return Ok(());
    }
    let list: Vec<String> = known.iter().map(|it| format!("`.{it}`")).collect();
    let folder = if is_folder { " or as a folder, without extension" } else { "" };
    Err(format!("`{ty}` {verb} as {}{folder}", list.join(", ")))
}

fn artifacts_at<'a>(io: &'a NodeIo<'_>, port: &str) -> impl Iterator<Item = &'a AnyArtifact> {
    let list = io.inputs().find(|it| it.0.name == port);
    list.into_iter().flat_map(|it| it.1).flatten()
}

/// The paths that a slot stands for.
fn paths(io: &NodeIo<'_>, slot: &Slot) -> Vec<String> {
    match slot {
        Slot::Input { port, extension } => {
            let end = dotted(extension);
            let is_list = io.inputs().any(|it| it.0.name == *port && it.0.arity.takes_list());
            match is_list {
                false => vec![format!("in/{port}{end}")],
                true => {
                    let n = artifacts_at(io, port).count();
                    (0..n).map(|it| format!("in/{port}/{it}{end}")).collect()
                }
            }
        }
        Slot::Output { port, extension } => vec![output_path(port, extension)],
        Slot::File { name } => vec![format!("files/{name}")],
    }
}

fn output_path(port: &str, extension: &str) -> String {
    format!("out/{port}{}", dotted(extension))
}

fn file_path(name: &str, file: &InputFile) -> String {
    // Nothing that a shell would take apart.
    let extension = file.extension();
    let is_plain = extension.chars().all(|it| it.is_ascii_alphanumeric());
    format!("files/{name}{}", if is_plain { dotted(&extension) } else { String::new() })
}

fn dotted(extension: &str) -> String {
    if extension.is_empty() { String::new() } else { format!(".{extension}") }
}

fn cannot_write(path: &Path, error: &io::Error) -> NodeError {
    NodeError::environment(format!("cannot write `{}`: {error}", path.display()))
}

/// All files below a folder.
fn read_file_set(root: &Path) -> Result<FileSet, String> {
    let mut res = FileSet::default();
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).map_err(|e| e.to_string())? {
            let path = entry.map_err(|e| e.to_string())?.path();
            let inside = path.strip_prefix(root).expect("it lies in the folder");
            let name = inside
                .to_str()
                .ok_or_else(|| format!("the name of `{}` is no UTF-8", inside.to_string_lossy()))?;
            let meta = fs::symlink_metadata(&path).map_err(|e| format!("`{name}`: {e}"))?;
            if meta.is_dir() {
                open.push(path);
            } else if meta.is_file() {
                let bytes = fs::read(&path).map_err(|e| format!("`{name}`: {e}"))?;
                res.files.insert(name.to_owned(), bytes);
            } else {
                return Err(format!("`{name}` is a link or no ordinary file"));
            }
        }
    }
    Ok(res)
}
