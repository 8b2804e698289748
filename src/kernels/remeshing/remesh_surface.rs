//! New triangles for the surface of a mesh.

use rayon::prelude::*;

use super::{
    remesh::{RemeshOptions, remesh},
    resampled::Resampled,
    shuffle::shuffled,
};
use crate::kernels::{
    geometry::{
        corner_table::TopologyError,
        mesh::{MeshError, TriMesh, Vec3},
        neighbour_means::neighbour_means,
        point_tree::PointTree,
        triangle::closest_on_triangle,
        triangle_tree::{Nearest, TriangleTree},
    },
    numerics::{random::Random, sparse::CsrMatrix},
};

/// How edge lengths vary over the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sizing {
    /// One length everywhere.
    Isotropic,
    /// Shorter where the surface bends.
    Adaptive,
    /// Lengths that change without reason, by a factor of about three.
    Irregular,
}

/// Options of [`remesh_surface`].
#[derive(Debug, Clone, PartialEq)]
pub struct RemeshSurfaceOptions {
    pub n_vertices: usize,
    pub sizing: Sizing,
    /// Decides on the order of the vertices and on irregular lengths.
    pub seed: u64,
}

/// Why a surface cannot be remeshed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RemeshError {
    #[error("{0}: remeshing needs a closed surface (`clean` with `fill_holes` makes one)")]
    Topology(#[from] TopologyError),
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error("the surface has no area")]
    Flat,
}

/// Covers the surface of a mesh with other triangles, whose vertices are in random order.
///
/// Isotropic remeshing (Botsch & Kobbelt 2004) with vertices that stay on the given triangles. What
/// lives on vertices is read off the old surface at the closest point; old vertices are stood for by
/// the nearest new ones.
///
/// # Errors
/// See [`RemeshError`].
pub fn remesh_surface(
    mesh: &TriMesh,
    options: &RemeshSurfaceOptions,
) -> Result<Resampled, RemeshError> {
    mesh.check_has_faces()?;
    if !(mesh.area() > 0.0) {
        return Err(RemeshError::Flat);
    }
    let (surface, places) = (TriangleTree::new(mesh), PointTree::new(mesh.vertices()));
    let sizes = sizes(mesh, options);
    let size = |it: Vec3| sizes[nearest_vertex(&places, it) as usize];
    let project = |it: Vec3| surface.nearest(it).point;
    let kernel_options = RemeshOptions { n_vertices: options.n_vertices, rounds: 5 };
    let made = remesh(mesh, &kernel_options, &size, &project)?;
    let made = shuffled(&made, &mut Random::stream(options.seed, "order"));
    let nearest: Vec<Nearest> = made.vertices().par_iter().map(|&it| surface.nearest(it)).collect();
    let triplets: Vec<(u32, u32, f64)> = nearest
        .iter()
        .enumerate()
        .flat_map(|(new, it)| {
            let corners = mesh.faces()[it.face as usize];
            let weights = closest_on_triangle(&it.point, &mesh.corners(it.face as usize));
            (0..3)
                .filter(move |&corner| weights[corner] > 0.0)
                .map(move |corner| (new as u32, corners[corner], weights[corner]))
        })
        .collect();
    let new_from_old = CsrMatrix::from_triplets(made.n_vertices(), mesh.n_vertices(), &triplets);
    let tree = PointTree::new(made.vertices());
    let stand_in = |it: &Vec3| Some(nearest_vertex(&tree, *it));
    let new_of_old = mesh.vertices().par_iter().map(stand_in).collect();
    let vertices = nearest.iter().map(|it| it.point).collect();
    Ok(Resampled { mesh: made.with_vertices(vertices)?, new_from_old, new_of_old })
}

fn nearest_vertex(tree: &PointTree, place: Vec3) -> u32 {
    let mut found = Vec::with_capacity(2);
    tree.nearest(place, 1, &mut found);
    found[0].1
}

/// The wanted edge length at every vertex of the mesh, up to a common factor.
///
/// However they vary, edges are shorter than the radius to which the surface is bent: fingers stay round.
fn sizes(mesh: &TriMesh, options: &RemeshSurfaceOptions) -> Vec<f64> {
    let radii = bending_radii(mesh);
    // Of equilateral triangles, two a vertex.
    let edge = (mesh.area() / (options.n_vertices as f64 * 0.75_f64.sqrt())).sqrt();
    let bounded = |(size, radius): (f64, &f64)| size.min((1.2 * radius / edge).max(0.25));
    let wanted = match options.sizing {
        Sizing::Isotropic => vec![1.0; mesh.n_vertices()],
        Sizing::Adaptive => {
            // Half the length at a tenth of the root of the area, the radius of a thigh.
            let unit = mesh.area().sqrt() / 10.0;
            radii.iter().map(|it| (it / (it + unit)).max(1.0 / 6.0) * 2.0).collect()
        }
        Sizing::Irregular => irregular_sizes(mesh, options.seed),
    };
    wanted.into_iter().zip(&radii).map(bounded).collect()
}

/// The radius to which the surface is bent at every vertex, from the turn of the normals.
fn bending_radii(mesh: &TriMesh) -> Vec<f64> {
    let normals = mesh.vertex_normals();
    let scale = mesh.area().sqrt();
    let mut bending = vec![0.0f64; mesh.n_vertices()];
    for face in mesh.faces() {
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (face[a] as usize, face[b] as usize)) {
            let length = (mesh.vertices()[a] - mesh.vertices()[b]).norm().max(1e-12 * scale);
            let turn = normals[a].angle(&normals[b]) / length;
            bending[a] = bending[a].max(turn);
            bending[b] = bending[b].max(turn);
        }
    }
    neighbour_means(mesh, bending, 3).iter().map(|it| 1.0 / it.max(1e-3 / scale)).collect()
}

/// A sum of a few waves in space.
fn irregular_sizes(mesh: &TriMesh, seed: u64) -> Vec<f64> {
    let mut random = Random::stream(seed, "sizes");
    let (low, high) = mesh.bounds();
    let scale = std::f64::consts::TAU / (high - low).norm();
    let waves: Vec<(Vec3, f64)> = (0..6)
        .map(|_| {
            let direction = Vec3::new(random.normal(), random.normal(), random.normal());
            (direction * (4.0 * scale), random.between(0.0, std::f64::consts::TAU))
        })
        .collect();
    let value = |it: &Vec3| {
        let sum: f64 = waves.iter().map(|(wave, phase)| (wave.dot(it) + phase).sin()).sum();
        // Six waves sum up to about two at most of the time: a factor of three between the extremes.
        3.0_f64.powf(0.25 * sum.clamp(-2.0, 2.0))
    };
    mesh.vertices().iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::landmarks::Landmarks;
    use crate::kernels::geometry::shapes::icosphere;
    use crate::kernels::rigs::weights::SkinWeights;

    fn options(sizing: Sizing) -> RemeshSurfaceOptions {
        RemeshSurfaceOptions { n_vertices: 900, sizing, seed: 3 }
    }

    #[test]
    fn vertices_stay_on_the_surface_and_carry_what_they_had() {
        let sphere = icosphere(4);
        let rows: Vec<Vec<(u32, f64)>> = sphere
            .vertices()
            .iter()
            .map(|it| vec![(0, 0.5 + 0.5 * it.z), (1, 0.5 - 0.5 * it.z)])
            .collect();
        let weights = SkinWeights::from_rows(2, &rows).unwrap();
        for sizing in [Sizing::Isotropic, Sizing::Adaptive, Sizing::Irregular] {
            let made = remesh_surface(&sphere, &options(sizing)).unwrap();
            assert_eq!(made.mesh.n_vertices(), 900);
            assert_eq!(made.mesh.n_faces(), 1796, "still a sphere");
            let carried = made.weights(&weights).unwrap();
            for (vertex, position) in made.mesh.vertices().iter().enumerate() {
                // The faces of the icosphere are at most 0.3 % inside of the sphere.
                assert!((position.norm() - 1.0).abs() < 3e-3);
                assert!((carried.get(vertex, 0) - 0.5 - 0.5 * position.z).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn landmarks_stay_near_and_seeds_differ() {
        let sphere = icosphere(4);
        let first = remesh_surface(&sphere, &options(Sizing::Irregular)).unwrap();
        let landmarks = Landmarks { names: vec!["top".to_owned()], vertices: vec![17] };
        let moved = first.landmarks(&landmarks).unwrap().vertices[0] as usize;
        assert!((first.mesh.vertices()[moved] - sphere.vertices()[17]).norm() < 0.12);
        let other = RemeshSurfaceOptions { seed: 4, ..options(Sizing::Irregular) };
        assert_ne!(remesh_surface(&sphere, &other).unwrap().mesh, first.mesh);
        assert_eq!(remesh_surface(&sphere, &options(Sizing::Irregular)).unwrap(), first);
    }

    #[test]
    fn an_open_surface_is_refused() {
        let sphere = icosphere(1);
        let open = TriMesh::new(sphere.vertices().to_vec(), sphere.faces()[1..].to_vec()).unwrap();
        let error = remesh_surface(&open, &options(Sizing::Isotropic)).unwrap_err().to_string();
        assert!(error.ends_with("(`clean` with `fill_holes` makes one)"), "{error}");
    }
}
