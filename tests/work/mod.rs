//! A folder with a pipeline and a small mesh, in which the program is run.

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use crate::folder::Folder;

const TETRAHEDRON: &str =
    "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

/// A node that loads the mesh.
pub const BODY: &str = "[nodes.body]\nkind = \"load\"\npath = \"tetrahedron.off\"\n";

pub struct Work {
    folder: Folder,
    /// How the pipeline is run.
    arguments: Vec<&'static str>,
}

impl Work {
    /// `arguments` are those of `sinew run pipeline.toml`.
    pub fn new(pipeline: &str, arguments: &[&'static str]) -> Self {
        let folder = Folder::new(&[("tetrahedron.off", TETRAHEDRON), ("pipeline.toml", pipeline)]);
        Self { folder, arguments: [&["run", "pipeline.toml"], arguments].concat() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        self.folder.write(name, text);
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    pub fn sinew(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_sinew"))
            .args(arguments)
            .current_dir(self.path(""))
            .env("SINEW_CACHE", "cache")
            .env("SECRET", "of the user")
            .output()
            .unwrap()
    }

    /// Runs the pipeline; everything that is printed.
    pub fn run(&self) -> (Option<i32>, String) {
        let output = self.sinew(&self.arguments);
        let text = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(text).unwrap())
    }

    #[track_caller]
    pub fn succeed(&self) -> String {
        let (code, text) = self.run();
        assert_eq!(code, Some(0), "{text}");
        text
    }

    #[track_caller]
    pub fn fail(&self, code: i32, message: &str) -> String {
        let (found, text) = self.run();
        assert!(text.contains(message), "`{message}` is not in:\n{text}");
        assert_eq!(found, Some(code), "{text}");
        text
    }
}
