//! Kind `landmarks_auto`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::geometry::landmarks::Landmarks;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::maps::landmarks_auto::{BodyPlan, FindOptions, Finding, find_landmarks};
use crate::kernels::table::{Column, Table};

/// Finds the landmarks of a body without a rig: head, hands, feet, and the front and back of its chest.
///
/// What sticks out are persistent maxima of the mean distance along the surface; distances between
/// their tips, which no pose changes, tell head, arms and legs apart. Front is where the feet point
/// and the knees bend (of a quadruped, where the head is), and front and up tell left from right. No
/// axis of the file is trusted: the body may lie or hang.
///
/// Names and order are those of `synthesize` and `make_body`: `head_top`, `hand_left`, `hand_right`,
/// `foot_left`, `foot_right`, `chest_front`, `chest_back`. Quadrupeds also get `nose` and `tail_tip`;
/// their hands are the fore feet, and `chest_front` is below the withers, which are `chest_back`.
///
/// What is not clear fails: no body, a missing limb, limbs that touch, feet without a direction, a
/// surface that is inside out. Parts that are not connected are joined where they come close;
/// `clean` removes others.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LandmarksAuto {
    /// The body plan.
    #[serde(default)]
    pub body: Plan,
    /// The body's front, roughly. It replaces what feet and knees show; of a quadruped, it tells the
    /// head from the tail.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub front: Option<Front>,
}

/// The plan of a body.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Plan {
    /// A head, two arms, two legs.
    #[default]
    Biped,
    /// A head, four legs, perhaps a tail.
    Quadruped,
}

/// A direction along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Front {
    /// Along x.
    #[serde(rename = "+x")]
    PlusX,
    /// Against x.
    #[serde(rename = "-x")]
    MinusX,
    /// Along y.
    #[serde(rename = "+y")]
    PlusY,
    /// Against y.
    #[serde(rename = "-y")]
    MinusY,
    /// Along z.
    #[serde(rename = "+z")]
    PlusZ,
    /// Against z.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Front {
    fn direction(self) -> Vec3 {
        match self {
            Front::PlusX => Vec3::x(),
            Front::MinusX => -Vec3::x(),
            Front::PlusY => Vec3::y(),
            Front::MinusY => -Vec3::y(),
            Front::PlusZ => Vec3::z(),
            Front::MinusZ => -Vec3::z(),
        }
    }
}

impl LandmarksAuto {
    const MESH: Input<TriMesh> = Input::new("mesh", "the body's surface, faces outwards");
    const LANDMARKS: Output<Landmarks> = Output::new("landmarks", "seven or nine named vertices");
    const EVIDENCE: Output<Table> =
        Output::new("evidence", "one row a test: what was measured and the least that passes");
}

impl Node for LandmarksAuto {
    const SPEC: Spec = Spec {
        kind: "landmarks_auto",
        version: 1,
        inputs: &[Self::MESH.port()],
        outputs: &[Self::LANDMARKS.port(), Self::EVIDENCE.port()],
        cites: &["hilaga2001topology", "edelsbrunner2002topological", "buneman1974note"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000
pose = "walk"

[nodes.found]
kind = "landmarks_auto"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let plan = match self.body {
            Plan::Biped => BodyPlan::Biped,
            Plan::Quadruped => BodyPlan::Quadruped,
        };
        let options = FindOptions { plan, front: self.front.map(Front::direction) };
        let found = find_landmarks(&io.get(Self::MESH), options)?;
        io.put(Self::EVIDENCE, table(&found.findings));
        io.put(Self::LANDMARKS, found.landmarks);
        Ok(())
    }
}

fn table(findings: &[Finding]) -> Table {
    Table::new(vec![
        Column::texts("test", findings.iter().map(|it| it.test.to_owned()).collect()),
        Column::numbers("value", "", findings.iter().map(|it| it.value).collect()),
        Column::numbers("least", "", findings.iter().map(|it| it.least).collect()),
    ])
}
