//! The least-squares problem of one contraction.

use faer::Mat;

use super::rings::Rings;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::sparse::CsrMatrix;
use crate::kernels::numerics::sparse_cholesky::SparseCholesky;

/// `(L^T L + H^2) D = -L^T L P` for rows `L` of fixed rings and anchors `H`: the displacements `D` that
/// make the Laplacian small and points stay where they are.
///
/// For displacements, rounding errors of large weights are errors of the step, not of the place: the
/// Laplacian of a constant is exactly zero, as its rows are applied to differences.
///
/// The places of the entries never change, so the order of elimination is found once.
pub struct Equations<'a> {
    rings: &'a Rings,
    /// The diagonal and what is above it.
    matrix: CsrMatrix,
    /// For every row of `L`, the places in `matrix` of the products of its entries: of the centre and
    /// the ring, each with itself and all later ones.
    slots: Vec<u32>,
    factor: Option<SparseCholesky>,
}

impl<'a> Equations<'a> {
    pub fn new(rings: &'a Rings) -> Self {
        let matrix = pattern(rings);
        let slots = slots(rings, &matrix);
        Self { rings, matrix, slots, factor: None }
    }

    /// Solves for displacements. `weights` of the ring entries of all rows (the centre's is minus
    /// their sum), and `anchors`, one a point; `None` if the matrix is not positive definite in
    /// floating-point numbers.
    pub fn solve(
        &mut self,
        weights: &[f64],
        anchors: &[f64],
        positions: &[Vec3],
    ) -> Option<Vec<Vec3>> {
        self.assemble(weights, anchors);
        match &mut self.factor {
            Some(factor) => factor.refactor(&self.matrix).then_some(())?,
            none => *none = Some(SparseCholesky::new(&self.matrix)?),
        }
        let mut right = self.right_side(weights, positions);
        self.factor.as_ref().expect("made above").solve_in_place(right.as_mut());
        let row = |it: usize| Vec3::new(right[(it, 0)], right[(it, 1)], right[(it, 2)]);
        let displacements: Vec<Vec3> = (0..positions.len()).map(row).collect();
        displacements.iter().all(|it| it.iter().all(|it| it.is_finite())).then_some(displacements)
    }

    fn assemble(&mut self, weights: &[f64], anchors: &[f64]) {
        let values = &mut self.matrix.values;
        values.fill(0.0);
        let mut slots = self.slots.iter();
        let mut row: Vec<f64> = Vec::new();
        for point in 0..self.rings.n_points() {
            let own = &weights[self.rings.offsets[point]..self.rings.offsets[point + 1]];
            row.clear();
            row.push(-own.iter().sum::<f64>());
            row.extend_from_slice(own);
            for (place, a) in row.iter().enumerate() {
                for (b, &slot) in row[place..].iter().zip(&mut slots) {
                    values[slot as usize] += a * b;
                }
            }
        }
        for (point, anchor) in anchors.iter().enumerate() {
            // The diagonal is the first entry of an upper row.
            values[self.matrix.offsets[point]] += anchor * anchor;
        }
    }

    fn right_side(&self, weights: &[f64], positions: &[Vec3]) -> Mat<f64> {
        let mut right: Mat<f64> = Mat::zeros(positions.len(), 3);
        for (point, position) in positions.iter().enumerate() {
            let range = self.rings.offsets[point]..self.rings.offsets[point + 1];
            let (ring, own) = (&self.rings.neighbors[range.clone()], &weights[range]);
            let entries = ring.iter().zip(own);
            let delta: Vec3 =
                entries.clone().map(|(&it, w)| (positions[it as usize] - position) * *w).sum();
            let total: f64 = own.iter().sum();
            for axis in 0..3 {
                right[(point, axis)] += total * delta[axis];
                for (&it, weight) in entries.clone() {
                    right[(it as usize, axis)] -= weight * delta[axis];
                }
            }
        }
        right
    }
}

/// Pairs of points that are in one row of the Laplacian, the smaller first.
fn pattern(rings: &Rings) -> CsrMatrix {
    let n_points = rings.n_points();
    // For every point the rows that it is in.
    let mut rows_of: Vec<Vec<u32>> = vec![Vec::new(); n_points];
    for point in 0..n_points {
        rows_of[point].push(point as u32);
        for &other in rings.ring(point) {
            rows_of[other as usize].push(point as u32);
        }
    }
    let mut offsets = Vec::with_capacity(n_points + 1);
    offsets.push(0);
    let mut columns: Vec<u32> = Vec::with_capacity(12 * n_points);
    let mut last_row = vec![u32::MAX; n_points];
    for (point, rows) in rows_of.iter().enumerate() {
        let first = columns.len();
        for &row in rows {
            for &other in rings.ring(row as usize).iter().chain([&row]) {
                if other as usize >= point && last_row[other as usize] != point as u32 {
                    last_row[other as usize] = point as u32;
                    columns.push(other);
                }
            }
        }
        columns[first..].sort_unstable();
        offsets.push(columns.len());
    }
    let values = vec![0.0; columns.len()];
    CsrMatrix { n_rows: n_points, n_cols: n_points, offsets, columns, values }
}

fn slots(rings: &Rings, matrix: &CsrMatrix) -> Vec<u32> {
    let mut slots = Vec::new();
    let mut row: Vec<u32> = Vec::new();
    for point in 0..rings.n_points() {
        row.clear();
        row.push(point as u32);
        row.extend_from_slice(rings.ring(point));
        for (place, &a) in row.iter().enumerate() {
            for &b in &row[place..] {
                let (low, high) = (a.min(b) as usize, a.max(b));
                let range = matrix.offsets[low]..matrix.offsets[low + 1];
                let found = matrix.columns[range.clone()].binary_search(&high);
                slots.push((range.start + found.expect("the pattern holds all pairs")) as u32);
            }
        }
    }
    slots
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes::bumpy_sphere;

    /// Compares with dense matrices.
    #[test]
    fn displacements_are_those_of_the_normal_equations() {
        let mesh = bumpy_sphere(3);
        let n = mesh.n_vertices();
        let rings = Rings::of_faces(n, mesh.faces());
        let mut equations = Equations::new(&rings);
        for round in 1..3 {
            let weights: Vec<f64> = (0..rings.neighbors.len())
                .map(|it| ((it * 7 + round) % 11) as f64 * 0.1 + 0.2)
                .collect();
            let anchors: Vec<f64> = (0..n).map(|it| 1.0 + (it % 3) as f64).collect();
            let found = equations.solve(&weights, &anchors, mesh.vertices()).unwrap();
            let mut laplacian: Mat<f64> = Mat::zeros(n, n);
            for point in 0..n {
                for (place, &other) in rings.ring(point).iter().enumerate() {
                    let weight = weights[rings.offsets[point] + place];
                    laplacian[(point, other as usize)] += weight;
                    laplacian[(point, point)] -= weight;
                }
            }
            let positions = Mat::from_fn(n, 3, |it, axis| mesh.vertices()[it][axis]);
            let moved = Mat::from_fn(n, 3, |it, axis| mesh.vertices()[it][axis] + found[it][axis]);
            let held = Mat::from_fn(n, 3, |it, axis| anchors[it].powi(2) * found[it][axis]);
            let residual = laplacian.transpose() * (&laplacian * &moved) + &held;
            assert!(residual.norm_max() < 1e-10 * positions.norm_l2(), "{}", residual.norm_max());
        }
    }
}
