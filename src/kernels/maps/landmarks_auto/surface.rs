//! A surface as a graph of short straight ways, for distances along it.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::kernels::geometry::mesh::{TriMesh, Vec3};
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::geometry::topology::{DisjointSets, Edges, Topology, is_collapsed};
use crate::kernels::numerics::sparse::row_offsets;

/// Over the diagonal of the bounding box: how far from each other parts may be that belong together.
const GAP: f64 = 0.015;

/// Positions, areas and ways between neighbours.
#[derive(Debug, Clone)]
pub struct Surface {
    pub positions: Vec<Vec3>,
    /// The area that belongs to a vertex.
    pub areas: Vec<f64>,
    /// Unit normals to the outside; zero where the faces do not agree on one.
    pub normals: Vec<Vec3>,
    /// Where the ways of every vertex begin; one more than vertices.
    offsets: Vec<usize>,
    ways: Vec<(u32, f64)>,
}

impl Surface {
    /// Joins the ends of every edge, and across it the corners that face it.
    ///
    /// The diagonals have the length in the unfolded plane of both faces (where it is inside of
    /// them), which removes most of the error that ways along edges alone have. Parts that are not
    /// connected are joined where they come close: characters are often made of several shells.
    pub fn of(mesh: &TriMesh) -> Self {
        let mut ways = mesh_ways(mesh);
        let areas = mesh.vertex_areas();
        let parts = Self::new(mesh, ways.clone(), Vec::new()).components();
        if parts.iter().any(|&it| it != parts[0]) {
            ways.extend(bridges(mesh, &parts));
        }
        Self::new(mesh, ways, areas)
    }

    fn new(mesh: &TriMesh, mut ways: Vec<(u32, u32, f64)>, areas: Vec<f64>) -> Self {
        ways.sort_unstable_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
        ways.dedup_by_key(|it| (it.0, it.1));
        let offsets = row_offsets(mesh.n_vertices(), ways.iter().map(|it| it.0));
        let ways = ways.into_iter().map(|(_, to, length)| (to, length)).collect();
        let normals = match Topology::of(mesh).is_oriented {
            true => mesh.vertex_normals(),
            false => vec![Vec3::zeros(); mesh.n_vertices()],
        };
        Self { positions: mesh.vertices().to_vec(), areas, normals, offsets, ways }
    }

    pub fn len(&self) -> usize {
        self.positions.len()
    }

    pub fn ways(&self, vertex: usize) -> &[(u32, f64)] {
        &self.ways[self.offsets[vertex]..self.offsets[vertex + 1]]
    }

    /// For every vertex, the least vertex that ways lead to.
    pub fn components(&self) -> Vec<usize> {
        let mut sets = DisjointSets::new(self.len());
        for vertex in 0..self.len() {
            self.ways(vertex).iter().for_each(|it| sets.join(vertex, it.0 as usize));
        }
        (0..self.len()).map(|it| sets.find(it)).collect()
    }

    /// Lengths of the shortest ways from one vertex (Dijkstra 1959); infinite where none leads.
    pub fn distances_from(&self, source: usize) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; self.len()];
        let mut open = BinaryHeap::new();
        distances[source] = 0.0;
        // Lengths are not negative, so their bits are in their order.
        open.push(Reverse((0_u64, source as u32)));
        while let Some(Reverse((bits, vertex))) = open.pop() {
            let distance = f64::from_bits(bits);
            if distance > distances[vertex as usize] {
                continue;
            }
            for &(to, length) in self.ways(vertex as usize) {
                let through = distance + length;
                if through < distances[to as usize] {
                    distances[to as usize] = through;
                    open.push(Reverse((through.to_bits(), to)));
                }
            }
        }
        distances
    }

    /// The mean distance of every vertex from `n_samples` vertices that lie far from each other.
    ///
    /// It is small in the middle of a shape and large at the tips of what sticks out (Hilaga et al.
    /// 2001).
    pub fn mean_distances(&self, n_samples: usize) -> Vec<f64> {
        let mut nearest = self.distances_from(0);
        let mut samples = Vec::new();
        while samples.len() < n_samples.min(self.len()) {
            let next = farthest(&nearest);
            samples.push(next);
            let distances = self.distances_from(next);
            nearest.iter_mut().zip(&distances).for_each(|(it, new)| *it = it.min(*new));
            if samples.len() == 1 {
                nearest = distances;
            }
        }
        let all: Vec<Vec<f64>> = samples.par_iter().map(|&it| self.distances_from(it)).collect();
        let mean = |vertex: usize| all.iter().map(|it| it[vertex]).sum::<f64>() / all.len() as f64;
        (0..self.len()).into_par_iter().map(mean).collect()
    }

    /// The area of some vertices, and their mean position by area.
    pub fn area_and_center(&self, vertices: impl Iterator<Item = usize>) -> (f64, Vec3) {
        let mut area = 0.0;
        let mut center = Vec3::zeros();
        for vertex in vertices {
            area += self.areas[vertex];
            center += self.positions[vertex] * self.areas[vertex];
        }
        (area, center / area)
    }
}

/// Ways between vertices of different parts that are closer than [`GAP`].
fn bridges(mesh: &TriMesh, parts: &[usize]) -> Vec<(u32, u32, f64)> {
    let (low, high) = mesh.bounds();
    let gap = GAP * (high - low).norm();
    let tree = PointTree::new(mesh.vertices());
    let bridges_of = |(index, &point): (usize, &Vec3)| {
        let mut found = Vec::new();
        tree.within(point, gap, &mut found);
        let other = |it: &(f64, u32)| parts[it.1 as usize] != parts[index];
        let length = |to: u32| (mesh.vertices()[to as usize] - point).norm();
        let pairs =
            found.into_iter().filter(other).map(move |it| (index as u32, it.1, length(it.1)));
        pairs.collect::<Vec<_>>()
    };
    mesh.vertices().par_iter().enumerate().flat_map_iter(bridges_of).collect()
}

/// The first of the greatest values.
pub fn farthest(values: &[f64]) -> usize {
    (0..values.len()).fold(0, |best, it| if values[it] > values[best] { it } else { best })
}

fn mesh_ways(mesh: &TriMesh) -> Vec<(u32, u32, f64)> {
    let faces: Vec<[u32; 3]> =
        mesh.faces().iter().copied().filter(|it| !is_collapsed(it)).collect();
    let at = |vertex: u32| mesh.vertices()[vertex as usize];
    let mut ways = Vec::new();
    let mut join = |a: u32, b: u32, length: f64| ways.extend([(a, b, length), (b, a, length)]);
    for sides in Edges::of(&faces).iter() {
        let (low, high) = (sides[0].low, sides[0].high);
        join(low, high, (at(low) - at(high)).norm());
        let [one, other] = sides else { continue };
        let facing = |side: u8, face: u32| faces[face as usize][(side as usize + 2) % 3];
        let (a, b) = (facing(one.side, one.face), facing(other.side, other.face));
        if let Some(length) = unfolded(at(low), at(high), at(a), at(b)).filter(|_| a != b) {
            join(a, b, length);
        }
    }
    ways
}

/// The distance of two points that face an edge, in the plane of one face after unfolding the other;
/// nothing if the straight way passes beside the edge.
fn unfolded(low: Vec3, high: Vec3, a: Vec3, b: Vec3) -> Option<f64> {
    let along = (high - low).try_normalize(0.0)?;
    let flat = |point: Vec3| {
        let x = (point - low).dot(&along);
        (x, (point - low - along * x).norm())
    };
    let ((ax, ay), (bx, by)) = (flat(a), flat(b));
    let crossing = (ax * by + bx * ay) / (ay + by);
    let inside = crossing >= 0.0 && crossing <= (high - low).norm();
    inside.then(|| (ax - bx).hypot(ay + by))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, rectangle};

    #[test]
    fn distances_on_a_square_and_a_sphere_are_nearly_exact() {
        let square = rectangle(20, 20, 1.0, 1.0);
        let corner = |x: f64, y: f64| {
            square.vertices().iter().position(|it| (it.x - x).hypot(it.y - y) < 1e-9).unwrap()
        };
        let distances = Surface::of(&square).distances_from(corner(0.0, 0.0));
        for (x, y) in [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0), (1.0, 0.5)] {
            let (found, true_distance) = (distances[corner(x, y)], x.hypot(y));
            assert!(found >= true_distance - 1e-12, "{found}");
            assert!(found < 1.06 * true_distance, "{found} for {true_distance}");
        }
        let sphere = icosphere(4);
        let distances = Surface::of(&sphere).distances_from(0);
        let first = sphere.vertices()[0];
        for (distance, it) in distances.iter().zip(sphere.vertices()) {
            let angle = it.dot(&first).clamp(-1.0, 1.0).acos();
            assert!((distance - angle).abs() < 0.06 * angle + 1e-3, "{distance} for {angle}");
        }
    }

    #[test]
    fn parts_are_joined_only_where_they_come_close() {
        let sphere = icosphere(2);
        let far = crate::kernels::geometry::shapes::moved(&sphere, Vec3::new(5.0, 0.0, 0.0));
        let both = crate::kernels::geometry::shapes::union(&sphere, &far);
        let mut found = Surface::of(&both).components();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found, [0, sphere.n_vertices()]);
    }
}
