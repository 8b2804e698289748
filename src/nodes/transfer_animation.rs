//! Kind `transfer_animation`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::motion::fit_clip::world_positions;
use crate::kernels::motion::transfer_animation::{
    RootPath, TransferAnimationOptions, TransferredAnimation, transfer_animation,
};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::segment_map::{Segment, SegmentMap};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Moves a skeleton like another one, by a map of its bones.
///
/// Mapped bones point where the source's do, twist included, and keep their own lengths, whatever the
/// rest poses are. Joints need no names in common: a `segment_map` comes from matched skeletons, or from
/// names by `segments_by_name`. A `rig` or `animate` takes the clip as it is, with `fit_clip = false` or
/// `fit = false`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransferAnimationNode {
    /// Whether the target takes the source's poses: its bones are first turned to the directions that
    /// the source's have at rest. Otherwise they turn from their own rest directions, which is right
    /// where both rest poses are meant to be the same and bones lie differently in the bodies.
    pub align_rest: bool,
    /// Bones shorter than this share of the mean bone are not turned by themselves: where joints nearly
    /// coincide, the direction from one to the other means nothing.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_bone: f64,
    /// With `align_rest`: bones that end within this share of a branch from the branch node where it
    /// begins keep their own rest directions. Pelvises and shoulder girdles differ by the shapes of
    /// bodies, not by their poses; 0.3 leaves these as they are.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fork_share: f64,
    /// Where the root is.
    pub root: RootPath,
    /// Bones that are turned by more at rest, in degrees, are told in a note.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub warn_above_deg: f64,
}

impl Default for TransferAnimationNode {
    fn default() -> Self {
        let TransferAnimationOptions { align_rest, least_bone, fork_share, root } =
            Default::default();
        Self { align_rest, least_bone, fork_share, root, warn_above_deg: 60.0 }
    }
}

impl TransferAnimationNode {
    const SOURCE: Input<Skeleton> = Input::new("source_skeleton", "the joints that the clip moves");
    const CLIP: Input<Clip> = Input::new("clip", "the motion of the source");
    const TARGET: Input<Skeleton> = Input::new("target_skeleton", "the joints to be moved");
    const MAP: Input<SegmentMap> = Input::new("map", "which bones follow which");
    const RESULT: Output<Clip> = Output::new("clip", "the motion of the target");
    const BONES: Output<Table> =
        Output::new("bones", "one row a target bone: what it follows, and its turn at rest");

    fn note_stiff(io: &mut NodeIo<'_>, target: &Skeleton, map: &SegmentMap) {
        let names = target.names().iter().zip(map.segments());
        let stiff: Vec<&str> = names.filter(|it| it.1.is_none()).map(|it| it.0.as_str()).collect();
        if !stiff.is_empty() {
            io.note(format!(
                "{} joints of the target follow nothing and are stiff: {}",
                stiff.len(),
                stiff.join(", ")
            ));
        }
    }

    fn note_angles(&self, io: &mut NodeIo<'_>, target: &Skeleton, angles_rad: &[f64]) {
        let names = target.names().iter().zip(angles_rad);
        let far: Vec<String> = names
            .filter(|it| it.1.to_degrees() > self.warn_above_deg)
            .map(|(name, angle)| format!("{name} ({:.0})", angle.to_degrees()))
            .collect();
        if !far.is_empty() {
            io.note(format!(
                "the rest poses are not alike: {} bones are turned by more than {} degrees: {}",
                far.len(),
                self.warn_above_deg,
                far.join(", ")
            ));
        }
    }
}

/// Tells of motions that float above or sink below their own rest pose.
fn note_height(io: &mut NodeIo<'_>, source: &Skeleton, clip: &Clip) {
    let lowest = |places: &[Vec3]| {
        places
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |it, at| (it.0.min(at.y), it.1.max(at.y)))
    };
    let (rest, top) = lowest(source.positions());
    let reached = (0..clip.n_frames())
        .map(|frame| lowest(&world_positions(clip, frame, source.parents())).0)
        .fold(f64::INFINITY, f64::min);
    if (reached - rest).abs() > 0.1 * (top - rest) {
        io.note(format!(
            "the lowest joint of the motion reaches {reached:.3}, but that of the source at rest is \
             at {rest:.3}: `root = \"grounded\"` puts the target on its floor"
        ));
    }
}

fn bones_table(
    source: &Skeleton,
    target: &Skeleton,
    map: &SegmentMap,
    res: &TransferredAnimation,
) -> Table {
    let names = source.names();
    let followed = |of: &dyn Fn(&Segment) -> f64| {
        map.segments().iter().map(|it| it.as_ref().map_or(f64::NAN, of)).collect::<Vec<f64>>()
    };
    let follows = map
        .segments()
        .iter()
        .map(|it| it.map_or(String::new(), |it| names[it.source as usize].clone()));
    Table::new(vec![
        Column::texts("bone", target.names().to_vec()),
        Column::texts("follows", follows.collect()),
        Column::numbers("from", "", followed(&|it| it.from)),
        Column::numbers("to", "", followed(&|it| it.to)),
        Column::numbers(
            "turn at rest",
            "°",
            res.rest_angles_rad.iter().map(|it| it.to_degrees()).collect(),
        ),
    ])
}

impl Node for TransferAnimationNode {
    const SPEC: Spec = Spec {
        kind: "transfer_animation",
        version: 1,
        inputs: &[Self::SOURCE.port(), Self::CLIP.port(), Self::TARGET.port(), Self::MAP.port()],
        outputs: &[Self::RESULT.port(), Self::BONES.port().aside()],
        cites: &["madaras2014skeleton"],
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
root = "grounded"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, clip) = (io.get(Self::SOURCE), io.get(Self::CLIP));
        let (target, map) = (io.get(Self::TARGET), io.get(Self::MAP));
        let options = TransferAnimationOptions {
            align_rest: self.align_rest,
            least_bone: self.least_bone,
            fork_share: self.fork_share,
            root: self.root,
        };
        let res = transfer_animation(&source, &clip, &target, &map, &options)?;
        Self::note_stiff(io, &target, &map);
        self.note_angles(io, &target, &res.rest_angles_rad);
        if self.root == RootPath::FromRest {
            note_height(io, &source, &clip);
        }
        io.put(Self::BONES, bones_table(&source, &target, &map, &res));
        io.put(Self::RESULT, res.clip);
        Ok(())
    }
}
