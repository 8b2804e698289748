//! Triangles of the zero set of a function in space.

use rayon::prelude::*;

use super::mesh::{TriMesh, Vec3};

/// Cells along the side of a block, the unit of culling and of parallel work.
const BLOCK: usize = 8;

/// The cube's tetrahedra that share its diagonal (Kuhn 1960): corners are sums of the axes in an
/// order, as bits. The flag tells whether the order is even, which makes the volume positive.
const TETRAHEDRA: [([usize; 4], bool); 6] = [
    ([0, 1, 3, 7], true),
    ([0, 1, 5, 7], false),
    ([0, 2, 3, 7], false),
    ([0, 2, 6, 7], true),
    ([0, 4, 5, 7], true),
    ([0, 4, 6, 7], false),
];

/// The grid on which [`isosurface`] samples.
#[derive(Debug, Clone)]
pub struct Grid {
    /// The least corner. The function must be positive on the whole border of the grid.
    pub origin: Vec3,
    /// The side of a cell.
    pub cell: f64,
    /// The number of cells along each axis.
    pub n_cells: [usize; 3],
}

/// Polygonizes the set where `value` is zero, its normals towards positive values.
///
/// Marching tetrahedra over Kuhn's six in every cell: inside the grid the result is a closed
/// manifold, however the values lie, as every tetrahedron is cut by one triangle or quadrangle.
/// `value` should be about a distance; blocks of cells farther from the surface than 1.6 times their
/// radius are skipped, so its gradient must not be longer than that.
///
/// Returns `None` if nothing is inside.
pub fn isosurface(grid: &Grid, value: &(dyn Fn(Vec3) -> f64 + Sync)) -> Option<TriMesh> {
    let counts = grid.n_cells.map(|it| it.div_ceil(BLOCK));
    let blocks: Vec<[usize; 3]> = (0..counts[2])
        .flat_map(|z| (0..counts[1]).flat_map(move |y| (0..counts[0]).map(move |x| [x, y, z])))
        .collect();
    let pieces: Vec<Vec<Crossing>> =
        blocks.par_iter().map(|&it| march_block(grid, it, value)).collect();
    let crossings: Vec<Crossing> = pieces.concat();
    if crossings.is_empty() {
        return None;
    }
    let mut unique = crossings.clone();
    unique.par_sort_unstable_by_key(|it| it.edge);
    unique.dedup_by_key(|it| it.edge);
    let number = |crossing: &Crossing| {
        let found = unique.binary_search_by_key(&crossing.edge, |it| it.edge);
        found.expect("`unique` holds every crossing") as u32
    };
    let faces = crossings.par_chunks(3).map(|it| [number(&it[0]), number(&it[1]), number(&it[2])]);
    let vertices = unique.iter().map(|it| it.position).collect();
    Some(TriMesh::new(vertices, faces.collect()).expect("crossings are numbered and finite"))
}

/// A vertex of the result: where an edge of the grid changes sign.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    /// Eight times the number of the edge's least corner, plus its direction as bits.
    edge: u64,
    position: Vec3,
}

/// Three crossings for every triangle in a block.
fn march_block(
    grid: &Grid,
    block: [usize; 3],
    value: &(dyn Fn(Vec3) -> f64 + Sync),
) -> Vec<Crossing> {
    let first = block.map(|it| it * BLOCK);
    let at = |corner: [usize; 3]| grid.origin + grid.cell * Vec3::from(corner.map(|it| it as f64));
    let half = 0.5 * grid.cell * BLOCK as f64;
    if value(at(first).add_scalar(half)).abs() > 1.6 * 3.0_f64.sqrt() * half {
        return Vec::new();
    }
    let side = BLOCK + 1;
    let corners: Vec<[usize; 3]> = (0..side * side * side)
        .map(|it| {
            [first[0] + it % side, first[1] + it / side % side, first[2] + it / (side * side)]
        })
        .collect();
    let values: Vec<f64> = corners.iter().map(|&it| value(at(it))).collect();
    let steps = [1, side, side * side];
    let mut crossings = Vec::new();
    for low in 0..values.len() {
        if (0..3).any(|axis| corners[low][axis] == first[axis] + BLOCK) {
            continue;
        }
        let cube: [usize; 8] = std::array::from_fn(|bits| {
            low + (0..3).map(|axis| (bits >> axis & 1) * steps[axis]).sum::<usize>()
        });
        let n_inside = cube.iter().filter(|&&it| values[it] < 0.0).count();
        if n_inside == 0 || n_inside == 8 {
            continue;
        }
        let crossing = |one: usize, other: usize| {
            let (a, b) = (one.min(other), one.max(other));
            let (value_a, value_b) = (values[cube[a]], values[cube[b]]);
            // Away from the ends, so that no triangle degenerates.
            let along = (value_a / (value_a - value_b)).clamp(0.05, 0.95);
            let [x, y, z] = corners[cube[a]].map(|it| it as u64);
            let [nx, ny] = [grid.n_cells[0] + BLOCK, grid.n_cells[1] + BLOCK].map(|it| it as u64);
            Crossing {
                edge: 8 * (x + nx * (y + ny * z)) + (a ^ b) as u64,
                position: at(corners[cube[a]]).lerp(&at(corners[cube[b]]), along),
            }
        };
        for (tetrahedron, even) in TETRAHEDRA {
            cut(
                tetrahedron,
                even,
                |it| values[cube[it]] < 0.0,
                |one, other| {
                    crossings.push(crossing(one, other));
                },
            );
        }
    }
    crossings
}

/// Cuts a tetrahedron: reports the edges whose crossings form triangles, three for each.
fn cut(
    corners: [usize; 4],
    even: bool,
    inside: impl Fn(usize) -> bool,
    mut report: impl FnMut(usize, usize),
) {
    let n_inside = corners.iter().filter(|&&it| inside(it)).count();
    // Sorts inside before outside and keeps track of the parity.
    let (mut order, mut even) = (corners, even);
    for _ in 0..3 {
        for k in 0..3 {
            if !inside(order[k]) && inside(order[k + 1]) {
                order.swap(k, k + 1);
                even = !even;
            }
        }
    }
    let [i, j, k, l] = order;
    let mut triangle = |edges: [(usize, usize); 3]| {
        let edges = if even { edges } else { [edges[0], edges[2], edges[1]] };
        edges.iter().for_each(|it| report(it.0, it.1));
    };
    match n_inside {
        1 => triangle([(i, j), (i, k), (i, l)]),
        2 => {
            triangle([(i, k), (i, l), (j, l)]);
            triangle([(i, k), (j, l), (j, k)]);
        }
        3 => triangle([(i, l), (j, l), (k, l)]),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::corner_table::CornerTable;

    fn grid(n: usize) -> Grid {
        let cell = 2.0 / n as f64;
        Grid { origin: Vec3::repeat(-1.0), cell, n_cells: [n; 3] }
    }

    fn volume(mesh: &TriMesh) -> f64 {
        (0..mesh.n_faces())
            .map(|face| mesh.area_vector(face).dot(&mesh.corners(face)[0]) / 3.0)
            .sum()
    }

    #[test]
    fn a_sphere_is_closed_and_has_its_volume() {
        let centre = Vec3::new(0.01, 0.02, -0.03);
        let mesh = isosurface(&grid(30), &|it| (it - centre).norm() - 0.7).unwrap();
        CornerTable::new(&mesh).unwrap();
        assert_eq!(mesh.n_faces(), 2 * mesh.n_vertices() - 4);
        let expected = 4.0 / 3.0 * std::f64::consts::PI * 0.7_f64.powi(3);
        assert!((volume(&mesh) / expected - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_torus_has_a_handle() {
        let ring = |it: Vec3| (it.xy().norm() - 0.6).hypot(it.z) - 0.2;
        let mesh = isosurface(&grid(30), &ring).unwrap();
        CornerTable::new(&mesh).unwrap();
        assert_eq!(mesh.n_faces(), 2 * mesh.n_vertices());
    }

    #[test]
    fn every_sign_pattern_closes() {
        let mut random = crate::kernels::random::Random::new(2);
        let cell = 0.125;
        let signs: Vec<f64> = (0..17_usize.pow(3)).map(|_| random.between(-0.05, 0.05)).collect();
        let noise = |it: Vec3| {
            let at = ((it.add_scalar(1.0)) / cell).map(|it| it.round() as usize);
            let border = at.iter().any(|&it| it == 0 || it >= 16);
            if border { 0.05 } else { signs[at.x + 17 * (at.y + 17 * at.z)] }
        };
        let mesh = isosurface(&grid(16), &noise).unwrap();
        CornerTable::new(&mesh).unwrap();
    }

    #[test]
    fn nothing_inside_is_nothing() {
        assert!(isosurface(&grid(8), &|it| it.norm() + 1.0).is_none());
    }
}
