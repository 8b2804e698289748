//! Kind `direction_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::motion::direction_error::{DirectionError, direction_errors};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::segment_map::SegmentMap;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Measures how far the bones of a transferred motion point away from those that they follow.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DirectionErrorNode {
    /// The target's joints at the ends of the bones that count; all if there are none.
    pub joints: Vec<String>,
}

impl DirectionErrorNode {
    const SOURCE: Input<Skeleton> = Input::new("source_skeleton", "the joints that are followed");
    const SOURCE_CLIP: Input<Clip> = Input::new("source_clip", "their motion");
    const TARGET: Input<Skeleton> = Input::new("target_skeleton", "the joints that follow");
    const TARGET_CLIP: Input<Clip> = Input::new("target_clip", "their motion, frame by frame");
    const MAP: Input<SegmentMap> = Input::new("map", "which bones follow which");
    const BONES: Output<Table> = Output::new("bones", "one row a bone");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: all bones");
}

impl Node for DirectionErrorNode {
    const SPEC: Spec = Spec {
        kind: "direction_error",
        version: 1,
        inputs: &[
            Self::SOURCE.port(),
            Self::SOURCE_CLIP.port(),
            Self::TARGET.port(),
            Self::TARGET_CLIP.port(),
            Self::MAP.port(),
        ],
        outputs: &[Self::BONES.port(), Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.adult]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1
pose = "t"

[nodes.map]
kind = "segments_by_name"
source_skeleton = "@adult.skeleton"
target_skeleton = "@other.skeleton"

[nodes.walk]
kind = "transfer_animation"
source_skeleton = "@adult.skeleton"
clip = "@adult.clip"
target_skeleton = "@other.skeleton"
map = "@map"

[nodes.error]
kind = "direction_error"
source_skeleton = "@adult.skeleton"
source_clip = "@adult.clip"
target_skeleton = "@other.skeleton"
target_clip = "@walk"
map = "@map"
joints = ["left_hand", "right_hand"]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE), io.get(Self::TARGET));
        let wanted = self.joints.iter().map(|name| {
            target.joint(name).ok_or_else(|| {
                let known = target.names().join(", ");
                NodeError::failed(format!("there is no joint `{name}`; there are {known}"))
            })
        });
        let wanted = wanted.collect::<Result<Vec<usize>, NodeError>>()?;
        let (source_clip, target_clip) = (io.get(Self::SOURCE_CLIP), io.get(Self::TARGET_CLIP));
        let (from, to) = ((&*source, &*source_clip), (&*target, &*target_clip));
        let mut errors = direction_errors(from, to, &io.get(Self::MAP))?;
        errors.retain(|it| wanted.is_empty() || wanted.contains(&it.joint));
        if errors.is_empty() {
            return Err(NodeError::failed("no bone of these follows one of the source"));
        }
        io.put(Self::BONES, bones_table(&errors, &source, &target));
        io.put(Self::SUMMARY, summary(&errors));
        Ok(())
    }
}

fn bones_table(errors: &[DirectionError], source: &Skeleton, target: &Skeleton) -> Table {
    let name = |of: &Skeleton, joint: usize| of.names()[joint].clone();
    let numbers = |of: fn(&DirectionError) -> f64| errors.iter().map(of).collect();
    Table::new(vec![
        Column::texts("bone", errors.iter().map(|it| name(target, it.joint)).collect()),
        Column::texts("follows", errors.iter().map(|it| name(source, it.follows)).collect()),
        Column::numbers("mean", "°", numbers(|it| it.mean_rad.to_degrees())),
        Column::numbers("max", "°", numbers(|it| it.largest_rad.to_degrees())),
    ])
}

fn summary(errors: &[DirectionError]) -> Table {
    let mean = errors.iter().map(|it| it.mean_rad).sum::<f64>() / errors.len() as f64;
    let largest = errors.iter().map(|it| it.largest_rad).fold(0.0, f64::max);
    let column = |name, unit, value| Column::numbers(name, unit, vec![value]);
    Table::new(vec![
        column("bones", "", errors.len() as f64),
        column("mean", "°", mean.to_degrees()),
        column("max", "°", largest.to_degrees()),
    ])
}
