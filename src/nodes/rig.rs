//! Kind `rig`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::artifacts::Rig;
use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::fit_clip::fit_clip;
use crate::kernels::limit_influences::limit_influences;
use crate::kernels::{clip::Clip, mesh::TriMesh, skeleton::Skeleton, weights::SkinWeights};

/// Puts a mesh, a skeleton, skin weights and a clip together: what is exported as `.glb`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RigNode {
    /// Keep only so many of the largest weights of every vertex, as many programs read only 4 or 8. All
    /// are kept if it is left out.
    #[serde(default)]
    #[schemars(range(min = 1, max = 64))]
    pub max_influences: Option<usize>,
    /// Whether the clip is made to fit the skeleton: bones keep the skeleton's lengths, and the root's
    /// path is scaled by the ratio of the heights. Otherwise the clip is taken as it is.
    #[serde(default = "yes")]
    pub fit_clip: bool,
}

fn yes() -> bool {
    true
}

impl RigNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "the joints");
    const WEIGHTS: Input<SkinWeights> = Input::new("weights", "how joints move vertices");
    const CLIP: OptionalInput<Clip> = OptionalInput::new("clip", "a motion of the same joints");
    const RIG: Output<Rig> = Output::new("rig", "all in one, to export");
}

impl Node for RigNode {
    const SPEC: Spec = Spec {
        kind: "rig",
        version: 1,
        inputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
        ],
        outputs: &[Self::RIG.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.rig]
kind = "rig"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
max_influences = 4
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = (*io.get(Self::MESH)).clone();
        let skeleton = (*io.get(Self::SKELETON)).clone();
        let mut weights = (*io.get(Self::WEIGHTS)).clone();
        if let Some(count) = self.max_influences {
            let (limited, loss) = limit_influences(&weights, count);
            if loss.n_vertices > 0 {
                io.note(format!(
                    "{} vertices had more than {count} influences; at most {:.2} % of a vertex's \
                     weight was dropped, {:.3} % in the mean",
                    loss.n_vertices,
                    100.0 * loss.largest,
                    100.0 * loss.mean
                ));
            }
            weights = limited;
        }
        let mut rig = Rig { mesh, skeleton, weights, clips: Vec::new() };
        if let Some(clip) = io.get_optional(Self::CLIP) {
            rig.clips.push((*clip).clone());
        }
        rig.check().map_err(NodeError::failed)?;
        if self.fit_clip {
            rig.clips = rig.clips.iter().map(|it| fit_clip(it, &rig.skeleton)).collect();
        }
        io.put(Self::RIG, rig);
        Ok(())
    }
}
