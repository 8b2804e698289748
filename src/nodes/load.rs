//! Kind `load`.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    InputFile, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec, extension_of,
};
use crate::kernels::{
    files::FileSet,
    geometry::mesh::TriMesh,
    io::{
        character::{Character, CoreJoints},
        gltf::{GltfOptions, RestPose, external_buffers},
        read::{EXTENSIONS, read_character},
    },
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// Reads a mesh from a file, and its skeleton, weights and a clip where the file has them.
///
/// Formats: obj, off (ASCII), ply and stl (ASCII and binary), glb and gltf. Vertices keep their order
/// and number, but for the joining of corners that stl and `weld` do. Polygons are cut into fans.
/// An obj, off or ply file without faces is a point cloud, and so is an xyz file (a point a line).
/// Either `path` names the file, or `file` is wired to a download.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// The file, relative to the pipeline file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<InputFile>,
    /// Which of several wired files is read, by its path in the set.
    #[serde(default)]
    pub entry: Option<String>,
    /// glTF: whether vertices that coincide exactly are joined, which closes the seams that normals
    /// and texture coordinates cut into a surface. Their weights are averaged.
    #[serde(default = "yes")]
    pub weld: bool,
    /// glTF: which joints are kept.
    #[serde(default)]
    pub joints: Joints,
    /// glTF: which pose is the rest pose.
    #[serde(default)]
    pub rest: Rest,
    /// glTF: the clip that is read, by its name or what follows the last `|` in it; the first if it is
    /// not given.
    #[serde(default)]
    pub clip: Option<String>,
    /// glTF: the rate at which the clip is sampled, in frames a second.
    #[serde(default = "default_rate")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub frames_per_second: f64,
}

/// Which joints of a rig are kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Joints {
    /// All joints of the file's skins.
    #[default]
    All,
    /// One tree of the joints that move the mesh: control bones are dropped, what hangs on them is
    /// hung on the nearest joint, and the weight of what is dropped goes there too.
    Core,
    /// As `core`, and the tree starts below a root that moves nothing and has a single child: such roots
    /// stand on the floor, outside of the body.
    Deforming,
    /// As `deforming`, and handles beside the tree that carry weight of their own stay, with what hangs on them:
    /// in rigs with inverse kinematics they are ankles.
    Skinned,
}

/// Which pose is the rest pose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rest {
    /// As the file's scene stands before any clip plays.
    #[default]
    Scene,
    /// As the skin was bound to the joints.
    Bind,
}

fn yes() -> bool {
    true
}

fn default_rate() -> f64 {
    30.0
}

impl Load {
    const FILE: OptionalInput<FileSet> =
        OptionalInput::new("file", "downloaded files, instead of `path`");
    const MESH: Output<TriMesh> = Output::new("mesh", "the mesh in rest pose, in the file's unit");
    const SKELETON: OptionalOutput<Skeleton> =
        OptionalOutput::new("skeleton", "the joints in rest pose");
    const WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "how the joints move the mesh");
    const CLIP: OptionalOutput<Clip> = OptionalOutput::new("clip", "one motion of the joints");

    fn options(&self) -> GltfOptions {
        let rest = match self.rest {
            Rest::Scene => RestPose::Scene,
            Rest::Bind => RestPose::Bind,
        };
        GltfOptions { weld: self.weld, rest, frames_per_second: self.frames_per_second }
    }

    /// The file's name and what it holds.
    fn read(&self, io: &NodeIo<'_>) -> Result<(String, Character), NodeError> {
        let options = self.options();
        let read = |name: &str, bytes: &[u8], side: &dyn Fn(&str) -> Option<Vec<u8>>| {
            let extension = extension_of(Path::new(name));
            let character = read_character(&extension, bytes, side, options)
                .map_err(|e| NodeError::failed(format!("`{name}`: {e}")))?;
            Ok((name.to_owned(), character))
        };
        match (&self.path, io.get_optional(Self::FILE)) {
            (Some(InputFile(path)), None) => {
                let bytes = io.read(path)?;
                let side_file = |name: &str| io.read(&io.path(path).with_file_name(name)).ok();
                read(&path.to_string_lossy(), &bytes, &side_file)
            }
            (None, Some(files)) => {
                let name = self.chosen(&files)?;
                let folder = name.rfind('/').map_or("", |it| &name[..=it]);
                let side_file = |it: &str| files.files.get(&format!("{folder}{it}")).cloned();
                read(name, &files.files[name], &side_file)
            }
            _ => Err(NodeError::failed("give either the parameter `path` or the wire `file`")),
        }
    }

    /// The wired file that is read.
    fn chosen<'a>(&self, files: &'a FileSet) -> Result<&'a str, NodeError> {
        let listed = || {
            let names = files.files.keys().take(8).map(|it| format!("`{it}`"));
            names.collect::<Vec<_>>().join(", ")
        };
        let readable = |it: &&String| EXTENSIONS.contains(&extension_of(Path::new(it)).as_str());
        match &self.entry {
            Some(entry) => {
                files.files.get_key_value(entry).map(|it| it.0.as_str()).ok_or_else(|| {
                    NodeError::failed(format!(
                        "there is no `{entry}` among the wired files: {}",
                        listed()
                    ))
                })
            }
            None => match files.files.keys().filter(readable).collect::<Vec<_>>()[..] {
                [name] => Ok(name),
                ref names => Err(NodeError::failed(format!(
                    "{} of the wired files can be read ({}); choose one with `entry`",
                    names.len(),
                    listed()
                ))),
            },
        }
    }

    fn chosen_clip(&self, clips: &[Clip]) -> Result<Option<Clip>, NodeError> {
        let Some(name) = &self.clip else { return Ok(clips.first().cloned()) };
        // Exporters put the name of the armature before that of the clip: `Armature|Walk`.
        let short = |it: &Clip| it.name.rsplit('|').next() == Some(name.as_str());
        let exact = clips.iter().find(|it| it.name == *name);
        let found = exact.or_else(|| clips.iter().find(|it| short(it))).cloned();
        if found.is_none() {
            let names: Vec<String> = clips.iter().map(|it| format!("`{}`", it.name)).collect();
            let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            return Err(NodeError::failed(format!(
                "there is no clip `{name}`; the file has {known}"
            )));
        }
        Ok(found)
    }
}

impl Node for Load {
    const SPEC: Spec = Spec {
        kind: "load",
        version: 1,
        inputs: &[Self::FILE.port()],
        outputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
        ],
        cites: &[],
        example: "[nodes.shape]\nkind = \"load\"\npath = \"tetrahedron.off\"\n",
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        self.path.iter().map(|it| ("path", it)).collect()
    }

    fn side_files(&self, path: &Path) -> Vec<PathBuf> {
        if extension_of(path) != "gltf" {
            return Vec::new();
        }
        let bytes = std::fs::read(path).unwrap_or_default();
        external_buffers(&bytes).into_iter().map(|it| path.with_file_name(it)).collect()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (name, mut character) = self.read(io)?;
        match self.joints {
            Joints::All => {}
            Joints::Core => character.keep_core_joints(CoreJoints::default()),
            Joints::Deforming => character.keep_core_joints(CoreJoints::DEFORMING),
            Joints::Skinned => character.keep_core_joints(CoreJoints::SKINNED),
        }
        let clip = self.chosen_clip(&character.clips)?;
        for note in character.notes {
            io.note(format!("`{name}`: {note}"));
        }
        let no_skin = format!("`{name}` has no skin");
        io.put(Self::MESH, character.mesh);
        io.put_optional(Self::SKELETON, character.skeleton, &no_skin);
        io.put_optional(Self::WEIGHTS, character.weights, &no_skin);
        io.put_optional(Self::CLIP, clip, &format!("`{name}` has no clip of a skin"));
        Ok(())
    }
}
