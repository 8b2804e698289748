//! Repair of meshes as they are found: unwelded, repeated, degenerate, inside out, in pieces.

mod flat_faces;
mod nonmanifold;
mod orient;
#[cfg(test)]
mod tests;
mod weld;

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fill::fill_holes;
use super::resampled::Resampled;
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::topology::{DisjointSets, Topology, is_collapsed};

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
    let mut repair = Repair::new(mesh, before);
    if let Some(tolerance) = options.weld {
        repair.weld(tolerance);
    }
    repair.drop_collapsed();
    repair.drop_duplicates();
    repair.flip_flat();
    if repair.faces.is_empty() {
        return Err(nothing_left);
    }
    if options.nonmanifold == Nonmanifold::Repair {
        repair.drop_fins();
    }
    if options.nonmanifold != Nonmanifold::Keep {
        repair.split();
    }
    if options.keep == Keep::Largest {
        repair.keep_largest();
    }
    if options.orient {
        repair.orient();
    }
    if options.fill_holes > 0 {
        repair.report.n_filled_holes =
            fill_holes(&repair.vertices, &mut repair.faces, options.fill_holes);
    }
    repair.report.n_unreferenced_vertices = n_unreferenced;
    if repair.faces.is_empty() {
        return Err(nothing_left);
    }
    Ok(repair.finish())
}

/// Faces under repair. Vertices are only added, and dropped at the end if no face names them.
struct Repair {
    vertices: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
    /// For every vertex in `vertices`, the old vertex that it is a copy of.
    old_of_vertex: Vec<u32>,
    /// For every old vertex, the one that it was joined to.
    welded: Vec<u32>,
    report: CleanReport,
}

impl Repair {
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
