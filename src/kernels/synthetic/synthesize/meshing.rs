//! From an implicit surface to a mesh of a wanted size and style.

use rayon::prelude::*;

use super::{SynthesizeError, SynthesizeOptions, surface::Surface};
use crate::kernels::{
    geometry::{
        isosurface::{Grid, isosurface},
        mesh::{TriMesh, Vec3},
        topology::DisjointSets,
    },
    numerics::random::Random,
    remeshing::{
        remesh::{RemeshOptions, remesh},
        shuffle::shuffled,
    },
};

/// How triangles are distributed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Connectivity {
    /// Edges of one length, shorter only where the body is thinner than that.
    Isotropic,
    /// Shorter edges where the body is thin: hands, feet, face.
    Adaptive,
    /// Edge lengths that change without reason, by a factor of about three.
    Irregular,
}

/// The widest cell that still finds thumbs and ears, in metres.
const WIDEST_CELL: f64 = 0.018;

/// About the skin of a body, in square metres.
const AREA: f64 = 1.9;

/// How often a surface that is not in one piece is tried again with finer cells.
const ATTEMPTS: usize = 3;

/// Meshes a surface with `options.n_vertices` vertices in random order.
pub fn mesh(surface: &Surface, options: &SynthesizeOptions) -> Result<TriMesh, SynthesizeError> {
    let n_vertices = options.n_vertices;
    if !(1_000..=250_000).contains(&n_vertices) {
        return Err(SynthesizeError::VertexCount { n_vertices });
    }
    let mut random = Random::stream(options.seed, "connectivity");
    let rough = rough(surface, n_vertices, &mut random)?;
    let size = sizes(surface, options, &mut random);
    // Fine meshes begin near their size, and moves within their tangent planes hardly leave the
    // surface: one step at the end is enough for them.
    let fine = n_vertices > 30_000;
    let options = RemeshOptions { n_vertices, rounds: if fine { 2 } else { 4 } };
    let project = |it: Vec3| if fine { it } else { surface.approach(it) };
    let mesh = remesh(&rough, &options, &size, &project)
        .expect("the polygonized surface is closed and manifold");
    let n_steps = if fine { 1 } else { 3 };
    let exact = |&it: &Vec3| (0..n_steps).fold(it, |at, _| surface.approach(at));
    let exact = mesh.vertices().par_iter().map(exact).collect();
    let mesh = mesh.with_vertices(exact).expect("the surface is finite");
    Ok(shuffled(&mesh, &mut random))
}

/// Polygonizes with cells that give somewhat more vertices than wanted.
fn rough(
    surface: &Surface,
    n_vertices: usize,
    random: &mut Random,
) -> Result<TriMesh, SynthesizeError> {
    let (low, high) = surface.bounds();
    // Kuhn's tetrahedra make some four vertices for every squared cell.
    let mut cell = (AREA * 4.0 / (1.2 * n_vertices as f64)).sqrt().min(WIDEST_CELL);
    let mut problem = None;
    for _ in 0..ATTEMPTS {
        let offset = Vec3::new(random.uniform(), random.uniform(), random.uniform());
        let origin = low - cell * offset;
        let n_cells: [usize; 3] =
            std::array::from_fn(|axis| ((high - origin)[axis] / cell).ceil() as usize);
        let grid = Grid { origin, cell, n_cells };
        let mesh = isosurface(&grid, &|it| surface.value(it)).expect("a body has an inside");
        let euler = mesh.n_vertices() as i64 - mesh.n_faces() as i64 / 2;
        let n_components = n_components(&mesh);
        if n_components == 1 && euler == 2 {
            return Ok(mesh);
        }
        problem = Some(SynthesizeError::Topology { n_components, euler });
        cell *= 0.6;
    }
    Err(problem.expect("there is a first attempt"))
}

/// The number of connected parts.
pub fn n_components(mesh: &TriMesh) -> usize {
    let mut sets = DisjointSets::new(mesh.n_vertices());
    for &[a, b, c] in mesh.faces() {
        sets.join(a as usize, b as usize);
        sets.join(b as usize, c as usize);
    }
    (0..mesh.n_vertices()).filter(|&it| sets.find(it) == it).count()
}

/// The wanted edge length at a point, up to a factor.
fn sizes<'a>(
    surface: &'a Surface,
    options: &SynthesizeOptions,
    random: &mut Random,
) -> Box<dyn Fn(Vec3) -> f64 + Sync + 'a> {
    let edge = (AREA * 2.0 / (3.0_f64.sqrt() * options.n_vertices as f64)).sqrt();
    match options.connectivity {
        // Nothing is thinner than a centimetre.
        Connectivity::Isotropic if edge < 0.01 => Box::new(|_| 1.0),
        Connectivity::Isotropic => {
            Box::new(move |it| (0.9 * surface.thickness(it) / edge).clamp(0.35, 1.0))
        }
        Connectivity::Adaptive => {
            Box::new(|it| (surface.thickness(it) / 0.08).sqrt().clamp(0.4, 1.3))
        }
        Connectivity::Irregular => {
            let mut wave = || {
                let direction = Vec3::new(random.normal(), random.normal(), random.normal());
                let length = random.between(0.12, 0.35);
                let phase = random.between(0.0, std::f64::consts::TAU);
                (direction.normalize() * std::f64::consts::TAU / length, phase)
            };
            let waves: Vec<(Vec3, f64)> = (0..6).map(|_| wave()).collect();
            let sum = move |at: Vec3| waves.iter().map(|it| (it.0.dot(&at) + it.1).sin()).sum();
            Box::new(move |it| {
                let sum: f64 = sum(it);
                (0.32 * sum).clamp(-0.55, 0.55).exp()
            })
        }
    }
}
