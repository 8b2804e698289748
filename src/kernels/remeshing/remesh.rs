//! Remeshing of closed surfaces to a given number of vertices.

use rayon::prelude::*;

use crate::kernels::geometry::{
    corner_table::{CornerTable, TopologyError},
    mesh::{TriMesh, Vec3},
};

/// How [`remesh`] works.
#[derive(Debug, Clone)]
pub struct RemeshOptions {
    /// The number of vertices of the result.
    pub n_vertices: usize,
    /// Rounds of split, collapse, flip and relaxation. Five settle.
    pub rounds: usize,
}

/// Remeshes a closed surface into triangles of a wanted size, with exactly `n_vertices` vertices
/// wherever its topology allows that.
///
/// Splits long edges, collapses short ones, flips towards valence six and relaxes tangentially
/// (Botsch & Kobbelt 2004). `size` gives the wanted edge length at a point, up to a common factor
/// that follows from the number of vertices: a constant makes the result uniform. `project` leads a
/// point near the surface onto it. Topology stays as it is; edges never become non-manifold.
///
/// # Errors
/// [`TopologyError`] if the mesh is not closed and manifold.
pub fn remesh(
    mesh: &TriMesh,
    options: &RemeshOptions,
    size: &(dyn Fn(Vec3) -> f64 + Sync),
    project: &(dyn Fn(Vec3) -> Vec3 + Sync),
) -> Result<TriMesh, TopologyError> {
    let mut state = Remesher { table: CornerTable::new(mesh)?, sizes: Vec::new(), size, project };
    state.sizes = mesh.vertices().par_iter().map(|&it| size(it)).collect();
    for _ in 0..options.rounds {
        let unit = state.unit_length(options.n_vertices);
        state.split_longer_than(unit * 4.0 / 3.0);
        state.collapse_shorter_than(unit * 4.0 / 5.0, unit * 4.0 / 3.0);
        state.flip();
        state.relax();
    }
    state.reach(options.n_vertices);
    for _ in 0..2 {
        state.flip();
        state.relax();
    }
    Ok(state.table.into_mesh())
}

struct Remesher<'a> {
    table: CornerTable,
    /// The wanted edge length at every vertex, up to the common factor.
    sizes: Vec<f64>,
    size: &'a (dyn Fn(Vec3) -> f64 + Sync),
    project: &'a (dyn Fn(Vec3) -> Vec3 + Sync),
}

impl Remesher<'_> {
    /// The factor of `sizes` at which equilateral triangles of those sizes need `n` vertices: two
    /// triangles, `sqrt(3) / 2` of the squared edge length, belong to every vertex.
    fn unit_length(&self, n_vertices: usize) -> f64 {
        let mut area = 0.0;
        for face in self.table.live_faces() {
            let [a, b, c] = self.table.corners(face);
            let [p, q, r] = [a, b, c].map(|it| self.table.position(it));
            let size = [a, b, c].map(|it| self.sizes[it as usize]).iter().sum::<f64>() / 3.0;
            area += (q - p).cross(&(r - p)).norm() * 0.5 / (size * size);
        }
        (area / (n_vertices as f64 * 0.75_f64.sqrt())).sqrt()
    }

    /// An edge's length over its wanted length, up to the common factor.
    fn relative_length(&self, [a, b]: [u32; 2]) -> f64 {
        let size = 0.5 * (self.sizes[a as usize] + self.sizes[b as usize]);
        (self.table.position(b) - self.table.position(a)).norm() / size
    }

    fn split_longer_than(&mut self, limit: f64) {
        for ends in self.table.edges() {
            if self.relative_length(ends) > limit {
                self.split(ends);
            }
        }
    }

    /// Splits an edge that exists.
    fn split(&mut self, [a, b]: [u32; 2]) {
        let edge = self.table.edge([a, b]).expect("splits remove no other edge");
        let middle = 0.5 * (self.table.position(a) + self.table.position(b));
        self.table.split(edge, middle);
        self.sizes.push(0.5 * (self.sizes[a as usize] + self.sizes[b as usize]));
    }

    fn collapse_shorter_than(&mut self, limit: f64, longest: f64) {
        for ends in self.table.edges() {
            if self.relative_length(ends) < limit {
                self.collapse(ends, longest);
            }
        }
    }

    /// Collapses an edge into its middle if it still exists and that neither folds the surface nor
    /// makes edges longer than `longest`.
    fn collapse(&mut self, [a, b]: [u32; 2], longest: f64) {
        let Some(edge) = self.table.edge([a, b]).filter(|&it| self.table.can_collapse(it)) else {
            return;
        };
        let middle = 0.5 * (self.table.position(a) + self.table.position(b));
        let fits = |from: u32, other: u32| {
            self.table.outgoing(from).all(|spoke| {
                let (p, q) = (self.table.target(spoke), self.table.apex(spoke));
                let length = (self.table.position(p) - middle).norm();
                let reach = length / self.sizes[p as usize];
                (p == other || reach < longest)
                    && (p == other || q == other || self.keeps_facing(from, middle, p, q))
            })
        };
        if fits(a, b) && fits(b, a) {
            self.table.collapse(edge, middle);
            self.sizes[b as usize] = 0.5 * (self.sizes[a as usize] + self.sizes[b as usize]);
        }
    }

    /// Whether the triangle `from p q` faces about the same way when `from` moves to `to`.
    fn keeps_facing(&self, from: u32, to: Vec3, p: u32, q: u32) -> bool {
        let [old, p, q] = [from, p, q].map(|it| self.table.position(it));
        let before = (p - old).cross(&(q - old));
        let after = (p - to).cross(&(q - to));
        before.dot(&after) > 0.5 * before.norm() * after.norm()
    }

    /// Flips edges where that brings valences closer to six, or equal and angles closer to Delaunay.
    fn flip(&mut self) {
        let mut valences = self.table.valences();
        for [a, b] in self.table.edges() {
            let Some(edge) = self.table.edge([a, b]) else { continue };
            let (c, d) = (self.table.apex(edge), self.table.apex(self.table.twin(edge)));
            let valence = |vertex: u32| f64::from(valences[vertex as usize]);
            let excess = |vertex: u32, change: f64| (valence(vertex) + change - 6.0).powi(2);
            let before = excess(a, 0.0) + excess(b, 0.0) + excess(c, 0.0) + excess(d, 0.0);
            let after = excess(a, -1.0) + excess(b, -1.0) + excess(c, 1.0) + excess(d, 1.0);
            if after <= before
                && valences[a as usize] > 3
                && valences[b as usize] > 3
                && (after < before
                    || self.opposite_angles(a, b, c, d) > 1.05 * std::f64::consts::PI)
                && self.flip_keeps_facing(a, b, c, d)
                && self.table.edge([c, d]).is_none()
            {
                self.table.flip(edge);
                valences[a as usize] -= 1;
                valences[b as usize] -= 1;
                valences[c as usize] += 1;
                valences[d as usize] += 1;
            }
        }
    }

    /// The sum of the two angles that face the edge `ab`; more than pi is not Delaunay.
    fn opposite_angles(&self, a: u32, b: u32, c: u32, d: u32) -> f64 {
        let [a, b, c, d] = [a, b, c, d].map(|it| self.table.position(it));
        (a - c).angle(&(b - c)) + (a - d).angle(&(b - d))
    }

    /// Whether both triangles after a flip face as the two before do together.
    fn flip_keeps_facing(&self, a: u32, b: u32, c: u32, d: u32) -> bool {
        let [a, b, c, d] = [a, b, c, d].map(|it| self.table.position(it));
        let (first, second) = ((b - a).cross(&(c - a)), (a - b).cross(&(d - b)));
        let facing = (first + second).normalize();
        let new = [(d - a).cross(&(c - a)), (b - d).cross(&(c - d))];
        let old_area = first.norm() + second.norm();
        new.iter().all(|it| it.dot(&facing) > 0.8 * it.norm() && it.norm() > 0.02 * old_area)
    }

    /// Moves every vertex to the weighted middle of its neighbours, within the surface.
    ///
    /// Neighbours weigh as much as the area around them differs from what is wanted, which equalizes
    /// the sampling (Surazhsky & Gotsman 2003 in the form of Botsch & Kobbelt).
    fn relax(&mut self) {
        let weights = self.table.vertex_areas();
        let moved: Vec<Vec3> = (0..self.table.n_slots())
            .into_par_iter()
            .map(|vertex| {
                let old = self.table.position(vertex);
                if !self.table.is_live_vertex(vertex) {
                    return old;
                }
                let (mut middle, mut total, mut normal) = (Vec3::zeros(), 0.0, Vec3::zeros());
                for spoke in self.table.outgoing(vertex) {
                    let (p, q) = (self.table.target(spoke), self.table.apex(spoke));
                    let size = self.sizes[p as usize];
                    let weight = weights[p as usize] / (size * size);
                    middle += weight * self.table.position(p);
                    total += weight;
                    let [p, q] = [p, q].map(|it| self.table.position(it));
                    normal += (p - old).cross(&(q - old));
                }
                let step = middle / total - old;
                let normal = normal.try_normalize(0.0).unwrap_or_default();
                let target = (self.project)(old + step - normal * normal.dot(&step));
                let facing = self.table.outgoing(vertex).all(|spoke| {
                    self.keeps_facing(
                        vertex,
                        target,
                        self.table.target(spoke),
                        self.table.apex(spoke),
                    )
                });
                if facing { target } else { old }
            })
            .collect();
        let size = self.size;
        self.sizes.par_iter_mut().zip(&moved).for_each(|(it, &position)| *it = size(position));
        self.table.set_positions(moved);
    }

    /// Collapses the shortest or splits the longest edges until the number of vertices is right.
    fn reach(&mut self, n_vertices: usize) {
        while self.table.n_vertices() != n_vertices {
            let before = self.table.n_vertices();
            let mut edges: Vec<(f64, [u32; 2])> =
                self.table.edges().into_iter().map(|it| (self.relative_length(it), it)).collect();
            edges.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            if before > n_vertices {
                for &(_, ends) in &edges {
                    if self.table.n_vertices() == n_vertices {
                        break;
                    }
                    self.collapse(ends, f64::INFINITY);
                }
            } else {
                // A third at most in one sweep, as splits make other edges the longest.
                let n_splits = (n_vertices - before).min(edges.len() / 3);
                for &(_, ends) in edges.iter().rev().take(n_splits) {
                    self.split(ends);
                }
            }
            if self.table.n_vertices() == before {
                break;
            }
            self.flip();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn octahedron() -> TriMesh {
        let vertices = vec![Vec3::x(), -Vec3::x(), Vec3::y(), -Vec3::y(), Vec3::z(), -Vec3::z()];
        let faces = vec![
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ];
        TriMesh::new(vertices, faces).unwrap()
    }

    #[test]
    fn a_sphere_gets_the_vertices_asked_for_and_good_triangles() {
        for n_vertices in [50, 1_000, 3_001] {
            let options = RemeshOptions { n_vertices, rounds: 12 };
            let mesh = remesh(&octahedron(), &options, &|_| 1.0, &|it| it.normalize()).unwrap();
            assert_eq!(mesh.n_vertices(), n_vertices);
            assert_eq!(mesh.n_faces(), 2 * n_vertices - 4, "still a sphere");
            let smallest = (0..mesh.n_faces()).map(|it| least_angle(mesh.corners(it)));
            let smallest = smallest.fold(f64::INFINITY, f64::min).to_degrees();
            assert!(smallest > 22.0, "smallest angle {smallest} degrees");
            assert!(
                (0..mesh.n_faces())
                    .all(|face| mesh.area_vector(face).dot(&mesh.corners(face)[0]) > 0.0)
            );
        }
    }

    #[test]
    fn sizes_are_followed() {
        let options = RemeshOptions { n_vertices: 2_000, rounds: 12 };
        let size = |it: Vec3| if it.z > 0.0 { 1.0 } else { 3.0 };
        let mesh = remesh(&octahedron(), &options, &size, &|it| it.normalize()).unwrap();
        let top = mesh.vertices().iter().filter(|it| it.z > 0.0).count() as f64;
        let ratio = top / (mesh.n_vertices() as f64 - top);
        assert!((7.0..10.0).contains(&ratio), "nine times as dense: {ratio}");
    }

    fn least_angle([a, b, c]: [Vec3; 3]) -> f64 {
        let angles = [(b - a).angle(&(c - a)), (c - b).angle(&(a - b)), (a - c).angle(&(b - c))];
        angles.into_iter().fold(f64::INFINITY, f64::min)
    }
}
