//! Kind `skeletonize_kmeans`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::curve_skeletons::skeleton_baselines::Moving;
use crate::kernels::curve_skeletons::skeleton_baselines::keypoints::{
    KeypointOptions, skeletonize_kmeans,
};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::Table;

/// Finds keypoints in a moving surface by k-means and joins them to a tree.
///
/// The stand-in for Neural Marionette (Bae et al. 2022) in Transfer4D's Table 1, not that method: its
/// keypoints, tree and weights are learned and cannot be had without its training. Here keypoints are
/// the means of vertices with like paths, the tree spans them where they stay near each other, and a
/// vertex has weights proportional to `exp(-falloff d)` for its own keypoint and one joined to it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkeletonizeKmeans {
    /// How many keypoints (Neural Marionette: 24).
    #[schemars(range(min = 1, max = 1000))]
    pub n_keypoints: usize,
    /// How fast weights fall with the distance `d`, for a surface whose box has a diagonal of 2 m.
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub falloff: f64,
    /// Decides on where clustering begins.
    pub seed: u64,
}

impl Default for SkeletonizeKmeans {
    fn default() -> Self {
        let it = KeypointOptions::default();
        Self { n_keypoints: it.n_keypoints, falloff: it.falloff, seed: it.seed }
    }
}

impl SkeletonizeKmeans {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the tracked surface in motion");
    const REST: OptionalInput<TriMesh> =
        OptionalInput::new("rest", "its rest pose; without it the first frame");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the keypoints at rest");
    const CLIP: Output<Clip> =
        Output::new("clip", "where the keypoints go; only positions, rotations are the identity");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "two joints a vertex");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: joints, error");
}

impl Node for SkeletonizeKmeans {
    const SPEC: Spec = Spec {
        kind: "skeletonize_kmeans",
        version: 1,
        inputs: &[Self::SEQUENCE.port(), Self::REST.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::CLIP.port(),
            Self::WEIGHTS.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["bae2022neural", "maheshwari2023transfer4d"],
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
kind = "skeletonize_kmeans"
sequence = "@walk.sequence"
rest = "@body.mesh"
n_keypoints = 16
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, rest) = (io.get(Self::SEQUENCE), io.get_optional(Self::REST));
        let options = KeypointOptions {
            n_keypoints: self.n_keypoints,
            falloff: self.falloff,
            seed: self.seed,
        };
        let found = skeletonize_kmeans(&Moving::new(&sequence, rest.as_deref())?, &options)?;
        if found.skeleton.n_joints() < self.n_keypoints {
            io.note(format!("only {} vertices have paths of their own", found.skeleton.n_joints()));
        }
        io.put(Self::SUMMARY, found.summary());
        io.put(Self::SKELETON, found.skeleton);
        io.put(Self::CLIP, found.clip);
        io.put(Self::WEIGHTS, found.weights);
        Ok(())
    }
}
