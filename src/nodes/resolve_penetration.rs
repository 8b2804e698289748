//! Kind `resolve_penetration`.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::motion::resolve_penetration::{
    Crossings, KeyReport, ResolvePenetrationOptions, ResolvedPenetration, resolve_penetration,
};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::rigs::weights::SkinWeights;
use crate::kernels::table::{Column, Table};

/// Turns joints back where a body passes through itself in a motion.
///
/// Faces are grouped by the joint that moves them most. Where groups that are no neighbours cross, a
/// joint between them (or several) goes back towards the frame before, only as far as needed, and what
/// moves the body least. Groups that cross at rest are left alone. `animate` and `rig` take the clip as
/// it is, with `fit = false` or `fit_clip = false`.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ResolvePenetrationNode {
    /// How often all crossing groups of a frame are gone through at most.
    #[schemars(range(min = 0, max = 1000))]
    pub max_sweeps: usize,
    /// The largest angle, in degrees, by which joints may turn from rest: `{ left_forearm = 150 }`.
    pub limits_deg: BTreeMap<String, f64>,
    /// Rotations that are set by hand, and not changed.
    #[schemars(length(max = 100_000))]
    pub set: Vec<SetRotation>,
}

/// A rotation that is set by hand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SetRotation {
    /// The frame of the clip.
    pub frame: usize,
    /// The name of the joint.
    pub joint: String,
    /// The joint's rotation from rest in the frame of its parent: an axis, as long as the angle in
    /// degrees.
    pub rotation_deg: [f64; 3],
}

impl Default for ResolvePenetrationNode {
    fn default() -> Self {
        let max_sweeps = ResolvePenetrationOptions::default().max_sweeps;
        Self { max_sweeps, limits_deg: BTreeMap::new(), set: Vec::new() }
    }
}

impl ResolvePenetrationNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface at rest");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "its joints");
    const WEIGHTS: Input<SkinWeights> = Input::new("weights", "how joints move vertices");
    const CLIP: Input<Clip> = Input::new("clip", "a motion of these joints");
    const RESULT: Output<Clip> = Output::new("clip", "the motion without what could be resolved");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: all frames, before and after");
    const KEYS: Output<Table> = Output::new("keys", "one row a frame, before and after");

    fn options(
        &self,
        skeleton: &Skeleton,
        clip: &Clip,
    ) -> Result<ResolvePenetrationOptions, NodeError> {
        let joint = |name: &String| {
            skeleton.joint(name).ok_or_else(|| {
                let known = skeleton.names().join(", ");
                NodeError::failed(format!("there is no joint `{name}`; there are {known}"))
            })
        };
        let mut options =
            ResolvePenetrationOptions { max_sweeps: self.max_sweeps, ..Default::default() };
        for (name, limit) in &self.limits_deg {
            if !(*limit >= 0.0) {
                return Err(NodeError::failed(format!("the limit of `{name}` is {limit} degrees")));
            }
            options.limits_rad.insert(joint(name)?, limit.to_radians());
        }
        for it in &self.set {
            if it.frame >= clip.n_frames() {
                let (frame, n_frames) = (it.frame, clip.n_frames());
                return Err(NodeError::failed(format!(
                    "`set` names frame {frame}, but the clip has {n_frames} frames"
                )));
            }
            let rotation = Vec3::from(it.rotation_deg.map(f64::to_radians));
            let rotation = UnitQuaternion::from_scaled_axis(rotation);
            options.overrides.insert((it.frame, joint(&it.joint)?), rotation);
        }
        Ok(options)
    }
}

impl Node for ResolvePenetrationNode {
    const SPEC: Spec = Spec {
        kind: "resolve_penetration",
        version: 1,
        inputs: &[
            Self::MESH.port(),
            Self::SKELETON.port(),
            Self::WEIGHTS.port(),
            Self::CLIP.port(),
        ],
        outputs: &[Self::RESULT.port(), Self::SUMMARY.port().aside(), Self::KEYS.port().aside()],
        cites: &["madaras2014skeleton", "moller1997fast"],
        example: r#"[nodes.slim]
kind = "synthesize"
n_vertices = 1000

[nodes.stout]
kind = "synthesize"
n_vertices = 1000
girth = 1.25
pose = "t"

[nodes.map]
kind = "segments_by_name"
source_skeleton = "@slim.skeleton"
target_skeleton = "@stout.skeleton"

[nodes.walk]
kind = "transfer_animation"
source_skeleton = "@slim.skeleton"
clip = "@slim.clip"
target_skeleton = "@stout.skeleton"
map = "@map"

[nodes.free]
kind = "resolve_penetration"
mesh = "@stout.mesh"
skeleton = "@stout.skeleton"
weights = "@stout.weights"
clip = "@walk"
limits_deg = { left_forearm = 120 }
set = [{ frame = 2, joint = "head", rotation_deg = [0, 20, 0] }]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let (weights, clip) = (io.get(Self::WEIGHTS), io.get(Self::CLIP));
        mesh.check_has_faces()?;
        let options = self.options(&skeleton, &clip)?;
        let res = resolve_penetration(&mesh, &skeleton, &weights, &clip, &options)?;
        if res.n_crossing_at_rest > 0 {
            io.note(format!(
                "{} pairs of groups cross at rest and are left alone; {} are watched",
                res.n_crossing_at_rest, res.n_pairs
            ));
        }
        let unresolved = res.keys.iter().filter(|it| !it.unresolved.is_empty()).count();
        if unresolved > 0 {
            io.note(format!(
                "in {unresolved} of {} frames something still crosses: see `keys`",
                res.keys.len()
            ));
        }
        io.put(Self::SUMMARY, summary(&res));
        io.put(Self::KEYS, keys_table(&res.keys, &skeleton));
        io.put(Self::RESULT, res.clip);
        Ok(())
    }
}

fn summary(res: &ResolvedPenetration) -> Table {
    let keys = &res.keys;
    let column = |name, unit, value| Column::numbers(name, unit, vec![value]);
    let frames = |of: fn(&KeyReport) -> Crossings| {
        keys.iter().filter(|it| of(it).n_pairs > 0).count() as f64
    };
    let faces = |of: fn(&KeyReport) -> Crossings| {
        keys.iter().map(|it| of(it).n_faces).sum::<usize>() as f64
    };
    let turns = keys.iter().map(|it| it.largest_turn_rad.to_degrees());
    Table::new(vec![
        column("frames", "", keys.len() as f64),
        column("watched pairs", "", res.n_pairs as f64),
        column("frames before", "", frames(|it| it.before)),
        column("frames after", "", frames(|it| it.after)),
        column("crossings before", "", faces(|it| it.before)),
        column("crossings after", "", faces(|it| it.after)),
        column("largest turn", "°", turns.fold(0.0, f64::max)),
    ])
}

fn keys_table(keys: &[KeyReport], skeleton: &Skeleton) -> Table {
    let numbers = |of: &dyn Fn(&KeyReport) -> f64| keys.iter().map(of).collect::<Vec<f64>>();
    let names = skeleton.names();
    let unresolved = keys.iter().map(|key| {
        let pairs = key.unresolved.iter().map(|[a, b]| format!("{}/{}", names[*a], names[*b]));
        pairs.collect::<Vec<_>>().join(", ")
    });
    Table::new(vec![
        Column::numbers("frame", "", (0..keys.len()).map(|it| it as f64).collect()),
        Column::numbers("pairs before", "", numbers(&|it| it.before.n_pairs as f64)),
        Column::numbers("pairs after", "", numbers(&|it| it.after.n_pairs as f64)),
        Column::numbers("crossings before", "", numbers(&|it| it.before.n_faces as f64)),
        Column::numbers("crossings after", "", numbers(&|it| it.after.n_faces as f64)),
        Column::numbers("largest turn", "°", numbers(&|it| it.largest_turn_rad.to_degrees())),
        Column::numbers("sweeps", "", numbers(&|it| it.n_sweeps as f64)),
        Column::texts("unresolved", unresolved.collect()),
    ])
}
