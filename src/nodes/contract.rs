//! Kind `contract`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::curve_skeletons::contract::{
    CollapseOptions, ContractOptions, ContractionSkeleton, FinishOptions, Neighbors, RingSize,
    Schedule, Stop, coarse_contraction, finish,
};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::curve_skeletons::skeleton_cleanup::PruneOptions;
use crate::kernels::curve_skeletons::skeleton_placement::PlacementOptions;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::table::{Column, Table};

/// Extracts curve skeletons by contraction, of surfaces and of point clouds.
///
/// The shape is drawn together until it is as thin as curves, and its triangles are collapsed to a
/// graph; of a cloud, a mesh without faces, triangles are found around every point. Surfaces may be
/// open, clouds noisy, with holes and one-sided. Every connected part has a skeleton; rings keep
/// their cycles.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contract {
    /// Of larger shapes so many points are taken: a mesh is decimated, a cloud thinned out evenly, each
    /// point at the mean of those it stands for, which takes off the noise of scanners, too.
    #[schemars(range(min = 8))]
    pub simplify_to: usize,
    /// Of clouds: how many of the nearest points make the surface around one.
    pub neighbors: NeighborRule,
    /// Of clouds: so many of the nearest points instead.
    #[schemars(range(min = 4, max = 100))]
    pub n_neighbors: Option<usize>,
    /// Of clouds: pass over points of other sheets that come near, such as the next finger.
    pub separate_sheets: bool,
    /// How strongly points are drawn together and held.
    pub schedule: ScheduleRule,
    /// The first weight of the Laplacian over the inverse of the mean edge of the shape in a box of
    /// side 1.6, instead of the schedule's.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub first_weight: Option<f64>,
    /// By how much the weight grows every time, instead of the schedule's.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub growth: Option<f64>,
    /// The most contractions.
    #[schemars(range(min = 1, max = 1000))]
    pub max_iterations: usize,
    /// Stop when the mean size of rings falls by less than this part of the first…
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_gain: f64,
    /// …or the area is less than this part of the first.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_area: f64,
    /// When edges collapse: the weight of distances from the lines of edges that went.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub shape_weight: f64,
    /// When edges collapse: the weight of lengths, for which nodes lie evenly.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub sampling_weight: f64,
    /// Unite junctions with a neighbour if distances from the surface then differ by less than this
    /// part of what they did; 0 for never.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub merge_junctions: f64,
    /// Unite nodes that are closer than this part of the shape's radius around them.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub spacing: f64,
    /// Move nodes to the middle: of the rings between their regions, then of closed surfaces to where
    /// rays across the curve go equally far, and of clouds to the middle of the circle that the points
    /// around the curve fit best, with new nodes in long edges.
    pub recenter: bool,
    /// What becomes of cycles.
    pub cycles: ContractedCycles,
    /// Spurs of at most so many nodes, from the leaf to the junction, are removed.
    pub prune_nodes: usize,
    /// Spurs shorter than so many radii of the shape at their junction are removed.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub prune_radii: f64,
    /// Move nodes to where the normals of their vertices meet, for surfaces of which only one side was
    /// seen. On others rings, rays and circles tell the middle better; rays and circles are left out
    /// then.
    pub place_by_normals: bool,
    /// With `place_by_normals`: the weight of the lengths of edges, in the mean number of vertices of
    /// a node.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub smoothness: f64,
    /// Move nodes that are outside of a closed surface into it, and bend edges that leave it.
    pub pull_inside: bool,
    /// Join the skeletons of parts where they are closest.
    pub connect: bool,
    /// Parts of fewer than this share of all points have no skeleton; those of fewer than 8 points
    /// never have.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_part: f64,
}

/// How many of the nearest points make the surface around one.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NeighborRule {
    /// 2 % of all points, 8 to 12.
    #[default]
    Madaras,
    /// 1.2 % of all points, 8 to 30.
    Cao,
}

/// How strongly points are drawn together and held.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScheduleRule {
    /// Of Au et al. for surfaces, of Cao et al. for clouds.
    #[default]
    Auto,
    /// Of Au et al.: slower growth, anchors by the areas of rings.
    Au,
    /// Of Cao et al.: faster growth, anchors by the shortest edges of rings.
    Cao,
}

/// What becomes of cycles.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContractedCycles {
    /// Those of at most six nodes become one node.
    #[default]
    Short,
    /// Each becomes one node.
    Collapse,
    /// They stay.
    Keep,
}

impl Default for Contract {
    fn default() -> Self {
        let (options, finish) = (ContractOptions::default(), FinishOptions::default());
        let schedule = Schedule::of_meshes();
        Self {
            simplify_to: 6000,
            neighbors: NeighborRule::default(),
            n_neighbors: None,
            separate_sheets: options.separate_sheets,
            schedule: ScheduleRule::default(),
            first_weight: None,
            growth: None,
            max_iterations: schedule.max_iterations,
            least_gain: schedule.least_gain,
            least_area: schedule.least_area,
            shape_weight: options.collapse.shape,
            sampling_weight: options.collapse.sampling,
            merge_junctions: options.merge_junctions,
            spacing: options.spacing,
            recenter: options.recenter,
            cycles: ContractedCycles::default(),
            prune_nodes: finish.prune.max_nodes,
            prune_radii: finish.prune.max_radii,
            place_by_normals: false,
            smoothness: 0.2,
            pull_inside: finish.pull_inside,
            connect: finish.connect,
            min_part: 0.01,
        }
    }
}

impl Contract {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface, or points without faces");
    const CURVES: Output<CurveSkeleton> = Output::new("curves", "its curve skeleton");
    const REPORT: Output<Table> =
        Output::new("report", "one row a contraction: the weight, sizes of rings, area");
    const COUNTS: Output<Table> =
        Output::new("counts", "nodes, leaves, junctions and cycles, as found and as finished");

    fn options(&self, shape: &TriMesh) -> ContractOptions {
        let is_cloud = shape.is_point_cloud();
        let mut schedule = match (self.schedule, is_cloud) {
            (ScheduleRule::Au, _) | (ScheduleRule::Auto, false) => Schedule::of_meshes(),
            (ScheduleRule::Cao, _) | (ScheduleRule::Auto, true) => Schedule::of_clouds(),
        };
        if is_cloud {
            // Triangles of a cloud do not fit each other; the areas of rings tell little.
            schedule.ring_size = RingSize::ShortestEdge;
        }
        schedule.first_weight = self.first_weight.unwrap_or(schedule.first_weight);
        schedule.growth = self.growth.unwrap_or(schedule.growth);
        schedule.max_iterations = self.max_iterations;
        schedule.least_gain = self.least_gain;
        schedule.least_area = self.least_area;
        let rule = match self.neighbors {
            NeighborRule::Madaras => Neighbors::default(),
            NeighborRule::Cao => Neighbors { share: 0.012, least: 8, most: 30 },
        };
        let fixed = |count| Neighbors { share: 0.0, least: count, most: count };
        let n_points = self.simplify_to.min(shape.n_vertices());
        ContractOptions {
            neighbors: self.n_neighbors.map_or(rule, fixed),
            separate_sheets: self.separate_sheets,
            schedule: Some(schedule),
            collapse: CollapseOptions { shape: self.shape_weight, sampling: self.sampling_weight },
            merge_junctions: self.merge_junctions,
            spacing: self.spacing,
            recenter: self.recenter,
            min_points: (self.min_part * n_points as f64).ceil() as usize,
        }
    }

    fn finish_options(&self) -> FinishOptions {
        let default = FinishOptions::default();
        let placement =
            PlacementOptions { lambda_s: self.smoothness, is_relative: true, ..Default::default() };
        FinishOptions {
            max_cycle_nodes: match self.cycles {
                ContractedCycles::Short => default.max_cycle_nodes,
                ContractedCycles::Collapse => usize::MAX,
                ContractedCycles::Keep => 0,
            },
            prune: PruneOptions { max_nodes: self.prune_nodes, max_radii: self.prune_radii },
            placement: self.place_by_normals.then_some(placement),
            center: default.center.filter(|_| self.recenter && !self.place_by_normals),
            pull_inside: self.pull_inside,
            connect: self.connect,
        }
    }
}

impl Node for Contract {
    const SPEC: Spec = Spec {
        kind: "contract",
        version: 3,
        inputs: &[Self::MESH.port()],
        outputs: &[Self::CURVES.port(), Self::REPORT.port(), Self::COUNTS.port()],
        cites: &["au2008skeleton", "cao2010point", "madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1500

[nodes.contract]
kind = "contract"
mesh = "@body.mesh"

[nodes.cloud]
kind = "point_cloud"
mesh = "@body.mesh"

[nodes.contract_cloud]
kind = "contract"
mesh = "@cloud.mesh"

[nodes.skeleton]
kind = "rooted_skeleton"
curves = "@contract_cloud.curves"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let shape = io.get(Self::MESH);
        let options = self.options(&shape);
        let found = coarse_contraction(&shape, self.simplify_to, &options)?;
        for note in notes(&found) {
            io.note(note);
        }
        let finished = finish(&found, &shape, &self.finish_options())?;
        io.put(Self::REPORT, report(&found));
        io.put(Self::COUNTS, counts(&found.skeleton, &finished));
        io.put(Self::CURVES, finished);
        Ok(())
    }
}

fn notes(found: &ContractionSkeleton) -> Vec<String> {
    let mut notes = Vec::new();
    let n_points = found.skeleton.node_of_vertex().len();
    if found.n_duplicates > 0 {
        let n_duplicates = found.n_duplicates;
        notes.push(format!("{n_duplicates} of {n_points} points are at the place of another"));
    }
    if found.n_lost > 0 {
        notes.push(format!("{} of {n_points} points belong to no curve", found.n_lost));
    }
    if found.parts.len() > 1 {
        notes.push(format!("{} parts, each with a skeleton of its own", found.parts.len()));
    }
    for (part, report) in found.parts.iter().enumerate() {
        let what = match report.stop {
            Stop::Thin | Stop::Settled => continue,
            Stop::Iterations => "is not yet thin after the most contractions",
            Stop::Unsolvable => "could not be contracted further: weights are too far apart",
            Stop::Unstable => "became larger: the last contraction was taken back",
        };
        notes.push(format!("part {part} of {} points {what}", report.n_points));
    }
    notes
}

fn report(found: &ContractionSkeleton) -> Table {
    let rows: Vec<[f64; 5]> = found
        .parts
        .iter()
        .enumerate()
        .flat_map(|(part, report)| {
            report.steps.iter().enumerate().map(move |(step, it)| {
                [part as f64, (step + 1) as f64, it.weight, it.size_ratio, it.area_ratio]
            })
        })
        .collect();
    let names = ["part", "iteration", "weight", "ring size", "area"];
    let column = |it: usize| rows.iter().map(|row| row[it]).collect();
    Table::new((0..5).map(|it| Column::numbers(names[it], "", column(it))).collect())
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
