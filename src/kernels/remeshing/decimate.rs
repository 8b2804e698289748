//! Coarser meshes by collapsing edges.

use crate::kernels::geometry::triangle::closest_on_triangle;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, SymmetricEigen};

use super::resampled::Resampled;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::{Edges, is_collapsed};
use crate::kernels::numerics::sparse::CsrMatrix;

/// When to stop, and what to leave alone.
#[derive(Debug, Clone, PartialEq)]
pub struct DecimateOptions {
    /// Collapse until so many vertices are left, or no edge may be collapsed any more.
    pub n_vertices: usize,
    /// How much dearer it is to leave a boundary than a face.
    pub boundary_weight: f64,
    /// Vertices that stay where they are (landmarks).
    pub fixed: Vec<u32>,
}

impl Default for DecimateOptions {
    fn default() -> Self {
        Self { n_vertices: 5000, boundary_weight: 100.0, fixed: Vec::new() }
    }
}

/// Why a mesh cannot be decimated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DecimateError {
    #[error("{n_wanted} vertices are no surface; the least is 4")]
    TooFew { n_wanted: usize },
    #[error("vertex {vertex} is to stay, but the mesh has {n_vertices} vertices")]
    OutOfRange { vertex: u32, n_vertices: usize },
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Collapses edges in the order of their quadric error (Garland & Heckbert 1997).
///
/// Never changes the topology: only edges that fulfil the link condition (Dey et al. 1999) collapse,
/// edges of three and more faces and their ends stay. Never turns a face over, and leaves no needle
/// where there was none. Ties go to the smaller vertex numbers, so the result is the same everywhere.
/// Vertices of no face vanish.
///
/// Each new vertex knows the old surface: its row in `new_from_old` holds the barycentric coordinates
/// of the closest point on the old faces around the vertices that it replaces.
///
/// # Errors
/// See [`DecimateError`].
pub fn decimate(mesh: &TriMesh, options: &DecimateOptions) -> Result<Resampled, DecimateError> {
    mesh.check_has_faces()?;
    if options.n_vertices < 4 {
        return Err(DecimateError::TooFew { n_wanted: options.n_vertices });
    }
    let n_vertices = mesh.n_vertices();
    if let Some(&vertex) = options.fixed.iter().find(|it| **it as usize >= n_vertices) {
        return Err(DecimateError::OutOfRange { vertex, n_vertices });
    }
    let mut state = State::new(mesh, options);
    state.run(options.n_vertices);
    Ok(state.finish(mesh)?)
}

struct State {
    positions: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
    is_alive: Vec<bool>,
    /// Living faces of every vertex.
    around: Vec<Vec<u32>>,
    quadrics: Vec<Quadric>,
    is_fixed: Vec<bool>,
    /// On an edge of one face. A collapse along a boundary keeps both ends on it.
    is_boundary: Vec<bool>,
    /// Raised when a vertex changes: older candidates are void.
    stamps: Vec<u32>,
    /// For a removed vertex, the one that took its place.
    replaced_by: Vec<u32>,
    n_left: usize,
    heap: BinaryHeap<Candidate>,
}

/// An edge that may collapse, the cheapest first.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    cost: f64,
    keep: u32,
    remove: u32,
    stamp: u32,
    place: Vec3,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        // The heap gives the greatest: the least cost, then the least numbers.
        let by_cost = other.cost.total_cmp(&self.cost);
        by_cost.then((other.keep, other.remove).cmp(&(self.keep, self.remove)))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl State {
    fn new(mesh: &TriMesh, options: &DecimateOptions) -> Self {
        let n_vertices = mesh.n_vertices();
        let faces: Vec<[u32; 3]> =
            mesh.faces().iter().copied().filter(|it| !is_collapsed(it)).collect();
        let mut around = vec![Vec::new(); n_vertices];
        for (face, corners) in faces.iter().enumerate() {
            corners.iter().for_each(|&it| around[it as usize].push(face as u32));
        }
        let mut is_fixed = vec![false; n_vertices];
        options.fixed.iter().for_each(|&it| is_fixed[it as usize] = true);
        let n_left = around.iter().filter(|it| !it.is_empty()).count();
        let mut state = Self {
            positions: mesh.vertices().to_vec(),
            is_alive: vec![true; faces.len()],
            around,
            quadrics: vec![Quadric::default(); n_vertices],
            is_fixed,
            is_boundary: vec![false; n_vertices],
            stamps: vec![0; n_vertices],
            replaced_by: (0..n_vertices as u32).collect(),
            n_left,
            heap: BinaryHeap::new(),
            faces,
        };
        let edges = Edges::of(&state.faces);
        state.add_quadrics(&edges, options.boundary_weight);
        for sides in edges.iter() {
            state.push(sides[0].low, sides[0].high);
        }
        state
    }

    fn add_quadrics(&mut self, edges: &Edges, boundary_weight: f64) {
        for &face in &self.faces {
            let area_vector = self.area_vector(face);
            let area = area_vector.norm();
            let quadric = Quadric::plane(area_vector, self.positions[face[0] as usize], area);
            face.iter().for_each(|&it| self.quadrics[it as usize].add(&quadric));
        }
        for sides in edges.iter() {
            let (low, high) = (sides[0].low as usize, sides[0].high as usize);
            if sides.len() == 1 {
                self.is_boundary[low] = true;
                self.is_boundary[high] = true;
                let along = self.positions[high] - self.positions[low];
                let across = along.cross(&self.area_vector(self.faces[sides[0].face as usize]));
                let weight = boundary_weight * along.norm_squared();
                let quadric = Quadric::plane(across, self.positions[low], weight);
                self.quadrics[low].add(&quadric);
                self.quadrics[high].add(&quadric);
            }
            if sides.len() > 2 {
                self.is_fixed[low] = true;
                self.is_fixed[high] = true;
            }
        }
    }

    fn area_vector(&self, face: [u32; 3]) -> Vec3 {
        let [a, b, c] = face.map(|it| self.positions[it as usize]);
        (b - a).cross(&(c - a)) * 0.5
    }

    fn push(&mut self, a: u32, b: u32) {
        let (keep, remove) = match (self.is_fixed[a as usize], self.is_fixed[b as usize]) {
            (true, true) => return,
            (false, true) => (b, a),
            (true, false) => (a, b),
            (false, false) => (a.min(b), a.max(b)),
        };
        let mut quadric = self.quadrics[keep as usize];
        quadric.add(&self.quadrics[remove as usize]);
        let ends = [keep, remove].map(|it| self.positions[it as usize]);
        let place = if self.is_fixed[keep as usize] {
            ends[0]
        } else {
            quadric.least((ends[0] + ends[1]) / 2.0)
        };
        // On flat parts all errors are zero: shorter edges then come first.
        let length2 = (ends[1] - ends[0]).norm_squared();
        let cost = quadric.error(&place).max(0.0) + 1e-6 * length2 * length2;
        let stamp = self.stamps[keep as usize] + self.stamps[remove as usize];
        self.heap.push(Candidate { cost, keep, remove, stamp, place });
    }

    fn run(&mut self, n_wanted: usize) {
        while self.n_left > n_wanted {
            let Some(candidate) = self.heap.pop() else { return };
            let (keep, remove) = (candidate.keep as usize, candidate.remove as usize);
            let is_current = self.replaced_by[keep] == candidate.keep
                && self.replaced_by[remove] == candidate.remove
                && self.stamps[keep] + self.stamps[remove] == candidate.stamp;
            if is_current && self.may_collapse(&candidate) {
                self.collapse(&candidate);
            }
        }
    }

    fn may_collapse(&self, candidate: &Candidate) -> bool {
        let (keep, remove) = (candidate.keep, candidate.remove);
        let shared: Vec<u32> = self.around[keep as usize]
            .iter()
            .copied()
            .filter(|&it| self.faces[it as usize].contains(&remove))
            .collect();
        self.keeps_topology(keep, remove, &shared) && self.keeps_faces(candidate, &shared)
    }

    /// The link condition: the ends' common neighbours are just the tips of the edge's faces.
    fn keeps_topology(&self, keep: u32, remove: u32, shared: &[u32]) -> bool {
        let both_on_boundary = self.is_boundary[keep as usize] && self.is_boundary[remove as usize];
        match shared.len() {
            1 if both_on_boundary => {}
            2 if !both_on_boundary => {}
            _ => return false,
        }
        let (of_keep, of_remove) = (self.neighbours(keep), self.neighbours(remove));
        let n_common = of_keep.iter().filter(|it| of_remove.binary_search(it).is_ok()).count();
        // The last triangle or tetrahedron of a part would vanish.
        let n_around = of_keep.len() + of_remove.len() - n_common;
        n_common == shared.len() && n_around > shared.len() + 2
    }

    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let corners = self.around[vertex as usize].iter().flat_map(|&it| self.faces[it as usize]);
        let mut neighbours: Vec<u32> = corners.filter(|&it| it != vertex).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        neighbours
    }

    /// No face that stays may turn by more than 70 degrees or become a needle.
    fn keeps_faces(&self, candidate: &Candidate, shared: &[u32]) -> bool {
        for vertex in [candidate.keep, candidate.remove] {
            for &face in self.around[vertex as usize].iter().filter(|it| !shared.contains(it)) {
                let corners = self.faces[face as usize].map(|it| self.positions[it as usize]);
                let moved = [0, 1, 2].map(|it| {
                    let is_moved = self.faces[face as usize][it] == vertex;
                    if is_moved { candidate.place } else { corners[it] }
                });
                let (before, after) = (area_vector(corners), area_vector(moved));
                let (old_area, new_area) = (before.norm(), after.norm());
                let turned = before.dot(&after) < 0.34 * old_area * new_area;
                let is_needle = roundness(&moved, new_area) < 0.06
                    && roundness(&moved, new_area) < roundness(&corners, old_area);
                if (old_area > 0.0 && turned) || is_needle {
                    return false;
                }
            }
        }
        true
    }

    fn collapse(&mut self, candidate: &Candidate) {
        let (keep, remove) = (candidate.keep as usize, candidate.remove as usize);
        self.positions[keep] = candidate.place;
        let removed = self.quadrics[remove];
        self.quadrics[keep].add(&removed);
        self.is_boundary[keep] |= self.is_boundary[remove];
        self.replaced_by[remove] = candidate.keep;
        for face in std::mem::take(&mut self.around[remove]) {
            let corners = &mut self.faces[face as usize];
            if corners.contains(&candidate.keep) {
                self.is_alive[face as usize] = false;
                for &corner in corners.iter().filter(|&&it| it != candidate.remove) {
                    self.around[corner as usize].retain(|&it| it != face);
                }
            } else {
                let corner = corners.iter_mut().find(|it| **it == candidate.remove);
                *corner.expect("a vertex is a corner of the faces around it") = candidate.keep;
                self.around[keep].push(face);
            }
        }
        self.around[keep].sort_unstable();
        self.n_left -= 1;
        self.stamps[keep] += 1;
        for neighbour in self.neighbours(candidate.keep) {
            self.push(candidate.keep, neighbour);
        }
    }

    fn finish(mut self, mesh: &TriMesh) -> Result<Resampled, MeshError> {
        // A vertex is replaced by one that may be replaced later; the last one counts.
        for vertex in 0..self.replaced_by.len() {
            let mut last = self.replaced_by[vertex];
            while self.replaced_by[last as usize] != last {
                last = self.replaced_by[last as usize];
            }
            self.replaced_by[vertex] = last;
        }
        let mut new_of_vertex = vec![None; self.positions.len()];
        let mut vertices = Vec::with_capacity(self.n_left);
        for vertex in 0..self.positions.len() {
            if !self.around[vertex].is_empty() {
                new_of_vertex[vertex] = Some(vertices.len() as u32);
                vertices.push(self.positions[vertex]);
            }
        }
        let number = |it: u32| new_of_vertex[it as usize].expect("a face's vertices are kept");
        let alive = self.faces.iter().zip(&self.is_alive).filter(|it| *it.1);
        let faces = alive.map(|(face, _)| face.map(number)).collect();
        let new_of_old: Vec<Option<u32>> =
            self.replaced_by.iter().map(|&it| new_of_vertex[it as usize]).collect();
        let new_from_old = places_on(mesh, &vertices, &new_of_old);
        Ok(Resampled { mesh: TriMesh::new(vertices, faces)?, new_from_old, new_of_old })
    }
}

/// For every new vertex, the closest point on the old faces that touch a vertex it replaces.
fn places_on(old: &TriMesh, vertices: &[Vec3], new_of_old: &[Option<u32>]) -> CsrMatrix {
    let mut best: Vec<(f64, [u32; 3], [f64; 3])> =
        vec![(f64::INFINITY, [0; 3], [0.0; 3]); vertices.len()];
    for (face, &corners) in old.faces().iter().enumerate() {
        let mut owners: Vec<u32> =
            corners.iter().filter_map(|&it| new_of_old[it as usize]).collect();
        owners.sort_unstable();
        owners.dedup();
        for owner in owners {
            let point = vertices[owner as usize];
            let weights = closest_on_triangle(&point, &old.corners(face));
            let at: Vec3 = old.corners(face).iter().zip(weights).map(|(p, w)| p * w).sum();
            let distance = (at - point).norm_squared();
            if distance < best[owner as usize].0 {
                best[owner as usize] = (distance, corners, weights);
            }
        }
    }
    let triplets: Vec<(u32, u32, f64)> = best
        .iter()
        .enumerate()
        .flat_map(|(new, (_, corners, weights))| {
            let positive = (0..3).filter(|&it| weights[it] > 0.0);
            positive.map(move |it| (new as u32, corners[it], weights[it]))
        })
        .collect();
    CsrMatrix::from_triplets(vertices.len(), new_of_old.len(), &triplets)
}

fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)) * 0.5
}

/// One for an equilateral triangle, zero for a line.
fn roundness([a, b, c]: &[Vec3; 3], area: f64) -> f64 {
    let edges2 = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    if edges2 > 0.0 { 4.0 * 3.0f64.sqrt() * area / edges2 } else { 0.0 }
}

/// A sum of weighted squared distances to planes: `x' A x + 2 b' x + c`.
#[derive(Debug, Clone, Copy, Default)]
struct Quadric {
    a: Matrix3<f64>,
    b: Vec3,
    c: f64,
}

impl Quadric {
    fn plane(normal: Vec3, through: Vec3, weight: f64) -> Self {
        let normal = normal.try_normalize(0.0).unwrap_or_default();
        let offset = -normal.dot(&through);
        Self {
            a: normal * normal.transpose() * weight,
            b: normal * (offset * weight),
            c: offset * offset * weight,
        }
    }

    fn add(&mut self, other: &Self) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
    }

    fn error(&self, at: &Vec3) -> f64 {
        at.dot(&(self.a * at)) + 2.0 * self.b.dot(at) + self.c
    }

    /// The least error, as close to `near` as the planes leave room (Lindstrom 2000: directions of
    /// small eigenvalues are not determined by the planes).
    fn least(&self, near: Vec3) -> Vec3 {
        let residual = -(self.b + self.a * near);
        let eigen = SymmetricEigen::new(self.a);
        let limit = 1e-3 * eigen.eigenvalues.amax();
        let mut place = near;
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > limit && *value > 0.0 {
                place += vector * (vector.dot(&residual) / value);
            }
        }
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::landmarks::Landmarks;
    use crate::kernels::geometry::shapes::{icosphere, rectangle, signed_volume, torus};
    use crate::kernels::geometry::topology::Topology;
    use crate::kernels::rigs::weights::SkinWeights;

    fn to(n_vertices: usize) -> DecimateOptions {
        DecimateOptions { n_vertices, ..Default::default() }
    }

    #[test]
    fn topology_stays_and_the_count_is_met() {
        for (mesh, n) in
            [(icosphere(4), 300), (torus(2.0, 0.5, 60, 30), 250), (rectangle(20, 20, 1.0, 1.0), 40)]
        {
            let coarse = decimate(&mesh, &to(n)).unwrap().mesh;
            assert_eq!(coarse.n_vertices(), n);
            let (before, after) = (Topology::of(&mesh), Topology::of(&coarse));
            assert_eq!(before.euler_characteristic, after.euler_characteristic);
            assert_eq!(before.n_boundary_loops, after.n_boundary_loops);
            assert!(after.is_manifold() && after.is_oriented);
        }
    }

    #[test]
    fn shape_stays() {
        let (sphere, ring) = (icosphere(4), torus(2.0, 0.5, 60, 30));
        for (mesh, n) in [(&sphere, 300), (&ring, 400)] {
            let coarse = decimate(mesh, &to(n)).unwrap().mesh;
            assert!((signed_volume(&coarse) / signed_volume(mesh) - 1.0).abs() < 0.01);
            assert!((coarse.area() / mesh.area() - 1.0).abs() < 0.02);
        }
        let square = decimate(&rectangle(20, 20, 1.0, 1.0), &to(16)).unwrap().mesh;
        assert!((square.area() - 1.0).abs() < 1e-9, "a flat square loses nothing");
    }

    #[test]
    fn every_part_and_the_last_tetrahedron_survive() {
        let ball = decimate(&icosphere(2), &to(4)).unwrap().mesh;
        assert!(ball.n_vertices() >= 4);
        assert_eq!(Topology::of(&ball).genus, Some(0));
    }

    #[test]
    fn new_vertices_lie_on_the_old_surface_and_weights_sum_to_one() {
        let mesh = icosphere(3);
        let coarse = decimate(&mesh, &to(100)).unwrap();
        let ones = coarse.function(&vec![1.0; mesh.n_vertices()]);
        assert!(ones.iter().all(|it| (it - 1.0).abs() < 1e-12));
        let x: Vec<f64> = mesh.vertices().iter().map(|it| it.x).collect();
        for (carried, vertex) in coarse.function(&x).iter().zip(coarse.mesh.vertices()) {
            assert!((carried - vertex.x).abs() < 0.03);
        }
        let rows: Vec<_> = x.iter().map(|it| vec![(0, 1.0 + it), (1, 1.0 - it)]).collect();
        let weights = coarse.weights(&SkinWeights::from_rows(2, &rows).unwrap()).unwrap();
        for (vertex, place) in coarse.mesh.vertices().iter().enumerate() {
            let sum: f64 = weights.row(vertex).map(|it| it.1).sum();
            assert!((sum - 1.0).abs() < 1e-12);
            assert!((weights.get(vertex, 0) - (1.0 + place.x) / 2.0).abs() < 0.02);
        }
    }

    #[test]
    fn fixed_vertices_keep_their_places() {
        let mesh = icosphere(3);
        let fixed = vec![5, 77, 300];
        let coarse = decimate(&mesh, &DecimateOptions { fixed: fixed.clone(), ..to(60) }).unwrap();
        let names = ["a", "b", "c"].map(str::to_owned).to_vec();
        let landmarks = coarse.landmarks(&Landmarks { names, vertices: fixed.clone() }).unwrap();
        for (old, new) in fixed.iter().zip(&landmarks.vertices) {
            assert_eq!(mesh.vertices()[*old as usize], coarse.mesh.vertices()[*new as usize]);
        }
    }

    #[test]
    fn a_mesh_that_is_coarse_enough_stays_as_it_is() {
        let mesh = torus(2.0, 0.5, 8, 6);
        let same = decimate(&mesh, &to(48)).unwrap();
        assert_eq!(same.mesh, mesh);
        assert_eq!(decimate(&mesh, &to(3)), Err(DecimateError::TooFew { n_wanted: 3 }));
    }

    #[test]
    fn closest_points_are_not_beaten_by_any_other() {
        let corners = [Vec3::zeros(), Vec3::new(2.0, 0.3, 0.1), Vec3::new(0.4, 1.5, -0.2)];
        let at = |w: [f64; 3]| -> Vec3 { corners.iter().zip(w).map(|(p, w)| p * w).sum() };
        for step in 0..60 {
            let angle = f64::from(step) * 0.7;
            let point = Vec3::new(3.0 * angle.cos(), 2.0 * (1.3 * angle).sin(), 0.5 * angle.sin());
            let best = (at(closest_on_triangle(&point, &corners)) - point).norm();
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (u, v) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    assert!((at([1.0 - u - v, u, v]) - point).norm() >= best - 1e-12);
                }
            }
        }
    }
}
