//! Kind `load_motion`.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{InputFile, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::io::bvh::{Motion, read_bvh};
use crate::kernels::{
    files::FileSet,
    geometry::mesh::Vec3,
    rigs::{clip::Clip, skeleton::Skeleton},
};

/// Reads a motion from a motion capture file (`.bvh`).
///
/// Either `path` names the file, or `file` is wired to a download of one file.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadMotion {
    /// The file, relative to the pipeline file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<InputFile>,
    /// A factor on all lengths: 0.056444 for files of CMU in metres.
    #[serde(default = "one")]
    #[schemars(range(min = 1e-9, max = 1e9))]
    pub scale: f64,
    /// Which axis points up in the file; turned to y.
    #[serde(default)]
    pub up: Up,
    /// Other names for joints: `{ LeftHip = "LeftUpLeg" }`.
    #[serde(default)]
    pub rename: BTreeMap<String, String>,
}

/// Which axis points up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Up {
    #[default]
    Y,
    /// What pointed up is turned about the x axis, so that -y becomes +z.
    Z,
}

fn one() -> f64 {
    1.0
}

impl LoadMotion {
    const FILE: OptionalInput<FileSet> =
        OptionalInput::new("file", "a downloaded file, instead of `path`");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the joints, as the offsets say");
    const CLIP: Output<Clip> = Output::new("clip", "their motion");

    fn bytes(&self, io: &NodeIo<'_>) -> Result<Vec<u8>, NodeError> {
        match (&self.path, io.get_optional(Self::FILE)) {
            (Some(path), None) => Ok(io.read(&path.0)?),
            (None, Some(files)) => match files.files.values().collect::<Vec<_>>()[..] {
                [bytes] => Ok(bytes.clone()),
                ref all => {
                    Err(NodeError::failed(format!("{} files are wired, not one", all.len())))
                }
            },
            _ => Err(NodeError::failed("give either the parameter `path` or the wire `file`")),
        }
    }

    fn renamed(&self, skeleton: &Skeleton) -> Result<Skeleton, NodeError> {
        if let Some(name) = self.rename.keys().find(|it| skeleton.joint(it).is_none()) {
            let known = skeleton.names().join(", ");
            return Err(NodeError::failed(format!(
                "there is no joint `{name}`; there are {known}"
            )));
        }
        let name = |it: &String| self.rename.get(it).unwrap_or(it).clone();
        let names = skeleton.names().iter().map(name).collect();
        let (parents, positions) = (skeleton.parents().to_vec(), skeleton.positions().to_vec());
        Ok(Skeleton::new(names, parents, positions)?)
    }
}

impl Node for LoadMotion {
    const SPEC: Spec = Spec {
        kind: "load_motion",
        version: 1,
        inputs: &[Self::FILE.port()],
        outputs: &[Self::SKELETON.port(), Self::CLIP.port()],
        cites: &[],
        example: r#"[nodes.motion]
kind = "load_motion"
path = "nod.bvh"
scale = 0.01
rename = { Head = "head" }
"#,
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        self.path.iter().map(|it| ("path", it)).collect()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let Motion { mut skeleton, mut clip } = read_bvh(&self.bytes(io)?, self.scale)?;
        if self.up == Up::Z {
            let turn = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), -FRAC_PI_2);
            let places = skeleton.positions().iter().map(|it| turn * it).collect();
            skeleton = skeleton.with_positions(places)?;
            clip = clip.turned(&turn);
        }
        io.put(Self::SKELETON, self.renamed(&skeleton)?);
        io.put(Self::CLIP, clip);
        Ok(())
    }
}
