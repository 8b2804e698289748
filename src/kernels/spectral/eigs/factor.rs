//! Factors of the shifted matrix, and solves with blocks of right-hand sides.

use super::EigsError;
use super::standard::StandardForm;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::reborrow::ReborrowMut;
use faer::sparse::linalg::cholesky::supernodal::{
    SupernodalLdltRef, factorize_supernodal_numeric_ldlt, factorize_supernodal_numeric_ldlt_scratch,
};
use faer::{MatMut, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};

/// Rows below the diagonal block that are worked on together, which reuses what is in registers.
const GROUP: usize = 4;

/// `L D L^T = B - shift` with unit lower triangular `L` by supernodes: runs of columns whose rows
/// below the diagonal block are the same.
///
/// With a shift below the spectrum all pivots are positive, and the factorization is stable without
/// pivoting.
pub(super) struct ShiftedFactor {
    pub shift: f64,
    n: usize,
    supernodes: Vec<Supernode>,
    /// For every supernode: the columns of the strict lower triangle of its diagonal block, then
    /// groups of `GROUP` rows below it, each group by columns. Solves read it front to back, and
    /// back to front.
    values: Vec<f64>,
    /// For every supernode: the rows below its diagonal block in groups of `GROUP`, the last filled
    /// up with row `n`, which stands for no row.
    rows: Vec<[u32; GROUP]>,
    inverse_pivots: Vec<f64>,
}

struct Supernode {
    first_column: usize,
    n_columns: usize,
    values_begin: usize,
    rows_begin: usize,
    n_groups: usize,
}

impl ShiftedFactor {
    /// Factors `B - shift`.
    ///
    /// # Errors
    /// [`EigsError::NotPositive`] if a pivot is not positive.
    pub fn new(problem: &StandardForm, shift: f64) -> Result<Self, EigsError> {
        let symbolic = problem.symbolic();
        let mut packed = vec![0.0; symbolic.len_val()];
        let scratch = factorize_supernodal_numeric_ldlt_scratch::<u32, f64>(
            symbolic,
            Par::Seq,
            Default::default(),
        );
        let mut memory = MemBuffer::new(scratch);
        problem
            .with_shifted(shift, |lower| {
                factorize_supernodal_numeric_ldlt(
                    &mut packed,
                    lower,
                    LdltRegularization::default(),
                    symbolic,
                    Par::Seq,
                    MemStack::new(&mut memory),
                    Default::default(),
                )
            })
            .map_err(|_| not_positive(problem, shift, 0.0))?;
        let factor = SupernodalLdltRef::new(symbolic, &packed);
        let res = Self::from_faer(factor, problem.n(), shift);
        match res.inverse_pivots.iter().find(|&&it| !(it.is_finite() && it > 0.0)) {
            Some(inverse) => Err(not_positive(problem, shift, 1.0 / inverse)),
            None => Ok(res),
        }
    }

    /// Copies faer's factor into the order in which solves read it.
    fn from_faer(factor: SupernodalLdltRef<'_, u32, f64>, n: usize, shift: f64) -> Self {
        let mut res = Self {
            shift,
            n,
            supernodes: Vec::with_capacity(factor.symbolic().n_supernodes()),
            values: Vec::with_capacity(factor.values().len()),
            rows: vec![],
            inverse_pivots: Vec::with_capacity(n),
        };
        for index in 0..factor.symbolic().n_supernodes() {
            let supernode = factor.supernode(index);
            let block = supernode.val();
            let n_columns = block.ncols();
            let pattern = supernode.pattern();
            res.supernodes.push(Supernode {
                first_column: supernode.start(),
                n_columns,
                values_begin: res.values.len(),
                rows_begin: res.rows.len(),
                n_groups: pattern.len().div_ceil(GROUP),
            });
            for column in 0..n_columns {
                res.values.extend((column + 1..n_columns).map(|row| block[(row, column)]));
                res.inverse_pivots.push(1.0 / block[(column, column)]);
            }
            for (group, rows) in pattern.chunks(GROUP).enumerate() {
                let mut padded = [n as u32; GROUP];
                padded[..rows.len()].copy_from_slice(rows);
                res.rows.push(padded);
                let first_row = n_columns + group * GROUP;
                for column in 0..n_columns {
                    let values = (0..GROUP).map(|it| match it < rows.len() {
                        true => block[(first_row + it, column)],
                        false => 0.0,
                    });
                    res.values.extend(values);
                }
            }
        }
        res
    }

    pub fn n(&self) -> usize {
        self.n
    }

    /// `solution = (B - shift)^-1 right` for `n x WIDTH` right-hand sides.
    ///
    /// All of them go through the factor together, which is read from memory twice a solve; they
    /// lie side by side meanwhile, so that what belongs to a row is one vector or two.
    pub fn solve<const WIDTH: usize>(
        &self,
        right: MatRef<'_, f64>,
        mut solution: MatMut<'_, f64>,
        panel: &mut Vec<[f64; WIDTH]>,
    ) {
        panel.resize(self.n + 1, [0.0; WIDTH]);
        for column in 0..WIDTH {
            for (line, value) in panel.iter_mut().zip(right.col(column).iter()) {
                line[column] = *value;
            }
        }
        Arch::new().dispatch(Solve { factor: self, panel });
        for column in 0..WIDTH {
            for (line, value) in panel.iter().zip(solution.rb_mut().col_mut(column).iter_mut()) {
                *value = line[column];
            }
        }
    }
}

fn not_positive(problem: &StandardForm, shift: f64, pivot: f64) -> EigsError {
    let shift = shift / problem.total_mass;
    EigsError::NotPositive { n_vertices: problem.n(), shift, pivot }
}

/// Both triangular solves, compiled for every vector width that the processor may have.
struct Solve<'a, const WIDTH: usize> {
    factor: &'a ShiftedFactor,
    panel: &'a mut [[f64; WIDTH]],
}

impl<const WIDTH: usize> WithSimd for Solve<'_, WIDTH> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // Without vector instructions, a fused product is a slow function call.
        if S::IS_SCALAR {
            solve_panel::<false, WIDTH>(self.factor, self.panel);
        } else {
            solve_panel::<true, WIDTH>(self.factor, self.panel);
        }
    }
}

#[inline(always)]
fn solve_panel<const FUSED: bool, const WIDTH: usize>(
    factor: &ShiftedFactor,
    panel: &mut [[f64; WIDTH]],
) {
    for supernode in &factor.supernodes {
        forward::<FUSED, WIDTH>(factor, supernode, panel);
    }
    for supernode in factor.supernodes.iter().rev() {
        backward::<FUSED, WIDTH>(factor, supernode, panel);
    }
}

/// `L y = x` for the columns of one supernode.
#[inline(always)]
fn forward<const FUSED: bool, const WIDTH: usize>(
    factor: &ShiftedFactor,
    node: &Supernode,
    panel: &mut [[f64; WIDTH]],
) {
    let below = node.first_column + node.n_columns;
    let (own, rest) = panel.split_at_mut(below);
    let own = &mut own[node.first_column..];
    let (mut triangle, groups) = factor.split_values(node);
    for column in 0..own.len() {
        let pivot_line = own[column];
        let (values, next) = triangle.split_at(own.len() - column - 1);
        for (line, value) in own[column + 1..].iter_mut().zip(values) {
            subtract::<FUSED, WIDTH>(line, *value, &pivot_line);
        }
        triangle = next;
    }
    for (rows, values) in factor.groups(node).iter().zip(groups.chunks_exact(GROUP * own.len())) {
        let mut sums = [[0.0; WIDTH]; GROUP];
        for (line, values) in own.iter().zip(values.chunks_exact(GROUP)) {
            for it in 0..GROUP {
                subtract::<FUSED, WIDTH>(&mut sums[it], values[it], line);
            }
        }
        for it in 0..GROUP {
            let line = &mut rest[rows[it] as usize - below];
            for lane in 0..WIDTH {
                line[lane] += sums[it][lane];
            }
        }
    }
}

/// `D L^T x = y` for the columns of one supernode.
#[inline(always)]
fn backward<const FUSED: bool, const WIDTH: usize>(
    factor: &ShiftedFactor,
    node: &Supernode,
    panel: &mut [[f64; WIDTH]],
) {
    let below = node.first_column + node.n_columns;
    let (own, rest) = panel.split_at_mut(below);
    let own = &mut own[node.first_column..];
    let (triangle, groups) = factor.split_values(node);
    for (line, inverse_pivot) in own.iter_mut().zip(&factor.inverse_pivots[node.first_column..]) {
        for value in line.iter_mut() {
            *value *= inverse_pivot;
        }
    }
    for (rows, values) in factor.groups(node).iter().zip(groups.chunks_exact(GROUP * own.len())) {
        let lines = rows.map(|row| rest[row as usize - below]);
        for (line, values) in own.iter_mut().zip(values.chunks_exact(GROUP)) {
            for it in 0..GROUP {
                subtract::<FUSED, WIDTH>(line, values[it], &lines[it]);
            }
        }
    }
    let mut rest_of_triangle = triangle;
    for column in (0..own.len()).rev() {
        let n_values = own.len() - column - 1;
        let (before, values) = rest_of_triangle.split_at(rest_of_triangle.len() - n_values);
        let mut line = own[column];
        for (other, value) in own[column + 1..].iter().zip(values) {
            subtract::<FUSED, WIDTH>(&mut line, *value, other);
        }
        own[column] = line;
        rest_of_triangle = before;
    }
}

/// `target -= factor * line`.
#[inline(always)]
fn subtract<const FUSED: bool, const WIDTH: usize>(
    target: &mut [f64; WIDTH],
    factor: f64,
    line: &[f64; WIDTH],
) {
    for lane in 0..WIDTH {
        target[lane] = if FUSED {
            (-factor).mul_add(line[lane], target[lane])
        } else {
            target[lane] - factor * line[lane]
        };
    }
}

impl ShiftedFactor {
    /// The values of a supernode's triangle and of its groups.
    #[inline(always)]
    fn split_values(&self, node: &Supernode) -> (&[f64], &[f64]) {
        let n_triangle = node.n_columns * (node.n_columns - 1) / 2;
        let n_below = node.n_groups * GROUP * node.n_columns;
        self.values[node.values_begin..][..n_triangle + n_below].split_at(n_triangle)
    }

    /// The rows below a supernode's diagonal block.
    #[inline(always)]
    fn groups(&self, node: &Supernode) -> &[[u32; GROUP]] {
        &self.rows[node.rows_begin..][..node.n_groups]
    }
}
