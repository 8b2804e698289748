//! Kind `correspondences`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, InputFile, Node, NodeError, NodeIo, OptionalInput, Output, Spec};
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::maps::correspondences::{
    Correspondences, closest_places, read_correspondences,
};

/// Says where every vertex of a mesh lies on the surface of a reference: the truth about a map.
///
/// Read from a file, or found as the closest places, which is right for a remeshed or decimated copy
/// that lies on its original. Whatever shares the reference's faces, as the bodies of one template do,
/// shares the places: a copy of one body has true correspondences with all others.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CorrespondencesNode {
    /// A file with a line `face,b0,b1` for every vertex of the mesh: a face of the reference, counted
    /// from zero, and two barycentric coordinates. Without it, the closest places are taken.
    pub file: Option<InputFile>,
}

impl CorrespondencesNode {
    const MESH: OptionalInput<TriMesh> =
        OptionalInput::new("mesh", "the mesh whose vertices are looked up");
    const REFERENCE: Input<TriMesh> = Input::new("reference", "the mesh on which they lie");
    const CORRESPONDENCES: Output<Correspondences> =
        Output::new("correspondences", "a place on the reference for every vertex of the mesh");
}

impl Node for CorrespondencesNode {
    const SPEC: Spec = Spec {
        kind: "correspondences",
        version: 1,
        inputs: &[Self::MESH.port(), Self::REFERENCE.port()],
        outputs: &[Self::CORRESPONDENCES.port()],
        cites: &[],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.coarse]
kind = "decimate"
mesh = "@body.mesh"
vertices = 400

[nodes.truth]
kind = "correspondences"
mesh = "@coarse.mesh"
reference = "@body.mesh"
"#,
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        self.file.iter().map(|it| ("file", it)).collect()
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (mesh, reference) = (io.get_optional(Self::MESH), io.get(Self::REFERENCE));
        let found = match (&self.file, &mesh) {
            (Some(file), _) => read_correspondences(&io.read(&file.0)?, reference.n_faces())?,
            (None, Some(mesh)) => {
                let found = closest_places(mesh.vertices(), &reference)?;
                self.judge_distances(io, mesh, &reference, &found);
                found
            }
            (None, None) => {
                return Err(NodeError::failed("without a `file`, the input `mesh` is needed"));
            }
        };
        if let Some(mesh) = mesh.filter(|it| it.n_vertices() != found.faces.len()) {
            return Err(NodeError::failed(format!(
                "the file has {} correspondences, but the mesh {} vertices",
                found.faces.len(),
                mesh.n_vertices()
            )));
        }
        io.put(Self::CORRESPONDENCES, found);
        Ok(())
    }
}

impl CorrespondencesNode {
    /// Leaves a note if the mesh does not lie on the reference.
    fn judge_distances(
        &self,
        io: &mut NodeIo<'_>,
        mesh: &TriMesh,
        reference: &TriMesh,
        found: &Correspondences,
    ) {
        let places = found.positions(reference);
        let distances = mesh.vertices().iter().zip(&places).map(|(a, b)| (a - b).norm());
        let (low, high) = reference.bounds();
        let percent = 100.0 * distances.fold(0.0, f64::max) / (high - low).norm();
        if percent > 2.0 {
            io.note(format!(
                "a vertex is {percent:.1} % of the reference's diagonal away from it: closest places \
                 are the truth only for a mesh that lies on its reference"
            ));
        }
    }
}
