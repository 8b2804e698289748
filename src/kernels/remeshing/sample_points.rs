//! Points of a surface.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::resampled::Resampled;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::numerics::random::Random;
use crate::kernels::numerics::sparse::CsrMatrix;

/// How points lie on the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// As far from each other as they can be: of five times as many random points, those that are
    /// most crowded are left out one by one (Yuksel 2015).
    #[default]
    Even,
    /// At random, as many on every part as its area asks for.
    Random,
}

/// Options of [`sample_points`].
#[derive(Debug, Clone, PartialEq)]
pub struct SampleOptions {
    pub n_points: usize,
    pub spread: Spread,
    pub seed: u64,
    /// Old vertices that become points, before all others and in this order.
    pub kept: Vec<u32>,
}

/// Why there are no points.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SampleError {
    #[error("the surface has no area: all {n_faces} faces are points or lines")]
    NoArea { n_faces: usize },
    #[error("{n_kept} vertices are to stay, more than the {n_points} points that are wanted")]
    TooManyKept { n_kept: usize, n_points: usize },
    #[error("vertex {vertex} is to stay, but the mesh has {n_vertices} vertices")]
    OutOfRange { vertex: u32, n_vertices: usize },
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Candidates for every point of an even spread.
const CANDIDATES: usize = 5;

/// Makes a point cloud of a surface; every point knows its place among the old vertices.
///
/// # Errors
/// See [`SampleError`].
pub fn sample_points(mesh: &TriMesh, options: &SampleOptions) -> Result<Resampled, SampleError> {
    mesh.check_has_faces()?;
    let (n_vertices, n_points) = (mesh.n_vertices(), options.n_points);
    let mut kept = options.kept.clone();
    let mut new_of_old = vec![None; n_vertices];
    if let Some(&vertex) = kept.iter().find(|&&it| it as usize >= n_vertices) {
        return Err(SampleError::OutOfRange { vertex, n_vertices });
    }
    // Two landmarks may be one vertex.
    let mut n_kept = 0;
    kept.retain(|&vertex| {
        let is_new = new_of_old[vertex as usize].is_none();
        if is_new {
            new_of_old[vertex as usize] = Some(n_kept);
            n_kept += 1;
        }
        is_new
    });
    if kept.len() > n_points {
        return Err(SampleError::TooManyKept { n_kept: kept.len(), n_points });
    }
    let mut samples: Vec<Sample> = kept.iter().map(|&it| Sample::of_vertex(it)).collect();
    let mut random = Random::stream(options.seed, "points");
    let dealer = Dealer::new(mesh)?;
    let n_more = n_points - kept.len();
    match options.spread {
        Spread::Random => samples.extend((0..n_more).map(|_| dealer.deal(&mut random))),
        Spread::Even => {
            samples.extend((0..CANDIDATES * n_more).map(|_| dealer.deal(&mut random)));
            let places: Vec<Vec3> = samples.iter().map(|it| it.place(mesh)).collect();
            let stays = thinned(&places, kept.len(), n_points, dealer.area());
            let mut stays = stays.into_iter();
            samples.retain(|_| stays.next().unwrap_or(false));
        }
    }
    let vertices = samples.iter().map(|it| it.place(mesh)).collect();
    let new_from_old = CsrMatrix::from_triplets(samples.len(), n_vertices, &triplets(&samples));
    Ok(Resampled { mesh: TriMesh::from_points(vertices)?, new_from_old, new_of_old })
}

/// A point of a face: its corners' shares.
#[derive(Debug, Clone, Copy)]
struct Sample {
    corners: [u32; 3],
    shares: [f64; 3],
}

impl Sample {
    fn of_vertex(vertex: u32) -> Self {
        Self { corners: [vertex; 3], shares: [1.0, 0.0, 0.0] }
    }

    fn place(&self, mesh: &TriMesh) -> Vec3 {
        let [a, b, c] = self.corners.map(|it| mesh.vertices()[it as usize]);
        a * self.shares[0] + b * self.shares[1] + c * self.shares[2]
    }
}

fn triplets(samples: &[Sample]) -> Vec<(u32, u32, f64)> {
    let of_sample = |(row, sample): (usize, &Sample)| {
        let Sample { corners, shares } = *sample;
        (0..3).map(move |it| (row as u32, corners[it], shares[it]))
    };
    samples.iter().enumerate().flat_map(of_sample).filter(|it| it.2 > 0.0).collect()
}

/// Draws points of a mesh at random.
struct Dealer<'a> {
    mesh: &'a TriMesh,
    /// The area of all faces up to each.
    areas: Vec<f64>,
}

impl<'a> Dealer<'a> {
    fn new(mesh: &'a TriMesh) -> Result<Self, SampleError> {
        let mut total = 0.0;
        let add = |face: usize| {
            total += mesh.area_vector(face).norm();
            total
        };
        let areas: Vec<f64> = (0..mesh.n_faces()).map(add).collect();
        if !(total > 0.0 && total.is_finite()) {
            return Err(SampleError::NoArea { n_faces: mesh.n_faces() });
        }
        Ok(Self { mesh, areas })
    }

    fn area(&self) -> f64 {
        self.areas[self.areas.len() - 1]
    }

    fn deal(&self, random: &mut Random) -> Sample {
        let at = random.uniform() * self.area();
        let face = self.areas.partition_point(|&it| it <= at).min(self.areas.len() - 1);
        // The square root makes up for the triangle's narrow end (Turk 1990).
        let (across, along) = (random.uniform().sqrt(), random.uniform());
        let shares = [1.0 - across, across * (1.0 - along), across * along];
        Sample { corners: self.mesh.faces()[face], shares }
    }
}

/// How crowded a candidate is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Crowded {
    weight: f64,
    point: u32,
}

impl Eq for Crowded {}

impl Ord for Crowded {
    fn cmp(&self, other: &Self) -> Ordering {
        self.weight.total_cmp(&other.weight).then(other.point.cmp(&self.point))
    }
}

impl PartialOrd for Crowded {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Which points stay when the most crowded is left out until `n_points` are left; the first `n_kept`
/// stay anyway.
fn thinned(places: &[Vec3], n_kept: usize, n_points: usize, area: f64) -> Vec<bool> {
    // Twice the radius of as many disks as there is room for.
    let reach = 2.0 * (area / (2.0 * 3.0_f64.sqrt() * n_points as f64)).sqrt();
    let tree = PointTree::new(places);
    let mut found = Vec::new();
    let mut neighbors = |point: usize| -> Vec<(u32, f64)> {
        tree.within(places[point], reach, &mut found);
        let others = found.iter().filter(|it| it.1 as usize != point);
        others.map(|&(square, other)| (other, (1.0 - square.sqrt() / reach).powi(8))).collect()
    };
    let around: Vec<Vec<(u32, f64)>> = (0..places.len()).map(&mut neighbors).collect();
    let mut weights: Vec<f64> =
        around.iter().map(|it| it.iter().map(|it| it.1).sum::<f64>()).collect();
    let mut stays = vec![true; places.len()];
    let candidates = n_kept..places.len();
    let mut heap: BinaryHeap<Crowded> =
        candidates.map(|it| Crowded { weight: weights[it], point: it as u32 }).collect();
    let mut n_left = places.len();
    while n_left > n_points {
        let Some(most) = heap.pop() else { break };
        let point = most.point as usize;
        // Weights only fall: an entry may be out of date, but never too low.
        if most.weight > weights[point] {
            heap.push(Crowded { weight: weights[point], point: most.point });
            continue;
        }
        stays[point] = false;
        n_left -= 1;
        for &(other, weight) in &around[point] {
            weights[other as usize] -= weight;
        }
    }
    stays
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, rectangle};

    fn sampled(mesh: &TriMesh, n_points: usize, spread: Spread, kept: &[u32]) -> Resampled {
        let options = SampleOptions { n_points, spread, seed: 3, kept: kept.to_vec() };
        sample_points(mesh, &options).unwrap()
    }

    fn least_distance(points: &[Vec3]) -> f64 {
        let tree = PointTree::new(points);
        let mut found = Vec::new();
        let nearest = points.iter().map(|&it| {
            tree.nearest(it, 2, &mut found);
            found[1].0.sqrt()
        });
        nearest.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn points_lie_on_the_surface_and_are_as_many_as_wanted() {
        let mesh = icosphere(3);
        for spread in [Spread::Even, Spread::Random] {
            let cloud = sampled(&mesh, 700, spread, &[5, 9, 5]);
            assert!(cloud.mesh.is_point_cloud());
            assert_eq!(cloud.mesh.n_vertices(), 700);
            assert_eq!(cloud.new_of_old.iter().flatten().count(), 2);
            assert_eq!(cloud.mesh.vertices()[1], mesh.vertices()[9]);
            for (row, point) in cloud.mesh.vertices().iter().enumerate() {
                assert!((0.98..=1.0 + 1e-12).contains(&point.norm()), "{point}");
                let shares: f64 = cloud.new_from_old.row(row).map(|it| it.1).sum();
                assert!((shares - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn an_even_spread_keeps_its_distance() {
        let mesh = rectangle(3, 2, 3.0, 2.0);
        let ideal = 2.0 * (6.0 / (2.0 * 3.0_f64.sqrt() * 600.0)).sqrt();
        let even = least_distance(sampled(&mesh, 600, Spread::Even, &[]).mesh.vertices());
        assert!(even > 0.6 * ideal, "{even} of {ideal}");
        let random = least_distance(sampled(&mesh, 600, Spread::Random, &[]).mesh.vertices());
        assert!(random < 0.2 * ideal, "{random} of {ideal}");
    }

    #[test]
    fn parts_get_points_by_their_area() {
        let mesh = rectangle(1, 1, 1.0, 1.0);
        let squeezed = |it: &Vec3| Vec3::new(it.x.powi(3), it.y, 0.0);
        let fine = rectangle(40, 3, 1.0, 1.0);
        let fine = fine.with_vertices(fine.vertices().iter().map(squeezed).collect()).unwrap();
        for mesh in [mesh, fine] {
            let cloud = sampled(&mesh, 4000, Spread::Random, &[]);
            let n_left = cloud.mesh.vertices().iter().filter(|it| it.x < 0.25).count();
            assert!((900..1100).contains(&n_left), "{n_left}");
        }
    }

    #[test]
    fn what_cannot_be_sampled_is_named() {
        let mesh = rectangle(1, 1, 1.0, 1.0);
        let error = |mesh: &TriMesh, kept: &[u32]| {
            let spread = Spread::Even;
            let options = SampleOptions { n_points: 2, spread, seed: 0, kept: kept.to_vec() };
            sample_points(mesh, &options).unwrap_err().to_string()
        };
        assert_eq!(
            error(&mesh, &[0, 1, 2]),
            "3 vertices are to stay, more than the 2 points that are wanted"
        );
        assert_eq!(error(&mesh, &[4]), "vertex 4 is to stay, but the mesh has 4 vertices");
        let line = mesh.with_vertices(vec![Vec3::zeros(); 4]).unwrap();
        assert_eq!(error(&line, &[]), "the surface has no area: all 2 faces are points or lines");
    }
}
