//! Functional maps refined like rigid motions: iterative closest points among coefficients.

use faer::Mat;

use super::{
    functional_map::{FunctionalMap, PointMap},
    point_map::{PointMapError, check, point_map},
};
use crate::kernels::{
    numerics::{cholesky::Cholesky, tall},
    spectral::basis::Basis,
};

/// Options of [`icp_refine`].
#[derive(Debug, Clone, PartialEq)]
pub struct IcpOptions {
    pub rounds: usize,
    /// Weighs vertices by their areas. The paper's demo does not.
    pub mass_weighted: bool,
}

impl Default for IcpOptions {
    fn default() -> Self {
        Self { rounds: 5, mass_weighted: true }
    }
}

/// Why a map cannot be refined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IcpError {
    #[error(transparent)]
    Map(#[from] PointMapError),
    #[error("{n_vertices} source vertices do not determine {k} coefficients")]
    FewVertices { n_vertices: usize, k: usize },
}

/// What [`icp_refine`] did.
#[derive(Debug, Clone, PartialEq)]
pub struct IcpReport {
    /// The part of the source's vertices whose match was another than in the round before, for every
    /// round but the first, and for the matches of the returned map.
    pub changed: Vec<f64>,
}

/// Makes a map orthogonal, by matching points and solving for the best orthogonal map in turns.
///
/// A round takes the matches `m` of the source's vertices, nearest rows of `Psi C^T` to rows of `Phi`;
/// the least-squares solution `W` of `Phi W = Psi[m]`; and for `C` the orthogonal matrix `U V^T` of
/// `W = U S V^T` (Ovsjanikov et al. 2012, section 6.2, for `C: F(N) -> F(M)`). A map that is not square
/// gets orthonormal rows or columns, of which it has fewer: more target functions than source functions
/// cannot all be kept apart, and some lie in the map's kernel.
///
/// Coordinates are those of both shapes at total area one. The returned matches are those of the
/// returned map.
///
/// # Errors
/// See [`IcpError`].
pub fn icp_refine(
    source: &Basis,
    target: &Basis,
    map: &FunctionalMap,
    options: &IcpOptions,
) -> Result<(FunctionalMap, PointMap, IcpReport), IcpError> {
    check(source, target, map)?;
    let (k, n_vertices) = (map.source_from_target.nrows(), source.n_vertices());
    let pseudo_inverse = PseudoInverse::new(source, k, options.mass_weighted);
    let pseudo_inverse = pseudo_inverse.ok_or(IcpError::FewVertices { n_vertices, k })?;
    let mut map = map.clone();
    let mut matches = point_map(source, target, &map);
    let mut changed = Vec::with_capacity(options.rounds);
    for _ in 0..options.rounds {
        let best = pseudo_inverse.of_matches(target, &matches, map.source_from_target.ncols());
        let orthogonal = tall::nearest_orthogonal(best.as_ref()).ok_or(PointMapError::NotFinite)?;
        map = FunctionalMap::new(source, target, orthogonal);
        let next = point_map(source, target, &map);
        let pairs = matches.target_of_source.iter().zip(&next.target_of_source);
        changed.push(pairs.filter(|it| it.0 != it.1).count() as f64 / n_vertices as f64);
        matches = next;
    }
    Ok((map, matches, IcpReport { changed }))
}

/// `Phi^+`, at total area one.
struct PseudoInverse<'a> {
    source: &'a Basis,
    k: usize,
    /// Without masses: the factor of `Phi^T Phi`.
    gram: Option<Cholesky>,
}

impl<'a> PseudoInverse<'a> {
    fn new(source: &'a Basis, k: usize, mass_weighted: bool) -> Option<Self> {
        if mass_weighted {
            return Some(Self { source, k, gram: None });
        }
        let vectors = source.truncated(k);
        let gram = Cholesky::new(tall::inner_products(vectors, vectors).as_ref())?;
        Some(Self { source, k, gram: Some(gram) })
    }

    /// `Phi^+ Psi[m]`, `k x n_functions`.
    fn of_matches(&self, target: &Basis, matches: &PointMap, n_functions: usize) -> Mat<f64> {
        let vectors = self.source.truncated(self.k);
        let pulled = Mat::from_fn(matches.target_of_source.len(), n_functions, |row, column| {
            target.eigenvectors[(matches.target_of_source[row] as usize, column)]
        });
        let solution = match &self.gram {
            None => tall::mass_products(vectors, &self.source.mass, pulled.as_ref()),
            Some(gram) => gram.solve(tall::inner_products(vectors, pulled.as_ref()).as_ref()),
        };
        solution * faer::Scale((target.area() / self.source.area()).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{
        maps::map_quality::orthogonality,
        test_shapes::{basis_of, creature, permuted},
    };

    /// A map that is right but for noise.
    fn noisy(source: &Basis, target: &Basis, order: &[u32], size: (usize, usize)) -> FunctionalMap {
        let exact = PointMap { target_of_source: order.to_vec(), n_target: order.len() };
        let inverse = PseudoInverse::new(source, size.0, true).unwrap();
        let mut map = inverse.of_matches(target, &exact, size.1);
        for (i, j) in (0..size.0).flat_map(|i| (0..size.1).map(move |j| (i, j))) {
            map[(i, j)] += 0.04 * (((i * 7 + j * 13) % 11) as f64 / 5.0 - 1.0);
        }
        FunctionalMap::new(source, target, map)
    }

    #[test]
    fn noise_is_removed_from_the_map_of_a_renumbered_shape() {
        let mesh = creature(0.0);
        let (renumbered, order) = permuted(&mesh);
        let (source, target) = (basis_of(&mesh, 24), basis_of(&renumbered, 24));
        for mass_weighted in [true, false] {
            for size in [(20, 20), (24, 16), (16, 24)] {
                let map = noisy(&source, &target, &order, size);
                let options = IcpOptions { rounds: 10, mass_weighted };
                let (refined, matches, report) =
                    icp_refine(&source, &target, &map, &options).unwrap();
                let pairs = matches.target_of_source.iter().zip(&order);
                let n_wrong = pairs.filter(|it| it.0 != it.1).count();
                // More target functions than source functions cannot all be told apart.
                let allowed = if size.0 < size.1 { order.len() / 10 } else { 0 };
                assert!(n_wrong <= allowed, "{n_wrong} wrong at {size:?}");
                assert_eq!((report.changed.len(), report.changed[9]), (10, 0.0));
                let map = &refined.source_from_target;
                let kept = if size.0 < size.1 { map.transpose() } else { map.as_ref() };
                assert!(orthogonality(kept) < 1e-12);
            }
        }
    }

    #[test]
    fn maps_that_do_not_fit_are_refused() {
        let basis = basis_of(&creature(0.0), 10);
        let refuse = |map: Mat<f64>, expected: &str| {
            let map = FunctionalMap::without_spaces(map);
            let error = icp_refine(&basis, &basis, &map, &IcpOptions::default()).unwrap_err();
            assert_eq!(error.to_string(), expected);
        };
        refuse(
            Mat::zeros(10, 12),
            "the map is 10 x 12, but the target basis has 10 eigenfunctions",
        );
        refuse(Mat::from_fn(5, 5, |_, _| f64::NAN), "the map has an entry that is not finite");
    }
}
