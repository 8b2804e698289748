//! Triangles of the zero set of a function in space.

use rayon::prelude::*;

use super::mesh::{TriMesh, Vec3};

/// Cells along the side of a block, the unit of parallel work; a power of two.
const BLOCK: usize = 8;

/// The longest gradient of the function that is allowed.
const STEEPEST: f64 = 2.5;

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
/// `value` should be about a distance: cubes of cells are skipped where it is more than 2.5 times
/// their radius, so its gradient must not be longer than that.
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
    let values = vec![f64::NAN; SIDE.pow(3)];
    let first = block.map(|it| it * BLOCK);
    let mut march = March { grid, first, value, values, crossings: Vec::new() };
    march.cube([0; 3], BLOCK);
    march.crossings
}

/// Corners along the side of a block.
const SIDE: usize = BLOCK + 1;

/// One block under way.
struct March<'a> {
    grid: &'a Grid,
    /// The block's least corner in the grid.
    first: [usize; 3],
    value: &'a (dyn Fn(Vec3) -> f64 + Sync),
    /// At the corners of the block; not a number where it is not known yet.
    values: Vec<f64>,
    crossings: Vec<Crossing>,
}

impl March<'_> {
    fn position(&self, corner: [usize; 3]) -> Vec3 {
        let corner = std::array::from_fn(|axis| (self.first[axis] + corner[axis]) as f64);
        self.grid.origin + self.grid.cell * Vec3::from(corner)
    }

    fn value(&mut self, corner: [usize; 3]) -> f64 {
        let index = corner[0] + SIDE * (corner[1] + SIDE * corner[2]);
        if self.values[index].is_nan() {
            self.values[index] = (self.value)(self.position(corner));
        }
        self.values[index]
    }

    /// Marches through a cube of cells unless its centre is too far from the surface.
    fn cube(&mut self, low: [usize; 3], side: usize) {
        if side == 1 {
            return self.cell(low);
        }
        let half = side / 2;
        let radius = 3.0_f64.sqrt() * half as f64 * self.grid.cell;
        if self.value(low.map(|it| it + half)).abs() > STEEPEST * radius {
            return;
        }
        for octant in 0..8 {
            self.cube(std::array::from_fn(|axis| low[axis] + (octant >> axis & 1) * half), half);
        }
    }

    fn cell(&mut self, low: [usize; 3]) {
        let corner = |bits: usize| std::array::from_fn(|axis| low[axis] + (bits >> axis & 1));
        let values: [f64; 8] = std::array::from_fn(|bits| self.value(corner(bits)));
        let n_inside = values.iter().filter(|it| **it < 0.0).count();
        if n_inside == 0 || n_inside == 8 {
            return;
        }
        let crossing = |march: &Self, one: usize, other: usize| {
            let (a, b) = (one.min(other), one.max(other));
            // Away from the ends, so that no triangle degenerates.
            let along = (values[a] / (values[a] - values[b])).clamp(0.05, 0.95);
            let at: [usize; 3] = corner(a);
            let [x, y, z] = std::array::from_fn(|axis| (march.first[axis] + at[axis]) as u64);
            let [nx, ny] = [0, 1].map(|axis| (march.grid.n_cells[axis] + SIDE) as u64);
            Crossing {
                edge: 8 * (x + nx * (y + ny * z)) + (a ^ b) as u64,
                position: march.position(at).lerp(&march.position(corner(b)), along),
            }
        };
        for (tetrahedron, even) in TETRAHEDRA {
            cut(
                tetrahedron,
                even,
                |it| values[it] < 0.0,
                |one, other| {
                    let crossing = crossing(self, one, other);
                    self.crossings.push(crossing);
                },
            );
        }
    }
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
    use crate::kernels::geometry::corner_table::CornerTable;

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
        let mut random = crate::kernels::numerics::random::Random::new(2);
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
