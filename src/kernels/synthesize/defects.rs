//! What scanners do to surfaces: noise and holes.

use super::{Character, SynthesizeError, SynthesizeOptions, meshing::n_components};
use crate::kernels::{
    landmarks::Landmarks,
    mesh::{TriMesh, Vec3},
    random::Random,
    weights::SkinWeights,
};

/// The radius of a hole over the square root of the area.
const HOLE_RADIUS: f64 = 0.035;

/// Displaces vertices and cuts holes as the options ask for.
pub fn apply(
    character: Character,
    options: &SynthesizeOptions,
) -> Result<Character, SynthesizeError> {
    let mut random = Random::stream(options.seed, "defects");
    let mut res = character;
    if options.noise > 0.0 {
        res.mesh = displaced(&res.mesh, options.noise, &mut random);
    }
    if options.n_holes > 0 {
        res = with_holes(res, options.n_holes, &mut random)?;
    }
    Ok(res)
}

/// Moves every vertex along its normal by normal noise of a deviation relative to the mean edge.
fn displaced(mesh: &TriMesh, noise: f64, random: &mut Random) -> TriMesh {
    // In a mesh of equilateral triangles of the same mean area.
    let edge = (mesh.area() / mesh.n_faces() as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
    let normals = mesh.vertex_normals();
    let moved = mesh.vertices().iter().zip(&normals);
    let moved = moved.map(|(it, normal)| it + normal * (noise * edge * random.normal())).collect();
    mesh.with_vertices(moved).expect("noise is finite")
}

/// Cuts round holes that touch neither each other nor landmarks, and leave one piece.
fn with_holes(
    character: Character,
    n_holes: usize,
    random: &mut Random,
) -> Result<Character, SynthesizeError> {
    let mesh = &character.mesh;
    let radius = HOLE_RADIUS * mesh.area().sqrt();
    let at = |vertex: u32| mesh.vertices()[vertex as usize];
    let marked: Vec<Vec3> = character.landmarks.vertices.iter().map(|&it| at(it)).collect();
    let mut order: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
    random.shuffle(&mut order);
    let mut centres: Vec<Vec3> = Vec::new();
    let mut faces = mesh.faces().to_vec();
    for centre in order.into_iter().map(at) {
        if centres.len() == n_holes {
            break;
        }
        let apart = |others: &[Vec3], by: f64| others.iter().all(|it| (it - centre).norm() > by);
        if !apart(&centres, 3.0 * radius) || !apart(&marked, 2.0 * radius) {
            continue;
        }
        let outside = |face: &&[u32; 3]| face.iter().all(|&it| (at(it) - centre).norm() > radius);
        let left: Vec<[u32; 3]> = faces.iter().filter(outside).copied().collect();
        if left.len() < faces.len() && n_parts(mesh, &left) == 1 {
            faces = left;
            centres.push(centre);
        }
    }
    if centres.len() < n_holes {
        return Err(SynthesizeError::Holes { asked: n_holes, possible: centres.len() });
    }
    Ok(without_unused(character, &faces))
}

/// The number of connected parts that faces of a mesh form.
fn n_parts(mesh: &TriMesh, faces: &[[u32; 3]]) -> usize {
    let used = used(mesh.n_vertices(), faces);
    let n_unused = used.iter().filter(|it| !**it).count();
    let part = TriMesh::new(mesh.vertices().to_vec(), faces.to_vec());
    n_components(&part.expect("these are faces of the mesh")) - n_unused
}

fn used(n_vertices: usize, faces: &[[u32; 3]]) -> Vec<bool> {
    let mut used = vec![false; n_vertices];
    for &vertex in faces.iter().flatten() {
        used[vertex as usize] = true;
    }
    used
}

/// The character with these faces only, and with the vertices that they use.
fn without_unused(character: Character, faces: &[[u32; 3]]) -> Character {
    let Character { mesh, skeleton, weights, landmarks, clip } = character;
    let used = used(mesh.n_vertices(), faces);
    let mut numbers = vec![u32::MAX; mesh.n_vertices()];
    let (mut vertices, mut rows) = (Vec::new(), Vec::new());
    for vertex in (0..mesh.n_vertices()).filter(|&it| used[it]) {
        numbers[vertex] = vertices.len() as u32;
        vertices.push(mesh.vertices()[vertex]);
        rows.push(weights.row(vertex).collect());
    }
    let number = |vertex: &u32| numbers[*vertex as usize];
    let faces = faces.iter().map(|it| [number(&it[0]), number(&it[1]), number(&it[2])]).collect();
    let mesh = TriMesh::new(vertices, faces).expect("used vertices have numbers");
    let weights = SkinWeights::from_rows(skeleton.n_joints(), &rows).expect("rows of weights");
    // Holes keep away from landmarks, so these are used.
    let vertices = landmarks.vertices.iter().map(number).collect();
    Character { mesh, skeleton, weights, landmarks: Landmarks { vertices, ..landmarks }, clip }
}
