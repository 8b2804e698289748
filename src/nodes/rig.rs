//! Kind `rig`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::artifacts::Rig;
use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::motion::fit_clip::fit_clip;
use crate::kernels::rigs::limit_influences::limit_influences;
use crate::kernels::{
    geometry::mesh::TriMesh,
    rigs::{clip::Clip, skeleton::Skeleton, weights::SkinWeights},
};

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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::engine::artifact::{AnyArtifact, Artifact};
    use crate::engine::node::{NodeOutputs, PortInputs, Surroundings};
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::geometry::shapes::icosphere;

    fn skeleton(n_joints: usize) -> Skeleton {
        let names = (0..n_joints).map(|it| format!("joint{it}")).collect();
        let parents = (0..n_joints).map(|it| it.checked_sub(1)).collect();
        let positions = (0..n_joints).map(|it| Vec3::y() * it as f64).collect();
        Skeleton::new(names, parents, positions).unwrap()
    }

    fn weights(n_vertices: usize, n_joints: usize) -> SkinWeights {
        let row =
            |vertex: usize| (0..n_joints).map(move |it| (it as u32, (1 + vertex + it) as f64));
        let rows: Vec<Vec<_>> = (0..n_vertices).map(|it| row(it).collect()).collect();
        SkinWeights::from_rows(n_joints, &rows).unwrap()
    }

    fn run(node: &RigNode, weights: SkinWeights) -> Result<NodeOutputs, NodeError> {
        fn artifact(value: impl Artifact) -> PortInputs {
            vec![Ok(AnyArtifact::encode(value).0)]
        }
        let inputs = BTreeMap::from([
            ("mesh", artifact(icosphere(0))),
            ("skeleton", artifact(skeleton(3))),
            ("weights", artifact(weights)),
        ]);
        let surroundings = Surroundings::default();
        let (labels, files) = (BTreeMap::new(), BTreeMap::new());
        let mut io = NodeIo::new(&RigNode::SPEC, inputs, labels, files, &surroundings, &|_, _| {});
        node.run(&mut io)?;
        Ok(io.finish())
    }

    #[test]
    fn counts_that_differ_are_named() {
        let node = RigNode { max_influences: None, fit_clip: true };
        let message = |weights| run(&node, weights).err().unwrap().message().to_owned();
        assert_eq!(message(weights(11, 3)), "weights of 11 vertices for a mesh of 12");
        assert_eq!(message(weights(12, 4)), "weights of 4 joints for a skeleton of 3");
    }

    #[test]
    fn dropped_influences_are_noted() {
        let node = RigNode { max_influences: Some(2), fit_clip: true };
        let outputs = run(&node, weights(12, 3)).unwrap();
        assert!(outputs.notes[0].starts_with("12 vertices had more than 2 influences"));
        let rig = outputs.artifacts["rig"].0.downcast::<Rig>().unwrap();
        assert_eq!(rig.weights.max_influences(), 2);
    }
}
