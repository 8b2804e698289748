//! Kind `skeletonize_zhang`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::curve_skeletons::skeleton_baselines::Moving;
use crate::kernels::curve_skeletons::skeleton_baselines::zhang::{ZhangOptions, skeletonize_zhang};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::Table;

/// Finds a skeleton in a moving surface by spectral clustering of its points.
///
/// A baseline of Transfer4D's Table 1 (Zhang et al. 2013): points whose distance from each other does
/// not change over time belong together. Joints are the centroids of the parts, so they lie within
/// bones rather than between them; every vertex has the weight 1 for its part. The published method
/// tracks the surface itself, too; here that is `nrr`'s work.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkeletonizeZhang {
    /// Clusters, before they are split into connected regions.
    #[schemars(range(min = 1, max = 1000))]
    pub n_clusters: usize,
    /// Random vertices whose distances are compared; time and memory grow with the square.
    #[schemars(range(min = 2, max = 10_000))]
    pub samples: usize,
    /// The deviation of a distance at which affinity has fallen to 1/e, for a surface whose box has a
    /// diagonal of 2 m. The paper's 1 makes all affinities of metre-sized bodies nearly the same.
    #[schemars(range(min = 0.000001, max = 1000.0))]
    pub scale: f64,
    /// Regions with a smaller share of the vertices are merged with a neighbour.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_share: f64,
    /// Decides on the vertices and where clustering begins.
    pub seed: u64,
}

impl Default for SkeletonizeZhang {
    fn default() -> Self {
        let it = ZhangOptions::default();
        Self {
            n_clusters: it.n_clusters,
            samples: it.n_samples,
            scale: it.scale,
            least_share: it.least_share,
            seed: it.seed,
        }
    }
}

impl SkeletonizeZhang {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the tracked surface in motion");
    const REST: OptionalInput<TriMesh> =
        OptionalInput::new("rest", "its rest pose; without it the first frame");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the joints at rest");
    const CLIP: Output<Clip> =
        Output::new("clip", "where the joints go; only positions, rotations are the identity");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "1 for the own part");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: joints, error");
}

impl Node for SkeletonizeZhang {
    const SPEC: Spec = Spec {
        kind: "skeletonize_zhang",
        version: 1,
        inputs: &[Self::SEQUENCE.port(), Self::REST.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::CLIP.port(),
            Self::WEIGHTS.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["zhang2013unsupervised", "maheshwari2023transfer4d"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.walk]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
every = 4

[nodes.bones]
kind = "skeletonize_zhang"
sequence = "@walk.sequence"
rest = "@body.mesh"
n_clusters = 12
samples = 300
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, rest) = (io.get(Self::SEQUENCE), io.get_optional(Self::REST));
        let options = ZhangOptions {
            n_clusters: self.n_clusters,
            n_samples: self.samples,
            scale: self.scale,
            least_share: self.least_share,
            seed: self.seed,
        };
        let found = skeletonize_zhang(&Moving::new(&sequence, rest.as_deref())?, &options)?;
        io.put(Self::SUMMARY, found.summary());
        io.put(Self::SKELETON, found.skeleton);
        io.put(Self::CLIP, found.clip);
        io.put(Self::WEIGHTS, found.weights);
        Ok(())
    }
}
