//! Kind `skeleton_error`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::curve_skeletons::skeleton_error::{fit_of, rig_distance};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::rigs::joint_error::{HeightAxis, JointErrorError, height};
use crate::kernels::rigs::skeleton::Skeleton;
use crate::kernels::table::{Column, Table};

/// Measures how good a curve skeleton is: its topology, whether it is inside of the surface and in the
/// middle, and how near it is to true bones.
///
/// Give the true closed surface, also for a skeleton of a scan of it. `off center` is the distance of
/// a curve from the middle of the surface around it over the surface's distance: 0 on the axis, 1 on
/// the surface.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SkeletonError {
    /// What counts as the height, of which distances from bones are percents.
    pub height: HeightAxis,
}

impl SkeletonError {
    const CURVES: Input<CurveSkeleton> = Input::new("curves", "the skeleton to be judged");
    const MESH: Input<TriMesh> = Input::new("mesh", "the true closed surface");
    const TRUTH: OptionalInput<Skeleton> = OptionalInput::new("truth", "the true bones");
    const REFERENCE: OptionalInput<CurveSkeleton> =
        OptionalInput::new("reference", "a skeleton whose topology should be met");
    const SUMMARY: Output<Table> = Output::new("summary", "one row: counts and errors");
}

impl Node for SkeletonError {
    const SPEC: Spec = Spec {
        kind: "skeleton_error",
        version: 1,
        inputs: &[
            Self::CURVES.port(),
            Self::MESH.port(),
            Self::TRUTH.port(),
            Self::REFERENCE.port(),
        ],
        outputs: &[Self::SUMMARY.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1500

[nodes.skeletonize]
kind = "skeletonize"
mesh = "@body.mesh"

[nodes.score]
kind = "skeleton_error"
curves = "@skeletonize.curves"
mesh = "@body.mesh"
truth = "@body.skeleton"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (curves, mesh) = (io.get(Self::CURVES), io.get(Self::MESH));
        mesh.check_has_faces()?;
        let fit = fit_of(&curves, &mesh);
        let number = |name: &str, unit: &str, value: f64| Column::numbers(name, unit, vec![value]);
        let counts = counts(&curves);
        let mut columns: Vec<Column> =
            counts.iter().map(|&(name, count)| number(name, "", count as f64)).collect();
        let height = height(&mesh, self.height);
        if !(height > 0.0) {
            return Err(JointErrorError::NoHeight.into());
        }
        columns.extend([
            number("inside", "%", 100.0 * fit.inside),
            number("outside", "%", 100.0 * fit.outside / height),
            number("off center", "", fit.off_center),
        ]);
        if let Some(truth) = io.get_optional(Self::TRUTH) {
            let distance = rig_distance(&curves, &truth, height);
            columns.push(number("joints to curves", "%", distance.joints_to_curves));
            columns.push(number("curves to bones", "%", distance.curves_to_bones));
        }
        if let Some(reference) = io.get_optional(Self::REFERENCE) {
            let same = self::counts(&reference)[1..] == counts[1..];
            columns.push(number("same topology", "", f64::from(u8::from(same))));
        }
        io.put(Self::SUMMARY, Table::new(columns));
        Ok(())
    }
}

fn counts(curves: &CurveSkeleton) -> [(&'static str, usize); 5] {
    [
        ("nodes", curves.n_nodes()),
        ("components", curves.n_components()),
        ("leaves", curves.leaves().len()),
        ("junctions", curves.junctions().len()),
        ("cycles", curves.n_cycles()),
    ]
}
