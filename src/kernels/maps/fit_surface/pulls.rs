//! Vertices that are pulled to places.

use crate::kernels::geometry::farthest_points::farthest_points;
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// A vertex of the surface that is drawn to a place, with the energy
/// `w ((n . (v - t))^2 + h |v - t|^2)`.
#[derive(Debug, Clone, Copy)]
pub struct Pull {
    pub vertex: u32,
    /// `t`.
    pub place: Vec3,
    /// `n`: zero if all directions count alike.
    pub normal: Vec3,
    /// `w`.
    pub weight: f64,
    /// `h`.
    pub hold: f64,
}

/// Vertices that stand for a shape, and how much each of them counts.
pub struct Samples {
    pub vertices: Vec<u32>,
    pub weights: Vec<f64>,
}

impl Samples {
    /// Spreads so many vertices over a shape (all, if 0); weights are areas with a given sum. Points of a
    /// cloud count alike.
    pub fn of(mesh: &TriMesh, count: usize, sum: usize) -> Self {
        let n = mesh.n_vertices();
        let areas = if mesh.is_point_cloud() { vec![1.0; n] } else { mesh.vertex_areas() };
        let factor = sum as f64 / areas.iter().sum::<f64>();
        let (vertices, areas) = if count == 0 || count >= n {
            ((0..n as u32).collect(), areas)
        } else {
            let spread = farthest_points(mesh.vertices(), count);
            let areas = spread.sums(&areas);
            (spread.chosen, areas)
        };
        Self { vertices, weights: areas.iter().map(|it| it * factor).collect() }
    }

    pub fn iter(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.vertices.iter().copied().zip(self.weights.iter().copied())
    }
}

/// How much a pull over a distance counts: little beyond the reach.
pub fn trust(distance: f64, reach: f64) -> f64 {
    (1.0 + (distance / reach).powi(2)).powi(-2)
}

/// Draws vertices to their matches; those farther off than is usual count less.
pub fn pulls_by_matches(samples: &Samples, vertices: &[Vec3], matched: &[Vec3]) -> Vec<Pull> {
    let distance = |it: u32| (matched[it as usize] - vertices[it as usize]).norm();
    let mut distances: Vec<f64> = samples.vertices.iter().map(|it| distance(*it)).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let reach = (2.0 * distances[distances.len() / 2]).max(f64::MIN_POSITIVE);
    let pull = |(vertex, weight): (u32, f64)| Pull {
        vertex,
        place: matched[vertex as usize],
        normal: Vec3::zeros(),
        weight: weight * trust(distance(vertex), reach),
        hold: 1.0,
    };
    samples.iter().map(pull).collect()
}
