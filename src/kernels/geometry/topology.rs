//! What connects to what in a mesh: edges, boundaries, components, defects.

use super::mesh::TriMesh;

/// Counts that describe how the faces of a mesh are glued together.
///
/// Faces that name a vertex twice are left out of everything but `n_collapsed_faces`; vertices that
/// no other face names are left out of everything but `n_vertices` and `n_unreferenced`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    pub n_vertices: usize,
    pub n_faces: usize,
    pub n_edges: usize,
    /// Parts that share no vertex.
    pub n_components: usize,
    /// Edges of one face.
    pub n_boundary_edges: usize,
    /// Closed chains of boundary edges: holes, rims, seams.
    pub n_boundary_loops: usize,
    /// Edges of more than two faces.
    pub n_nonmanifold_edges: usize,
    /// Vertices whose faces form more than one fan (two cones that touch at their tips).
    pub n_nonmanifold_vertices: usize,
    /// Vertices of no face.
    pub n_unreferenced: usize,
    /// Faces that name a vertex twice.
    pub n_collapsed_faces: usize,
    /// `V - E + F` over what is referenced.
    pub euler_characteristic: i64,
    /// No edge has only one face.
    pub is_closed: bool,
    /// Every edge of two faces is walked in opposite directions by them.
    pub is_oriented: bool,
    /// The number of handles over all components; only for oriented manifolds.
    pub genus: Option<usize>,
}

impl Topology {
    /// Counts.
    pub fn of(mesh: &TriMesh) -> Self {
        let faces: Vec<[u32; 3]> =
            mesh.faces().iter().copied().filter(|it| !is_collapsed(it)).collect();
        let edges = Edges::of(&faces);
        let fans = Fans::of(&faces, &edges, |_| true);
        let (n_referenced, n_components) = referenced_and_components(&faces, mesh.n_vertices());
        let count = |holds: fn(usize) -> bool| edges.iter().filter(|it| holds(it.len())).count();
        let n_boundary_edges = count(|it| it == 1);
        let n_nonmanifold_edges = count(|it| it > 2);
        let n_nonmanifold_vertices = fans.n_vertices_with_several();
        let n_boundary_loops = n_boundary_loops(&edges, &fans);
        let euler_characteristic = n_referenced as i64 - edges.len() as i64 + faces.len() as i64;
        let is_oriented = edges.iter().all(|it| it.len() != 2 || it[0].forward != it[1].forward);
        let is_manifold = n_nonmanifold_edges == 0 && n_nonmanifold_vertices == 0;
        let handles = 2 * n_components as i64 - euler_characteristic - n_boundary_loops as i64;
        Self {
            n_vertices: mesh.n_vertices(),
            n_faces: mesh.n_faces(),
            n_edges: edges.len(),
            n_components,
            n_boundary_edges,
            n_boundary_loops,
            n_nonmanifold_edges,
            n_nonmanifold_vertices,
            n_unreferenced: mesh.n_vertices() - n_referenced,
            n_collapsed_faces: mesh.n_faces() - faces.len(),
            euler_characteristic,
            is_closed: n_boundary_edges == 0,
            is_oriented,
            genus: (is_manifold && is_oriented && handles >= 0).then_some(handles as usize / 2),
        }
    }

    /// No edge has more than two faces, and the faces of every vertex form one fan.
    pub fn is_manifold(&self) -> bool {
        self.n_nonmanifold_edges == 0 && self.n_nonmanifold_vertices == 0
    }
}

/// Whether a face names a vertex twice.
pub fn is_collapsed(&[a, b, c]: &[u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// One side of a face: the edge from corner `side` to the next corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Side {
    /// The smaller vertex.
    pub low: u32,
    /// The larger vertex.
    pub high: u32,
    pub face: u32,
    /// 0, 1 or 2.
    pub side: u8,
    /// Whether the face walks from the smaller vertex to the larger.
    pub forward: bool,
}

/// The sides of all faces, grouped into edges, in ascending order of their vertices.
#[derive(Debug, Clone)]
pub struct Edges {
    sides: Vec<Side>,
    /// One more than edges.
    offsets: Vec<usize>,
}

impl Edges {
    /// Groups the sides of faces that name no vertex twice.
    pub fn of(faces: &[[u32; 3]]) -> Self {
        let mut sides: Vec<Side> = faces
            .iter()
            .enumerate()
            .flat_map(|(face, corners)| {
                (0..3).map(move |side| {
                    let (from, to) = (corners[side], corners[(side + 1) % 3]);
                    let (low, high) = (from.min(to), from.max(to));
                    Side { low, high, face: face as u32, side: side as u8, forward: from < to }
                })
            })
            .collect();
        sides.sort_unstable();
        let mut offsets = vec![0];
        for next in 1..sides.len() {
            if (sides[next].low, sides[next].high) != (sides[next - 1].low, sides[next - 1].high) {
                offsets.push(next);
            }
        }
        if !sides.is_empty() {
            offsets.push(sides.len());
        }
        Self { sides, offsets }
    }

    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The sides that lie on one edge, by ascending face.
    pub fn sides(&self, edge: usize) -> &[Side] {
        &self.sides[self.offsets[edge]..self.offsets[edge + 1]]
    }

    /// The sides of every edge.
    pub fn iter(&self) -> impl Iterator<Item = &[Side]> + '_ {
        self.offsets.windows(2).map(|it| &self.sides[it[0]..it[1]])
    }

    /// For every side of every face (`3 * face + side`), its edge.
    pub fn edge_of_side(&self) -> Vec<u32> {
        let mut edges = vec![0; self.sides.len()];
        for (edge, sides) in self.iter().enumerate() {
            for it in sides {
                edges[3 * it.face as usize + it.side as usize] = edge as u32;
            }
        }
        edges
    }
}

/// The corners of faces, grouped around each vertex into fans that hang together by edges.
#[derive(Debug, Clone)]
pub struct Fans {
    /// For every corner (`3 * face + corner`), the least corner of its fan.
    pub fan_of_corner: Vec<u32>,
    /// For every corner, its vertex.
    vertex_of_corner: Vec<u32>,
}

impl Fans {
    /// Joins corners across the edges for which `glues` holds of the number of their faces.
    pub fn of(faces: &[[u32; 3]], edges: &Edges, glues: impl Fn(usize) -> bool) -> Self {
        let mut sets = DisjointSets::new(3 * faces.len());
        let corner_at = |it: &Side, vertex: u32| {
            let from = faces[it.face as usize][it.side as usize] == vertex;
            let corner = if from { it.side as usize } else { (it.side as usize + 1) % 3 };
            3 * it.face as usize + corner
        };
        for sides in edges.iter().filter(|it| glues(it.len())) {
            for it in &sides[1..] {
                for vertex in [it.low, it.high] {
                    sets.join(corner_at(&sides[0], vertex), corner_at(it, vertex));
                }
            }
        }
        let fan_of_corner = (0..3 * faces.len()).map(|it| sets.find(it) as u32).collect();
        Self { fan_of_corner, vertex_of_corner: faces.iter().flatten().copied().collect() }
    }

    /// The (vertex, fan) pairs, ascending: by vertex, then by the fan's first corner.
    pub fn by_vertex(&self) -> Vec<(u32, u32)> {
        let mut pairs: Vec<(u32, u32)> = (0..self.fan_of_corner.len())
            .filter(|&it| self.fan_of_corner[it] as usize == it)
            .map(|it| (self.vertex_of_corner[it], it as u32))
            .collect();
        pairs.sort_unstable();
        pairs
    }

    fn n_vertices_with_several(&self) -> usize {
        self.by_vertex().chunk_by(|a, b| a.0 == b.0).filter(|it| it.len() > 1).count()
    }
}

/// Boundary edges hang together where they end in the same fan: there every boundary has one way on.
fn n_boundary_loops(edges: &Edges, fans: &Fans) -> usize {
    let mut sets = DisjointSets::new(fans.fan_of_corner.len());
    let mut touched = Vec::new();
    for sides in edges.iter().filter(|it| it.len() == 1) {
        let (face, side) = (sides[0].face as usize, sides[0].side as usize);
        let ends = [side, (side + 1) % 3].map(|it| fans.fan_of_corner[3 * face + it] as usize);
        sets.join(ends[0], ends[1]);
        touched.push(ends[0]);
    }
    touched.iter_mut().for_each(|it| *it = sets.find(*it));
    touched.sort_unstable();
    touched.dedup();
    touched.len()
}

fn referenced_and_components(faces: &[[u32; 3]], n_vertices: usize) -> (usize, usize) {
    let mut sets = DisjointSets::new(n_vertices);
    let mut is_referenced = vec![false; n_vertices];
    for &[a, b, c] in faces {
        sets.join(a as usize, b as usize);
        sets.join(a as usize, c as usize);
        [a, b, c].iter().for_each(|&it| is_referenced[it as usize] = true);
    }
    let referenced = (0..n_vertices).filter(|&it| is_referenced[it]);
    let n_components = referenced.clone().filter(|&it| sets.find(it) == it).count();
    (referenced.count(), n_components)
}

/// Union-find; a set's representative is its least member.
#[derive(Debug, Clone)]
pub struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    pub fn new(n: usize) -> Self {
        Self { parents: (0..n as u32).collect() }
    }

    /// The least member of the set.
    pub fn find(&mut self, mut member: usize) -> usize {
        while self.parents[member] as usize != member {
            self.parents[member] = self.parents[self.parents[member] as usize];
            member = self.parents[member] as usize;
        }
        member
    }

    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.parents[a.max(b)] = a.min(b) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::geometry::shapes::{icosphere, moved, rectangle, torus, union};

    fn mesh_of(n_vertices: usize, faces: &[[u32; 3]]) -> TriMesh {
        let vertices = (0..n_vertices).map(|it| Vec3::new(it as f64, (it * it) as f64, 0.0));
        TriMesh::new(vertices.collect(), faces.to_vec()).unwrap()
    }

    #[test]
    fn known_surfaces_have_their_characteristic_and_genus() {
        let sphere = Topology::of(&icosphere(2));
        assert_eq!((sphere.euler_characteristic, sphere.genus), (2, Some(0)));
        assert!(sphere.is_closed && sphere.is_oriented && sphere.is_manifold());
        let torus_facts = Topology::of(&torus(2.0, 0.5, 12, 8));
        assert_eq!((torus_facts.euler_characteristic, torus_facts.genus), (0, Some(1)));
        let disk = Topology::of(&rectangle(4, 4, 1.0, 1.0));
        assert_eq!((disk.euler_characteristic, disk.genus), (1, Some(0)));
        assert_eq!((disk.n_boundary_edges, disk.n_boundary_loops), (16, 1));
        let both = Topology::of(&union(&icosphere(1), &moved(&torus(2.0, 0.5, 9, 9), Vec3::x())));
        assert_eq!((both.n_components, both.genus), (2, Some(1)));
    }

    #[test]
    fn a_sphere_without_two_distant_faces_has_two_loops() {
        let sphere = icosphere(2);
        let faces = sphere.faces()[1..sphere.n_faces() - 1].to_vec();
        let facts = Topology::of(&TriMesh::new(sphere.vertices().to_vec(), faces).unwrap());
        assert_eq!((facts.n_boundary_edges, facts.n_boundary_loops), (6, 2));
        assert_eq!(facts.genus, Some(0));
    }

    #[test]
    fn a_fin_is_a_nonmanifold_edge_and_a_bow_tie_a_nonmanifold_vertex() {
        let fin = Topology::of(&mesh_of(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]));
        assert_eq!((fin.n_nonmanifold_edges, fin.n_nonmanifold_vertices), (1, 0));
        assert_eq!(fin.genus, None);
        let tie = Topology::of(&mesh_of(5, &[[0, 1, 2], [0, 3, 4]]));
        assert_eq!((tie.n_nonmanifold_edges, tie.n_nonmanifold_vertices), (0, 1));
        assert_eq!((tie.n_components, tie.n_boundary_loops), (1, 2));
    }

    #[test]
    fn unreferenced_vertices_and_collapsed_faces_do_not_count() {
        let facts = Topology::of(&mesh_of(5, &[[0, 1, 2], [1, 1, 3]]));
        assert_eq!((facts.n_unreferenced, facts.n_collapsed_faces), (2, 1));
        assert_eq!((facts.n_edges, facts.euler_characteristic), (3, 1));
    }

    #[test]
    fn two_faces_that_walk_an_edge_alike_are_not_oriented() {
        assert!(!Topology::of(&mesh_of(4, &[[0, 1, 2], [0, 1, 3]])).is_oriented);
        assert!(Topology::of(&mesh_of(4, &[[0, 1, 2], [1, 0, 3]])).is_oriented);
    }
}
