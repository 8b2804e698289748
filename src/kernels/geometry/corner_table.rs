//! Connectivity of closed triangle meshes that can be edited.

use std::collections::HashMap;

use super::mesh::{TriMesh, Vec3};

/// A closed, oriented, manifold triangle mesh under local edits.
///
/// Half-edge `3 f + i` leads from corner `i` of face `f` to the next corner (Rossignac's corner
/// table). Removed faces and vertices keep their numbers until [`CornerTable::into_mesh`].
#[derive(Debug, Clone)]
pub struct CornerTable {
    positions: Vec<Vec3>,
    /// The vertex where every half-edge starts; `NONE` in removed faces.
    origins: Vec<u32>,
    twins: Vec<u32>,
    /// A half-edge that starts at every vertex; `NONE` for removed vertices.
    outgoing: Vec<u32>,
    n_vertices: usize,
}

const NONE: u32 = u32::MAX;

/// Why a mesh is no closed manifold.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TopologyError {
    #[error("the edge from vertex {from} to vertex {to} occurs in two faces of one direction")]
    RepeatedEdge { from: u32, to: u32 },
    #[error("the edge between vertices {from} and {to} has a face on one side only")]
    Boundary { from: u32, to: u32 },
    #[error("the faces around vertex {vertex} form more than one fan")]
    SeveralFans { vertex: u32 },
    #[error("vertex {vertex} belongs to no face")]
    Unreferenced { vertex: u32 },
}

impl CornerTable {
    /// Links the faces of a mesh.
    ///
    /// # Errors
    /// [`TopologyError`], naming the first offence.
    pub fn new(mesh: &TriMesh) -> Result<Self, TopologyError> {
        let origins: Vec<u32> = mesh.faces().iter().flatten().copied().collect();
        let mut by_ends = HashMap::with_capacity(origins.len());
        for edge in 0..origins.len() as u32 {
            let (from, to) = (origins[edge as usize], origins[next(edge) as usize]);
            if by_ends.insert((from, to), edge).is_some() {
                return Err(TopologyError::RepeatedEdge { from, to });
            }
        }
        let mut outgoing = vec![NONE; mesh.n_vertices()];
        let mut twins = vec![NONE; origins.len()];
        let mut degrees = vec![0_u32; mesh.n_vertices()];
        for edge in 0..origins.len() as u32 {
            let (from, to) = (origins[edge as usize], origins[next(edge) as usize]);
            let Some(&twin) = by_ends.get(&(to, from)) else {
                return Err(TopologyError::Boundary { from, to });
            };
            twins[edge as usize] = twin;
            outgoing[from as usize] = edge;
            degrees[from as usize] += 1;
        }
        let n_vertices = mesh.n_vertices();
        let table =
            Self { positions: mesh.vertices().to_vec(), origins, twins, outgoing, n_vertices };
        for vertex in 0..n_vertices as u32 {
            if table.outgoing[vertex as usize] == NONE {
                return Err(TopologyError::Unreferenced { vertex });
            }
            if table.outgoing(vertex).count() != degrees[vertex as usize] as usize {
                return Err(TopologyError::SeveralFans { vertex });
            }
        }
        Ok(table)
    }

    /// The mesh without what was removed, vertices and faces in their order.
    pub fn into_mesh(self) -> TriMesh {
        let mut numbers = vec![NONE; self.positions.len()];
        let mut vertices = Vec::with_capacity(self.n_vertices);
        for vertex in 0..self.positions.len() {
            if self.outgoing[vertex] != NONE {
                numbers[vertex] = vertices.len() as u32;
                vertices.push(self.positions[vertex]);
            }
        }
        let faces = self.live_faces().map(|it| self.corners(it).map(|v| numbers[v as usize]));
        let faces = faces.collect();
        TriMesh::new(vertices, faces).expect("edits keep indices in range and positions finite")
    }

    /// The number of vertices that are not removed.
    pub fn n_vertices(&self) -> usize {
        self.n_vertices
    }

    /// One more than the greatest vertex number.
    pub fn n_slots(&self) -> u32 {
        self.positions.len() as u32
    }

    pub fn position(&self, vertex: u32) -> Vec3 {
        self.positions[vertex as usize]
    }

    /// Replaces all positions, also those of removed vertices.
    ///
    /// # Panics
    /// If the number of positions is not [`CornerTable::n_slots`].
    pub fn set_positions(&mut self, positions: Vec<Vec3>) {
        assert_eq!(positions.len(), self.positions.len(), "one position for every vertex");
        self.positions = positions;
    }

    pub fn is_live_vertex(&self, vertex: u32) -> bool {
        self.outgoing[vertex as usize] != NONE
    }

    fn is_live_edge(&self, edge: u32) -> bool {
        self.origins[edge as usize] != NONE
    }

    pub fn live_faces(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.origins.len() as u32 / 3).filter(|&face| self.is_live_edge(3 * face))
    }

    pub fn corners(&self, face: u32) -> [u32; 3] {
        let first = 3 * face as usize;
        [self.origins[first], self.origins[first + 1], self.origins[first + 2]]
    }

    /// The ends of every edge. They name it for as long as it exists, while edits give the numbers of
    /// half-edges to others.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let all = 0..self.origins.len() as u32;
        all.filter(|&it| self.is_live_edge(it) && it < self.twins[it as usize])
            .map(|it| [self.origin(it), self.target(it)])
            .collect()
    }

    /// The half-edge that leads from one vertex to another.
    pub fn edge(&self, [from, to]: [u32; 2]) -> Option<u32> {
        let live = self.is_live_vertex(from);
        live.then(|| self.outgoing(from).find(|&it| self.target(it) == to)).flatten()
    }

    pub fn origin(&self, edge: u32) -> u32 {
        self.origins[edge as usize]
    }

    pub fn target(&self, edge: u32) -> u32 {
        self.origins[next(edge) as usize]
    }

    /// The vertex across a half-edge, in its own face.
    pub fn apex(&self, edge: u32) -> u32 {
        self.origins[previous(edge) as usize]
    }

    pub fn twin(&self, edge: u32) -> u32 {
        self.twins[edge as usize]
    }

    /// The half-edges that start at a vertex, counter-clockwise.
    pub fn outgoing(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.outgoing[vertex as usize];
        let mut at = Some(first);
        std::iter::from_fn(move || {
            let edge = at?;
            let following = self.twins[previous(edge) as usize];
            at = (following != first).then_some(following);
            Some(edge)
        })
    }

    /// The number of edges at every vertex; zero for removed ones.
    pub fn valences(&self) -> Vec<u32> {
        let mut valences = vec![0; self.positions.len()];
        for &origin in self.origins.iter().filter(|&&it| it != NONE) {
            valences[origin as usize] += 1;
        }
        valences
    }

    /// A third of the area of the faces around every vertex.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.positions.len()];
        for face in self.live_faces() {
            let corners = self.corners(face);
            let [a, b, c] = corners.map(|it| self.position(it));
            let third = (b - a).cross(&(c - a)).norm() / 6.0;
            for vertex in corners {
                areas[vertex as usize] += third;
            }
        }
        areas
    }

    /// Turns an edge `ab` with the apices `c`, `d` into `cd`. There must be no edge `cd` yet.
    pub fn flip(&mut self, edge: u32) {
        let twin = self.twin(edge);
        let (a, b) = (self.origin(edge), self.target(edge));
        let (c, d) = (self.apex(edge), self.apex(twin));
        let (bc, ca) = (self.twin(next(edge)), self.twin(previous(edge)));
        let (ad, db) = (self.twin(next(twin)), self.twin(previous(twin)));
        let (first, second) = (3 * (edge / 3), 3 * (twin / 3));
        self.set_face(first, [d, c, a]);
        self.set_face(second, [c, d, b]);
        self.link(first, second);
        self.link(first + 1, ca);
        self.link(first + 2, ad);
        self.link(second + 1, db);
        self.link(second + 2, bc);
    }

    /// Puts a vertex on an edge; returns its number, the first unused one.
    pub fn split(&mut self, edge: u32, position: Vec3) -> u32 {
        let twin = self.twin(edge);
        let (a, b) = (self.origin(edge), self.target(edge));
        let (c, d) = (self.apex(edge), self.apex(twin));
        let (bc, ca) = (self.twin(next(edge)), self.twin(previous(edge)));
        let (ad, db) = (self.twin(next(twin)), self.twin(previous(twin)));
        let middle = self.positions.len() as u32;
        self.positions.push(position);
        self.outgoing.push(NONE);
        self.n_vertices += 1;
        let third = self.origins.len() as u32;
        self.origins.resize(third as usize + 6, NONE);
        self.twins.resize(third as usize + 6, NONE);
        let [first, second, fourth] = [3 * (edge / 3), 3 * (twin / 3), third + 3];
        self.set_face(first, [a, middle, c]);
        self.set_face(second, [b, middle, d]);
        self.set_face(third, [middle, b, c]);
        self.set_face(fourth, [middle, a, d]);
        self.link(first, fourth);
        self.link(first + 1, third + 2);
        self.link(first + 2, ca);
        self.link(second, third);
        self.link(second + 1, fourth + 2);
        self.link(second + 2, db);
        self.link(third + 1, bc);
        self.link(fourth + 1, ad);
        middle
    }

    /// Whether an edge can go without the surface ceasing to be a manifold: its ends share no
    /// neighbours but the two apices (the link condition), and these keep three edges at least.
    pub fn can_collapse(&self, edge: u32) -> bool {
        let (a, b) = (self.origin(edge), self.target(edge));
        let (c, d) = (self.apex(edge), self.apex(self.twin(edge)));
        let shared =
            self.outgoing(a).filter(|&it| self.edge([b, self.target(it)]).is_some()).count();
        shared == 2 && c != d && [c, d].iter().all(|&it| self.outgoing(it).nth(3).is_some())
    }

    /// Collapses an edge into its target, which moves to `position`.
    ///
    /// [`CornerTable::can_collapse`] must hold.
    pub fn collapse(&mut self, edge: u32, position: Vec3) {
        let twin = self.twin(edge);
        let (a, b) = (self.origin(edge), self.target(edge));
        let (c, d) = (self.apex(edge), self.apex(twin));
        let (cb, ac) = (self.twin(next(edge)), self.twin(previous(edge)));
        let (da, bd) = (self.twin(next(twin)), self.twin(previous(twin)));
        let spokes: Vec<u32> = self.outgoing(a).collect();
        for spoke in spokes {
            self.origins[spoke as usize] = b;
        }
        for dead in [3 * (edge / 3), 3 * (twin / 3)] {
            self.origins[dead as usize..dead as usize + 3].fill(NONE);
        }
        self.twins[cb as usize] = ac;
        self.twins[ac as usize] = cb;
        self.twins[da as usize] = bd;
        self.twins[bd as usize] = da;
        self.outgoing[a as usize] = NONE;
        self.outgoing[b as usize] = ac;
        self.outgoing[c as usize] = cb;
        self.outgoing[d as usize] = da;
        self.positions[b as usize] = position;
        self.n_vertices -= 1;
    }

    /// Writes the corners of the face whose first half-edge is given.
    fn set_face(&mut self, first: u32, corners: [u32; 3]) {
        for (edge, vertex) in (first..).zip(corners) {
            self.origins[edge as usize] = vertex;
            self.outgoing[vertex as usize] = edge;
        }
    }

    fn link(&mut self, one: u32, other: u32) {
        self.twins[one as usize] = other;
        self.twins[other as usize] = one;
    }
}

/// The half-edge that follows around its face; those of face `f` are `3 f`, `3 f + 1`, `3 f + 2`.
pub fn next(edge: u32) -> u32 {
    if edge % 3 == 2 { edge - 2 } else { edge + 1 }
}

/// The half-edge before it around its face.
pub fn previous(edge: u32) -> u32 {
    if edge.is_multiple_of(3) { edge + 2 } else { edge - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriMesh {
        let vertices = vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()];
        TriMesh::new(vertices, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).unwrap()
    }

    /// Rebuilding checks every link and fan.
    fn check(table: &CornerTable) {
        let mesh = table.clone().into_mesh();
        assert_eq!(mesh.n_faces(), 2 * mesh.n_vertices() - 4);
        CornerTable::new(&mesh).unwrap();
    }

    #[test]
    fn random_edits_keep_a_closed_manifold() {
        let mut random = crate::kernels::numerics::random::Random::new(11);
        let mut table = CornerTable::new(&tetrahedron()).unwrap();
        for _ in 0..400 {
            let edges = table.edges();
            let edge = table.edge(edges[random.below(edges.len())]).unwrap();
            let (c, d) = (table.apex(edge), table.apex(table.twin(edge)));
            match random.below(5) {
                0 | 1 => {
                    table.split(edge, Vec3::zeros());
                }
                2 | 3 if table.edge([c, d]).is_none() => table.flip(edge),
                4 if table.can_collapse(edge) => table.collapse(edge, Vec3::zeros()),
                _ => {}
            }
            check(&table);
        }
        assert!(table.n_vertices() > 40);
    }

    #[test]
    fn what_is_not_closed_and_manifold_is_named() {
        let mesh = tetrahedron();
        let with_faces = |faces: Vec<[u32; 3]>| {
            CornerTable::new(&TriMesh::new(mesh.vertices().to_vec(), faces).unwrap()).unwrap_err()
        };
        let faces = mesh.faces().to_vec();
        assert_eq!(with_faces(faces[..3].to_vec()), TopologyError::Boundary { from: 0, to: 2 });
        let twice = [faces.clone(), vec![faces[0]]].concat();
        assert_eq!(with_faces(twice), TopologyError::RepeatedEdge { from: 0, to: 2 });
    }
}
