//! Kind `landmarks`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{InputFile, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::maps::landmark_files::read_landmarks;
use crate::kernels::maps::rig_landmarks::{LandmarkPick, PickDirection, rig_landmarks};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;

/// A direction in which the farthest vertex is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum Direction {
    /// From the joint's parent to the joint: the tip of a limb.
    #[default]
    #[serde(rename = "bone")]
    Bone,
    /// Along x.
    #[serde(rename = "+x")]
    PlusX,
    /// Against x.
    #[serde(rename = "-x")]
    MinusX,
    /// Along y.
    #[serde(rename = "+y")]
    PlusY,
    /// Against y.
    #[serde(rename = "-y")]
    MinusY,
    /// Along z.
    #[serde(rename = "+z")]
    PlusZ,
    /// Against z.
    #[serde(rename = "-z")]
    MinusZ,
}

/// One landmark of a rig: of the vertices that a joint moves the most, the farthest in a direction.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Pick {
    /// The landmark's name, the same on both shapes.
    pub name: String,
    /// The joint whose vertices are searched.
    pub joint: String,
    /// Where the farthest vertex is looked for.
    #[serde(default)]
    pub direction: Direction,
    /// Search what the joint's descendants move as well. Turn it off for the chest.
    #[serde(default = "yes")]
    pub with_descendants: bool,
}

fn yes() -> bool {
    true
}

/// Reads landmarks from a file, or picks them on a rigged mesh by the names of its joints.
///
/// Give either `file` or `picks`. Landmarks of a source and a target need the same names in the same
/// order; five protrusions, front and back serve for people, the same and a nose and a tail tip for
/// quadrupeds.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LandmarksNode {
    /// A file: `.json` with `{"landmarks": {"head_top": {"vertex": 881}}}`, others with a line
    /// `name,vertex` or `vertex` a landmark. Vertices count from zero.
    pub file: Option<InputFile>,
    /// With `file`: which landmarks to take, in this order; empty for all.
    pub names: Vec<String>,
    /// The landmarks to pick; needs the inputs `mesh`, `skeleton` and `weights`.
    pub picks: Vec<Pick>,
}

impl LandmarksNode {
    const MESH: OptionalInput<TriMesh> = OptionalInput::new("mesh", "the mesh");
    const SKELETON: OptionalInput<Skeleton> = OptionalInput::new("skeleton", "its joints");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: Output<Landmarks> = Output::new("landmarks", "named vertices");

    fn pick(&self, io: &NodeIo<'_>) -> Result<Landmarks, NodeError> {
        let mesh = io.get_optional(Self::MESH);
        let (skeleton, weights) = (io.get_optional(Self::SKELETON), io.get_optional(Self::WEIGHTS));
        let (Some(mesh), Some(skeleton), Some(weights)) = (mesh, skeleton, weights) else {
            return Err(NodeError::failed(
                "`picks` need the inputs `mesh`, `skeleton` and `weights`",
            ));
        };
        let picks: Vec<LandmarkPick> = self.picks.iter().map(kernel_pick).collect();
        Ok(rig_landmarks(&mesh, &skeleton, &weights, &picks)?)
    }
}

impl Node for LandmarksNode {
    const SPEC: Spec = Spec {
        kind: "landmarks",
        version: 1,
        inputs: &[Self::MESH.port(), Self::SKELETON.port(), Self::WEIGHTS.port()],
        outputs: &[Self::LANDMARKS.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.tips]
kind = "landmarks"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
picks = [{ name = "head_top", joint = "head" }]
"#,
    };

    fn validate(&self) -> Result<(), String> {
        match (&self.file, self.picks.is_empty()) {
            (None, true) => Err("one of `file` and `picks` is needed".to_owned()),
            (Some(_), false) => Err("`file` and `picks` exclude each other".to_owned()),
            (None, false) if !self.names.is_empty() => {
                Err("`names` select from a `file`; `picks` have names of their own".to_owned())
            }
            _ => Ok(()),
        }
    }

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        self.file.iter().map(|it| ("file", it)).collect()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let landmarks = match &self.file {
            Some(file) => read_landmarks(&io.read(&file.0)?, &file.extension(), &self.names)?,
            None => self.pick(io)?,
        };
        if let Some(mesh) = io.get_optional(Self::MESH) {
            let n_vertices = mesh.n_vertices();
            let mut pairs = landmarks.names.iter().zip(&landmarks.vertices);
            if let Some((name, vertex)) = pairs.find(|it| *it.1 as usize >= n_vertices) {
                return Err(NodeError::failed(format!(
                    "landmark `{name}` is vertex {vertex}, but the mesh has {n_vertices} vertices"
                )));
            }
        }
        io.put(Self::LANDMARKS, landmarks);
        Ok(())
    }
}

fn kernel_pick(pick: &Pick) -> LandmarkPick {
    let direction = match pick.direction {
        Direction::Bone => PickDirection::Bone,
        Direction::PlusX => PickDirection::Fixed(Vec3::x()),
        Direction::MinusX => PickDirection::Fixed(-Vec3::x()),
        Direction::PlusY => PickDirection::Fixed(Vec3::y()),
        Direction::MinusY => PickDirection::Fixed(-Vec3::y()),
        Direction::PlusZ => PickDirection::Fixed(Vec3::z()),
        Direction::MinusZ => PickDirection::Fixed(-Vec3::z()),
    };
    LandmarkPick {
        name: pick.name.clone(),
        joint: pick.joint.clone(),
        direction,
        with_descendants: pick.with_descendants,
    }
}
