//! Kind `ssdr`.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::ssdr::{Ssdr, SsdrOptions, ssdr};
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::{Column, Table};

/// Finds rigid bones, their motions and skin weights for a mesh in motion.
///
/// Smooth skinning decomposition (SSDR): no skeleton is needed or found; every bone is a root of its
/// own. A `rig` of the mesh, the bones, the weights and the clip (with `fit_clip = false`) plays the
/// motion in other programs.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SsdrNode {
    /// How many bones at most; fewer if the mesh has not so many motions.
    #[schemars(range(min = 1, max = 1000))]
    pub n_bones: usize,
    /// The most bones that move a vertex.
    #[schemars(range(min = 1, max = 64))]
    pub max_influences: usize,
    /// The most rounds of fitting motions, then weights.
    #[schemars(range(min = 1, max = 10_000))]
    pub max_iterations: usize,
    /// Stop when the error falls by less than this share of itself…
    #[schemars(range(min = 0.0, max = 1.0))]
    pub tolerance: f64,
    /// … so many times in a row.
    #[schemars(range(min = 1, max = 1000))]
    pub patience: usize,
    /// How strongly bones hold to the vertices that are mostly theirs. 0 gives the least error; with 10
    /// bones that share their vertices stay a few times closer to them.
    pub affinity: f64,
    /// How strongly weights are pulled towards those of neighbours that move alike.
    pub smoothness: f64,
}

impl Default for SsdrNode {
    fn default() -> Self {
        let it = SsdrOptions::default();
        Self {
            n_bones: it.n_bones,
            max_influences: it.max_influences,
            max_iterations: it.max_iterations,
            tolerance: it.tolerance,
            patience: it.patience,
            affinity: it.affinity,
            smoothness: it.smoothness,
        }
    }
}

impl SsdrNode {
    const SEQUENCE: Input<MeshSequence> = Input::new("sequence", "the mesh in motion");
    const REST: OptionalInput<TriMesh> =
        OptionalInput::new("rest", "the pose that bones move from; without it the first frame");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the bones, at their centres");
    const WEIGHTS: Output<SkinWeights> = Output::new("weights", "how bones move vertices");
    const CLIP: Output<Clip> = Output::new("clip", "how bones move");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: counts, error");
}

impl Node for SsdrNode {
    const SPEC: Spec = Spec {
        kind: "ssdr",
        version: 2,
        inputs: &[Self::SEQUENCE.port(), Self::REST.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["le2012smooth"],
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
kind = "ssdr"
sequence = "@walk.sequence"
rest = "@body.mesh"
n_bones = 8
max_iterations = 5
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let sequence = io.get(Self::SEQUENCE);
        let frames: Vec<&[Vec3]> = (0..sequence.n_frames()).map(|it| sequence.frame(it)).collect();
        let rest = io.get_optional(Self::REST);
        let rest = rest.as_ref().map_or(frames[0], |it| it.vertices());
        if rest.len() != sequence.n_vertices() {
            return Err(NodeError::failed(format!(
                "`rest` has {} vertices, but the sequence {}",
                rest.len(),
                sequence.n_vertices()
            )));
        }
        let options = SsdrOptions {
            n_bones: self.n_bones,
            max_influences: self.max_influences,
            max_iterations: self.max_iterations,
            tolerance: self.tolerance,
            patience: self.patience,
            affinity: self.affinity,
            smoothness: self.smoothness,
            ..Default::default()
        };
        let res = ssdr(rest, sequence.faces(), &frames, None, &options)?;
        io.put(Self::SUMMARY, summary(&res, rest));
        io.put(Self::CLIP, clip(&res, sequence.frames_per_second()));
        let n_bones = res.centers.len();
        let names = (0..n_bones).map(|it| format!("bone_{it}")).collect();
        let bones = Skeleton::new(names, vec![None; n_bones], res.centers);
        io.put(Self::SKELETON, bones.map_err(|error| NodeError::failed(error.to_string()))?);
        io.put(Self::WEIGHTS, res.weights);
        Ok(())
    }
}

/// The bones' motions, for joints at their centres.
fn clip(res: &Ssdr, frames_per_second: f64) -> Clip {
    let n_bones = res.centers.len();
    let place = |(index, motion): (usize, &nalgebra::Isometry3<f64>)| {
        (motion * nalgebra::Point3::from(res.centers[index % n_bones])).coords
    };
    let rotations: Vec<UnitQuaternion<f64>> = res.motions.iter().map(|it| it.rotation).collect();
    let translations = res.motions.iter().enumerate().map(place).collect();
    Clip { name: "ssdr".to_owned(), frames_per_second, n_joints: n_bones, rotations, translations }
}

fn summary(res: &Ssdr, rest: &[Vec3]) -> Table {
    let first = rest[0];
    let (low, high) = rest.iter().fold((first, first), |(l, h), it| (l.inf(it), h.sup(it)));
    let diagonal = (high - low).norm();
    let percent = if diagonal > 0.0 { 100.0 * res.rmse / diagonal } else { f64::NAN };
    let number = |name, value| Column::numbers(name, "", vec![value]);
    Table::new(vec![
        number("bones", res.centers.len() as f64),
        number("influences", res.weights.max_influences() as f64),
        number("iterations", res.history.len() as f64),
        number("rmse", res.rmse),
        Column::numbers("rmse of diagonal", "%", vec![percent]),
    ])
}
