//! Kind `embed`.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::embed::{EmbedOptions, Embedding, GiveUp, TERM_NAMES, Terms, embed};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Puts a skeleton into another body (Pinocchio, with the changes of Transfer4D).
///
/// The directions and lengths of the skeleton's bones matter, and with a `source_mesh` where joints are in
/// it: body and skeleton should stand in similar poses, but may be anywhere. The body should be one
/// closed surface (see `clean`). Joints that find no place are given up; a note and the table say which.
/// Where the skeleton is turned, a `retarget` takes `turned` to turn the motion alike.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EmbedNode {
    /// Turns the skeleton first: degrees about x, then y, then z.
    pub rotation_deg: [f64; 3],
    /// Whether to try all 24 rotations of axes into axes and keep the one that fits best.
    pub align: bool,
    /// With a `source_mesh`: how much it matters that joints are where they are in their own body, when the
    /// bounding boxes have the same middle; 0 for not at all, as in Transfer4D.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub place: f64,
    /// With a `source_mesh`: whether both bodies stand in the same place and are equally large already, as
    /// when somebody laid them upon each other. Without, the middles and the largest extents of their
    /// bounding boxes do that, which a body that is only seen from one side misleads.
    pub aligned: bool,
    /// What is given up when a joint finds no place.
    pub give_up: GiveUp,
    /// Joints that should stand at the bottom.
    pub feet: Vec<String>,
    /// Joints that should be in the thick of the body, such as the hips.
    pub fat: Vec<String>,
    /// Whether bones that mirror each other in the skeleton should be equally long.
    pub symmetry: bool,
    /// How obtuse the angle between two places where a ball touches the surface has to be for its
    /// centre to count as inside a limb, in degrees. The paper writes 120, its program uses 90.
    #[schemars(range(min = 1.0, max = 179.0))]
    pub medial_angle_deg: f64,
    /// The most partial matchings that wait; when there are more, the better half is kept.
    #[schemars(range(min = 2, max = 10_000_000))]
    pub max_queue: usize,
    /// The most partial matchings that are extended before a joint is given up; where `place` counts, before
    /// the search goes on with the best hundred of every joint only.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub max_steps: usize,
    /// Rounds of the refinement; 0 leaves joints on the centres of balls.
    #[schemars(range(max = 1000))]
    pub refine_rounds: usize,
}

impl Default for EmbedNode {
    fn default() -> Self {
        let it = EmbedOptions::default();
        Self {
            rotation_deg: [0.0; 3],
            align: it.align,
            place: it.place,
            aligned: false,
            give_up: it.give_up,
            feet: it.feet,
            fat: it.fat,
            symmetry: it.symmetry,
            medial_angle_deg: it.medial_angle_deg,
            max_queue: it.max_queue,
            max_steps: it.max_steps,
            refine_rounds: it.refine_rounds,
        }
    }
}

impl EmbedNode {
    const MESH: Input<TriMesh> = Input::new("mesh", "the body that gets the skeleton");
    const SKELETON: Input<Skeleton> = Input::new("skeleton", "the joints of another body");
    const SOURCE_MESH: OptionalInput<TriMesh> = OptionalInput::new(
        "source_mesh",
        "the body of the skeleton, for its size and place; without it the skeleton spans nine tenths of it",
    );
    const EMBEDDED: Output<Skeleton> = Output::new("skeleton", "the matched joints in the body");
    const TURNED: Output<Skeleton> =
        Output::new("turned", "the given joints, all of them, as they were turned to be embedded");
    const JOINTS: Output<Table> =
        Output::new("joints", "one row a joint: matched or not, penalties");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: counts, penalty");
}

impl Node for EmbedNode {
    const SPEC: Spec = Spec {
        kind: "embed",
        version: 4,
        inputs: &[Self::MESH.port(), Self::SKELETON.port(), Self::SOURCE_MESH.port()],
        outputs: &[
            Self::EMBEDDED.port(),
            Self::TURNED.port(),
            Self::JOINTS.port(),
            Self::SUMMARY.port(),
        ],
        cites: &["baran2007automatic", "maheshwari2023transfer4d"],
        example: r#"[nodes.adult]
kind = "synthesize"
n_vertices = 1000

[nodes.other]
kind = "synthesize"
n_vertices = 1000
seed = 1

[nodes.skeleton]
kind = "embed"
mesh = "@other.mesh"
skeleton = "@adult.skeleton"
source_mesh = "@adult.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, skeleton) = (io.get(Self::MESH), io.get(Self::SKELETON));
        let source = io.get_optional(Self::SOURCE_MESH);
        let bounds = source.map(|it| if self.aligned { mesh.bounds() } else { it.bounds() });
        let [x, y, z] = self.rotation_deg.map(f64::to_radians);
        let options = EmbedOptions {
            source_extent: bounds.map(|(low, high)| (high - low).max()),
            source_center: bounds.map(|(low, high)| (low + high) / 2.0),
            place: self.place,
            give_up: self.give_up,
            rotation: UnitQuaternion::from_euler_angles(x, y, z),
            align: self.align,
            feet: self.feet.clone(),
            fat: self.fat.clone(),
            symmetry: self.symmetry,
            medial_angle_deg: self.medial_angle_deg,
            max_queue: self.max_queue,
            max_steps: self.max_steps,
            refine_rounds: self.refine_rounds,
            ..Default::default()
        };
        let res = embed(&mesh, &skeleton, &options)?;
        let lost: Vec<&str> = skeleton
            .names()
            .iter()
            .zip(&res.joints)
            .filter(|it| !it.1.is_matched)
            .map(|it| it.0.as_str())
            .collect();
        if !lost.is_empty() {
            let (n_lost, n_joints) = (lost.len(), skeleton.n_joints());
            io.note(format!("{n_lost} of {n_joints} joints found no place: {}", lost.join(", ")));
        }
        let turned = skeleton.positions().iter().map(|it| res.rotation * it).collect();
        io.put(Self::TURNED, skeleton.with_positions(turned)?);
        io.put(Self::JOINTS, joints_table(&skeleton, &res));
        io.put(Self::SUMMARY, summary_table(&skeleton, &res));
        io.put(Self::EMBEDDED, res.skeleton);
        Ok(())
    }
}

fn joints_table(skeleton: &Skeleton, res: &Embedding) -> Table {
    let matched = res.joints.iter().map(|it| f64::from(u8::from(it.is_matched))).collect();
    let mut columns = vec![
        Column::texts("joint", skeleton.names().to_vec()),
        Column::numbers("matched", "", matched),
    ];
    // Joints within chains have no penalties of their own.
    let values = |of: &dyn Fn(&Terms) -> f64| {
        res.joints.iter().map(|it| it.terms.as_ref().map_or(f64::NAN, of)).collect()
    };
    columns.push(Column::numbers("penalty", "", values(&|it| it.iter().sum())));
    for (index, name) in TERM_NAMES.iter().enumerate() {
        columns.push(Column::numbers(name, "", values(&|it| it[index])));
    }
    Table::new(columns)
}

fn summary_table(skeleton: &Skeleton, res: &Embedding) -> Table {
    let n_matched = res.joints.iter().filter(|it| it.is_matched).count() as f64;
    let n_joints = skeleton.n_joints() as f64;
    let number = |name, value| Column::numbers(name, "", vec![value]);
    Table::new(vec![
        number("joints", n_joints),
        number("matched", n_matched),
        Column::numbers("matched share", "%", vec![100.0 * n_matched / n_joints]),
        number("penalty", res.penalty),
        Column::numbers("turned by", "°", vec![res.rotation.angle().to_degrees()]),
        number("balls", res.n_balls as f64),
        number("edges", res.n_edges as f64),
        number("searches", res.n_searches as f64),
    ])
}
