//! Kind `segments_by_name`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::segments_by_name::segments_by_name;
use crate::kernels::rigs::skeleton::Skeleton;

/// Maps every bone of a target to the bone of the source that has the same name.
///
/// For rigs of one family. Joints without a namesake follow nothing.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SegmentsByName {}

impl SegmentsByName {
    const SOURCE: Input<Skeleton> = Input::new("source_skeleton", "the joints that are followed");
    const TARGET: Input<Skeleton> = Input::new("target_skeleton", "the joints that follow");
    const MAP: Output<SegmentMap> = Output::new("map", "which bones follow which");
}

impl Node for SegmentsByName {
    const SPEC: Spec = Spec {
        kind: "segments_by_name",
        version: 1,
        inputs: &[Self::SOURCE.port(), Self::TARGET.port()],
        outputs: &[Self::MAP.port()],
        cites: &[],
        example: r#"[nodes.adult]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1

[nodes.map]
kind = "segments_by_name"
source_skeleton = "@adult.skeleton"
target_skeleton = "@other.skeleton"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE), io.get(Self::TARGET));
        let map = segments_by_name(&source, &target);
        let n_mapped = map.segments().iter().flatten().count();
        if n_mapped == 0 {
            return Err(NodeError::failed(format!(
                "no joint of the target (`{}`, … {} joints) has the name of one of the source \
                 (`{}`, … {} joints)",
                target.names()[0],
                target.n_joints(),
                source.names()[0],
                source.n_joints()
            )));
        }
        if n_mapped < target.n_joints() {
            let n_joints = target.n_joints();
            io.note(format!("{n_mapped} of {n_joints} joints of the target have a namesake"));
        }
        io.put(Self::MAP, map);
        Ok(())
    }
}
