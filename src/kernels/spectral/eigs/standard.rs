//! The generalized problem as an ordinary one, in an order in which its factors stay sparse.

use super::EigsError;
use crate::kernels::spectral::operator::Operator;
use faer::Side;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};

/// `B = M^-1/2 L M^-1/2` with rows and columns in a fill-reducing order (approximate minimum
/// degree, Amestoy, Davis & Duff 1996), for masses that add up to one.
///
/// Eigenvectors of `B` are orthonormal in the plain sense, which makes every inner product of the
/// solver a matrix product, and on a closed surface its eigenvalues grow like `4 pi i` (Weyl's law),
/// which makes tolerances independent of the unit of length.
pub(super) struct StandardForm {
    /// Vertex of every row.
    pub order: Vec<u32>,
    /// Square roots of the masses, by row.
    pub root_mass: Vec<f64>,
    /// The sum of the masses: eigenvalues of the operator are those of `B` over it.
    pub total_mass: f64,
    lower: LowerTriangle,
    symbolic: SymbolicCholesky<u32>,
}

/// A lower triangle by columns; the diagonal comes first in every column.
struct LowerTriangle {
    offsets: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
}

impl StandardForm {
    /// # Errors
    /// [`EigsError::TooLarge`] if the matrix is too large for its indices or for memory.
    pub fn new(operator: &Operator) -> Result<Self, EigsError> {
        let symbolic = symbolic_factorization(operator)?;
        let perm = symbolic.perm().expect("an ordering was asked for");
        let (order, row_of_vertex) = perm.arrays();
        let (order, row_of_vertex) = (order.to_vec(), row_of_vertex.to_vec());
        let total_mass: f64 = operator.mass.iter().sum();
        let root_mass: Vec<f64> =
            order.iter().map(|&it| (operator.mass[it as usize] / total_mass).sqrt()).collect();
        let mut lower = LowerTriangle { offsets: vec![0], rows: vec![], values: vec![] };
        let mut column = vec![];
        for (row, &vertex) in order.iter().enumerate() {
            column.clear();
            let entries = operator.stiffness.row(vertex as usize);
            let moved = entries.map(|(to, value)| (row_of_vertex[to], value));
            column.extend(moved.filter(|it| it.0 as usize >= row));
            column.sort_unstable_by_key(|it| it.0);
            if column.first().is_none_or(|it| it.0 as usize != row) {
                column.insert(0, (row as u32, 0.0));
            }
            for &(other, value) in &column {
                lower.rows.push(other);
                lower.values.push(value / (root_mass[row] * root_mass[other as usize]));
            }
            lower.offsets.push(lower.rows.len() as u32);
        }
        Ok(Self { order, root_mass, total_mass, lower, symbolic })
    }

    /// The pattern of the factors of `B - shift`, which is the same for all shifts.
    pub fn symbolic(&self) -> &SymbolicSupernodalCholesky<u32> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => symbolic,
            SymbolicCholeskyRaw::Simplicial(_) => unreachable!("supernodes were asked for"),
        }
    }

    pub fn n(&self) -> usize {
        self.order.len()
    }

    /// Calls `work` with the lower triangle of `B - shift`.
    pub fn with_shifted<T>(
        &self,
        shift: f64,
        work: impl FnOnce(SparseColMatRef<'_, u32, f64>) -> T,
    ) -> T {
        let mut values = self.lower.values.clone();
        for &begin in &self.lower.offsets[..self.n()] {
            values[begin as usize] -= shift;
        }
        let (offsets, rows) = (&self.lower.offsets, &self.lower.rows);
        let pattern = SymbolicSparseColMatRef::new_checked(self.n(), self.n(), offsets, None, rows);
        work(SparseColMatRef::new(pattern, &values))
    }
}

fn symbolic_factorization(operator: &Operator) -> Result<SymbolicCholesky<u32>, EigsError> {
    let n = operator.mass.len();
    let too_large = || EigsError::TooLarge { n_vertices: n };
    let n_stored = operator.stiffness.n_stored();
    u32::try_from(n_stored).map_err(|_| too_large())?;
    let offsets: Vec<u32> = operator.stiffness.offsets.iter().map(|&it| it as u32).collect();
    let columns = &operator.stiffness.columns;
    // The matrix is symmetric: its rows are its columns.
    let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, columns);
    let params = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..Default::default()
    };
    factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
        .map_err(|_| too_large())
}
