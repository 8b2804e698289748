//! Kind `motion_skeleton`.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::curve_skeletons::motion_skeleton::{
    JointMotion, MotionSkeleton, MotionSkeletonOptions, motion_skeleton,
};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::ssdr::SsdrOptions;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::{Column, Table};

/// Makes a skeleton in motion from a tracked surface and its curve skeleton: joints are where curves
/// branch and end, and where the surface bends.
///
/// Components of the curve skeleton are joined where they stay close over time. Curves between
/// junctions are split where two rigid motions fit much better than one; smooth skinning decomposition
/// refines the motions of the parts. A `rig` of the surface, `skeleton`, `weights` and `clip` (with
/// `fit_clip = false`) plays the motion.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionSkeletonNode {
    /// Bones are split if that lowers their squared error by more than this share; Transfer4D takes 0.2.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub threshold: f64,
    /// Bones of fewer vertices are not split.
    pub min_vertices: usize,
    /// Both sides of a split have at least so many vertices.
    #[schemars(range(min = 1))]
    pub min_side: usize,
    /// No splits beyond so many bones.
    #[schemars(range(min = 1, max = 1000))]
    pub max_bones: usize,
    /// How often every bone may be split.
    #[schemars(range(max = 100))]
    pub rounds: usize,
    /// Bones with less error than this share of the bounding box's diagonal are not split.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_error: f64,
    /// Ends of curves that are shorter than this share of the diagonal are no limbs, and are removed.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_limb: f64,
    /// A link between components may become longer by less than this factor over time.
    #[schemars(range(min = 1.001, max = 1e9))]
    pub max_variation: f64,
    /// How joints follow the surface.
    pub joints: JointMotion,
    /// The most bones that move a vertex.
    #[schemars(range(min = 1, max = 64))]
    pub max_influences: usize,
    /// The most rounds of fitting motions, then weights; stops earlier if the error hardly falls.
    #[schemars(range(min = 1, max = 10_000))]
    pub max_iterations: usize,
    /// Whether camera space (y down, z forward) is turned upright, to +y up and +z towards the camera.
    pub upright: bool,
}

impl Default for MotionSkeletonNode {
    fn default() -> Self {
        let it = MotionSkeletonOptions::default();
        Self {
            threshold: it.threshold,
            min_vertices: it.min_vertices,
            min_side: it.min_side,
            max_bones: it.max_bones,
            rounds: it.rounds,
            least_error: it.least_error,
            least_limb: it.least_limb,
            max_variation: it.max_variation,
            joints: it.joints,
            max_influences: it.ssdr.max_influences,
            max_iterations: it.ssdr.max_iterations,
            upright: false,
        }
    }
}

impl MotionSkeletonNode {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the tracked surface");
    const CURVES: Input<CurveSkeleton> =
        Input::new("curves", "its curve skeleton in rest pose, with the nodes of its vertices");
    const REST: OptionalInput<TriMesh> =
        OptionalInput::new("rest", "the surface in rest pose; without it the first frame");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the joints in rest pose");
    const CLIP: Output<Clip> = Output::new("clip", "how they move");
    const WEIGHTS: Output<SkinWeights> =
        Output::new("weights", "how they move the surface: every joint the bone that leads to it");
    const SUMMARY: Output<Table> = Output::new(
        "summary",
        "one row: counts; errors of the curves, of the parts they were split into, of skinned parts",
    );

    fn options(&self) -> MotionSkeletonOptions {
        let it = MotionSkeletonOptions::default();
        MotionSkeletonOptions {
            threshold: self.threshold,
            min_vertices: self.min_vertices,
            min_side: self.min_side,
            max_bones: self.max_bones,
            rounds: self.rounds,
            least_error: self.least_error,
            least_limb: self.least_limb,
            max_variation: self.max_variation,
            joints: self.joints,
            ssdr: SsdrOptions {
                max_influences: self.max_influences,
                max_iterations: self.max_iterations,
                ..it.ssdr
            },
        }
    }
}

impl Node for MotionSkeletonNode {
    const SPEC: Spec = Spec {
        kind: "motion_skeleton",
        version: 2,
        inputs: &[Self::SEQUENCE.port(), Self::CURVES.port(), Self::REST.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::CLIP.port(),
            Self::WEIGHTS.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["maheshwari2023transfer4d", "le2012smooth"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.walk]
kind = "animate"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
every = 8

[nodes.curves]
kind = "skeletonize"
mesh = "@body.mesh"

[nodes.skeleton]
kind = "motion_skeleton"
sequence = "@walk.sequence"
curves = "@curves.curves"
rest = "@body.mesh"
max_bones = 12
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (sequence, curves) = (io.get(Self::SEQUENCE), io.get(Self::CURVES));
        let frames: Vec<&[Vec3]> = (0..sequence.n_frames()).map(|it| sequence.frame(it)).collect();
        let rest = io.get_optional(Self::REST);
        let rest = rest.as_ref().map_or(frames[0], |it| it.vertices());
        let rate = sequence.frames_per_second();
        let made =
            motion_skeleton(rest, sequence.faces(), &frames, rate, &curves, &self.options())?;
        if made.n_links > 0 {
            io.note(format!("{} components were joined by links", made.n_links + 1));
        }
        if made.skeleton.n_joints() == 1 {
            io.note("the surface has no limbs: one joint moves all of it");
        } else if made.n_splits == 0 {
            io.note("nothing bends: joints are only where curves branch and end");
        }
        io.put(Self::SUMMARY, summary(&made));
        let (skeleton, clip) = match self.upright {
            true => upright(&made)?,
            false => (made.skeleton, made.clip),
        };
        io.put(Self::SKELETON, skeleton);
        io.put(Self::CLIP, clip);
        io.put(Self::WEIGHTS, made.weights);
        Ok(())
    }
}

/// Turns half around x.
fn upright(made: &MotionSkeleton) -> Result<(Skeleton, Clip), NodeError> {
    let turn = UnitQuaternion::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI);
    let turned = made.skeleton.positions().iter().map(|it| Vec3::new(it.x, -it.y, -it.z));
    Ok((made.skeleton.with_positions(turned.collect())?, made.clip.turned(&turn)))
}

fn summary(made: &MotionSkeleton) -> Table {
    let number = |name, value| Column::numbers(name, "", vec![value]);
    Table::new(vec![
        number("joints", made.skeleton.n_joints() as f64),
        number("bones", made.n_bones as f64),
        number("splits", made.n_splits as f64),
        number("links", made.n_links as f64),
        number("curves rmse", made.curves_rmse),
        number("rigid rmse", made.rigid_rmse),
        number("rmse", made.rmse),
    ])
}
