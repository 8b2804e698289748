//! The functional map of FARM, the baseline that transfers coordinates.

use faer::{Mat, MatRef};

use super::{
    fmap::{FitError, FitOptions, fit_rectangular_map},
    functional_map::FunctionalMap,
    nearest::nearest_rows,
};
use crate::kernels::{
    geometry::{farthest_points::farthest_points, mesh::Vec3},
    numerics::{cholesky::Cholesky, tall},
    spectral::{basis::Basis, descriptors::Descriptors},
};

/// Options of [`farm_map`]; the defaults are FARM's.
#[derive(Debug, Clone, PartialEq)]
pub struct FarmOptions {
    /// Eigenfunctions of the source: rows of the map.
    pub k_source: usize,
    /// Eigenfunctions of the target: columns of the map, no more than rows.
    pub k_target: usize,
    /// Weights of the first fit; its own `k` is not used.
    pub fit: FitOptions,
    /// Rounds of iterated closest points.
    pub icp_rounds: usize,
    /// Matches of every robust fit.
    pub boosts: Vec<usize>,
    /// The weight of orthogonality in robust fits, for every match.
    pub orthogonality: f64,
}

impl Default for FarmOptions {
    fn default() -> Self {
        Self {
            k_source: 50,
            k_target: 30,
            fit: FitOptions::default(),
            icp_rounds: 5,
            boosts: vec![200, 300, 400],
            orthogonality: 1.0,
        }
    }
}

/// What [`farm_map`] found on its way.
#[derive(Debug, Clone, PartialEq)]
pub struct FarmReport {
    /// For every boost `|C A - B|_{2,1} / s`, before and after.
    pub distances: Vec<[f64; 2]>,
}

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FarmError {
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error("the map has {k_source} rows and {k_target} columns, but needs as many rows or more")]
    Wide { k_source: usize, k_target: usize },
    #[error("the source basis belongs to {basis} vertices, but there are {found}")]
    Vertices { basis: usize, found: usize },
    #[error("the map of the first fit has no nearest orthonormal one: it is not finite")]
    NotFinite,
}

/// Steps of a robust fit, and the distance below which a match counts as met.
const N_STEPS: usize = 20;
const SHORTEST: f64 = 1e-6;

/// Fits a rectangular map `C: F(N) -> F(M)` as FARM does (Marin et al. 2020).
///
/// An exact fit to descriptors; iterated closest points with orthonormal columns; then, a few times,
/// matches of vertices that are spread over the source, and the map that carries the functions which
/// are one at the matched points alone best,
///
/// `min_C |C A - B|_{2,1} + mu |C^T C - I|^2`,
///
/// by iteratively reweighted least squares. The quartic term is replaced by `4 mu |C - Q|^2` for the
/// nearest orthonormal `Q`, which agrees with it to second order. Constants are carried to
/// constants, and functions without mean to such, throughout. The repair of flipped sides is left out:
/// landmarks tell the sides.
///
/// # Errors
/// See [`FarmError`].
pub fn farm_map(
    source: (&Basis, &Descriptors, &[Vec3]),
    target: (&Basis, &Descriptors),
    options: &FarmOptions,
) -> Result<(FunctionalMap, FarmReport), FarmError> {
    let FarmOptions { k_source, k_target, .. } = *options;
    if k_source < k_target {
        return Err(FarmError::Wide { k_source, k_target });
    }
    if source.0.n_vertices() != source.2.len() {
        let (basis, found) = (source.0.n_vertices(), source.2.len());
        return Err(FarmError::Vertices { basis, found });
    }
    let shape = [k_source, k_target];
    let first = fit_rectangular_map((source.0, source.1), target, shape, &options.fit)?;
    let shapes = Shapes::new(source.0, target.0, shape);
    let mut map = first.source_from_target;
    for _ in 0..options.icp_rounds {
        let pulled = shapes.pull_back(&shapes.matches(&map, None));
        map = orthonormal(&pulled).ok_or(FarmError::NotFinite)?;
    }
    let mut distances = Vec::with_capacity(options.boosts.len());
    for &count in &options.boosts {
        let samples = farthest_points(source.2, count).chosen;
        let matches = shapes.matches(&map, Some(&samples));
        let points = Points::new(&shapes, &samples, &matches);
        let before = points.distance(&map);
        map = points.robust_fit(&map, options.orthogonality).ok_or(FarmError::NotFinite)?;
        distances.push([before, points.distance(&map)]);
    }
    Ok((FunctionalMap::new(source.0, target.0, map), FarmReport { distances }))
}

/// Both bases at total area one.
struct Shapes {
    /// `n_source x k_source` and `n_target x k_target`.
    phi: Mat<f64>,
    psi: Mat<f64>,
    /// The masses of the source, of sum one.
    mass: Vec<f64>,
}

impl Shapes {
    fn new(source: &Basis, target: &Basis, [k_source, k_target]: [usize; 2]) -> Self {
        let area = source.area();
        Self {
            phi: source.truncated(k_source) * faer::Scale(area.sqrt()),
            psi: target.truncated(k_target) * faer::Scale(target.area().sqrt()),
            mass: source.mass.iter().map(|it| it / area).collect(),
        }
    }

    /// For source vertices (all or some) the target vertex whose row of `Psi C^T` is nearest.
    fn matches(&self, map: &Mat<f64>, samples: Option<&[u32]>) -> Vec<u32> {
        let points = tall::product(self.psi.as_ref(), map.transpose());
        match samples {
            None => nearest_rows(self.phi.as_ref(), points.as_ref()),
            Some(samples) => nearest_rows(rows(&self.phi, samples).as_ref(), points.as_ref()),
        }
    }

    /// `Phi^+ Psi[matches]`.
    fn pull_back(&self, matches: &[u32]) -> Mat<f64> {
        let pulled = rows(&self.psi, matches);
        tall::mass_products(self.phi.as_ref(), &self.mass, pulled.as_ref())
    }
}

fn rows(matrix: &Mat<f64>, of: &[u32]) -> Mat<f64> {
    Mat::from_fn(of.len(), matrix.ncols(), |row, column| matrix[(of[row] as usize, column)])
}

/// The nearest matrix with orthonormal columns that carries constants to constants: the polar factor
/// without first row and column, and a sign in their place. `None` if it is not finite.
fn orthonormal(map: &Mat<f64>) -> Option<Mat<f64>> {
    let (n, m) = (map.nrows() - 1, map.ncols() - 1);
    let mut res = Mat::zeros(n + 1, m + 1);
    res[(0, 0)] = if map[(0, 0)] < 0.0 { -1.0 } else { 1.0 };
    let polar = polar_factor(map.as_ref().submatrix(1, 1, n, m))?;
    res.as_mut().submatrix_mut(1, 1, n, m).copy_from(&polar);
    Some(res)
}

/// `W (W^T W)^(-1/2)` for a matrix with no fewer rows than columns.
fn polar_factor(w: MatRef<'_, f64>) -> Option<Mat<f64>> {
    if !w.is_all_finite() {
        return None;
    }
    let (squares, vectors) = tall::symmetric_eigen(tall::small_product(w.transpose(), w).as_ref())?;
    // Directions that nothing is known of stay zero.
    let least = 1e-14 * squares.last().copied().unwrap_or_default();
    let root = |it: f64| if it > least { 1.0 / it.sqrt() } else { 0.0 };
    let scaled = Mat::from_fn(vectors.nrows(), squares.len(), |row, column| {
        vectors[(row, column)] * root(squares[column])
    });
    let inverse = tall::small_product(scaled.as_ref(), vectors.transpose());
    Some(tall::small_product(w, inverse.as_ref()))
}

/// Matched points as columns of coefficients, without the constant functions.
struct Points {
    /// `(k_target - 1) x s` and `(k_source - 1) x s`.
    a: Mat<f64>,
    b: Mat<f64>,
}

impl Points {
    fn new(shapes: &Shapes, samples: &[u32], matches: &[u32]) -> Self {
        let columns = |matrix: &Mat<f64>, of: &[u32]| {
            let rows = rows(matrix, of);
            rows.subcols(1, matrix.ncols() - 1).transpose().to_owned()
        };
        Self { a: columns(&shapes.psi, matches), b: columns(&shapes.phi, samples) }
    }

    /// The mean distance of `C a` from `b`.
    fn distance(&self, map: &Mat<f64>) -> f64 {
        let inner = map.as_ref().submatrix(1, 1, map.nrows() - 1, map.ncols() - 1);
        self.distances(inner).iter().sum::<f64>() / self.a.ncols() as f64
    }

    fn distances(&self, inner: MatRef<'_, f64>) -> Vec<f64> {
        let gaps = tall::small_product(inner, self.a.as_ref()) - &self.b;
        let length = |it: &[f64]| it.iter().map(|it| it * it).sum::<f64>().sqrt();
        (0..gaps.ncols()).map(|it| length(gaps.col_as_slice(it))).collect()
    }

    fn robust_fit(&self, map: &Mat<f64>, orthogonality: f64) -> Option<Mat<f64>> {
        let (n, m) = (self.b.nrows(), self.a.nrows());
        let count = self.a.ncols();
        let mut inner = map.as_ref().submatrix(1, 1, n, m).to_owned();
        let pull = 4.0 * orthogonality * count as f64;
        for _ in 0..N_STEPS {
            let weights: Vec<f64> =
                self.distances(inner.as_ref()).iter().map(|it| 0.5 / it.max(SHORTEST)).collect();
            let weighted = Mat::from_fn(m, count, |row, it| self.a[(row, it)] * weights[it]);
            let nearest = polar_factor(inner.as_ref())?;
            let mut gram = tall::small_product(weighted.as_ref(), self.a.transpose());
            (0..m).for_each(|it| gram[(it, it)] += pull);
            let right = tall::small_product(weighted.as_ref(), self.b.transpose())
                + nearest.transpose() * faer::Scale(pull);
            inner = Cholesky::new(gram.as_ref())?.solve(right.as_ref()).transpose().to_owned();
        }
        let mut res = map.clone();
        res.as_mut().submatrix_mut(1, 1, n, m).copy_from(&inner);
        Some(res)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::test_shapes::{LANDMARKS, basis_of, creature, described, permuted};

    fn options() -> FarmOptions {
        FarmOptions { k_source: 20, k_target: 14, boosts: vec![60, 90], ..Default::default() }
    }

    /// On a shape renumbered, the map is a unit matrix up to signs, and every vertex is found.
    #[test]
    fn a_renumbered_shape_is_found_again() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 40), basis_of(&renumbered, 40));
        let moved = LANDMARKS.map(|it| order[it as usize]);
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &moved));
        let run = |options: &FarmOptions| {
            farm_map((&source, &g, mesh.vertices()), (&target, &f), options).unwrap()
        };
        let (map, _) = run(&options());
        let map = map.source_from_target;
        assert_eq!((map.nrows(), map.ncols()), (20, 14));
        // What 14 functions of 20 cannot tell draws the map from the unit matrix a little.
        for (i, j) in (0..20).flat_map(|i| (0..14).map(move |j| (i, j))) {
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((map[(i, j)].abs() - expected).abs() < 0.15, "{i}, {j}: {}", map[(i, j)]);
        }
        let square = FarmOptions { k_target: 20, ..options() };
        let (map, report) = run(&square);
        let shapes = Shapes::new(&source, &target, [20, 20]);
        assert_eq!(shapes.matches(&map.source_from_target, None), order);
        assert!(report.distances.iter().all(|it| it[1] < 1e-6), "{report:?}");
    }

    #[test]
    fn boosts_come_nearer_and_constants_stay() {
        let (mesh, other) = (creature(0.0), creature(0.4));
        let (source, target) = (basis_of(&mesh, 40), basis_of(&other, 40));
        let (g, f) = (described(&source, &LANDMARKS), described(&target, &LANDMARKS));
        let loose = FarmOptions { orthogonality: 1e-3, ..options() };
        let (map, report) =
            farm_map((&source, &g, mesh.vertices()), (&target, &f), &loose).unwrap();
        assert!(report.distances.iter().all(|it| it[1] < it[0]), "{report:?}");
        let map = map.source_from_target;
        assert_eq!(map[(0, 0)].abs(), 1.0);
        assert!((1..20).all(|it| map[(it, 0)] == 0.0));
        assert!((1..14).all(|it| map[(0, it)] == 0.0));
    }

    #[test]
    fn the_polar_factor_is_orthonormal_and_nearest() {
        let w = Mat::from_fn(5, 3, |i, j| ((i * 7 + j * 5) % 6) as f64 - 2.0);
        let q = polar_factor(w.as_ref()).unwrap();
        let gram = q.transpose() * &q;
        assert!((&gram - Mat::<f64>::identity(3, 3)).norm_max() < 1e-12, "{gram:?}");
        // The nearest: Q^T W is symmetric and positive definite.
        let stretch = q.transpose() * &w;
        assert!((&stretch - stretch.transpose()).norm_max() < 1e-12);
        assert!(Cholesky::new(stretch.as_ref()).is_some());
    }

    #[test]
    fn maps_that_are_wider_than_high_are_refused() {
        let mesh = creature(0.0);
        let basis = basis_of(&mesh, 20);
        let all = described(&basis, &LANDMARKS);
        let wide = FarmOptions { k_source: 5, k_target: 10, ..FarmOptions::default() };
        let error = farm_map((&basis, &all, mesh.vertices()), (&basis, &all), &wide).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the map has 5 rows and 10 columns, but needs as many rows or more"
        );
    }
}
