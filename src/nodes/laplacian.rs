//! Kind `laplacian`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{Input, Node, NodeError, NodeIo, Output, Spec};
use crate::kernels::spectral::cloud_laplacian::{CloudOptions, CloudReport, cloud_laplacian};
use crate::kernels::spectral::laplacian::{MassLumping, cotangent_laplacian};
use crate::kernels::spectral::tufted::{TuftedReport, tufted_laplacian};
use crate::kernels::{geometry::mesh::TriMesh, spectral::operator::Operator};

/// Assembles the Laplace-Beltrami operator of a mesh or of a point cloud.
///
/// The cotangent operator is the usual one and wants a clean mesh. The tufted operator (Sharp & Crane
/// 2020) takes anything: non-manifold edges, holes, faces that are repeated, flat or turned around,
/// stray vertices, and points without any faces.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Laplacian {
    /// Which operator.
    #[serde(default)]
    pub method: Method,
    /// How `cotan` shares out the area of the faces among the vertices; `tufted` always gives a third
    /// to each corner.
    #[serde(default)]
    pub mass: Mass,
    /// Point clouds: the nearest points of which the surface around each point is made.
    #[serde(default = "default_neighbors")]
    #[schemars(range(min = 2, max = 1000))]
    pub neighbors: usize,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// `cotan` for what has faces, `tufted` for point clouds.
    #[default]
    Auto,
    /// Cotangents of the angles of the faces.
    Cotan,
    /// Cotangents of the tufted cover after flips to its intrinsic Delaunay triangulation: no negative
    /// weights, whatever the triangles. Where vertices belong to no face, functions are zero.
    Tufted,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mass {
    /// Voronoi cells, safe at obtuse triangles (Meyer et al. 2003).
    #[default]
    Voronoi,
    /// A third of every face to each of its corners.
    Barycentric,
}

fn default_neighbors() -> usize {
    CloudOptions::default().n_neighbors
}

impl Laplacian {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface, or points of it");
    const OPERATOR: Output<Operator> = Output::new("operator", "stiffness and lumped masses");

    fn cotan(&self, mesh: &TriMesh) -> Result<Operator, NodeError> {
        let lumping = match self.mass {
            Mass::Voronoi => MassLumping::MixedVoronoi,
            Mass::Barycentric => MassLumping::Barycentric,
        };
        Ok(cotangent_laplacian(mesh, lumping)?)
    }

    fn of_cloud(&self, io: &mut NodeIo<'_>, cloud: &TriMesh) -> Result<Operator, NodeError> {
        let options = CloudOptions { n_neighbors: self.neighbors };
        let (operator, report) = cloud_laplacian(cloud.vertices(), &options)?;
        let CloudReport { n_duplicates, n_isolated, cover } = report;
        note_counts(
            io,
            &[
                (n_duplicates, "points at the place of an earlier one, tied to it"),
                (n_isolated, "points that no triangle reaches: functions are zero there"),
                (cover.flips.n_left, "edges that are not Delaunay: the limit of flips was reached"),
            ],
        );
        Ok(operator)
    }
}

fn tufted(io: &mut NodeIo<'_>, mesh: &TriMesh) -> Result<Operator, NodeError> {
    let (operator, report) = tufted_laplacian(mesh)?;
    let TuftedReport { flips, n_collapsed_faces, n_unreferenced, .. } = report;
    note_counts(
        io,
        &[
            (report.n_nonmanifold_edges, "edges of more than two faces"),
            (report.n_boundary_edges, "edges of one face"),
            (n_collapsed_faces, "faces that name a vertex twice, left out"),
            (n_unreferenced, "vertices of no face: functions are zero there"),
            (flips.n_left, "edges that are not Delaunay: the limit of flips was reached"),
        ],
    );
    Ok(operator)
}

/// Notes what there is any of, in one line.
fn note_counts(io: &mut NodeIo<'_>, counts: &[(usize, &str)]) {
    let there = counts.iter().filter(|it| it.0 > 0);
    let parts: Vec<String> = there.map(|(count, what)| format!("{count} {what}")).collect();
    if !parts.is_empty() {
        io.note(parts.join("; "));
    }
}

impl Node for Laplacian {
    const SPEC: Spec = Spec {
        kind: "laplacian",
        version: 1,
        inputs: &[Self::MESH.port()],
        outputs: &[Self::OPERATOR.port()],
        cites: &["pinkall1993computing", "meyer2003discrete", "sharp2020laplacian"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.laplacian]
kind = "laplacian"
mesh = "@body.mesh"

[nodes.robust]
kind = "laplacian"
method = "tufted"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        let operator = match self.method {
            Method::Auto | Method::Tufted if mesh.is_point_cloud() => self.of_cloud(io, &mesh)?,
            Method::Tufted => tufted(io, &mesh)?,
            Method::Auto | Method::Cotan => self.cotan(&mesh)?,
        };
        io.put(Self::OPERATOR, operator);
        Ok(())
    }
}
