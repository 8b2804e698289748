//! Kind `point_cloud`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    Input, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec,
};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::numerics::random::Random;
use crate::kernels::remeshing::resampled::Resampled;
use crate::kernels::remeshing::sample_points::{SampleOptions, Spread, sample_points};
use crate::kernels::{geometry::landmarks::Landmarks, rigs::weights::SkinWeights};

/// Makes a point cloud of a mesh: its vertices, or points of its surface.
///
/// A point cloud is a mesh without faces, so every kind that works on vertices takes it. Landmarks
/// stay where they are and become the first points; weights are read off the surface.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointCloud {
    /// The number of points; the vertices are taken, with their numbers, if it is left out.
    #[serde(default)]
    #[schemars(range(min = 4, max = 10_000_000))]
    pub points: Option<usize>,
    /// With `points`: how they lie on the surface.
    #[serde(default)]
    pub spread: Spread,
    /// How far points are moved off the surface, as a scanner does: the deviation along each axis, in
    /// parts of the bounding box's diagonal. Landmarks are moved as well.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub noise: f64,
    /// Another seed gives other points and another noise.
    #[serde(default)]
    pub seed: u64,
}

impl PointCloud {
    const MESH: Input<TriMesh> = Input::new("mesh", "the surface");
    const WEIGHTS: OptionalInput<SkinWeights> = OptionalInput::new("weights", "its skin weights");
    const LANDMARKS: OptionalInput<Landmarks> =
        OptionalInput::new("landmarks", "its landmarks, which become points");
    const CLOUD: Output<TriMesh> = Output::new("mesh", "the points");
    const NEW_WEIGHTS: OptionalOutput<SkinWeights> =
        OptionalOutput::new("weights", "the skin weights of the points");
    const NEW_LANDMARKS: OptionalOutput<Landmarks> =
        OptionalOutput::new("landmarks", "the landmarks among the points");

    fn sampled(&self, mesh: &TriMesh, landmarks: &[u32]) -> Result<Resampled, NodeError> {
        let Some(n_points) = self.points else {
            let all: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
            let cloud = TriMesh::from_points(mesh.vertices().to_vec())?;
            let new_of_old = all.iter().map(|&it| Some(it)).collect();
            return Ok(Resampled::from_selection(cloud, &all, new_of_old));
        };
        let (spread, seed) = (self.spread, self.seed);
        let options = SampleOptions { n_points, spread, seed, kept: landmarks.to_vec() };
        Ok(sample_points(mesh, &options)?)
    }

    fn with_noise(&self, cloud: &TriMesh) -> Result<TriMesh, NodeError> {
        let mut random = Random::stream(self.seed, "noise");
        let (low, high) = cloud.bounds();
        let deviation = self.noise * (high - low).norm();
        let moved = cloud.vertices().iter();
        let moved = moved.map(|it| it + Vec3::from_fn(|_, _| deviation * random.normal()));
        Ok(cloud.with_vertices(moved.collect())?)
    }
}

impl Node for PointCloud {
    const SPEC: Spec = Spec {
        kind: "point_cloud",
        version: 1,
        inputs: &[Self::MESH.port(), Self::WEIGHTS.port(), Self::LANDMARKS.port()],
        outputs: &[Self::CLOUD.port(), Self::NEW_WEIGHTS.port(), Self::NEW_LANDMARKS.port()],
        cites: &["yuksel2015sample"],
        example: r#"[nodes.body]
kind = "synthesize"
n_vertices = 1000

[nodes.scan]
kind = "point_cloud"
mesh = "@body.mesh"
weights = "@body.weights"
landmarks = "@body.landmarks"
points = 800
noise = 0.001

[nodes.vertices]
kind = "point_cloud"
mesh = "@body.mesh"
"#,
    };

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let mesh = io.get(Self::MESH);
        let old_landmarks = io.get_optional(Self::LANDMARKS);
        let kept = old_landmarks.as_ref().map_or(&[][..], |it| &it.vertices);
        let cloud = self.sampled(&mesh, kept)?;
        let weights = io.get_optional(Self::WEIGHTS).map(|it| cloud.weights(&it)).transpose()?;
        let landmarks = old_landmarks.map(|it| cloud.landmarks(&it)).transpose()?;
        let points = if self.noise > 0.0 { self.with_noise(&cloud.mesh)? } else { cloud.mesh };
        io.put(Self::CLOUD, points);
        io.put_optional(Self::NEW_WEIGHTS, weights, "no weights were given");
        io.put_optional(Self::NEW_LANDMARKS, landmarks, "no landmarks were given");
        Ok(())
    }
}
