//! Kind `load_skeleton`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{InputFile, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::io::skeleton_file::read_skeleton;
use crate::kernels::rigs::skeleton::Skeleton;

/// Reads joints from a file that has no mesh: ground truth, or the result of another program.
///
/// Formats: `.json` with a list of joints, each `{"name": "knee", "parent": "hip", "position": [0, 0.5,
/// 0]}` (a root's parent is null), others with a line `name,parent,x,y,z` a joint.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadSkeleton {
    /// The file, relative to the pipeline file.
    pub path: InputFile,
    /// JSON: the key of the list of joints.
    #[serde(default = "default_list")]
    pub list: String,
}

fn default_list() -> String {
    "joints".to_owned()
}

impl LoadSkeleton {
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the joints, parents first");
}

impl Node for LoadSkeleton {
    const SPEC: Spec = Spec {
        kind: "load_skeleton",
        version: 1,
        inputs: &[],
        outputs: &[Self::SKELETON.port()],
        cites: &[],
        example: "[nodes.truth]\nkind = \"load_skeleton\"\npath = \"joints.csv\"\n",
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        vec![("path", &self.path)]
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let bytes = io.read(&self.path.0)?;
        io.put(Self::SKELETON, read_skeleton(&bytes, &self.path.extension(), &self.list)?);
        Ok(())
    }
}
