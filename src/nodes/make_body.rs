//! Kind `make_body`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalOutput, Output, Spec};
use crate::kernels::{
    files::FileSet,
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::{skeleton::Skeleton, weights::SkinWeights},
    synthetic::make_body::{BodyParameters, HeightTargets, make_body},
};

/// Makes a rigged adult or child from MakeHuman's base mesh and macro targets (CC0).
///
/// All bodies have the same 13380 vertices, the same 31 joints and true joint positions, in metres,
/// Y up, looking along +Z, feet on y = 0. The pipeline `data/makehuman.toml` fetches the files; only
/// those that a body needs must be there.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MakeBody {
    /// Age in years.
    #[serde(default = "default_age")]
    #[schemars(range(min = 1.0, max = 90.0))]
    pub age: f64,
    /// From 0 (female) to 1 (male).
    #[serde(default = "one")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gender: f64,
    /// From 0 (thin) to 1 (heavy).
    #[serde(default = "half")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub weight: f64,
    /// From 0 (weak) to 1 (strong).
    #[serde(default = "half")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub muscle: f64,
    /// From 0 (small) to 1 (tall) among people of this age.
    #[serde(default = "half")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub height: f64,
    /// From 0 (uncommon) to 1 (ideal). Other values than 0.5 need the files of
    /// `data/makehuman_every_build.toml`.
    #[serde(default = "half")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub proportions: f64,
    /// The parts that MakeHuman's three ethnic targets have; divided by their sum.
    #[serde(default)]
    pub race: Race,
    /// Which targets change the height.
    #[serde(default)]
    pub height_targets: HeightTargets,
}

/// Parts of MakeHuman's three ethnic targets.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Race {
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub caucasian: f64,
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub asian: f64,
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub african: f64,
}

impl Default for Race {
    fn default() -> Self {
        Self { caucasian: 1.0, asian: 1.0, african: 1.0 }
    }
}

fn default_age() -> f64 {
    25.0
}

fn half() -> f64 {
    0.5
}

fn one() -> f64 {
    1.0
}

impl MakeBody {
    const FILES: Input<FileSet> = Input::new("files", "MakeHuman's files");
    const MESH: Output<TriMesh> = Output::new("mesh", "the skin, in metres");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the true joints");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "how joints move the skin");
    const LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "head, hands, feet, chest and back");
}

impl Node for MakeBody {
    const SPEC: Spec = Spec {
        kind: "make_body",
        version: 1,
        inputs: &[Self::FILES.port()],
        outputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::LANDMARKS.port(),
        ],
        cites: &[],
        // Small files in the place of MakeHuman's, so that the example needs no network.
        example: r##"[nodes.files]
kind = "download"
files = [
  { path = '3dobjs/base.obj', url = 'data:,g body%0Av 0 0 0%0Av 2 0 0%0Av 0 0 2%0Av 0 9 0%0Af 1 2 3%0Af 1 4 2%0Af 1 3 4%0Af 2 4 3%0A',
    blake3 = '7e0687f9eeba5aa5f9ef6edc92381df5140289c9a8eed816a8072218e67473f0' },
  { path = 'rig.cmu_mb.json', url = 'data:,{"hips":{"parent":"","head":{"strategy":"MEAN","vertex_indices":[0,1,2]}}}',
    blake3 = 'f93ef41dc48fde6122fe091f91ddd51b105c9e1cd54bee6fb880435ae27a217a' },
  { path = 'weights.cmu_mb.json', url = 'data:,{"weights":{"hips":[[0,1],[1,1],[2,1],[3,1]]}}',
    blake3 = 'e9f3bc66b44358bbe9604d639e34dbc0e99e897fe5e3fe9be91968bffeab021e' },
  { path = 'targets/macrodetails/asian-female-young.target', url = 'data:,3 0 2 0%0A',
    blake3 = '3cc009812d08df34fb0a17602ee7303293ff132d76f86a32a632f1e38982debd' },
  { path = 'targets/macrodetails/universal-female-young-averagemuscle-averageweight.target', url = 'data:,3 0 4 0%0A',
    blake3 = '54239a257e40bbc02c604ee0c103e302c38ca0d28e648be174c973926ee6fd17' },
]

[nodes.body]
kind = "make_body"
files = "@files"
gender = 0.0
race = { caucasian = 0.0, asian = 1.0, african = 0.0 }
"##,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let parameters = BodyParameters {
            age_years: self.age,
            gender: self.gender,
            weight: self.weight,
            muscle: self.muscle,
            height: self.height,
            proportions: self.proportions,
            races: [self.race.caucasian, self.race.asian, self.race.african],
            height_targets: self.height_targets,
        };
        let body = make_body(&io.get(Self::FILES), &parameters)?;
        io.put(Self::MESH, body.mesh);
        io.put(Self::SKELETON, body.skeleton);
        io.put(Self::WEIGHTS, body.weights);
        io.put_optional(Self::LANDMARKS, body.landmarks, "this is another base mesh than hm08");
        Ok(())
    }
}
