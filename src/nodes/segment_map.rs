//! Kind `segment_map`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::matching::map_segments::{
    Assignment, Insertion, MapSegmentsOptions, map_segments,
};
use crate::kernels::matching::skeleton_match::SkeletonMatch;
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;

/// Maps every bone of a skeleton to the bone of a matched skeleton that it follows.
///
/// Bones on matched branches follow the bone at the same share of the branch's length; all others
/// follow their parents. The target comes out with its root where the source has it, and with new joints
/// where it is too coarse: use it, not the one that went in, with the map.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SegmentMapNode {
    /// Where the target gets new joints.
    pub insert: Insertion,
    /// Which bone of the source is followed by a bone that lies along several.
    pub assign: Assignment,
    /// Joints are in the same place if they are closer than this share of their branch.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub threshold: f64,
    /// Give the target its root where the source has it; otherwise bones that lead against the source's
    /// follow nothing.
    pub move_root: bool,
}

impl Default for SegmentMapNode {
    fn default() -> Self {
        let it = MapSegmentsOptions::default();
        Self {
            insert: it.insertion,
            assign: it.assignment,
            threshold: it.threshold,
            move_root: it.move_root,
        }
    }
}

impl SegmentMapNode {
    const SOURCE: Input<Skeleton> = Input::new("source", "the skeleton that is followed");
    const TARGET: Input<Skeleton> = Input::new("target", "the skeleton that follows");
    const MATCH: Input<SkeletonMatch> = Input::new("match", "of the source and the target");
    const MAP: Output<SegmentMap> = Output::new("map", "what every bone follows");
    const GROWN: Output<Skeleton> =
        Output::new("target", "the target with its new joints, which the map belongs to");
}

impl Node for SegmentMapNode {
    const SPEC: Spec = Spec {
        kind: "segment_map",
        version: 1,
        inputs: &[Self::SOURCE.port(), Self::TARGET.port(), Self::MATCH.port()],
        outputs: &[Self::MAP.port(), Self::GROWN.port()],
        cites: &["madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1

[nodes.matched]
kind = "match_skeletons"
source = "@body.skeleton"
target = "@other.skeleton"

[nodes.segments]
kind = "segment_map"
source = "@body.skeleton"
target = "@other.skeleton"
match = "@matched.match"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE), io.get(Self::TARGET));
        let options = MapSegmentsOptions {
            insertion: self.insert,
            assignment: self.assign,
            threshold: self.threshold,
            move_root: self.move_root,
        };
        let res = map_segments(&source, &target, &io.get(Self::MATCH), &options)?;
        if res.n_inserted > 0 {
            io.note(format!("the target has {} new joints", res.n_inserted));
        }
        if res.is_root_moved {
            io.note("the target's root is now where the source has its own");
        }
        if res.n_empty > 0 {
            io.note(format!("no bone of the target follows {} bones of the source", res.n_empty));
        }
        let stiff = res.target.names().iter().zip(res.map.segments());
        let stiff: Vec<&str> = stiff.filter(|it| it.1.is_none()).map(|it| it.0.as_str()).collect();
        if !stiff.is_empty() {
            io.note(format!("{} joints follow their parents: {}", stiff.len(), stiff.join(", ")));
        }
        io.put(Self::MAP, res.map);
        io.put(Self::GROWN, res.target);
        Ok(())
    }
}
