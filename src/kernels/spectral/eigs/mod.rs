//! The smallest eigenpairs of the Laplacian.

mod dense;
mod factor;
mod lanczos;
mod shift_invert;
mod standard;
#[cfg(test)]
mod tests;

use super::basis::Basis;
use super::operator::Operator;
use crate::kernels::numerics::tall;
use faer::Mat;
use faer::reborrow::{Reborrow, ReborrowMut};
use rayon::prelude::*;

/// What to do with an operator whose graph has several components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Disconnected {
    /// Refuse it.
    #[default]
    Refuse,
    /// Compute the eigenpairs of all components and merge them: one zero for each.
    Merge,
}

/// Options of [`eigs`].
#[derive(Debug, Clone, PartialEq)]
pub struct EigsOptions {
    /// The number of eigenpairs, the constant function included.
    pub k: usize,
    pub disconnected: Disconnected,
    /// The largest accepted residual `|L phi - lambda M phi| / |M phi|` in parts of the largest
    /// eigenvalue; more, up to 1e-6, where weights are so uneven that rounding alone makes more.
    pub tolerance: f64,
}

impl Default for EigsOptions {
    fn default() -> Self {
        Self { k: 120, disconnected: Disconnected::Refuse, tolerance: 1e-9 }
    }
}

/// What was needed for a basis and how good it is.
#[derive(Debug, Clone, PartialEq)]
pub struct EigsStats {
    /// Whether the dense solver was used.
    pub dense: bool,
    /// The number of solves with one right-hand side.
    pub n_solves: usize,
    /// The largest `|L phi - lambda M phi| / (lambda_k |M phi|)`.
    pub residual: f64,
    /// The largest entry of `|Phi^T M Phi - I|`.
    pub orthogonality: f64,
    /// The number of connected components of the operator's graph, without pinned vertices.
    pub n_components: usize,
}

/// Why there are no eigenpairs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EigsError {
    #[error("the number of eigenpairs is zero")]
    NoPairs,
    #[error("{k} eigenpairs are wanted of an operator with {n_vertices} vertices")]
    TooMany { k: usize, n_vertices: usize },
    #[error(
        "the stiffness is {n_rows} x {n_cols}, but there are {n_masses} masses: \
         both belong to the same vertices"
    )]
    Shape { n_rows: usize, n_cols: usize, n_masses: usize },
    #[error("the stiffness has the value {value} in row {row}, column {column}")]
    StiffnessNotFinite { row: usize, column: usize, value: f64 },
    #[error("vertex {vertex} has the mass {mass}, which is not positive and finite")]
    MassNotPositive { vertex: usize, mass: f64 },
    #[error(
        "the operator has {n_components} connected components (of {sizes} vertices), \
         each of which has an eigenvalue zero of its own"
    )]
    Disconnected { n_components: usize, sizes: String },
    #[error(
        "the operator is not positive semi-definite: its {n_vertices} x {n_vertices} stiffness plus \
         {:e} times the mass has the pivot {pivot:e}", -.shift
    )]
    NotPositive { n_vertices: usize, shift: f64, pivot: f64 },
    #[error(
        "the operator is not positive semi-definite: its smallest eigenvalue is {smallest:e}, \
         the largest of the {k} wanted is {largest:e}"
    )]
    Negative { smallest: f64, largest: f64, k: usize },
    #[error("a matrix of {n_vertices} vertices is too large to be factored")]
    TooLarge { n_vertices: usize },
    #[error("{k} eigenpairs of {n_vertices} vertices did not converge")]
    NotConverged { k: usize, n_vertices: usize },
    #[error(
        "the eigenpairs are inaccurate: the residual is {residual:e} of the largest eigenvalue, \
         the tolerance {tolerance:e}; orthogonality is off by {orthogonality:e}"
    )]
    Inaccurate { residual: f64, tolerance: f64, orthogonality: f64 },
}

/// A part of the work, for those who measure it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Fill-reducing order and the pattern of the factors.
    Ordering,
    Factorization,
    Solves,
    Orthogonalization,
    /// The projected eigenproblems.
    SmallEigenproblems,
    /// Eigenvectors from the Krylov spaces.
    RitzVectors,
    /// Residuals and inner products of the result.
    Verification,
}

/// Is told when a phase begins (on the thread that works on it): time and memory are for others to
/// measure, a kernel reads no clock.
pub trait Observer: Sync {
    fn enter(&self, phase: Phase);
}

/// Watches nothing.
struct Nobody;

impl Observer for Nobody {
    fn enter(&self, _: Phase) {}
}

/// Below this number of vertices a component is solved densely.
const DENSE: usize = 300;
/// No operator is so badly scaled that a larger residual would be accepted for it.
const ATTAINABLE: f64 = 1e-6;
/// The largest accepted entry of `|Phi^T M Phi - I|`.
const ORTHOGONALITY: f64 = 1e-9;

/// Eigenpairs before they are checked: in the operator's units, by vertex.
struct Pairs {
    eigenvalues: Vec<f64>,
    eigenvectors: Mat<f64>,
    n_solves: usize,
}

/// Computes the `k` smallest eigenpairs of `L phi = lambda M phi`.
///
/// Block Lanczos on `(L + s M)^-1` for a small `s`, with a sparse Cholesky factor; small operators
/// and large shares of the spectrum go to a dense solver. See `docs/eigs.md` for what was measured
/// and what lost.
///
/// Eigenvectors are `V x k`, orthonormal with respect to the masses, with their largest entry
/// positive (ties by index); vectors inside a multiple eigenvalue stay arbitrary. The first
/// eigenvalue (the first of every component) is exactly zero if constants are in the kernel. Vertices
/// without neighbours that have a positive diagonal are no components: functions are zero there. The
/// result has the same bytes at any number of threads.
///
/// # Errors
/// See [`EigsError`]; residual and orthogonality are checked at the end.
pub fn eigs(operator: &Operator, options: &EigsOptions) -> Result<(Basis, EigsStats), EigsError> {
    eigs_observed(operator, options, &Nobody)
}

/// [`eigs`] with somebody who is told what is being done.
///
/// # Errors
/// Those of [`eigs`].
pub fn eigs_observed(
    operator: &Operator,
    options: &EigsOptions,
    observer: &dyn Observer,
) -> Result<(Basis, EigsStats), EigsError> {
    check(operator, options.k)?;
    let k = options.k;
    let (components, n_pinned) = free_components(operator);
    let n_free = operator.mass.len() - n_pinned;
    if k > n_free {
        return Err(EigsError::TooMany { k, n_vertices: n_free });
    }
    if components.len() > 1 && options.disconnected == Disconnected::Refuse {
        return Err(disconnected(&components));
    }
    let (mut pairs, dense) = match components.len() {
        1 if n_pinned == 0 => solve_connected(operator, k, observer)?,
        _ => merged(operator, &components, k, observer)?,
    };
    let largest = pairs.eigenvalues[k - 1];
    if pairs.eigenvalues[0] < -1e-9 * largest.abs() {
        let smallest = pairs.eigenvalues[0];
        return Err(EigsError::Negative { smallest, largest, k });
    }
    for eigenvalue in &mut pairs.eigenvalues {
        if *eigenvalue < 1e-11 * largest {
            *eigenvalue = 0.0;
        }
    }
    let Pairs { eigenvalues, mut eigenvectors, n_solves } = pairs;
    observer.enter(Phase::Verification);
    make_signs_canonical(&mut eigenvectors);
    let basis = Basis { eigenvalues, eigenvectors, mass: operator.mass.clone() };
    let stats = EigsStats {
        dense,
        n_solves,
        residual: largest_residual(operator, &basis),
        orthogonality: orthogonality(&basis),
        n_components: components.len(),
    };
    let tolerance = options.tolerance.max(attainable_residual(operator, largest));
    // Not `>`, which would let pass what is not a number.
    if !(stats.residual <= tolerance && stats.orthogonality <= ORTHOGONALITY) {
        return Err(EigsError::Inaccurate {
            residual: stats.residual,
            tolerance,
            orthogonality: stats.orthogonality,
        });
    }
    Ok((basis, stats))
}

fn check(operator: &Operator, k: usize) -> Result<(), EigsError> {
    let (stiffness, mass) = (&operator.stiffness, &operator.mass);
    let n_vertices = mass.len();
    if stiffness.n_rows != n_vertices || stiffness.n_cols != n_vertices {
        let (n_rows, n_cols) = (stiffness.n_rows, stiffness.n_cols);
        return Err(EigsError::Shape { n_rows, n_cols, n_masses: n_vertices });
    }
    if k == 0 {
        return Err(EigsError::NoPairs);
    }
    if k > n_vertices {
        return Err(EigsError::TooMany { k, n_vertices });
    }
    if let Some(place) = stiffness.values.iter().position(|it| !it.is_finite()) {
        let row = stiffness.offsets.partition_point(|&it| it <= place) - 1;
        let (column, value) = (stiffness.columns[place] as usize, stiffness.values[place]);
        return Err(EigsError::StiffnessNotFinite { row, column, value });
    }
    let is_good = |mass: f64| mass.is_finite() && mass > 0.0;
    match mass.iter().position(|&it| !is_good(it)) {
        Some(vertex) => Err(EigsError::MassNotPositive { vertex, mass: mass[vertex] }),
        None => Ok(()),
    }
}

fn solve_connected(
    operator: &Operator,
    k: usize,
    observer: &dyn Observer,
) -> Result<(Pairs, bool), EigsError> {
    let n_vertices = operator.mass.len();
    // The Krylov space becomes two or three times as large as the number of pairs.
    if n_vertices <= DENSE || 4 * k > n_vertices {
        observer.enter(Phase::SmallEigenproblems);
        return Ok((dense::solve(operator, k)?, true));
    }
    Ok((shift_invert::solve(operator, k, observer)?, false))
}

/// The components without the pinned vertices, and the number of those.
///
/// A vertex is pinned if it has no neighbours but a positive diagonal: its own eigenvalue is not zero,
/// and all other eigenfunctions are zero there.
fn free_components(operator: &Operator) -> (Vec<Vec<usize>>, usize) {
    let mut components = components(operator);
    let n_components = components.len();
    components.retain(|members| match members[..] {
        [only] => operator.stiffness.row(only).all(|(_, value)| value <= 0.0),
        _ => true,
    });
    let n_pinned = n_components - components.len();
    (components, n_pinned)
}

/// The vertices of every connected component, ascending, the component of vertex 0 first.
fn components(operator: &Operator) -> Vec<Vec<usize>> {
    let n_vertices = operator.mass.len();
    let mut seen = vec![false; n_vertices];
    let mut res = vec![];
    for start in 0..n_vertices {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut members = vec![start];
        let mut next = 0;
        while next < members.len() {
            for (other, value) in operator.stiffness.row(members[next]) {
                if value != 0.0 && !seen[other] {
                    seen[other] = true;
                    members.push(other);
                }
            }
            next += 1;
        }
        members.sort_unstable();
        res.push(members);
    }
    res
}

fn disconnected(components: &[Vec<usize>]) -> EigsError {
    let mut sizes: Vec<usize> = components.iter().map(Vec::len).collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    let named: Vec<String> = sizes.iter().take(5).map(usize::to_string).collect();
    let more = if sizes.len() > named.len() { ", ..." } else { "" };
    EigsError::Disconnected {
        n_components: components.len(),
        sizes: format!("{}{more}", named.join(", ")),
    }
}

/// Solves every component by itself and keeps the `k` smallest of all pairs.
fn merged(
    operator: &Operator,
    components: &[Vec<usize>],
    k: usize,
    observer: &dyn Observer,
) -> Result<(Pairs, bool), EigsError> {
    let mut solved = Vec::with_capacity(components.len());
    let mut dense = true;
    for members in components {
        let part = restricted(operator, members);
        let (pairs, is_dense) = solve_connected(&part, k.min(members.len()), observer)?;
        dense &= is_dense;
        solved.push(pairs);
    }
    let mut places: Vec<(usize, usize)> = solved
        .iter()
        .enumerate()
        .flat_map(|(component, pairs)| (0..pairs.eigenvalues.len()).map(move |it| (component, it)))
        .collect();
    // Zeros differ by rounding: those of the first components come first nevertheless.
    let value = |&(component, it): &(usize, usize)| solved[component].eigenvalues[it].max(0.0);
    places.sort_by(|a, b| value(a).total_cmp(&value(b)));
    places.truncate(k);
    let mut eigenvectors = Mat::zeros(operator.mass.len(), k);
    for (col, &(component, it)) in places.iter().enumerate() {
        for (row, &vertex) in components[component].iter().enumerate() {
            eigenvectors[(vertex, col)] = solved[component].eigenvectors[(row, it)];
        }
    }
    let eigenvalues = places.iter().map(|it| solved[it.0].eigenvalues[it.1]).collect();
    let n_solves = solved.iter().map(|it| it.n_solves).sum();
    Ok((Pairs { eigenvalues, eigenvectors, n_solves }, dense))
}

/// The operator of one component.
fn restricted(operator: &Operator, members: &[usize]) -> Operator {
    let mut new_index = vec![u32::MAX; operator.mass.len()];
    for (index, &vertex) in members.iter().enumerate() {
        new_index[vertex] = index as u32;
    }
    let triplets: Vec<(u32, u32, f64)> = members
        .iter()
        .flat_map(|&row| operator.stiffness.row(row).map(move |(col, value)| (row, col, value)))
        .filter(|&(_, col, _)| new_index[col] != u32::MAX)
        .map(|(row, col, value)| (new_index[row], new_index[col], value))
        .collect();
    let n = members.len();
    Operator {
        stiffness: crate::kernels::numerics::sparse::CsrMatrix::from_triplets(n, n, &triplets),
        mass: members.iter().map(|&it| operator.mass[it]).collect(),
    }
}

/// Entries that differ from the largest by less than this part of it count as equal to it: on a
/// symmetric shape they do so up to rounding, which must not choose the sign.
const SIGN_TIE: f64 = 1e-6;

/// Turns every vector so that its entry of largest magnitude is positive, the first of equals.
fn make_signs_canonical(vectors: &mut Mat<f64>) {
    vectors.par_col_iter_mut().for_each(|mut column| {
        let largest = column.rb().norm_max();
        let leading = column.rb().iter().find(|it| it.abs() >= (1.0 - SIGN_TIE) * largest);
        if leading.is_some_and(|&it| it < 0.0) {
            column.rb_mut().iter_mut().for_each(|it| *it = -*it);
        }
    });
}

/// The largest `|L phi - lambda M phi| / (lambda_k |M phi|)`.
fn largest_residual(operator: &Operator, basis: &Basis) -> f64 {
    let largest = basis.eigenvalues[basis.k() - 1];
    let residuals: Vec<f64> = (0..basis.k().div_ceil(TOGETHER))
        .into_par_iter()
        .flat_map_iter(|group| {
            let first = group * TOGETHER;
            residuals(operator, basis, first).into_iter().take(basis.k() - first)
        })
        .collect();
    let worst = residuals.iter().fold(0.0, |max: f64, &it| if it <= max { max } else { it });
    // One pair alone is the constant, whose eigenvalue is no measure.
    if largest > 0.0 { worst / largest } else { worst * operator_scale(operator) }
}

/// What rounding alone makes of a residual, in parts of the largest eigenvalue: some tens of units in
/// the last place of the steepest diagonal entry. Far below any tolerance, but where nearly flat faces
/// or tied points have weights of many thousands.
fn attainable_residual(operator: &Operator, largest: f64) -> f64 {
    let (stiffness, mass) = (&operator.stiffness, &operator.mass);
    let diagonal = |row: usize| stiffness.row(row).find(|it| it.0 == row).map_or(0.0, |it| it.1);
    let steepest = (0..mass.len()).map(|row| diagonal(row) / mass[row]).fold(0.0, f64::max);
    if largest > 0.0 { (64.0 * f64::EPSILON * steepest / largest).min(ATTAINABLE) } else { 0.0 }
}

/// Vectors that are multiplied together: one look at a row of the stiffness serves all of them.
const TOGETHER: usize = 4;

/// `|L phi - lambda M phi| / |M phi|` of the pairs from `first` on, the last repeated.
fn residuals(operator: &Operator, basis: &Basis, first: usize) -> [f64; TOGETHER] {
    let columns: [usize; TOGETHER] = std::array::from_fn(|it| (first + it).min(basis.k() - 1));
    let vectors = columns.map(|it| basis.eigenvectors.col(it));
    let lines: Vec<[f64; TOGETHER]> =
        (0..basis.n_vertices()).map(|row| vectors.map(|it| it[row])).collect();
    let (mut error, mut size) = ([0.0; TOGETHER], [0.0; TOGETHER]);
    for (row, line) in lines.iter().enumerate() {
        let mut image = [0.0; TOGETHER];
        for (col, value) in operator.stiffness.row(row) {
            for lane in 0..TOGETHER {
                image[lane] += value * lines[col][lane];
            }
        }
        for lane in 0..TOGETHER {
            let weighted = operator.mass[row] * line[lane];
            error[lane] += (image[lane] - basis.eigenvalues[columns[lane]] * weighted).powi(2);
            size[lane] += weighted * weighted;
        }
    }
    std::array::from_fn(|lane| f64::sqrt(error[lane] / size[lane]))
}

/// The area over the mean diagonal of the stiffness: makes a residual free of units.
fn operator_scale(operator: &Operator) -> f64 {
    let area: f64 = operator.mass.iter().sum();
    let n_vertices = operator.mass.len() as f64;
    let size: f64 = operator.stiffness.values.iter().map(|it| it.abs()).sum();
    if size > 0.0 { area / (size * n_vertices) } else { 1.0 }
}

/// The largest entry of `|Phi^T M Phi - I|`.
fn orthogonality(basis: &Basis) -> f64 {
    let vectors = basis.eigenvectors.as_ref();
    let gram = tall::mass_products(vectors, &basis.mass, vectors);
    let mut worst = 0.0f64;
    for row in 0..basis.k() {
        for col in 0..basis.k() {
            let error = (gram[(row, col)] - f64::from(u8::from(row == col))).abs();
            worst = if error <= worst { worst } else { error };
        }
    }
    worst
}
