//! Kind `union_skeleton`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Labelled, LabelledInputs, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::matching::skeleton_match::{MatchOptions, Partial};
use crate::kernels::matching::union_skeleton::{
    Union, UnionOptions, clip_of_places, union_skeleton,
};
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Unites the skeletons of a figure in several poses: one skeleton with the joints and limbs of all.
///
/// Skeletons are matched, and joints at like places along matched branches become one. Then each pose
/// gets a place for every joint, at the same share of its branch; the clip has a frame for each pose, in
/// the order of the inputs. It moves joints exactly, but its turns are only the smallest that do.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UnionSkeleton {
    /// The pose that the united skeleton is in, from 0; the straightest one if it is left out.
    pub reference: Option<usize>,
    /// Joints are one that are nearer than this share of a bone, and each other's nearest.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub threshold: f64,
    /// Branch nodes are one whose way to each other is shorter than this share of the longest way through
    /// the skeleton; poses and noise decide about their order. 0 leaves all of them apart.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub hub: f64,
    /// The figure may be turned about the y axis from pose to pose.
    pub turn: bool,
    /// When parts of a skeleton may stay unmatched; they are grafted on.
    pub partial: Partial,
}

impl Default for UnionSkeleton {
    fn default() -> Self {
        let it = UnionOptions::default();
        Self {
            reference: it.reference,
            threshold: it.threshold,
            hub: it.hub,
            turn: false,
            partial: it.matching.partial,
        }
    }
}

impl UnionSkeleton {
    const SKELETONS: LabelledInputs<Skeleton> =
        LabelledInputs::new("skeletons", "the skeletons, one a pose");
    const SKELETON: Output<Skeleton> = Output::new("skeleton", "the union, in the reference pose");
    const CLIP: Output<Clip> = Output::new("clip", "the union in every pose, a frame each");
    const POSES: Output<Table> =
        Output::new("poses", "one row a pose: how it matched, how many joints it does not show");
    const NODES: Output<Table> = Output::new(
        "nodes",
        "one row a joint: in how many poses it was found, and which do not show its limb",
    );
}

impl Node for UnionSkeleton {
    const SPEC: Spec = Spec {
        kind: "union_skeleton",
        version: 2,
        inputs: &[Self::SKELETONS.port()],
        outputs: &[
            Self::SKELETON.port(),
            Self::CLIP.port(),
            Self::POSES.port(),
            Self::NODES.port(),
        ],
        cites: &["madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
pose = "random"

[nodes.union]
kind = "union_skeleton"
skeletons = ["@body.skeleton", "@other.skeleton"]
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let gathered = io.get_labelled(Self::SKELETONS);
        let mut poses: Vec<(String, &Skeleton)> = Vec::new();
        for (index, it) in gathered.iter().enumerate() {
            match it.value.as_deref() {
                Ok(skeleton) => poses.push((label(it, index), skeleton)),
                Err(why) => io.note(format!("pose {} is missing: {why}", label(it, index))),
            }
        }
        let skeletons: Vec<&Skeleton> = poses.iter().map(|it| it.1).collect();
        let union = union_skeleton(&skeletons, &self.options())?;
        let reference = &poses[union.reference].0;
        io.note(format!("the union is in pose {reference}"));
        let n_hidden = union.is_observed.iter().flatten().filter(|it| !**it).count();
        if n_hidden > 0 {
            io.note(format!("{n_hidden} places of joints in poses were brought from other poses"));
        }
        let labels: Vec<String> = poses.iter().map(|it| it.0.clone()).collect();
        io.put(Self::POSES, poses_table(&union, &labels));
        io.put(Self::NODES, nodes_table(&union, &labels));
        io.put(Self::CLIP, clip_of_places(&union.skeleton, &union.places, "poses"));
        io.put(Self::SKELETON, union.skeleton);
        Ok(())
    }
}

impl UnionSkeleton {
    fn options(&self) -> UnionOptions {
        let matching = MatchOptions {
            partial: self.partial,
            turn_axis: self.turn.then(Vec3::y),
            ..UnionOptions::default().matching
        };
        UnionOptions {
            matching,
            threshold: self.threshold,
            hub: self.hub,
            reference: self.reference,
        }
    }
}

/// The items of the axes that a pose belongs to, or its number from 0.
fn label(gathered: &Labelled<Skeleton>, index: usize) -> String {
    let items: Vec<&str> = gathered.labels.iter().map(|it| &*it.1).collect();
    if items.is_empty() { index.to_string() } else { items.join(" ") }
}

fn poses_table(union: &Union, labels: &[String]) -> Table {
    let rating = |side: usize| {
        let value = |it: &Option<([f64; 2], usize)>| it.map_or(f64::NAN, |it| it.0[side]);
        union.ratings.iter().map(value).collect()
    };
    let nearest =
        |it: &Option<([f64; 2], usize)>| it.map_or(String::new(), |it| labels[it.1].clone());
    let hidden = |it: &Vec<bool>| it.iter().filter(|it| !**it).count() as f64;
    Table::new(vec![
        Column::texts("pose", labels.to_vec()),
        Column::numbers("branches rating", "", rating(0)),
        Column::numbers("places rating", "", rating(1)),
        Column::texts("matched in pose", union.ratings.iter().map(nearest).collect()),
        Column::numbers("hidden joints", "", union.is_observed.iter().map(hidden).collect()),
    ])
}

fn nodes_table(union: &Union, labels: &[String]) -> Table {
    let n_joints = union.skeleton.n_joints();
    let hidden = |joint: usize| {
        let poses = union.is_observed.iter().zip(labels).filter(|it| !it.0[joint]);
        poses.map(|it| it.1.as_str()).collect::<Vec<_>>().join(", ")
    };
    Table::new(vec![
        Column::texts("joint", union.skeleton.names().to_vec()),
        Column::numbers("poses", "", union.counts.iter().map(|&it| it as f64).collect()),
        Column::texts("hidden in", (0..n_joints).map(hidden).collect()),
    ])
}
