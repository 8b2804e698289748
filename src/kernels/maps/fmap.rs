//! Functional maps from descriptors.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use super::functional_map::FunctionalMap;
use crate::kernels::{
    numerics::{
        adam::{AdamOptions, minimize},
        cholesky::Cholesky,
        tall,
    },
    spectral::{basis::Basis, descriptors::Descriptors, function_space::FunctionSpace},
};

/// Weights of the energy that [`fit_functional_map`] minimizes.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Eigenfunctions of either shape.
    pub k: usize,
    /// `a`, of preserved descriptors.
    pub descriptors: f64,
    /// `b`, of commutativity with multiplication by descriptors.
    pub commutativity: f64,
    /// `c`, of commutativity with the Laplacians.
    pub laplacian: f64,
    /// Divides the squared gaps of the spectra by their sum, so that `laplacian` does not depend on
    /// `k`.
    pub normalized_gaps: bool,
    pub solver: Solver,
}

/// How the minimum is looked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Solver {
    /// By one factorization.
    Exact,
    /// By steps of Adam from zero, as the paper's demo does. They stop above the minimum.
    Adam(AdamOptions),
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            k: 20,
            descriptors: 0.1,
            commutativity: 1.0,
            laplacian: 1e-3,
            normalized_gaps: true,
            solver: Solver::Exact,
        }
    }
}

impl FitOptions {
    /// The paper's demo: no commutativity with multiplication, plain gaps, 1000 steps of Adam.
    pub fn demo() -> Self {
        Self {
            commutativity: 0.0,
            laplacian: 2e-8,
            normalized_gaps: false,
            solver: Solver::Adam(AdamOptions::default()),
            ..Self::default()
        }
    }
}

/// Why there is no functional map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    #[error("{k} eigenfunctions are wanted, but the {side} basis has {available}")]
    FewPairs { side: &'static str, k: usize, available: usize },
    #[error(
        "the {side} descriptors belong to {descriptors} vertices, but the {side} basis to {basis}"
    )]
    Vertices { side: &'static str, descriptors: usize, basis: usize },
    #[error(
        "the source has {source_count} descriptors and the target {target_count}: \
         use the same options and landmarks for both"
    )]
    Counts { source_count: usize, target_count: usize },
    #[error(
        "descriptor {index} is `{source_name}` on the source and `{target_name}` on the target: \
         both shapes need the same landmarks in the same order"
    )]
    Names { index: usize, source_name: String, target_name: String },
    #[error(
        "source and target are swapped: the {side} descriptors were computed on the shape of the \
         {other} basis"
    )]
    Swapped { side: &'static str, other: &'static str },
    #[error("the descriptors do not determine a map: the system is singular")]
    Singular,
    #[error("Adam ran away: the map has entries that are not finite, use smaller steps")]
    NotFinite,
}

/// Fits a functional map `C: F(N) -> F(M)` to corresponding descriptors.
///
/// With coefficients `F`, `G` (`k x p`) of the target's and the source's descriptors, the minimum of
///
/// `a/2 |C F - G|^2 + b/2 sum_i |C X_i - Y_i C|^2 + c/2 sum_jl D_jl C_jl^2`
///
/// (Nogneng & Ovsjanikov 2017), where `X_i = Psi^T A_N diag(f_i) Psi` and
/// `Y_i = Phi^T A_M diag(g_i) Phi` multiply by a descriptor, and `D_jl = (lambda_j - mu_l)^2`,
/// divided by its sum unless that is turned off, compares the spectra. Constants are carried to constants: the first column is
/// fixed. The energy is quadratic in the entries of `C`, so one Cholesky factorization of a
/// `k (k - 1)` system finds the minimum, unless the options ask for steps of Adam.
///
/// Coordinates are those of both shapes at total area one: `C` is the same whatever their scale, and
/// its first column is plus or minus the first unit vector.
///
/// # Errors
/// See [`FitError`].
pub fn fit_functional_map(
    source: (&Basis, &Descriptors),
    target: (&Basis, &Descriptors),
    options: &FitOptions,
) -> Result<FunctionalMap, FitError> {
    fit_rectangular_map(source, target, [options.k, options.k], options)
}

/// As [`fit_functional_map`], with other numbers of eigenfunctions on the source and the target.
///
/// # Errors
/// See [`FitError`].
pub fn fit_rectangular_map(
    source: (&Basis, &Descriptors),
    target: (&Basis, &Descriptors),
    [k_source, k_target]: [usize; 2],
    options: &FitOptions,
) -> Result<FunctionalMap, FitError> {
    check("source", source, k_source)?;
    check("target", target, k_target)?;
    check_names(&source.1.names, &target.1.names)?;
    check_not_swapped(["source", "target"], source, target.0)?;
    check_not_swapped(["target", "source"], target, source.0)?;
    let kept: Vec<usize> = (0..source.1.count())
        .filter(|&it| !vanishes(source.1, it) && !vanishes(target.1, it))
        .collect();
    let energy = Energy::new(
        &Side::new(source, &kept, k_source),
        &Side::new(target, &kept, k_target),
        options,
    );
    let map = match &options.solver {
        Solver::Exact => energy.minimum().ok_or(FitError::Singular)?,
        Solver::Adam(adam) => energy.descended(adam).ok_or(FitError::NotFinite)?,
    };
    Ok(FunctionalMap::new(source.0, target.0, map))
}

/// Descriptors may come from another basis of the same shape, but not from the other shape.
fn check_not_swapped(
    [side, other]: [&'static str; 2],
    (basis, descriptors): (&Basis, &Descriptors),
    other_basis: &Basis,
) -> Result<(), FitError> {
    let Some(space) = descriptors.space else { return Ok(()) };
    let [own, opposite] = [basis, other_basis].map(|it| FunctionSpace::of(it).shape);
    match space.shape != own && space.shape == opposite {
        true => Err(FitError::Swapped { side, other }),
        false => Ok(()),
    }
}

fn check(side: &'static str, shape: (&Basis, &Descriptors), k: usize) -> Result<(), FitError> {
    let (basis, descriptors) = shape;
    if k == 0 || basis.k() < k {
        return Err(FitError::FewPairs { side, k, available: basis.k() });
    }
    if descriptors.n_vertices() != basis.n_vertices() {
        let (descriptors, basis) = (descriptors.n_vertices(), basis.n_vertices());
        return Err(FitError::Vertices { side, descriptors, basis });
    }
    Ok(())
}

fn check_names(source: &[String], target: &[String]) -> Result<(), FitError> {
    if source.len() != target.len() {
        return Err(FitError::Counts { source_count: source.len(), target_count: target.len() });
    }
    match source.iter().zip(target).position(|(a, b)| a != b) {
        Some(index) => Err(FitError::Names {
            index,
            source_name: source[index].clone(),
            target_name: target[index].clone(),
        }),
        None => Ok(()),
    }
}

fn vanishes(descriptors: &Descriptors, column: usize) -> bool {
    descriptors.values.col_as_slice(column).iter().all(|&it| it == 0.0)
}

/// One shape as the energy sees it, at total area one.
struct Side {
    /// `k` eigenvalues.
    eigenvalues: Vec<f64>,
    /// The sign of the constant eigenfunction.
    sign: f64,
    /// `k x p` coefficients of the descriptors.
    coefficients: Mat<f64>,
    /// `k^2 x p`: by columns the `k x k` matrices that multiply by a descriptor, row by row.
    multiplications: Mat<f64>,
}

impl Side {
    fn new((basis, descriptors): (&Basis, &Descriptors), kept: &[usize], k: usize) -> Self {
        let area = basis.area();
        let values = Mat::from_fn(descriptors.n_vertices(), kept.len(), |row, column| {
            descriptors.values[(row, kept[column])]
        });
        let vectors = basis.truncated(k);
        // At total area one, masses are divided by the area and eigenfunctions multiplied by its
        // root: a product with one eigenfunction keeps 1 / sqrt(area), one with two keeps nothing.
        let coefficients = tall::mass_products(vectors, &basis.mass, values.as_ref())
            * faer::Scale(1.0 / area.sqrt());
        Self {
            eigenvalues: basis.eigenvalues[..k].iter().map(|it| it * area).collect(),
            sign: basis.eigenvectors[(0, 0)].signum(),
            coefficients,
            multiplications: multiplications(vectors, &basis.mass, values.as_ref()),
        }
    }
}

/// `Phi^T A diag(f) Phi` for all functions at once, from the products of pairs of eigenfunctions.
fn multiplications(vectors: MatRef<'_, f64>, mass: &[f64], values: MatRef<'_, f64>) -> Mat<f64> {
    let k = vectors.ncols();
    let pairs: Vec<(usize, usize)> = (0..k).flat_map(|i| (i..k).map(move |j| (i, j))).collect();
    // By chunks of rows, whose products with each other stay in the cache.
    let n_chunks = vectors.nrows().div_ceil(tall::CHUNK);
    let parts: Vec<Mat<f64>> = (0..n_chunks)
        .into_par_iter()
        .map(|chunk| {
            let first = chunk * tall::CHUNK;
            let height = tall::CHUNK.min(vectors.nrows() - first);
            let (vectors, values) = (vectors.subrows(first, height), values.subrows(first, height));
            let mut products = Mat::zeros(height, pairs.len());
            for (column, &(i, j)) in pairs.iter().enumerate() {
                let factors = vectors.col(i).iter().zip(vectors.col(j).iter());
                for (slot, (a, b)) in products.col_as_slice_mut(column).iter_mut().zip(factors) {
                    *slot = a * b;
                }
            }
            tall::mass_products(products.as_ref(), &mass[first..first + height], values)
        })
        .collect();
    let mut half = Mat::zeros(pairs.len(), values.ncols());
    for part in &parts {
        half += part;
    }
    let mut res = Mat::zeros(k * k, values.ncols());
    for (from, &(i, j)) in pairs.iter().enumerate() {
        res.row_mut(i * k + j).copy_from(half.row(from));
        res.row_mut(j * k + i).copy_from(half.row(from));
    }
    res
}

/// The energy `1/2 x^T H x - r^T x + const` of the entries `x` of `C`, row by row.
struct Energy {
    /// Rows and columns of `C`: `k_source` and `k_target`.
    shape: [usize; 2],
    /// Symmetric, a row for every entry.
    hessian: Mat<f64>,
    linear: Vec<f64>,
    /// The first entry of the first column of `C`; the others are zero.
    constant: f64,
}

impl Energy {
    fn new(source: &Side, target: &Side, options: &FitOptions) -> Self {
        let shape = [source.eigenvalues.len(), target.eigenvalues.len()];
        let [n, m] = shape;
        let (f, g) = (&target.coefficients, &source.coefficients);
        let gram = f * f.transpose();
        let mixed = g * f.transpose();
        let (x, y) = (&target.multiplications, &source.multiplications);
        // sum_i |C X_i - Y_i C|^2 = tr(C (sum X_i X_i) C^T) + tr(C^T (sum Y_i Y_i) C)
        //                           - 2 sum_i tr(C X_i C^T Y_i), for the matrices are symmetric.
        let (x_squared, y_squared) = (sum_of_squares(x, m), sum_of_squares(y, n));
        let crossed = y * x.transpose();
        let mut gaps = spectral_gaps(&source.eigenvalues, &target.eigenvalues);
        if options.normalized_gaps {
            gaps = normalized(gaps);
        }
        let (a, b, c) = (options.descriptors, options.commutativity, options.laplacian);
        let hessian = Mat::from_fn(n * m, n * m, |row, column| {
            let ((i, j), (p, q)) = ((row / m, row % m), (column / m, column % m));
            let mut value = -2.0 * b * crossed[(i * n + p, j * m + q)];
            if i == p {
                value += a * gram[(j, q)] + b * x_squared[(j, q)];
            }
            if j == q {
                value += b * y_squared[(i, p)];
            }
            if row == column {
                value += c * gaps[(i, j)];
            }
            value
        });
        let linear = (0..n * m).map(|it| a * mixed[(it / m, it % m)]).collect();
        Self { shape, hessian, linear, constant: source.sign * target.sign }
    }

    /// The gradient `H x - r` at a map.
    fn gradient(&self, map: &Mat<f64>) -> Mat<f64> {
        let [n, m] = self.shape;
        let x = Mat::from_fn(n * m, 1, |row, _| map[(row / m, row % m)]);
        let product = tall::product(self.hessian.as_ref(), x.as_ref());
        Mat::from_fn(n, m, |i, j| product[(i * m + j, 0)] - self.linear[i * m + j])
    }

    /// The energy of a map, less the constant, and its gradient.
    fn value_and_gradient(&self, map: &Mat<f64>) -> (f64, Mat<f64>) {
        let ([n, m], gradient) = (self.shape, self.gradient(map));
        let half = |it: usize| {
            let at = (it / m, it % m);
            0.5 * map[at] * (gradient[at] - self.linear[it])
        };
        ((0..n * m).map(half).sum(), gradient)
    }

    /// Where Adam ends from zero, the first column kept; nothing if it does not stay finite.
    fn descended(&self, options: &AdamOptions) -> Option<Mat<f64>> {
        let [n, m] = self.shape;
        let mut entries = vec![0.0; n * m];
        entries[0] = self.constant;
        minimize(&mut entries, options, |entries, slopes| {
            let map = Mat::from_fn(n, m, |i, j| entries[i * m + j]);
            let (value, gradient) = self.value_and_gradient(&map);
            for (it, slope) in slopes.iter_mut().enumerate().filter(|it| it.0 % m != 0) {
                *slope = gradient[(it / m, it % m)];
            }
            value
        });
        let map = Mat::from_fn(n, m, |i, j| entries[i * m + j]);
        map.is_all_finite().then_some(map)
    }

    /// The minimum over all entries but the first column.
    fn minimum(&self) -> Option<Mat<f64>> {
        let [n, m] = self.shape;
        let free: Vec<usize> = (0..n * m).filter(|it| it % m != 0).collect();
        let mut map = Mat::zeros(n, m);
        map[(0, 0)] = self.constant;
        if free.is_empty() {
            return Some(map);
        }
        let system = Mat::from_fn(free.len(), free.len(), |i, j| self.hessian[(free[i], free[j])]);
        let factor = Cholesky::new(system.as_ref())?;
        // The second step removes the rounding errors of the first.
        for _ in 0..2 {
            let gradient = self.gradient(&map);
            let right = Mat::from_fn(free.len(), 1, |i, _| gradient[(free[i] / m, free[i] % m)]);
            let step = factor.solve(right.as_ref());
            for (i, &entry) in free.iter().enumerate() {
                map[(entry / m, entry % m)] -= step[(i, 0)];
            }
        }
        Some(map)
    }
}

/// `sum_i X_i X_i` for symmetric matrices stored by columns of `k^2` entries.
fn sum_of_squares(matrices: &Mat<f64>, k: usize) -> Mat<f64> {
    // Entry (j, q) is the sum over i and m of X_i[j, m] X_i[q, m].
    Mat::from_fn(k, k, |j, q| {
        (0..matrices.ncols())
            .map(|i| {
                let matrix = matrices.col_as_slice(i);
                let (row_j, row_q) = (&matrix[j * k..(j + 1) * k], &matrix[q * k..(q + 1) * k]);
                row_j.iter().zip(row_q).map(|(a, b)| a * b).sum::<f64>()
            })
            .sum()
    })
}

/// `(lambda_j - mu_l)^2` for source and target eigenvalues.
fn spectral_gaps(source: &[f64], target: &[f64]) -> Mat<f64> {
    let gap = |j: usize, l: usize| (source[j] - target[l]).powi(2);
    Mat::from_fn(source.len(), target.len(), gap)
}

/// Divided by the sum of all entries.
fn normalized(gaps: Mat<f64>) -> Mat<f64> {
    let sum: f64 = (0..gaps.ncols()).map(|l| gaps.col_as_slice(l).iter().sum::<f64>()).sum();
    // A single eigenvalue, zero on both sides, has no gap at all.
    gaps * faer::Scale(1.0 / sum.max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::test_shapes::{LANDMARKS, basis_of, creature, described, permuted};

    /// Test 12 of the specification: the minimum has no gradient, and Adam ends above it.
    #[test]
    fn the_exact_minimum_has_no_gradient_and_beats_adam() {
        let options = FitOptions { k: 10, ..FitOptions::default() };
        let (source, target) = (basis_of(&creature(0.0), 30), basis_of(&creature(0.3), 30));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let map = fit_functional_map((&source, &g), (&target, &f), &options).unwrap();
        let kept: Vec<usize> = (0..g.count()).collect();
        let energy = Energy::new(
            &Side::new((&source, &g), &kept, 10),
            &Side::new((&target, &f), &kept, 10),
            &options,
        );
        let map = map.source_from_target;
        let gradient = energy.gradient(&map);
        assert!(gradient.subcols(1, 9).norm_max() < 1e-9, "{gradient:?}");
        let value = |map: &Mat<f64>| energy.value_and_gradient(map).0;
        for n_steps in [300, 1000] {
            let adam = AdamOptions { n_steps, ..AdamOptions::default() };
            let other = energy.descended(&adam).unwrap();
            assert!(value(&map) < value(&other), "{n_steps} steps");
        }
    }

    /// The demo's energy has the same minimum, which its steps come near to.
    #[test]
    fn the_demo_ends_near_the_minimum_of_its_energy() {
        let (source, target) = (basis_of(&creature(0.0), 30), basis_of(&creature(0.3), 30));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let demo = FitOptions { k: 10, ..FitOptions::demo() };
        let exact = FitOptions { solver: Solver::Exact, ..demo.clone() };
        let fit = |options| fit_functional_map((&source, &g), (&target, &f), options).unwrap();
        let (found, minimum) = (fit(&demo).source_from_target, fit(&exact).source_from_target);
        let kept: Vec<usize> = (0..g.count()).collect();
        let side = |shape| Side::new(shape, &kept, 10);
        let energy = Energy::new(&side((&source, &g)), &side((&target, &f)), &demo);
        let value = |map: &Mat<f64>| energy.value_and_gradient(map).0;
        let (above, least, zero) = (value(&found), value(&minimum), value(&Mat::zeros(10, 10)));
        let depth = zero - least;
        assert!(above - least > -1e-14 * depth && above - least < 1e-3 * depth, "{least} {above}");
        // The gaps are those of the spectra, undivided.
        let [lambda, mu] = [&source, &target].map(|it| it.eigenvalues[3] * it.area());
        let extra = energy.hessian[(33, 33)]
            - Energy::new(
                &side((&source, &g)),
                &side((&target, &f)),
                &FitOptions { laplacian: 0.0, ..demo.clone() },
            )
            .hessian[(33, 33)];
        let expected = 2e-8 * (lambda - mu).powi(2);
        assert!((extra - expected).abs() < 1e-6 * expected + 1e-15, "{extra} {expected}");
    }

    #[test]
    fn swapped_bases_are_refused_though_the_sizes_agree() {
        let (source, target) = (basis_of(&creature(0.0), 30), basis_of(&creature(0.3), 30));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let options = FitOptions { k: 10, ..FitOptions::default() };
        let error = fit_functional_map((&target, &g), (&source, &f), &options).unwrap_err();
        assert_eq!(
            error.to_string(),
            "source and target are swapped: the source descriptors were computed on the shape of \
             the target basis"
        );
        // Descriptors of another basis of the same shape are welcome.
        let more = described(&basis_of(&creature(0.3), 40), &LANDMARKS);
        fit_functional_map((&source, &g), (&target, &more), &options).unwrap();
    }

    /// The energy by its definition, without the assembled system.
    #[test]
    fn the_assembled_gradient_is_that_of_the_definition() {
        let k = 6;
        let options = FitOptions { k, laplacian: 0.7, ..FitOptions::default() };
        let (source, target) = (basis_of(&creature(0.0), 20), basis_of(&creature(0.3), 20));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let kept: Vec<usize> = (0..g.count()).collect();
        let (m, n) = (Side::new((&source, &g), &kept, k), Side::new((&target, &f), &kept, k));
        let energy = Energy::new(&m, &n, &options);
        let map = Mat::from_fn(k, k, |i, j| ((i * 5 + j * 3) % 7) as f64 / 7.0 - 0.4);
        let unpack = |side: &Side, i: usize| {
            Mat::from_fn(k, k, |row, column| side.multiplications[(row * k + column, i)])
        };
        let mut expected = (&map * &n.coefficients - &m.coefficients)
            * n.coefficients.transpose()
            * faer::Scale(0.1);
        for i in 0..kept.len() {
            let (x, y) = (unpack(&n, i), unpack(&m, i));
            let gap = &map * &x - &y * &map;
            expected += &gap * x.transpose() - y.transpose() * &gap;
        }
        let gaps = normalized(spectral_gaps(&m.eigenvalues, &n.eigenvalues));
        expected += Mat::from_fn(k, k, |i, j| 0.7 * gaps[(i, j)] * map[(i, j)]);
        let error = &energy.gradient(&map) - &expected;
        assert!(error.norm_max() < 1e-9 * expected.norm_max(), "{error:?}");
    }

    #[test]
    fn a_rectangular_map_has_no_gradient() {
        let options = FitOptions { k: 8, ..FitOptions::default() };
        let (source, target) = (basis_of(&creature(0.0), 30), basis_of(&creature(0.3), 30));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let map = fit_rectangular_map((&source, &g), (&target, &f), [14, 8], &options).unwrap();
        let map = map.source_from_target;
        assert_eq!((map.nrows(), map.ncols()), (14, 8));
        let kept: Vec<usize> = (0..g.count()).collect();
        let energy = Energy::new(
            &Side::new((&source, &g), &kept, 14),
            &Side::new((&target, &f), &kept, 8),
            &options,
        );
        let gradient = energy.gradient(&map);
        assert!(gradient.subcols(1, 7).norm_max() < 1e-9, "{gradient:?}");
    }

    /// Test 5: a shape with its vertices in another order is mapped by the identity, up to signs.
    #[test]
    fn a_renumbered_shape_is_mapped_by_signs() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 40), basis_of(&renumbered, 40));
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &moved));
        let options = FitOptions { k: 12, ..FitOptions::default() };
        let map = fit_functional_map((&source, &g), (&target, &f), &options).unwrap();
        let map = map.source_from_target;
        for (i, j) in (0..12).flat_map(|i| (0..12).map(move |j| (i, j))) {
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((map[(i, j)].abs() - expected).abs() < 1e-6, "{i}, {j}: {}", map[(i, j)]);
        }
    }

    #[test]
    fn unlike_descriptors_are_refused() {
        let basis = basis_of(&creature(0.0), 30);
        let all = described(&basis, &LANDMARKS);
        let few = described(&basis, &LANDMARKS[..2]);
        let options = FitOptions::default();
        let check = |target: &Descriptors, k: usize, expected: &str| {
            let options = FitOptions { k, ..options.clone() };
            let error = fit_functional_map((&basis, &all), (&basis, target), &options).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        check(
            &few,
            20,
            "the source has 120 descriptors and the target 60: use the same options and \
             landmarks for both",
        );
        check(&all, 50, "50 eigenfunctions are wanted, but the source basis has 30");
        let mut other = all.clone();
        other.names[30] = "wkm nose 100".to_owned();
        check(
            &other,
            20,
            "descriptor 30 is `wkm l0 100` on the source and `wkm nose 100` on the target: \
             both shapes need the same landmarks in the same order",
        );
    }
}
