//! Kind `point_map`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::maps::functional_map::{FunctionalMap, PointMap};
use crate::kernels::maps::point_map::{check, inverse_point_map, point_map};
use crate::kernels::spectral::basis::Basis;

/// Which shape's vertices get matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MatchDirection {
    /// Every source vertex gets a target vertex.
    #[default]
    TargetOfSource,
    /// Every target vertex gets a source vertex.
    SourceOfTarget,
}

/// Matches the vertices of two shapes by a functional map.
///
/// The map places the target among the source's coefficients; matches are nearest neighbours there,
/// exactly. The two directions are not each other's inverse: `map_quality` measures how far from it.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PointMapNode {
    /// Which shape's vertices get matches.
    pub direction: MatchDirection,
}

impl PointMapNode {
    const SOURCE_BASIS: Input<Basis> = Input::new("source_basis", "eigenpairs of the source");
    const TARGET_BASIS: Input<Basis> = Input::new("target_basis", "eigenpairs of the target");
    const MAP: Input<FunctionalMap> =
        Input::new("map", "functions on the target to functions on the source");
    const MATCHES: Output<PointMap> =
        Output::new("matches", "for every vertex of one shape a vertex of the other");
}

impl Node for PointMapNode {
    const SPEC: Spec = Spec {
        kind: "point_map",
        version: 1,
        inputs: &[Self::SOURCE_BASIS.port(), Self::TARGET_BASIS.port(), Self::MAP.port()],
        outputs: &[Self::MATCHES.port()],
        cites: &["ovsjanikov2012functional"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.operator]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.basis]
kind = "eigs"
operator = "@operator"
k = 40

[nodes.functions]
kind = "descriptors"
basis = "@basis"
landmarks = "@body.landmarks"

[nodes.coarse]
kind = "fmap"
source_basis = "@basis"
target_basis = "@basis"
source_descriptors = "@functions"
target_descriptors = "@functions"
k = 15

[nodes.back]
kind = "point_map"
source_basis = "@basis"
target_basis = "@basis"
map = "@coarse"
direction = "source_of_target"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (source, target) = (io.get(Self::SOURCE_BASIS), io.get(Self::TARGET_BASIS));
        let map = io.get(Self::MAP);
        check(&source, &target, &map)?;
        let matches = match self.direction {
            MatchDirection::TargetOfSource => point_map(&source, &target, &map),
            MatchDirection::SourceOfTarget => inverse_point_map(&source, &target, &map),
        };
        io.put(Self::MATCHES, matches);
        Ok(())
    }
}
