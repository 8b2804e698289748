//! Kind `clean`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::remeshing::clean::{CleanOptions, CleanReport, Keep, Nonmanifold, clean};
use crate::kernels::{
    geometry::{landmarks::Landmarks, mesh::TriMesh},
    rigs::weights::SkinWeights,
};

/// Repairs a mesh: welds vertices, drops degenerate and repeated faces and stray vertices, resolves
/// non-manifold places, keeps the largest part, turns faces outward, fills small holes.
///
/// No vertex moves. What was found and done is noted with the result. Weights and landmarks come
/// along.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Clean {
    /// Whether vertices are welded.
    #[serde(default = "yes")]
    pub weld: bool,
    /// Vertices closer than this fraction of the bounding box's diagonal are welded; 0 welds only equal
    /// positions.
    #[serde(default = "default_tolerance")]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub tolerance: f64,
    /// What to do about edges of three and more faces, and vertices where surfaces only touch.
    #[serde(default)]
    pub nonmanifold: Nonmanifold,
    /// Which connected parts stay.
    #[serde(default)]
    pub keep: Keep,
    /// Whether faces are turned so that neighbours agree and volumes are positive.
    #[serde(default = "yes")]
    pub orient: bool,
    /// Holes of at most this many edges are filled; 0 fills none.
    #[serde(default)]
    #[schemars(range(max = 500))]
    pub fill_holes: usize,
}

fn yes() -> bool {
    true
}

fn default_tolerance() -> f64 {
    1e-7
}

impl Clean {
    const MESH: Input<TriMesh> = Input::new("mesh", "the mesh to repair");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> = OptionalInput::new("landmarks", "its landmarks");
    const CLEANED: Output<TriMesh> = Output::new("mesh", "the repaired mesh");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of what is left");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks on the repaired mesh");
}

impl Node for Clean {
    const SPEC: Spec = Spec {
        kind: "clean",
        version: 1,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::CLEANED.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &["gueziec2001cutting", "barequet1995filling"],
        example: r#"[nodes.body]
kind = "synthesize"

[nodes.clean]
kind = "clean"
mesh = "@body.mesh"
landmarks = "@body.landmarks"
fill_holes = 30
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        let options = CleanOptions {
            weld: self.weld.then_some(self.tolerance),
            nonmanifold: self.nonmanifold,
            keep: self.keep,
            orient: self.orient,
            fill_holes: self.fill_holes,
        };
        let (cleaned, report) = clean(&mesh, &options)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| cleaned.weights(&it)).transpose()?;
        let landmarks =
            io.get_optional(Self::LANDMARKS).map(|it| cleaned.landmarks(&it)).transpose()?;
        for line in remarks(&report) {
            io.note(line);
        }
        io.put(Self::CLEANED, cleaned.mesh);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}

/// What was done, and what is still wrong.
fn remarks(report: &CleanReport) -> Vec<String> {
    let done = [
        (report.n_welded_vertices, "vertices welded"),
        (report.n_collapsed_faces, "collapsed faces removed"),
        (report.n_duplicate_faces, "repeated faces removed"),
        (report.n_flat_faces, "flat faces flipped away or removed"),
        (report.n_fin_faces, "fin faces removed"),
        (report.n_split_vertices, "vertices added to cut non-manifold places open"),
        (report.n_removed_components, "smaller parts removed"),
        (report.n_turned_faces, "faces turned"),
        (report.n_filled_holes, "holes filled"),
        (report.n_unreferenced_vertices, "unreferenced vertices removed"),
    ];
    let left = [
        (report.after.n_nonmanifold_edges, "non-manifold edges remain"),
        (report.after.n_nonmanifold_vertices, "non-manifold vertices remain"),
        (report.n_unorientable_edges, "edges are between faces that cannot agree"),
        (report.after.n_boundary_loops, "boundary loops remain"),
    ];
    let line = |&(count, what): &(usize, &str)| (count > 0).then(|| format!("{count} {what}"));
    done.iter().chain(&left).filter_map(line).collect()
}
