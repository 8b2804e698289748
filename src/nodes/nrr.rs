//! Kind `nrr`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::sensors::depth::DepthVideo;
use crate::kernels::sensors::registration::{
    FrameReport, NrrOptions, PaperOptions, Solver, SourceOptions, source_mesh, track,
};
use crate::kernels::table::{Column, Table};

/// How frames are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NrrSolver {
    /// Gauss-Newton steps on point-to-plane pairs, from coarse to fine.
    GaussNewton,
    /// Transfer4D as published: Adam on the chamfer distance. Slower, and it takes hidden parts of the
    /// surface for seen ones; for comparison.
    Paper,
}

/// Follows a surface through a depth video by non-rigid registration.
///
/// An embedded deformation graph is fitted to frame after frame by Gauss-Newton steps: first rigidly,
/// then on graphs of four, two and one `spacing`. A frame that was not found is reported as
/// lost, and the surface stays as in the one before unless it got nearer. With `solver = "paper"` it is done as Transfer4D's paper does; of the other
/// parameters those of the source, `spacing`, `smoothness`, `samples`, `erosion`, `seed` and the ones
/// that name the paper count then. Lengths are for a surface whose box has a diagonal of 2 m and are scaled
/// with it, except for those in metres.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Nrr {
    /// The frame in which the surface is seen first; tracking goes forward and backward from it.
    pub source_frame: usize,
    /// Without a `source`: the longest edge of the surface that is made, in metres; by default, and with
    /// 0, `gate` times `stride`. Less keeps a hand apart from what it hangs before, in exact films.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub max_edge: Option<f64>,
    /// Without a `source`: only every so many columns and rows are used.
    #[schemars(range(min = 1, max = 64))]
    pub stride: usize,
    /// How frames are fitted.
    pub solver: NrrSolver,
    /// The distance between the nodes of the finest graph.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub spacing: f64,
    /// Outer iterations on each level.
    #[schemars(range(min = 1, max = 200))]
    pub iterations: usize,
    /// The weight of smoothness against 1000 times the mean squared distance; by default 2, with the
    /// paper's solver 10. Fast limbs want less.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0001, max = 100_000.0))]
    pub smoothness: Option<f64>,
    /// The farthest that a frame's first pairs are apart; more follows faster motion.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub reach: f64,
    /// The farthest that a frame's last pairs are apart.
    #[schemars(range(min = 0.001, max = 10.0))]
    pub final_reach: f64,
    /// The largest angle between normals of a pair, in degrees.
    #[schemars(range(min = 1.0, max = 180.0))]
    pub max_angle: f64,
    /// The step in depth that separates surfaces, in metres; above the step of the sensor. By default
    /// one and a half times what 90 % of neighbouring pixels of the source frame differ by, at least 0.05.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0001, max = 10.0))]
    pub gate: Option<f64>,
    /// How many pixels around each one its depth is averaged over.
    #[schemars(range(max = 10))]
    pub smoothing: usize,
    /// The weight of pairs from bare target points to the surface.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub reverse: f64,
    /// How many vertices carry data at most; with the paper's solver also how many points of a frame.
    #[schemars(range(min = 10, max = 1_000_000))]
    pub samples: usize,
    /// How far a frame may start ahead of the one before, as a share of the last motion; parts that were
    /// hidden do not. What is nearer to the frame is taken.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub momentum: f64,
    /// Rounds of erosion before nodes are placed.
    #[schemars(range(max = 100))]
    pub erosion: usize,
    /// The least share of what is seen of the surface that lies on the subject; below, the subject is
    /// sought anew, and else the frame is lost.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_overlap: f64,
    /// The decrease of the energy, relative, at which a level is done.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub tolerance: f64,
    /// Decides on the trials when the subject is sought anew, and on what the paper's solver samples.
    pub seed: u64,
    /// The paper's solver: Adam's steps in every frame.
    #[schemars(range(min = 1, max = 100_000))]
    pub steps: usize,
    /// The paper's solver: the first step in metres and radians.
    #[schemars(range(min = 0.000001, max = 10.0))]
    pub learning_rate: f64,
    /// The paper's solver: what a step is of the one before.
    #[schemars(range(min = 0.1, max = 1.0))]
    pub decay: f64,
    /// The paper's solver: the squared distance from which pairs do not count.
    #[schemars(range(min = 0.000001, max = 1000.0))]
    pub truncation: f64,
    /// The paper's solver: the weight of nodes' mean squared change of translation from frame to frame.
    #[schemars(range(min = 0.0, max = 100_000.0))]
    pub steady_translation: f64,
    /// The paper's solver: the weight of nodes' mean squared change of rotation from frame to frame.
    #[schemars(range(min = 0.0, max = 100_000.0))]
    pub steady_rotation: f64,
}

impl Default for Nrr {
    fn default() -> Self {
        let (options, paper) = (NrrOptions::default(), PaperOptions::default());
        Self {
            source_frame: 0,
            max_edge: None,
            stride: 1,
            solver: NrrSolver::GaussNewton,
            spacing: options.spacing,
            iterations: options.iterations,
            smoothness: None,
            reach: options.reach,
            final_reach: options.final_reach,
            max_angle: options.max_angle_deg,
            gate: options.gate,
            smoothing: options.smoothing,
            reverse: options.reverse,
            samples: options.n_samples,
            momentum: options.momentum,
            erosion: options.erosion,
            least_overlap: options.least_overlap,
            tolerance: options.tolerance,
            seed: options.seed,
            steps: paper.n_steps,
            learning_rate: paper.learning_rate,
            decay: paper.decay,
            truncation: paper.truncation,
            steady_translation: paper.steady_translation,
            steady_rotation: paper.steady_rotation,
        }
    }
}

impl Nrr {
    const VIDEO: Input<DepthVideo> = Input::new("video", "the subject alone, cut out");
    const SOURCE: OptionalInput<TriMesh> = OptionalInput::new(
        "source",
        "its surface in camera space as in `source_frame`; made from that frame if not given",
    );
    const SEQUENCE: Output<MeshSequence> =
        Output::new("sequence", "the surface in every frame, in camera space");
    const SOURCE_MESH: Output<TriMesh> = Output::new("mesh", "the surface in the source frame");
    const REPORT: Output<Table> =
        Output::new("report", "one row a frame: residual, coverage, overlap, whether it is lost");

    fn source_options(&self) -> SourceOptions {
        let Self { stride, gate, smoothing, .. } = *self;
        let max_edge = self.max_edge.filter(|it| *it > 0.0);
        SourceOptions { max_edge, stride, gate, smoothing }
    }

    fn solver(&self) -> Solver {
        match self.solver {
            NrrSolver::GaussNewton => Solver::GaussNewton,
            NrrSolver::Paper => Solver::Paper(PaperOptions {
                n_steps: self.steps,
                learning_rate: self.learning_rate,
                decay: self.decay,
                smoothness: self.smoothness.unwrap_or(PaperOptions::default().smoothness),
                steady_translation: self.steady_translation,
                steady_rotation: self.steady_rotation,
                n_samples: self.samples,
                truncation: self.truncation,
            }),
        }
    }

    fn options(&self) -> NrrOptions {
        NrrOptions {
            solver: self.solver(),
            spacing: self.spacing,
            iterations: self.iterations,
            smoothness: self.smoothness.unwrap_or(NrrOptions::default().smoothness),
            reach: self.reach,
            final_reach: self.final_reach,
            max_angle_deg: self.max_angle,
            gate: self.gate,
            smoothing: self.smoothing,
            reverse: self.reverse,
            n_samples: self.samples,
            momentum: self.momentum,
            erosion: self.erosion,
            least_overlap: self.least_overlap,
            tolerance: self.tolerance,
            seed: self.seed,
        }
    }
}

fn report_table(reports: &[FrameReport]) -> Table {
    let numbers = |name: &str, unit: &str, of: &dyn Fn(&FrameReport) -> f64| {
        Column::numbers(name, unit, reports.iter().map(of).collect())
    };
    let flag = |it: bool| f64::from(u8::from(it));
    Table::new(vec![
        Column::numbers("frame", "", (0..reports.len()).map(|it| it as f64).collect()),
        numbers("residual", "m", &|it| it.residual),
        numbers("coverage", "", &|it| it.coverage),
        numbers("iou", "", &|it| it.iou),
        numbers("overlap", "", &|it| it.overlap),
        numbers("visible", "", &|it| it.visible),
        numbers("paired", "", &|it| it.paired),
        numbers("lost", "", &|it| flag(it.is_lost)),
        numbers("relocalized", "", &|it| flag(it.is_relocalized)),
        numbers("iterations", "", &|it| it.n_iterations as f64),
    ])
}

impl Node for Nrr {
    const SPEC: Spec = Spec {
        kind: "nrr",
        version: 3,
        inputs: &[Self::VIDEO.port(), Self::SOURCE.port()],
        outputs: &[Self::SEQUENCE.port(), Self::SOURCE_MESH.port(), Self::REPORT.port()],
        cites: &["maheshwari2023transfer4d", "li2008global"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.film]
kind = "render_depth"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
clip = "@body.clip"
frames = 3
width = 160
height = 120

[nodes.tracked]
kind = "nrr"
video = "@film.video"
spacing = 0.1
gate = 0.15
max_edge = 0.15
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let video = io.get(Self::VIDEO);
        let source = match io.get_optional(Self::SOURCE) {
            Some(source) => TriMesh::clone(&source),
            None => source_mesh(&video, self.source_frame, &self.source_options())?,
        };
        let tracked = track(&video, &source, self.source_frame, &self.options())?;
        let lost: Vec<String> = (tracked.reports.iter().enumerate())
            .filter(|it| it.1.is_lost)
            .map(|it| it.0.to_string())
            .collect();
        if !lost.is_empty() {
            io.note(format!("{} frames are lost: {}", lost.len(), lost.join(", ")));
        }
        io.note(format!("{} vertices, {} nodes", source.n_vertices(), tracked.n_nodes));
        io.put(Self::REPORT, report_table(&tracked.reports));
        io.put(Self::SEQUENCE, tracked.sequence);
        io.put(Self::SOURCE_MESH, source);
        Ok(())
    }
}
