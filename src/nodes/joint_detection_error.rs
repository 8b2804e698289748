//! Kind `joint_detection_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInputs, Output, Spec};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::matching::joint_detection::{Detection, DetectionOptions, joint_detection};
use crate::kernels::matching::moving_joints::Moving;
use crate::kernels::rigs::clip::Clip;
use crate::kernels::rigs::joint_error::{HeightAxis, height};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Measures how many of the joints that move were detected, and how near.
///
/// True joints are those of the rig that turn against their parent in its `motions`. Without these they are where
/// the rig bends between its `poses`: roll about bones does not count then, and whether its ends turn, as hooves and
/// heads may, places of joints do not tell, so that what is detected there is neither right nor wrong. A true and a
/// detected joint that are near enough make a pair, the nearest first.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JointDetectionError {
    /// True joints turn by more than this against the pose of `truth`, in degrees.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub min_angle: f64,
    /// The farthest that a detected joint may be from a true one, in percent of the height.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub tolerance: f64,
    /// What counts as the height.
    pub height: HeightAxis,
}

impl Default for JointDetectionError {
    fn default() -> Self {
        Self { min_angle: 15.0, tolerance: 2.0, height: HeightAxis::default() }
    }
}

impl JointDetectionError {
    const DETECTED: Input<Table> =
        Input::new("detected", "detected joints: columns `x`, `y`, `z`, as `joints` makes them");
    const TRUTH: Input<Skeleton> = Input::new("truth", "the rig, in the pose of these places");
    const POSES: OptionalInputs<Skeleton> =
        OptionalInputs::new("poses", "the rig in all poses, if its motions are not known");
    const MOTIONS: OptionalInputs<Clip> =
        OptionalInputs::new("motions", "how the rig moves; its first pose is that of `truth`");
    const MESH: Input<TriMesh> = Input::new("mesh", "the shape, for its height");
    const JOINTS: Output<Table> =
        Output::new("joints", "one row a joint that moves, then one for each other detection");
    const SUMMARY: Output<Table> =
        Output::new("summary", "one row: counts, precision, recall, distances");
}

impl Node for JointDetectionError {
    const SPEC: Spec = Spec {
        kind: "joint_detection_error",
        version: 4,
        inputs: &[
            Self::DETECTED.port(),
            Self::TRUTH.port(),
            Self::POSES.port(),
            Self::MOTIONS.port(),
            Self::MESH.port(),
        ],
        outputs: &[Self::SUMMARY.port(), Self::JOINTS.port()],
        cites: &["madaras2014skeleton"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.joints]
kind = "joints"
skeleton = "@body.skeleton"
clip = "@body.clip"

[nodes.bent]
kind = "pose"
mesh = "@body.mesh"
skeleton = "@body.skeleton"
weights = "@body.weights"
turns = { left_leg = [60, 0, 0], right_leg = [40, 0, 0] }

[nodes.score]
kind = "joint_detection_error"
detected = "@joints.joints"
truth = "@body.skeleton"
poses = ["@bent.skeleton"]
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (table, truth) = (io.get(Self::DETECTED), io.get(Self::TRUTH));
        let failed =
            |error: crate::kernels::table::TableError| NodeError::failed(error.to_string());
        let mut places = vec![Vec3::zeros(); table.n_data_rows()];
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let values = table.numbers(name, "a place").map_err(failed)?;
            for (place, value) in places.iter_mut().zip(values) {
                place[axis] = *value;
            }
        }
        if let Some(row) = places.iter().position(|it| it.iter().any(|it| !it.is_finite())) {
            return Err(NodeError::failed(format!("row {row} of `detected` is no place")));
        }
        let height = height(&io.get(Self::MESH), self.height);
        if !(height > 0.0) {
            return Err(NodeError::failed("the mesh has no extent along the chosen axis"));
        }
        let moving = self.moving(io, &truth)?;
        if moving.joints.is_empty() {
            io.note(format!("no joint of the rig turns by more than {} degrees", self.min_angle));
        }
        let options = DetectionOptions { tolerance: self.tolerance, height };
        let res = joint_detection(&places, moving, &options);
        io.put(Self::JOINTS, joints_table(&res));
        io.put(Self::SUMMARY, summary(&res));
        Ok(())
    }
}

impl JointDetectionError {
    fn moving(&self, io: &NodeIo<'_>, truth: &Skeleton) -> Result<Moving, NodeError> {
        let motions = io.get_all_optional(Self::MOTIONS);
        let motions: Vec<&Clip> = motions.iter().map(|it| &**it).collect();
        let poses = io.get_all_optional(Self::POSES);
        let poses: Vec<_> = poses.iter().map(|it| it.positions().to_vec()).collect();
        match (motions.is_empty(), poses.is_empty()) {
            (false, _) => Ok(Moving::by_turns(truth, &motions, self.min_angle)?),
            (true, false) => Ok(Moving::by_places(truth, &poses, self.min_angle)?),
            (true, true) => Err(NodeError::failed("there are neither `motions` nor `poses`")),
        }
    }
}

fn joints_table(res: &Detection) -> Table {
    let others: Vec<(usize, &str)> = (res.wrong.iter().map(|&it| (it, "wrong")))
        .chain(res.unknown.iter().map(|&it| (it, "not known")))
        .collect();
    let n_others = others.len();
    let number = |name: &str, unit: &str, of: &dyn Fn(usize) -> f64| {
        let known = (0..res.truth.len()).map(of);
        Column::numbers(name, unit, known.chain(std::iter::repeat_n(f64::NAN, n_others)).collect())
    };
    let texts = |name: &str, of: &dyn Fn(usize) -> String, other: &dyn Fn(usize) -> String| {
        let known = (0..res.truth.len()).map(of);
        Column::texts(name, known.chain((0..n_others).map(other)).collect())
    };
    let outcome = |it: usize| match res.truth[it].found {
        Some(_) => "found".to_owned(),
        None => "missed".to_owned(),
    };
    let distance = |it: usize| match res.truth[it].distance {
        it if it.is_finite() => it,
        _ => f64::NAN,
    };
    Table::new(vec![
        texts("joint", &|it| res.truth[it].joint.name.clone(), &|it| {
            format!("row {}", others[it].0)
        }),
        texts("outcome", &outcome, &|it| others[it].1.to_owned()),
        number("angle", "°", &|it| res.truth[it].joint.angle),
        number("distance of height", "%", &distance),
    ])
}

fn summary(res: &Detection) -> Table {
    let distances = res.distances();
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    let greatest = distances.iter().copied().fold(f64::NAN, f64::max);
    let number = |name, unit, value| Column::numbers(name, unit, vec![value]);
    Table::new(vec![
        number("true joints", "", res.truth.len() as f64),
        number("detected", "", res.n_detected as f64),
        number("not known", "", res.unknown.len() as f64),
        number("found", "", res.n_found() as f64),
        number("precision", "", res.precision()),
        number("recall", "", res.recall()),
        number("mean of height", "%", mean),
        number("max of height", "%", greatest),
    ])
}
