//! Kind `skeletonize`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::curve_skeletons::coarse_skeleton::coarse_skeleton;
use crate::kernels::curve_skeletons::curve_skeleton::{CurveSkeleton, NO_NODE};
use crate::kernels::curve_skeletons::finish_skeleton::{FinishOptions, finish_skeleton};
use crate::kernels::curve_skeletons::local_separators::{
    self, LocalSeparatorsOptions, SpatialGraph, local_separators,
};
use crate::kernels::curve_skeletons::medial_skeleton::{MedialSkeletonOptions, medial_skeleton};
use crate::kernels::curve_skeletons::skeleton_cleanup::PruneOptions;
use crate::kernels::curve_skeletons::skeleton_placement::{self, PlacementOptions};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::table::{Column, Table};

/// Extracts the curve skeleton of a surface and makes it fit for joints: without cycles and spurs, in
/// the middle of limbs.
///
/// The surface may be open (not for `medial_balls`) or have several parts, but must have faces. A shape without any curve, such
/// as a ball, gets one node.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Skeletonize {
    /// How curves are found.
    pub method: Method,
    /// Of `local_separators`: on what separators are looked for.
    pub variant: Variant,
    /// Of `local_separators`: skip seeds that separators were found through. Without, it takes several
    /// times as long for hardly another result.
    pub sampling: bool,
    /// Of `local_separators`: the order of the seeds follows from it.
    pub seed: u64,
    /// Of `medial_balls`: the least angle between two places where a ball touches the surface, in
    /// degrees.
    #[schemars(range(min = 1.0, max = 179.0))]
    pub medial_angle: f64,
    /// Of `medial_balls`: curves go to what sticks out of the balls on other curves, made so many times
    /// larger.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub reach: f64,
    /// Decimate the mesh to so many vertices first; a mesh that has fewer is taken as it is.
    #[schemars(range(min = 4))]
    pub simplify_to: Option<usize>,
    /// What becomes of cycles.
    pub cycles: Cycles,
    /// Spurs of at most so many nodes, from the leaf to the junction, are removed.
    pub prune_nodes: usize,
    /// Spurs shorter than so many radii of the shape at their junction are removed.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub prune_radii: f64,
    /// Components of fewer nodes are removed; the largest one stays.
    pub min_nodes: usize,
    /// How nodes are moved to the middle; those of `medial_balls` are there already and stay.
    pub placement: Placement,
    /// The weight of distances from the lines through vertices along their normals.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub lambda_cpp: f64,
    /// The weight of distances from vertices.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub lambda_euc: f64,
    /// The weight of the lengths of edges; 200 with `smoothness = "absolute"` in the paper.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub lambda_s: f64,
    /// What `lambda_s` counts in.
    pub smoothness: Smoothness,
    /// Every edge counts for both of its nodes; for one without.
    pub edges_count_twice: bool,
    /// Move nodes that are outside of a closed surface into it.
    pub pull_inside: bool,
    /// Join components where they are closest.
    pub connect: bool,
    /// Joined nodes that are closer than this share of the bounding box's diagonal are united.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub merge: f64,
    /// Give the vertices of junctions to the curves around them.
    pub free_junctions: bool,
}

/// How curves are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Small sets of vertices that cut their surroundings apart, such as rings around limbs.
    #[default]
    LocalSeparators,
    /// Along the largest balls inside a closed surface: a tree that is inside and near the true bones, but
    /// has more spurs where the surface is noisy.
    MedialBalls,
}

/// On what separators are looked for.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Plain for parts of up to 2000 vertices, multiscale for larger ones.
    #[default]
    Auto,
    /// On the mesh itself. Time grows with the square of its size.
    Plain,
    /// On coarser and coarser graphs, too.
    Multiscale,
}

/// What becomes of cycles.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Cycles {
    /// Each becomes one node.
    #[default]
    Collapse,
    /// They stay.
    Keep,
}

/// How nodes are moved to the middle.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// They stay at the mean of their vertices.
    None,
    /// By squared distances.
    #[default]
    Squared,
    /// By plain distances, to which outliers matter less.
    Plain,
}

/// What the weight of edges counts in.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Smoothness {
    /// In the mean number of vertices of a node.
    #[default]
    Relative,
    /// In single vertices.
    Absolute,
}

impl Default for Skeletonize {
    fn default() -> Self {
        let finish = FinishOptions::default();
        let placement = finish.placement.unwrap_or_default();
        let search = LocalSeparatorsOptions::default();
        let medial = MedialSkeletonOptions::default();
        Self {
            method: Method::default(),
            variant: Variant::default(),
            sampling: search.sampling,
            seed: search.seed,
            medial_angle: medial.angle_deg,
            reach: medial.reach,
            simplify_to: None,
            cycles: Cycles::default(),
            prune_nodes: finish.prune.max_nodes,
            prune_radii: finish.prune.max_radii,
            min_nodes: finish.min_nodes,
            placement: Placement::default(),
            lambda_cpp: placement.lambda_cpp,
            lambda_euc: placement.lambda_euc,
            lambda_s: placement.lambda_s,
            smoothness: Smoothness::default(),
            edges_count_twice: placement.counts_edges_twice,
            pull_inside: finish.pull_inside,
            connect: finish.connect,
            merge: finish.merge_distance,
            free_junctions: finish.free_junctions,
        }
    }
}

impl Skeletonize {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const CURVES: Output<CurveSkeleton> = Output::new("curves", "its curve skeleton");
    const COUNTS: Output<Table> =
        Output::new("counts", "nodes, leaves, junctions and cycles, as found and as finished");

    fn raw(&self, mesh: &TriMesh) -> Result<CurveSkeleton, NodeError> {
        let most = self.simplify_to.unwrap_or(usize::MAX);
        Ok(match self.method {
            Method::LocalSeparators => {
                let options = self.separator_options();
                let extract = |it: &TriMesh| local_separators(&SpatialGraph::of_mesh(it), &options);
                coarse_skeleton(mesh, most, extract)?
            }
            Method::MedialBalls => {
                let options =
                    MedialSkeletonOptions { angle_deg: self.medial_angle, reach: self.reach };
                coarse_skeleton(mesh, most, |it| medial_skeleton(it, &options))?
            }
        })
    }

    fn separator_options(&self) -> LocalSeparatorsOptions {
        LocalSeparatorsOptions {
            variant: match self.variant {
                Variant::Auto => local_separators::Variant::Auto,
                Variant::Plain => local_separators::Variant::Plain,
                Variant::Multiscale => local_separators::Variant::Multiscale,
            },
            sampling: self.sampling,
            seed: self.seed,
        }
    }

    fn finish_options(&self, mesh: &TriMesh) -> FinishOptions {
        let norm = match self.placement {
            _ if self.method == Method::MedialBalls => None,
            Placement::None => None,
            Placement::Squared => Some(skeleton_placement::Norm::Squared),
            Placement::Plain => Some(skeleton_placement::Norm::Plain),
        };
        let (low, high) = mesh.bounds();
        FinishOptions {
            collapse_cycles: matches!(self.cycles, Cycles::Collapse),
            prune: PruneOptions { max_nodes: self.prune_nodes, max_radii: self.prune_radii },
            min_nodes: self.min_nodes,
            placement: norm.map(|norm| PlacementOptions {
                lambda_cpp: self.lambda_cpp,
                lambda_euc: self.lambda_euc,
                lambda_s: self.lambda_s,
                is_relative: matches!(self.smoothness, Smoothness::Relative),
                counts_edges_twice: self.edges_count_twice,
                norm,
            }),
            pull_inside: self.pull_inside,
            connect: self.connect,
            merge_distance: self.merge * (high - low).norm(),
            free_junctions: self.free_junctions,
        }
    }
}

impl Node for Skeletonize {
    const SPEC: Spec = Spec {
        kind: "skeletonize",
        version: 1,
        inputs: &[Self::MESH.port()],
        outputs: &[Self::CURVES.port(), Self::COUNTS.port()],
        cites: &[
            "baerentzen2021skeletonization",
            "baerentzen2023multilevel",
            "sato2000teasar",
            "ma2012medial",
        ],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1500

[nodes.skeletonize]
kind = "skeletonize"
mesh = "@body.mesh"

[nodes.skeleton]
kind = "rooted_skeleton"
curves = "@skeletonize.curves"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        mesh.check_has_faces()?;
        let raw = self.raw(&mesh)?;
        let finished = finish_skeleton(&raw, &mesh, &self.finish_options(&mesh))?;
        if raw.n_nodes() == 0 {
            io.note("no part of the shape is narrow enough for a curve: one node stands for all");
        }
        let n_lost = finished.node_of_vertex().iter().filter(|it| **it == NO_NODE).count();
        if n_lost > 0 {
            let n_vertices = mesh.n_vertices();
            io.note(format!("{n_lost} of {n_vertices} vertices belong to no curve"));
        }
        io.put(Self::COUNTS, counts(&raw, &finished));
        io.put(Self::CURVES, finished);
        Ok(())
    }
}

fn counts(raw: &CurveSkeleton, finished: &CurveSkeleton) -> Table {
    let both = [raw, finished];
    let count = |name, of: &dyn Fn(&CurveSkeleton) -> usize| {
        Column::numbers(name, "", both.iter().map(|&it| of(it) as f64).collect())
    };
    Table::new(vec![
        Column::texts("skeleton", vec!["found".to_owned(), "finished".to_owned()]),
        count("nodes", &CurveSkeleton::n_nodes),
        count("components", &CurveSkeleton::n_components),
        count("leaves", &|it| it.leaves().len()),
        count("junctions", &|it| it.junctions().len()),
        count("cycles", &CurveSkeleton::n_cycles),
        Column::numbers("length", "", both.iter().map(|it| it.total_length() + 0.0).collect()),
    ])
}
