//! Repair of meshes as they are found: unwelded, repeated, degenerate, inside out, in pieces.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fill::fill_holes;
use super::resampled::Resampled;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::{DisjointSets, Edges, Fans, Topology, is_collapsed};

/// What to do; the defaults make most found meshes fit for a Laplacian.
#[derive(Debug, Clone, PartialEq)]
pub struct CleanOptions {
    /// Vertices closer than this fraction of the bounding box's diagonal become one. Zero joins only
    /// equal positions; `None` joins nothing.
    pub weld: Option<f64>,
    pub nonmanifold: Nonmanifold,
    pub keep: Keep,
    /// Turn faces so that neighbours agree and volumes are positive.
    pub orient: bool,
    /// Holes of at most this many edges are filled.
    pub fill_holes: usize,
}

impl Default for CleanOptions {
    fn default() -> Self {
        Self {
            weld: Some(1e-7),
            nonmanifold: Nonmanifold::Repair,
            keep: Keep::Largest,
            orient: true,
            fill_holes: 0,
        }
    }
}

/// What to do about edges of three and more faces, and about vertices where surfaces only touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Nonmanifold {
    /// Count them only.
    Keep,
    /// Cut the surface open along them: every sheet gets its own vertices.
    Split,
    /// Remove fins (faces that hang on such an edge and are free at another), then cut open the rest.
    #[default]
    Repair,
}

/// Which connected parts stay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// The part with the largest area.
    #[default]
    Largest,
    All,
}

/// What was found and done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CleanReport {
    pub before: Topology,
    pub after: Topology,
    /// Vertices that were joined to another one.
    pub n_welded_vertices: usize,
    /// Faces that named a vertex twice, before or after welding.
    pub n_collapsed_faces: usize,
    /// Faces with the same three vertices as an earlier one.
    pub n_duplicate_faces: usize,
    /// Faces of three vertices on a line; their longest edge was flipped, or they were removed.
    pub n_flat_faces: usize,
    pub n_fin_faces: usize,
    /// Vertices that were added to cut the surface open.
    pub n_split_vertices: usize,
    pub n_removed_components: usize,
    pub n_turned_faces: usize,
    /// Edges whose faces cannot be made to agree (a Moebius band has some).
    pub n_unorientable_edges: usize,
    pub n_filled_holes: usize,
    pub n_unreferenced_vertices: usize,
}

/// Why a mesh cannot be cleaned.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CleanError {
    #[error("no face of {n_faces} has an area")]
    NothingLeft { n_faces: usize },
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Welds, drops bad faces, resolves non-manifold places, keeps components, orients, fills holes.
///
/// In this order, so that each step meets what the ones before it make: equal faces are found after
/// welding, components are counted after touching surfaces have been cut apart. No vertex moves:
/// every new vertex is one of the old ones (of a welded group, the first).
///
/// # Errors
/// See [`CleanError`].
pub fn clean(
    mesh: &TriMesh,
    options: &CleanOptions,
) -> Result<(Resampled, CleanReport), CleanError> {
    mesh.check_has_faces()?;
    let nothing_left = CleanError::NothingLeft { n_faces: mesh.n_faces() };
    let before = Topology::of(mesh);
    let n_unreferenced = before.n_unreferenced;
    let mut state = State::new(mesh, before);
    if let Some(tolerance) = options.weld {
        state.weld(tolerance);
    }
    state.drop_collapsed();
    state.drop_duplicates();
    state.flip_flat();
    if state.faces.is_empty() {
        return Err(nothing_left);
    }
    if options.nonmanifold == Nonmanifold::Repair {
        state.drop_fins();
    }
    if options.nonmanifold != Nonmanifold::Keep {
        state.split();
    }
    if options.keep == Keep::Largest {
        state.keep_largest();
    }
    if options.orient {
        state.orient();
    }
    if options.fill_holes > 0 {
        state.report.n_filled_holes =
            fill_holes(&state.vertices, &mut state.faces, options.fill_holes);
    }
    state.report.n_unreferenced_vertices = n_unreferenced;
    if state.faces.is_empty() {
        return Err(nothing_left);
    }
    Ok(state.finish())
}

/// Faces under repair. Vertices are only added, and dropped at the end if no face names them.
struct State {
    vertices: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
    /// For every vertex in `vertices`, the old vertex that it is a copy of.
    old_of_vertex: Vec<u32>,
    /// For every old vertex, the one that it was joined to.
    welded: Vec<u32>,
    report: CleanReport,
}

impl State {
    fn new(mesh: &TriMesh, before: Topology) -> Self {
        let n_vertices = mesh.n_vertices() as u32;
        Self {
            vertices: mesh.vertices().to_vec(),
            faces: mesh.faces().to_vec(),
            old_of_vertex: (0..n_vertices).collect(),
            welded: (0..n_vertices).collect(),
            report: CleanReport {
                after: before.clone(),
                before,
                n_welded_vertices: 0,
                n_collapsed_faces: 0,
                n_duplicate_faces: 0,
                n_flat_faces: 0,
                n_fin_faces: 0,
                n_split_vertices: 0,
                n_removed_components: 0,
                n_turned_faces: 0,
                n_unorientable_edges: 0,
                n_filled_holes: 0,
                n_unreferenced_vertices: 0,
            },
        }
    }

    fn weld(&mut self, tolerance: f64) {
        let mut is_referenced = vec![false; self.vertices.len()];
        self.faces.iter().flatten().for_each(|&it| is_referenced[it as usize] = true);
        self.welded = weld_targets(&self.vertices, &is_referenced, tolerance);
        for face in &mut self.faces {
            *face = face.map(|vertex| self.welded[vertex as usize]);
        }
        let joined = self.welded.iter().enumerate().filter(|(from, to)| *from != **to as usize);
        self.report.n_welded_vertices = joined.count();
    }

    fn drop_collapsed(&mut self) {
        let n_faces = self.faces.len();
        self.faces.retain(|it| !is_collapsed(it));
        self.report.n_collapsed_faces = n_faces - self.faces.len();
    }

    fn drop_duplicates(&mut self) {
        let n_faces = self.faces.len();
        let mut seen = BTreeSet::new();
        self.faces.retain(|&face| {
            let mut sorted = face;
            sorted.sort_unstable();
            seen.insert(sorted)
        });
        self.report.n_duplicate_faces = n_faces - self.faces.len();
    }

    /// Gives the thin space of a flat face to the neighbour across its longest edge.
    ///
    /// Removing the face instead would leave a slit: its short edges would lie on the long one
    /// without being glued to it. Where the flip is impossible, the face does go.
    fn flip_flat(&mut self) {
        // A flip may leave a neighbour flat (several vertices on one line): a few rounds settle that.
        for _ in 0..8 {
            let flat: Vec<usize> =
                (0..self.faces.len()).filter(|&it| self.is_flat(self.faces[it])).collect();
            if flat.is_empty() {
                return;
            }
            let edges = Edges::of(&self.faces);
            let edge_of_side = edges.edge_of_side();
            let mut known: BTreeSet<(u32, u32)> =
                edges.iter().map(|it| (it[0].low, it[0].high)).collect();
            let mut is_touched = vec![false; self.faces.len()];
            let mut is_removed = vec![false; self.faces.len()];
            for face in flat {
                if is_touched[face] {
                    continue;
                }
                self.report.n_flat_faces += 1;
                let side = self.longest_side(face);
                let sides = edges.sides(edge_of_side[3 * face + side] as usize);
                let other = sides.iter().map(|it| it.face as usize).find(|&it| it != face);
                match other.filter(|&it| sides.len() == 2 && !is_touched[it]) {
                    Some(other) if self.flip(face, side, other, &mut known) => {
                        is_touched[face] = true;
                        is_touched[other] = true;
                    }
                    Some(_) => is_removed[face] = true,
                    // On a rim the face is no loss; beside a face just changed it waits a round.
                    None if sides.len() == 2 => self.report.n_flat_faces -= 1,
                    None => is_removed[face] = true,
                }
            }
            let mut removed = is_removed.iter();
            self.faces.retain(|_| !removed.next().expect("as many as faces"));
        }
    }

    /// Whether the height is below a billionth of the longest edge: no angle can be told.
    fn is_flat(&self, face: [u32; 3]) -> bool {
        let [a, b, c] = face.map(|it| self.vertices[it as usize]);
        let longest =
            (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        (b - a).cross(&(c - a)).norm() <= 1e-9 * longest
    }

    fn longest_side(&self, face: usize) -> usize {
        let corners = self.faces[face].map(|it| self.vertices[it as usize]);
        let length = |side: usize| (corners[(side + 1) % 3] - corners[side]).norm_squared();
        (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).expect("three sides")
    }

    /// Replaces `[u, v, tip]` and the face beyond `uv` by the two faces beside the edge tip-to-tip.
    fn flip(
        &mut self,
        face: usize,
        side: usize,
        other: usize,
        known: &mut BTreeSet<(u32, u32)>,
    ) -> bool {
        let [u, v, tip] = [0, 1, 2].map(|it| self.faces[face][(side + it) % 3]);
        let beyond = *self.faces[other]
            .iter()
            .find(|&&it| it != u && it != v)
            .expect("a face that is not collapsed has a third vertex");
        let edge = (tip.min(beyond), tip.max(beyond));
        if tip == beyond || known.contains(&edge) {
            return false;
        }
        // The other face may be turned the other way; both new ones follow it, as it has an area.
        let walks_alike =
            (0..3).any(|it| self.faces[other][it] == u && self.faces[other][(it + 1) % 3] == v);
        let new = [[u, beyond, tip], [beyond, v, tip]];
        let new = if walks_alike { new.map(|[a, b, c]| [a, c, b]) } else { new };
        known.insert(edge);
        known.remove(&(u.min(v), u.max(v)));
        self.faces[face] = new[0];
        self.faces[other] = new[1];
        true
    }

    fn drop_fins(&mut self) {
        loop {
            let edges = Edges::of(&self.faces);
            let mut touches = vec![(false, false); self.faces.len()];
            for sides in edges.iter() {
                for it in sides {
                    touches[it.face as usize].0 |= sides.len() > 2;
                    touches[it.face as usize].1 |= sides.len() == 1;
                }
            }
            let n_faces = self.faces.len();
            let mut fins = touches.iter().map(|&(hangs, is_free)| hangs && is_free);
            let is_fin: Vec<bool> = fins.by_ref().collect();
            // An open sheet that is all fins (three leaves on one edge) is a surface, not debris.
            if !is_fin.contains(&true) || is_fin.iter().filter(|it| **it).count() * 2 > n_faces {
                return;
            }
            let mut drop = is_fin.into_iter();
            self.faces.retain(|_| !drop.next().expect("as many as faces"));
            self.report.n_fin_faces += n_faces - self.faces.len();
        }
    }

    /// Gives every fan of faces at a vertex a vertex of its own (Gueziec et al. 2001, "cutting").
    fn split(&mut self) {
        let edges = Edges::of(&self.faces);
        let fans = Fans::of(&self.faces, &edges, |n_faces| n_faces == 2);
        let mut vertex_of_fan = BTreeMap::new();
        for at_vertex in fans.by_vertex().chunk_by(|a, b| a.0 == b.0) {
            for &(vertex, fan) in &at_vertex[1..] {
                vertex_of_fan.insert(fan, self.vertices.len() as u32);
                self.vertices.push(self.vertices[vertex as usize]);
                self.old_of_vertex.push(self.old_of_vertex[vertex as usize]);
            }
        }
        for (corner, vertex) in self.faces.iter_mut().flatten().enumerate() {
            if let Some(&copy) = vertex_of_fan.get(&fans.fan_of_corner[corner]) {
                *vertex = copy;
            }
        }
        self.report.n_split_vertices = vertex_of_fan.len();
    }

    fn keep_largest(&mut self) {
        let mut sets = DisjointSets::new(self.vertices.len());
        for &[a, b, c] in &self.faces {
            sets.join(a as usize, b as usize);
            sets.join(a as usize, c as usize);
        }
        let component = |sets: &mut DisjointSets, face: &[u32; 3]| sets.find(face[0] as usize);
        let mut areas: BTreeMap<usize, f64> = BTreeMap::new();
        for face in &self.faces {
            let [a, b, c] = face.map(|it| self.vertices[it as usize]);
            let area = (b - a).cross(&(c - a)).norm() / 2.0;
            *areas.entry(component(&mut sets, face)).or_default() += area;
        }
        let Some((&largest, _)) = areas.iter().rev().max_by(|a, b| a.1.total_cmp(b.1)) else {
            return;
        };
        self.faces.retain(|face| component(&mut sets, face) == largest);
        self.report.n_removed_components = areas.len() - 1;
    }

    /// Turns faces so that neighbours agree, then whole patches so that they face outward.
    ///
    /// A patch is what hangs together by edges of two faces. The sign of its volume, seen from its own
    /// centroid, says whether it faces outward; a patch that is nearly flat keeps the majority's side.
    fn orient(&mut self) {
        let edges = Edges::of(&self.faces);
        let edge_of_side = edges.edge_of_side();
        let mut turns: Vec<Option<bool>> = vec![None; self.faces.len()];
        for seed in 0..self.faces.len() {
            if turns[seed].is_some() {
                continue;
            }
            let patch = self.agree(seed, &edges, &edge_of_side, &mut turns);
            if self.faces_inward(&patch, &turns) {
                for &face in &patch {
                    turns[face] = turns[face].map(|it| !it);
                }
            }
        }
        let turn = |face: u32| turns[face as usize] == Some(true);
        for sides in edges.iter().filter(|it| it.len() == 2) {
            let [a, b] = [sides[0], sides[1]].map(|it| it.forward != turn(it.face));
            self.report.n_unorientable_edges += usize::from(a == b);
        }
        for (face, turn) in self.faces.iter_mut().zip(&turns) {
            if *turn == Some(true) {
                face.swap(1, 2);
                self.report.n_turned_faces += 1;
            }
        }
    }

    /// Walks from face to face, and notes which must turn to agree with the seed.
    fn agree(
        &self,
        seed: usize,
        edges: &Edges,
        edge_of_side: &[u32],
        turns: &mut [Option<bool>],
    ) -> Vec<usize> {
        turns[seed] = Some(false);
        let mut patch = vec![seed];
        let mut queue = VecDeque::from([seed]);
        while let Some(face) = queue.pop_front() {
            for side in 0..3 {
                let sides = edges.sides(edge_of_side[3 * face + side] as usize);
                let [a, b] = sides else { continue };
                let (this, next) = if a.face as usize == face { (a, b) } else { (b, a) };
                let next_face = next.face as usize;
                if turns[next_face].is_none() {
                    let alike = this.forward == next.forward;
                    turns[next_face] = Some(turns[face] == Some(!alike));
                    patch.push(next_face);
                    queue.push_back(next_face);
                }
            }
        }
        patch
    }

    fn faces_inward(&self, patch: &[usize], turns: &[Option<bool>]) -> bool {
        let corners = |face: usize| self.faces[face].map(|it| self.vertices[it as usize]);
        let sum: Vec3 = patch.iter().map(|&it| corners(it).iter().sum::<Vec3>()).sum();
        let centre = sum / (3 * patch.len()) as f64;
        let (mut volume, mut area) = (0.0, 0.0);
        for &face in patch {
            let [a, b, c] = corners(face).map(|it| it - centre);
            let sign = if turns[face] == Some(true) { -1.0 } else { 1.0 };
            volume += sign * a.dot(&b.cross(&c)) / 6.0;
            area += (b - a).cross(&(c - a)).norm() / 2.0;
        }
        // A ball of this area has a volume of about 0.094 area^1.5.
        if volume.abs() > 1e-4 * area.powf(1.5) {
            return volume < 0.0;
        }
        2 * patch.iter().filter(|&&it| turns[it] == Some(true)).count() > patch.len()
    }

    /// Drops vertices that no face names and numbers the rest in their old order.
    fn finish(mut self) -> (Resampled, CleanReport) {
        let mut new_of_vertex = vec![None; self.vertices.len()];
        self.faces.iter().flatten().for_each(|&it| new_of_vertex[it as usize] = Some(0));
        let mut vertices = Vec::new();
        let mut old_of_new = Vec::new();
        for (vertex, new) in new_of_vertex.iter_mut().enumerate() {
            if let Some(new) = new {
                *new = vertices.len() as u32;
                vertices.push(self.vertices[vertex]);
                old_of_new.push(self.old_of_vertex[vertex]);
            }
        }
        let renumbered = self.faces.iter().map(|face| {
            face.map(|it| new_of_vertex[it as usize].expect("faces name kept vertices"))
        });
        let mesh =
            TriMesh::new(vertices, renumbered.collect()).expect("a part of a mesh is a mesh");
        let new_of_old = self.new_of_old(&new_of_vertex);
        self.report.after = Topology::of(&mesh);
        (Resampled::from_selection(mesh, &old_of_new, new_of_old), self.report)
    }

    /// An old vertex is where it was welded to; if that went with its faces, where a copy of it is.
    fn new_of_old(&self, new_of_vertex: &[Option<u32>]) -> Vec<Option<u32>> {
        let mut new_of_welded = new_of_vertex[..self.welded.len()].to_vec();
        for copy in self.welded.len()..self.vertices.len() {
            let original = self.old_of_vertex[copy] as usize;
            new_of_welded[original] = new_of_welded[original].or(new_of_vertex[copy]);
        }
        self.welded.iter().map(|&it| new_of_welded[it as usize]).collect()
    }
}

/// For every vertex, the first vertex within the tolerance that is itself joined to no other.
///
/// Only referenced vertices count for the bounding box: strays are often far away.
fn weld_targets(vertices: &[Vec3], is_referenced: &[bool], tolerance: f64) -> Vec<u32> {
    let referenced = || vertices.iter().zip(is_referenced).filter(|it| *it.1).map(|it| it.0);
    let Some(first) = referenced().next() else {
        return (0..vertices.len() as u32).collect();
    };
    let (low, high) = referenced().fold((*first, *first), |(l, h), it| (l.inf(it), h.sup(it)));
    let radius = tolerance * (high - low).norm();
    // With no tolerance, any cell size does: equal points share a cell.
    let cell_size =
        if radius > 0.0 { radius } else { f64::MIN_POSITIVE.max((high - low).max() * 1e-6) };
    let cell_of = |point: &Vec3| ((point - low) / cell_size).map(f64::floor);
    let reach = if radius > 0.0 { 1 } else { 0 };
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut targets: Vec<u32> = (0..vertices.len() as u32).collect();
    for (vertex, point) in vertices.iter().enumerate().filter(|it| is_referenced[it.0]) {
        let cell = cell_of(point);
        let key = [cell.x as i64, cell.y as i64, cell.z as i64];
        let near = neighbour_cells(key, reach)
            .filter_map(|it| cells.get(&it))
            .flatten()
            .filter(|&&it| (vertices[it as usize] - point).norm() <= radius)
            .min();
        match near {
            Some(&target) => targets[vertex] = target,
            None => cells.entry(key).or_default().push(vertex as u32),
        }
    }
    targets
}

fn neighbour_cells([x, y, z]: [i64; 3], reach: i64) -> impl Iterator<Item = [i64; 3]> {
    let around = -reach..=reach;
    around.clone().flat_map(move |dx| {
        let around = around.clone();
        around.clone().flat_map(move |dy| around.clone().map(move |dz| [x + dx, y + dy, z + dz]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::{icosphere, moved, signed_volume, torus, union};

    fn cleaned(mesh: &TriMesh, options: &CleanOptions) -> (Resampled, CleanReport) {
        clean(mesh, options).unwrap()
    }

    fn with_faces(mesh: &TriMesh, faces: Vec<[u32; 3]>) -> TriMesh {
        TriMesh::new(mesh.vertices().to_vec(), faces).unwrap()
    }

    /// Every face with vertices of its own.
    fn soup(mesh: &TriMesh) -> TriMesh {
        let vertices = (0..mesh.n_faces()).flat_map(|it| mesh.corners(it)).collect();
        let faces = (0..mesh.n_faces() as u32).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]);
        TriMesh::new(vertices, faces.collect()).unwrap()
    }

    #[test]
    fn a_clean_mesh_stays_as_it_is() {
        for mesh in [icosphere(2), torus(2.0, 0.5, 12, 8)] {
            let (same, report) = cleaned(&mesh, &CleanOptions::default());
            assert_eq!(same.mesh, mesh);
            assert_eq!(report.before, report.after);
            assert_eq!(same.function(&vec![2.0; mesh.n_vertices()]), vec![2.0; mesh.n_vertices()]);
        }
    }

    #[test]
    fn a_soup_of_triangles_becomes_the_surface_at_three_scales() {
        for scale in [1e-8, 1.0, 1e8] {
            for weld in [0.0, 1e-6] {
                let mesh = torus(2.0, 0.5, 12, 8);
                let vertices = mesh.vertices().iter().map(|it| it * scale).collect();
                let mesh = mesh.with_vertices(vertices).unwrap();
                let options = CleanOptions { weld: Some(weld), ..Default::default() };
                let (welded, report) = cleaned(&soup(&mesh), &options);
                assert_eq!(report.after.genus, Some(1));
                assert_eq!(welded.mesh.n_vertices(), mesh.n_vertices());
                assert_eq!(report.n_welded_vertices, 3 * mesh.n_faces() - mesh.n_vertices());
                assert!((welded.mesh.area() / mesh.area() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn repeated_and_collapsed_faces_and_stray_vertices_go() {
        let mesh = icosphere(1);
        let mut vertices = mesh.vertices().to_vec();
        vertices.push(Vec3::x() * 1e6);
        let mut faces = mesh.faces().to_vec();
        let [a, b, c] = faces[3];
        faces.extend([[b, c, a], [b, a, c], [a, a, b]]);
        let (found, report) =
            cleaned(&TriMesh::new(vertices, faces).unwrap(), &CleanOptions::default());
        assert_eq!(found.mesh, mesh);
        assert_eq!((report.n_duplicate_faces, report.n_collapsed_faces), (2, 1));
        assert_eq!((report.n_unreferenced_vertices, found.new_of_old.last()), (1, Some(&None)));
    }

    #[test]
    fn a_flat_face_is_flipped_away_without_a_slit() {
        // Vertex 4 lies on the diagonal 0-2 of the square.
        let mut vertices: Vec<Vec3> = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]| Vec3::new(x, y, 0.0))
            .to_vec();
        vertices.push(Vec3::new(0.5, 0.5, 0.0));
        // The sliver 0-4-2 lies between the two halves of the square.
        let faces = vec![[0, 1, 2], [0, 2, 4], [0, 4, 3], [4, 2, 3]];
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let (found, report) = cleaned(&mesh, &CleanOptions::default());
        assert_eq!(report.n_flat_faces, 1);
        assert_eq!(report.after.n_boundary_edges, 4);
        assert_eq!((report.after.euler_characteristic, report.after.n_components), (1, 1));
        assert!((found.mesh.area() - 1.0).abs() < 1e-12);
        let smallest = (0..found.mesh.n_faces()).map(|it| found.mesh.area_vector(it).norm());
        assert!(smallest.fold(1.0, f64::min) > 0.2);
    }

    #[test]
    fn an_inside_out_half_is_turned_outward() {
        for mesh in [icosphere(2), torus(2.0, 0.5, 12, 8)] {
            let turn = |(index, &[a, b, c]): (usize, &[u32; 3])| {
                if index % 3 > 0 { [a, c, b] } else { [a, b, c] }
            };
            let faces = mesh.faces().iter().enumerate().map(turn).collect();
            let (found, report) = cleaned(&with_faces(&mesh, faces), &CleanOptions::default());
            assert!(report.after.is_oriented);
            assert!((signed_volume(&found.mesh) - signed_volume(&mesh)).abs() < 1e-12);
            assert!(report.n_turned_faces > mesh.n_faces() / 2);
        }
    }

    #[test]
    fn the_largest_part_stays_with_its_values() {
        let far = moved(&torus(2.0, 0.5, 12, 8), Vec3::x() * 9.0);
        let both = union(&icosphere(1), &far);
        let (found, report) = cleaned(&both, &CleanOptions::default());
        assert_eq!((report.n_removed_components, &found.mesh), (1, &far));
        let x: Vec<f64> = both.vertices().iter().map(|it| it.x).collect();
        let expected: Vec<f64> = far.vertices().iter().map(|it| it.x).collect();
        assert_eq!(found.function(&x), expected);
        let all = CleanOptions { keep: Keep::All, ..Default::default() };
        assert_eq!(cleaned(&both, &all).0.mesh, both);
    }

    #[test]
    fn fins_go_and_touching_surfaces_are_cut_apart() {
        let sphere = icosphere(2);
        // A second sphere whose vertex 0 is the first one's, and a fin on an edge of the first.
        let second = moved(&sphere, sphere.vertices()[0] * 3.0);
        let shift = sphere.n_vertices() as u32;
        let both = union(&sphere, &second);
        let merge = |it: u32| if it == shift { 0 } else { it };
        let mut faces: Vec<[u32; 3]> = both.faces().iter().map(|it| it.map(merge)).collect();
        let [a, b, _] = faces[7];
        faces.push([a, b, shift]);
        let mut vertices = both.vertices().to_vec();
        vertices[shift as usize] = Vec3::y() * 3.0;
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let before = Topology::of(&mesh);
        assert_eq!((before.n_nonmanifold_edges, before.n_nonmanifold_vertices), (1, 1));
        let options = CleanOptions { keep: Keep::All, ..Default::default() };
        let (_, report) = cleaned(&mesh, &options);
        assert_eq!((report.n_fin_faces, report.n_split_vertices), (1, 1));
        assert!(report.after.is_manifold() && report.after.is_closed);
        assert_eq!((report.after.n_components, report.after.genus), (2, Some(0)));
        let keep = CleanOptions { nonmanifold: Nonmanifold::Keep, ..options.clone() };
        assert_eq!(cleaned(&mesh, &keep).1.after.n_nonmanifold_edges, 1);
        let split = CleanOptions { nonmanifold: Nonmanifold::Split, ..options };
        let (_, report) = cleaned(&mesh, &split);
        assert!(report.after.is_manifold());
        assert_eq!((report.n_fin_faces, report.after.n_faces), (0, mesh.n_faces()));
    }

    #[test]
    fn a_moebius_band_is_reported_as_unorientable() {
        let n = 12u32;
        let vertices = (0..2 * n)
            .map(|it| {
                let u = f64::from(it / 2) / f64::from(n) * std::f64::consts::TAU;
                let v = if it % 2 == 0 { -0.3 } else { 0.3 };
                let radius = 1.0 + v * (u / 2.0).cos();
                Vec3::new(radius * u.cos(), v * (u / 2.0).sin(), radius * u.sin())
            })
            .collect();
        let faces = (0..n).flat_map(|it| {
            let [a, b] = [2 * it, 2 * it + 1];
            let [c, d] = if it + 1 < n { [a + 2, b + 2] } else { [1, 0] };
            [[a, b, d], [a, d, c]]
        });
        let mesh = TriMesh::new(vertices, faces.collect()).unwrap();
        let (_, report) = cleaned(&mesh, &CleanOptions::default());
        assert_eq!(report.n_unorientable_edges, 1);
        assert_eq!((report.after.n_boundary_loops, report.after.euler_characteristic), (1, 0));
    }

    #[test]
    fn nothing_but_points_is_refused() {
        let mesh = TriMesh::new(vec![Vec3::x(); 3], vec![[0, 1, 2]]).unwrap();
        let error = clean(&mesh, &CleanOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), "no face of 1 has an area");
    }

    /// A mesh of the corpus (binary little-endian `.ply` of floats and triangles), or none without it.
    fn corpus(name: &str) -> Option<TriMesh> {
        let root = std::env::var_os("SINEW_CORPUS").map_or_else(
            || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
            Into::into,
        );
        let path = root.join("meshes_plain/defective").join(name);
        let Ok(bytes) = std::fs::read(&path) else {
            println!("skipped: no corpus at {}", path.display());
            return None;
        };
        let body = bytes.windows(11).position(|it| it == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..body]).unwrap();
        let count = |element: &str| -> usize {
            let line = header.lines().find_map(|it| it.strip_prefix(element)).unwrap();
            line.trim().parse().unwrap()
        };
        let (n_vertices, n_faces) = (count("element vertex"), count("element face"));
        let (points, faces) = bytes[body..].split_at(12 * n_vertices);
        let float = |it: &[u8]| f64::from(f32::from_le_bytes(it.try_into().unwrap()));
        let index = |it: &[u8]| u32::from_le_bytes(it.try_into().unwrap());
        let point = |it: &[u8]| Vec3::new(float(&it[..4]), float(&it[4..8]), float(&it[8..]));
        let face = |it: &[u8]| [index(&it[1..5]), index(&it[5..9]), index(&it[9..])];
        let faces: Vec<_> = faces.chunks_exact(13).map(face).collect();
        assert_eq!(faces.len(), n_faces);
        Some(TriMesh::new(points.chunks_exact(12).map(point).collect(), faces).unwrap())
    }

    /// Closed, oriented, one part, no handle: what every defect was made from.
    #[track_caller]
    fn assert_whole(name: &str, expect: impl Fn(&CleanReport) -> bool) {
        let Some(mesh) = corpus(name) else { return };
        let options = CleanOptions { fill_holes: 60, ..Default::default() };
        let (found, report) = cleaned(&mesh, &options);
        let facts = &report.after;
        assert!(facts.is_manifold() && facts.is_oriented && facts.is_closed, "{name}: {facts:?}");
        assert_eq!((facts.n_components, facts.genus), (1, Some(0)), "{name}");
        assert!(signed_volume(&found.mesh) > 0.0, "{name}");
        assert!(expect(&report), "{name}: {report:?}");
    }

    #[test]
    fn broken_bodies_of_the_corpus_are_made_whole() {
        assert_whole("adult_m25_components.ply", |it| it.n_removed_components == 12);
        assert_whole("adult_m25_degenerate.ply", |it| it.before.n_collapsed_faces == 30);
        // 40 strays and the 40 vertices that the duplicates left without a face.
        assert_whole("adult_m25_duplicates.ply", |it| {
            (it.n_duplicate_faces, it.n_welded_vertices, it.n_unreferenced_vertices)
                == (200, 460, 80)
        });
        assert_whole("adult_m25_flipped.ply", |it| it.n_turned_faces == 3273);
        assert_whole("adult_m25_holes.ply", |it| {
            (it.n_removed_components, it.n_filled_holes) == (1, 9)
        });
        assert_whole("adult_m25_nonmanifold.ply", |it| {
            (it.n_fin_faces, it.n_split_vertices) == (25, 6)
        });
        assert_whole("horse_components.ply", |it| it.n_removed_components == 12);
        assert_whole("horse_holes.ply", |it| it.n_filled_holes == 9);
        assert_whole("horse_nonmanifold.ply", |it| {
            (it.n_fin_faces, it.n_split_vertices) == (25, 6)
        });
    }
}
