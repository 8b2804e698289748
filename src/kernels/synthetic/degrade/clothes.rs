//! Cloth that stands off the body.

use std::f64::consts::TAU;

use crate::kernels::{
    geometry::{
        mesh::{MeshError, TriMesh, Vec3},
        neighbour_means::neighbour_means,
    },
    numerics::random::Random,
};

/// How far from protected vertices clothes begin and are full, over the square root of the area.
const SLEEVE: [f64; 2] = [0.12, 0.24];

/// Blows a surface up along its normals, with folds, but not near protected vertices: hands, feet and
/// head look out.
///
/// Between 40 and 100 % of `distance`, by a sum of waves; the normals are smoothed first, since cloth
/// does not follow every dent.
pub fn clothes(
    mesh: &TriMesh,
    protected: &[u32],
    distance: f64,
    random: &mut Random,
) -> Result<TriMesh, MeshError> {
    let unit = mesh.area().sqrt();
    let waves: Vec<(Vec3, f64)> = (0..5)
        .map(|_| {
            let direction = Vec3::new(random.normal(), random.normal(), random.normal());
            (direction.normalize() * (TAU / (0.25 * unit)), random.between(0.0, TAU))
        })
        .collect();
    let fold = |at: &Vec3| {
        let sum: f64 = waves.iter().map(|(wave, phase)| (wave.dot(at) + phase).sin()).sum();
        0.7 + 0.3 * (sum / 2.0).clamp(-1.0, 1.0)
    };
    let tips: Vec<Vec3> = protected.iter().map(|&it| mesh.vertices()[it as usize]).collect();
    let covered = |at: &Vec3| {
        let nearest = tips.iter().map(|it| (it - at).norm()).fold(f64::INFINITY, f64::min);
        let t = ((nearest / unit - SLEEVE[0]) / (SLEEVE[1] - SLEEVE[0])).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let normals = neighbour_means(mesh, mesh.vertex_normals(), 8);
    let moved = mesh.vertices().iter().zip(&normals);
    mesh.with_vertices(
        moved
            .map(|(at, normal)| {
                let normal = normal.try_normalize(0.0).unwrap_or_default();
                at + normal * (distance * covered(at) * fold(at))
            })
            .collect(),
    )
}
