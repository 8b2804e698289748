//! Skin weights for any mesh and skeleton, by the equilibrium of heat.

mod bones;

use std::collections::HashMap;

use faer::Mat;
use rayon::prelude::*;

use super::skeleton::Skeleton;
use super::weights::{SkinWeights, WeightsError};
use crate::kernels::geometry::mesh::{MeshError, TriMesh, Vec3};
use crate::kernels::geometry::shapes::signed_volume;
use crate::kernels::geometry::topology::DisjointSets;
use crate::kernels::geometry::triangle_tree::TriangleTree;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::numerics::sparse_cholesky::SparseCholesky;
use crate::kernels::spectral::laplacian::{LaplacianError, MassLumping, cotangent_laplacian};

pub use bones::Leaves;
use bones::{Bone, bones};

/// How heat is given to the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeightsOptions {
    /// How strongly a vertex is bound to its nearest bone, against its neighbours.
    pub heat: f64,
    /// How close to the surface a line of sight may begin and end, over the mesh's largest extent.
    pub tolerance: f64,
    /// The greatest angle between a vertex's normal and the line from the bone, in degrees.
    pub cone_deg: f64,
    pub leaves: Leaves,
    /// Weights up to this are dropped.
    pub least: f64,
}

impl Default for SkinWeightsOptions {
    fn default() -> Self {
        Self { heat: 1.0, tolerance: 0.0022, cone_deg: 60.0, leaves: Leaves::Extend, least: 1e-8 }
    }
}

/// Weights, and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeightsResult {
    pub weights: SkinWeights,
    /// Vertices that see no bone: heat reaches them through their neighbours.
    pub n_blind: usize,
    /// Vertices of parts that no heat reaches: they follow the nearest bone.
    pub n_cold: usize,
}

/// Why a mesh gets no weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkinWeightsError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(transparent)]
    Laplacian(#[from] LaplacianError),
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error("the option `{name}` is {value}, but must be a positive number")]
    Option { name: &'static str, value: f64 },
    #[error("the heat equation of {n_vertices} vertices has no factor in double precision")]
    Singular { n_vertices: usize },
}

/// Computes skin weights from a mesh and a skeleton inside of it.
///
/// Every vertex takes heat from the nearest bone that it sees and shares it with its neighbours
/// (Baran & Popović 2007, section 4): `(L + 3 H M) w = 3 H M p` for every joint, with the cotangent
/// Laplacian `L`, the barycentric masses `M`, `H = c / d^2` for the distance `d` of that bone, and
/// `p = 1` where it is the joint's. (Their code writes the same with twice our `L` and six times our
/// `M`.) A bone is seen if the segment to its nearest point does not leave the surface and comes from
/// within a cone about the inward normal. Bones belong to the joint at their beginning; a joint
/// without children gets a bone of its own, see [`Leaves`].
///
/// The surface may be open, in parts, unwelded (equal positions count as one vertex) or inside out.
///
/// # Errors
/// See [`SkinWeightsError`].
pub fn skin_weights(
    mesh: &TriMesh,
    skeleton: &Skeleton,
    options: &SkinWeightsOptions,
) -> Result<SkinWeightsResult, SkinWeightsError> {
    check(options)?;
    mesh.check_has_faces()?;
    let surface = Surface::of(mesh);
    let tree = TriangleTree::new(mesh);
    let bones = bones(skeleton, &tree, options.leaves);
    let heats = heats(&surface, &tree, &bones, options);
    let rows = match &surface.mesh {
        Some(solid) => equilibrium(solid, &surface, &heats, &bones, options)?,
        None => vec![Vec::new(); surface.points.len()],
    };
    let mut n_cold = 0;
    let all: Vec<Vec<(u32, f64)>> = (0..mesh.n_vertices())
        .map(|vertex| {
            let row = &rows[surface.point_of_vertex[vertex] as usize];
            if !row.is_empty() {
                return row.clone();
            }
            n_cold += 1;
            vec![(bones::nearest(&bones, mesh.vertices()[vertex]).joint as u32, 1.0)]
        })
        .collect();
    let n_blind = surface.point_of_vertex.iter().filter(|&&it| heats[it as usize].is_empty());
    let n_blind = n_blind.count();
    let weights = SkinWeights::from_rows(skeleton.n_joints(), &all)?;
    Ok(SkinWeightsResult { weights, n_blind, n_cold })
}

fn check(options: &SkinWeightsOptions) -> Result<(), SkinWeightsError> {
    let SkinWeightsOptions { heat, tolerance, cone_deg, least, .. } = *options;
    for (name, value) in [("heat", heat), ("cone_deg", cone_deg)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(SkinWeightsError::Option { name, value });
        }
    }
    for (name, value) in [("tolerance", tolerance), ("least", least)] {
        if !(0.0..1.0).contains(&value) {
            return Err(SkinWeightsError::Option { name, value });
        }
    }
    Ok(())
}

/// The mesh with equal positions joined, and without what has no area.
struct Surface {
    /// Distinct positions of the mesh.
    points: Vec<Vec3>,
    point_of_vertex: Vec<u32>,
    /// Outward unit normals of the points.
    normals: Vec<Vec3>,
    /// The points with area; `None` if there are none.
    mesh: Option<TriMesh>,
    /// The point of every vertex of `mesh`.
    point_of_solid: Vec<u32>,
    /// The largest extent.
    extent: f64,
}

/// Faces below this share of the mean area are no part of the surface.
const DEGENERATE_AREA: f64 = 1e-13;

impl Surface {
    fn of(mesh: &TriMesh) -> Self {
        let mut index: HashMap<[u64; 3], u32> = HashMap::new();
        let mut points = Vec::new();
        let mut point_of_vertex = Vec::with_capacity(mesh.n_vertices());
        for position in mesh.vertices() {
            // Adding zero makes one zero of both.
            let key = [position.x, position.y, position.z].map(|it| (it + 0.0).to_bits());
            let point = *index.entry(key).or_insert(points.len() as u32);
            if point as usize == points.len() {
                points.push(*position);
            }
            point_of_vertex.push(point);
        }
        let least = DEGENERATE_AREA * mesh.area() / mesh.n_faces() as f64;
        let side = if signed_volume(mesh) < 0.0 { -1.0 } else { 1.0 };
        let mut normals = vec![Vec3::zeros(); points.len()];
        let mut solid_of_point = vec![u32::MAX; points.len()];
        let mut point_of_solid = Vec::new();
        let mut faces = Vec::new();
        for face in 0..mesh.n_faces() {
            let area_vector = mesh.area_vector(face);
            if !(area_vector.norm() > least) {
                continue;
            }
            let corners = mesh.faces()[face].map(|it| point_of_vertex[it as usize]);
            for point in corners {
                normals[point as usize] += area_vector * side;
            }
            faces.push(corners.map(|point| {
                let solid = &mut solid_of_point[point as usize];
                if *solid == u32::MAX {
                    *solid = point_of_solid.len() as u32;
                    point_of_solid.push(point);
                }
                *solid
            }));
        }
        for normal in &mut normals {
            *normal = normal.try_normalize(0.0).unwrap_or_default();
        }
        let positions = point_of_solid.iter().map(|&it| points[it as usize]).collect();
        let solid = TriMesh::new(positions, faces).ok();
        let (low, high) = mesh.bounds();
        let extent = (high - low).max();
        Self { points, point_of_vertex, normals, mesh: solid, point_of_solid, extent }
    }
}

/// The bones that give heat to a point, with the strength of each: all nearest ones that it sees.
type Heat = Vec<(u32, f64)>;

/// Bones count as equally near within this factor.
const TIE: f64 = 1.0 + 1e-5;

fn heats(
    surface: &Surface,
    tree: &TriangleTree,
    bones: &[Bone],
    options: &SkinWeightsOptions,
) -> Vec<Heat> {
    let cone = options.cone_deg.to_radians().cos();
    let margin = options.tolerance * surface.extent;
    let of_point = |point: usize| {
        let (place, normal) = (surface.points[point], surface.normals[point]);
        let mut near: Vec<(f64, usize, Vec3)> = bones
            .iter()
            .enumerate()
            .map(|(bone, it)| (it.closest(place), bone))
            .map(|(at, bone)| ((at - place).norm(), bone, at))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let sees = |distance: f64, at: Vec3| {
            if distance <= margin {
                return true;
            }
            let towards = (at - place) / distance;
            // A point on an edge of no area has no normal and sees in all directions.
            let in_cone = normal == Vec3::zeros() || -towards.dot(&normal) >= cone;
            let inset = margin.min(0.25 * distance);
            in_cone && !tree.is_crossed(place + towards * inset, at - towards * inset)
        };
        let mut heat = Heat::new();
        let mut limit = f64::INFINITY;
        for (distance, bone, at) in near {
            if distance > limit {
                break;
            }
            if sees(distance, at) {
                limit = limit.min(distance * TIE);
                let kept = distance.max(1e-6 * surface.extent);
                heat.push((bone as u32, options.heat / (kept * kept)));
            }
        }
        heat
    };
    (0..surface.points.len()).into_par_iter().map(of_point).collect()
}

/// Solves the heat equation for all joints; rows of points that no heat reaches stay empty.
fn equilibrium(
    solid: &TriMesh,
    surface: &Surface,
    heats: &[Heat],
    bones: &[Bone],
    options: &SkinWeightsOptions,
) -> Result<Vec<Vec<(u32, f64)>>, SkinWeightsError> {
    let operator = cotangent_laplacian(solid, MassLumping::Barycentric)?;
    let n = solid.n_vertices();
    let warm = warm_vertices(solid, |it| !heats[surface.point_of_solid[it] as usize].is_empty());
    let mut joints: Vec<usize> = bones.iter().map(|it| it.joint).collect();
    joints.sort_unstable();
    joints.dedup();
    let mut right = Mat::<f64>::zeros(n, joints.len());
    let mut diagonal = vec![0.0; n];
    for vertex in 0..n {
        if !warm[vertex] {
            // Parts without heat would make the matrix singular; they are not read.
            diagonal[vertex] = 1.0;
        }
        for &(bone, strength) in &heats[surface.point_of_solid[vertex] as usize] {
            let joint = bones[bone as usize].joint;
            let column = joints.binary_search(&joint).expect("every bone's joint is listed");
            let heat = 3.0 * strength * operator.mass[vertex];
            right[(vertex, column)] += heat;
            diagonal[vertex] += heat;
        }
    }
    let factor = SparseCholesky::new(&with_diagonal(&operator.stiffness, &diagonal))
        .ok_or(SkinWeightsError::Singular { n_vertices: n })?;
    solve_columns(&factor, &mut right);
    let mut rows = vec![Vec::new(); surface.points.len()];
    for vertex in (0..n).filter(|&it| warm[it]) {
        let row = &mut rows[surface.point_of_solid[vertex] as usize];
        for (column, &joint) in joints.iter().enumerate() {
            let weight = right[(vertex, column)].min(1.0);
            if weight > options.least {
                row.push((joint as u32, weight));
            }
        }
    }
    Ok(rows)
}

/// Right-hand sides that one task solves.
const COLUMNS: usize = 8;

fn solve_columns(factor: &SparseCholesky, right: &mut Mat<f64>) {
    let mut blocks = Vec::new();
    let mut rest = right.as_mut();
    while rest.ncols() > 0 {
        let width = COLUMNS.min(rest.ncols());
        let (block, later) = rest.split_at_col_mut(width);
        blocks.push(block);
        rest = later;
    }
    blocks.into_par_iter().for_each(|it| factor.solve_in_place(it));
}

/// Whether a vertex's connected part has a vertex with heat.
fn warm_vertices(mesh: &TriMesh, has_heat: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut parts = DisjointSets::new(mesh.n_vertices());
    for face in mesh.faces() {
        parts.join(face[0] as usize, face[1] as usize);
        parts.join(face[0] as usize, face[2] as usize);
    }
    let mut is_warm = vec![false; mesh.n_vertices()];
    for vertex in (0..mesh.n_vertices()).filter(|&it| has_heat(it)) {
        is_warm[parts.find(vertex)] = true;
    }
    (0..mesh.n_vertices()).map(|it| is_warm[parts.find(it)]).collect()
}

fn with_diagonal(matrix: &CsrMatrix, diagonal: &[f64]) -> CsrMatrix {
    let mut triplets = Vec::with_capacity(matrix.n_stored() + diagonal.len());
    for row in 0..matrix.n_rows {
        triplets.extend(matrix.row(row).map(|(col, value)| (row as u32, col as u32, value)));
        triplets.push((row as u32, row as u32, diagonal[row]));
    }
    CsrMatrix::from_triplets(matrix.n_rows, matrix.n_cols, &triplets)
}

#[cfg(test)]
mod tests;
