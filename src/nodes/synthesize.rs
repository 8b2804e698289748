//! Kind `synthesize`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::synthetic::synthesize::{
    self as kernel, N_FRAMES, SynthesizeOptions, synthesize,
};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

/// Makes a rigged biped or quadruped from a seed, with everything that is true about it.
///
/// A smooth, closed surface of genus 0 with the joints that it was built around, its skin weights,
/// landmarks, and a walk cycle. Y is up, the character faces +Z with its left towards +X, in metres,
/// its feet on y = 0. Vertices are in random order, and two seeds share no connectivity.
///
/// Landmarks: `head_top`, `hand_left`, `hand_right`, `foot_left`, `foot_right`, `chest_front`,
/// `chest_back`; for quadrupeds, hands are the front feet, and `nose` and `tail_tip` follow.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Synthesize {
    /// The body plan.
    pub body: Body,
    /// The number of vertices.
    #[schemars(range(min = 1000, max = 250_000))]
    pub n_vertices: usize,
    /// Decides on proportions, random pose, connectivity, the order of vertices, noise and holes.
    pub seed: u64,
    /// How much individuals differ in their proportions; at 0 all seeds give the same body.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub variation: f64,
    /// A factor on the height that the seed gives (nominal: 1.75 m; quadrupeds 1.3 m at the withers).
    #[schemars(range(min = 0.5, max = 2.0))]
    pub height: f64,
    /// A factor on how thick the torso is; limbs follow by its square root.
    #[schemars(range(min = 0.8, max = 1.25))]
    pub girth: f64,
    /// A factor on the length of arms and legs; the height stays.
    #[schemars(range(min = 0.8, max = 1.25))]
    pub limb_length: f64,
    /// A factor on the size of the head.
    #[schemars(range(min = 0.8, max = 1.4))]
    pub head_size: f64,
    /// The pose of the mesh and its joints.
    pub pose: Pose,
    /// How far a random pose departs from rest; 1 is lively.
    #[schemars(range(min = 0.0, max = 1.5))]
    pub pose_amount: f64,
    /// The frame of the walk cycle for the pose `walk`, 0 to 29. The left heel (of quadrupeds, the
    /// left hind foot) touches the ground in frame 0.
    #[schemars(range(min = 0, max = 29))]
    pub pose_frame: usize,
    /// How triangles are distributed.
    pub connectivity: Connectivity,
    /// The deviation of random displacements along normals, over the mean edge length.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise: f64,
    /// The number of holes to cut. Their vertices are lost.
    #[schemars(range(min = 0, max = 50))]
    pub holes: usize,
}

/// The body plan.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Body {
    /// 22 joints; rests in an A-pose.
    Biped,
    /// 32 joints; between dog and horse.
    Quadruped,
}

/// The pose of the mesh and its joints.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pose {
    /// A-pose; quadrupeds stand.
    Rest,
    /// Arms straight out; quadrupeds stand.
    T,
    /// A frame of the walk cycle.
    Walk,
    /// Random turns of all joints.
    Random,
}

/// How triangles are distributed.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Connectivity {
    /// Edges of one length, shorter only where the body is thinner than that.
    Isotropic,
    /// Shorter edges where the body is thin: hands, feet, face.
    Adaptive,
    /// Edge lengths that change without reason, by a factor of about three.
    Irregular,
}

impl Default for Synthesize {
    fn default() -> Self {
        let options = SynthesizeOptions::default();
        Self {
            body: Body::Biped,
            n_vertices: options.n_vertices,
            seed: options.seed,
            variation: options.variation,
            height: options.height,
            girth: options.girth,
            limb_length: options.limb_length,
            head_size: options.head_size,
            pose: Pose::Rest,
            pose_amount: 1.0,
            pose_frame: 0,
            connectivity: Connectivity::Isotropic,
            noise: options.noise,
            holes: options.n_holes,
        }
    }
}

impl Synthesize {
    const MESH: Output<TriMesh> = Output::new("mesh", "the surface in its pose");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the true joints in that pose");
    const WEIGHTS: Output<SkinWeights> =
        Output::new("weights", "the true skin weights, four joints a vertex at most");
    const LANDMARKS: Output<Landmarks> = Output::new("landmarks", "seven or nine named vertices");
    const CLIP: Output<Clip> =
        Output::new("clip", "a walk cycle in place, for the skeleton in its pose; it loops");

    fn options(&self) -> SynthesizeOptions {
        SynthesizeOptions {
            body: match self.body {
                Body::Biped => kernel::Body::Biped,
                Body::Quadruped => kernel::Body::Quadruped,
            },
            n_vertices: self.n_vertices,
            seed: self.seed,
            variation: self.variation,
            height: self.height,
            girth: self.girth,
            limb_length: self.limb_length,
            head_size: self.head_size,
            stance: match self.pose {
                Pose::Rest => kernel::Stance::Rest,
                Pose::T => kernel::Stance::T,
                Pose::Walk => kernel::Stance::Walk(self.pose_frame as f64 / N_FRAMES as f64),
                Pose::Random => kernel::Stance::Random(self.pose_amount),
            },
            connectivity: match self.connectivity {
                Connectivity::Isotropic => kernel::Connectivity::Isotropic,
                Connectivity::Adaptive => kernel::Connectivity::Adaptive,
                Connectivity::Irregular => kernel::Connectivity::Irregular,
            },
            noise: self.noise,
            n_holes: self.holes,
        }
    }
}

impl Node for Synthesize {
    const SPEC: Spec = Spec {
        kind: "synthesize",
        version: 1,
        inputs: &[],
        outputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::LANDMARKS.port(),
            Self::CLIP.port(),
        ],
        cites: &["botsch2004remeshing"],
        example: r#"[nodes.walker]
kind = "synthesize"
body = "quadruped"
n_vertices = 1000
seed = 4
pose = "walk"
pose_frame = 10
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let character = synthesize(&self.options())?;
        io.put(Self::MESH, character.mesh);
        io.put(Self::SKELETON, character.skeleton);
        io.put(Self::WEIGHTS, character.weights);
        io.put(Self::LANDMARKS, character.landmarks);
        io.put(Self::CLIP, character.clip);
        Ok(())
    }
}
