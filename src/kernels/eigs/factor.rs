//! Factors of the shifted matrix, and solves with blocks of right-hand sides.

use super::standard::StandardForm;
use crate::kernels::random::Random;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::supernodal::{
    SupernodalLdltRef, factorize_supernodal_numeric_ldlt,
    factorize_supernodal_numeric_ldlt_scratch,
};
use faer::reborrow::ReborrowMut;
use faer::{MatMut, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};

/// Right-hand sides of one solve: a row of a panel is a cache line.
pub(super) const PANEL: usize = 8;
/// Rows below the diagonal block that are worked on together, which reuses what is in registers.
const GROUP: usize = 4;

type Line = [f64; PANEL];

/// `L D L^T = B - shift` with unit lower triangular `L` by supernodes: runs of columns whose rows
/// below the diagonal block are the same.
///
/// `B - shift` is indefinite inside the spectrum. The factorization does not pivot, so its accuracy
/// is tested by a solve; the number of negative pivots is the number of eigenvalues below the shift
/// (Sylvester's law of inertia).
pub(super) struct ShiftedFactor {
    pub shift: f64,
    /// The number of eigenvalues below the shift.
    pub n_below: usize,
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
    /// Factors `B - shift`; `None` if the shift is too close to an eigenvalue (of a leading block)
    /// for the factors to be accurate.
    pub fn new(problem: &StandardForm, shift: f64) -> Option<Self> {
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
            .ok()?;
        let factor = Self::from_faer(SupernodalLdltRef::new(symbolic, &packed), problem, shift);
        factor.is_accurate(problem).then_some(factor)
    }

    /// Copies faer's factor into the order in which solves read it.
    fn from_faer(
        factor: SupernodalLdltRef<'_, u32, f64>,
        problem: &StandardForm,
        shift: f64,
    ) -> Self {
        let n = problem.n();
        let mut res = Self {
            shift,
            n_below: 0,
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
                let pivot = block[(column, column)];
                res.n_below += usize::from(pivot < 0.0);
                res.inverse_pivots.push(1.0 / pivot);
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

    /// Solves for a random right-hand side and looks at the residual.
    fn is_accurate(&self, problem: &StandardForm) -> bool {
        let mut random = Random::new(self.n as u64);
        let right = faer::Mat::from_fn(self.n, 1, |_, _| random.uniform() - 0.5);
        let mut solution = faer::Mat::zeros(self.n, 1);
        self.solve(right.as_ref(), solution.as_mut());
        let solution: Vec<f64> = solution.col(0).iter().copied().collect();
        let image = problem.mul_shifted(self.shift, &solution);
        let error: f64 = image.iter().zip(right.col(0).iter()).map(|(a, b)| (a - b).powi(2)).sum();
        // Not `error > ...`, which would let pass what is not a number.
        error.sqrt() <= 1e-8 * right.norm_l2()
    }

    pub fn n(&self) -> usize {
        self.n
    }

    /// `solution = (B - shift)^-1 right` for `n x p` right-hand sides, `p` at most [`PANEL`].
    pub fn solve(&self, right: MatRef<'_, f64>, mut solution: MatMut<'_, f64>) {
        assert!(right.ncols() <= PANEL, "right-hand sides fit into a panel");
        let mut panel = vec![[0.0; PANEL]; self.n + 1];
        for column in 0..right.ncols() {
            for (line, value) in panel.iter_mut().zip(right.col(column).iter()) {
                line[column] = *value;
            }
        }
        Arch::new().dispatch(Solve { factor: self, panel: &mut panel });
        for column in 0..right.ncols() {
            for (line, value) in panel.iter().zip(solution.rb_mut().col_mut(column).iter_mut()) {
                *value = line[column];
            }
        }
    }
}

/// Both triangular solves, compiled for every vector width that the processor may have.
struct Solve<'a> {
    factor: &'a ShiftedFactor,
    panel: &'a mut [Line],
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // Without vector instructions, a fused product is a slow function call.
        if S::IS_SCALAR {
            solve_panel::<false>(self.factor, self.panel);
        } else {
            solve_panel::<true>(self.factor, self.panel);
        }
    }
}

#[inline(always)]
fn solve_panel<const FUSED: bool>(factor: &ShiftedFactor, panel: &mut [Line]) {
    for supernode in &factor.supernodes {
        forward::<FUSED>(factor, supernode, panel);
    }
    for supernode in factor.supernodes.iter().rev() {
        backward::<FUSED>(factor, supernode, panel);
    }
}

/// `L y = x` for the columns of one supernode.
#[inline(always)]
fn forward<const FUSED: bool>(factor: &ShiftedFactor, node: &Supernode, panel: &mut [Line]) {
    let below = node.first_column + node.n_columns;
    let (own, rest) = panel.split_at_mut(below);
    let own = &mut own[node.first_column..];
    let (mut triangle, groups) = factor.split_values(node);
    for column in 0..own.len() {
        let pivot_line = own[column];
        let (values, next) = triangle.split_at(own.len() - column - 1);
        for (line, value) in own[column + 1..].iter_mut().zip(values) {
            subtract::<FUSED>(line, *value, &pivot_line);
        }
        triangle = next;
    }
    for (rows, values) in factor.groups(node).iter().zip(groups.chunks_exact(GROUP * own.len())) {
        let mut sums = [[0.0; PANEL]; GROUP];
        for (line, values) in own.iter().zip(values.chunks_exact(GROUP)) {
            for it in 0..GROUP {
                subtract::<FUSED>(&mut sums[it], values[it], line);
            }
        }
        for it in 0..GROUP {
            let line = &mut rest[rows[it] as usize - below];
            for lane in 0..PANEL {
                line[lane] += sums[it][lane];
            }
        }
    }
}

/// `D L^T x = y` for the columns of one supernode.
#[inline(always)]
fn backward<const FUSED: bool>(factor: &ShiftedFactor, node: &Supernode, panel: &mut [Line]) {
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
                subtract::<FUSED>(line, values[it], &lines[it]);
            }
        }
    }
    let mut rest_of_triangle = triangle;
    for column in (0..own.len()).rev() {
        let n_values = own.len() - column - 1;
        let (before, values) = rest_of_triangle.split_at(rest_of_triangle.len() - n_values);
        let mut line = own[column];
        for (other, value) in own[column + 1..].iter().zip(values) {
            subtract::<FUSED>(&mut line, *value, other);
        }
        own[column] = line;
        rest_of_triangle = before;
    }
}

/// `target -= factor * line`.
#[inline(always)]
fn subtract<const FUSED: bool>(target: &mut Line, factor: f64, line: &Line) {
    for lane in 0..PANEL {
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
