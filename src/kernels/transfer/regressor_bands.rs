//! Regressors as one sees them: squared, and compared by bands of frequencies.

use faer::Mat;

use super::regressor::SpectralRegressor;
use crate::kernels::maps::functional_map::{FunctionalMap, WrongSpace};

/// Why regressors cannot be carried over or compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegressorBandsError {
    #[error("the map is {n_rows} x {n_cols}, but the regressor has {k} coefficients")]
    MapShape { n_rows: usize, n_cols: usize, k: usize },
    #[error(
        "regressor {index} has {rows} joints and {columns} coefficients, the first {first_rows} and \
         {first_columns}: compare regressors of one source and maps of one size"
    )]
    Shape { index: usize, rows: usize, columns: usize, first_rows: usize, first_columns: usize },
    #[error("there are {0} regressors: a comparison needs two")]
    Few(usize),
    #[error("{identities} identities for {regressors} regressors")]
    Identities { identities: usize, regressors: usize },
    #[error("{bands} bands of {k} coefficients")]
    Bands { bands: usize, k: usize },
    #[error(transparent)]
    WrongSpace(#[from] WrongSpace),
}

/// Carries a spectral regressor over to a map's target: `R^ C`, so that `J = (R^ C) Psi^+ X`.
///
/// # Errors
/// [`RegressorBandsError::MapShape`].
pub fn carried_regressor(
    regressor: &SpectralRegressor,
    map: &FunctionalMap,
) -> Result<SpectralRegressor, RegressorBandsError> {
    let spaces = map.spaces;
    if let (Some(spaces), Some(space)) = (spaces, regressor.space) {
        spaces.check_source(space)?;
    }
    let map = &map.source_from_target;
    let k = regressor.matrix.ncols();
    if map.nrows() > k {
        let (n_rows, n_cols) = (map.nrows(), map.ncols());
        return Err(RegressorBandsError::MapShape { n_rows, n_cols, k });
    }
    Ok(SpectralRegressor {
        names: regressor.names.clone(),
        parents: regressor.parents.clone(),
        matrix: regressor.matrix.as_ref().subcols(0, map.nrows()) * map,
        space: spaces.map(|it| it.target),
    })
}

/// How two regressors differ.
#[derive(Debug, Clone, PartialEq)]
pub struct PairDifference {
    pub first: usize,
    pub second: usize,
    /// Whether both are of one identity.
    pub same: bool,
    /// For every band the Frobenius norm of the difference of the squared entries.
    pub bands: Vec<f64>,
}

/// The columns of every band: as many in each, the first ones a column more where it does not divide.
pub fn bands(k: usize, n_bands: usize) -> Vec<std::ops::Range<usize>> {
    let edge = |it: usize| it * (k / n_bands) + it.min(k % n_bands);
    (0..n_bands).map(|it| edge(it)..edge(it + 1)).collect()
}

/// Compares all pairs of regressors (Musoni et al. 2021, figure 10).
///
/// Entries are squared first: signs of eigenfunctions are arbitrary.
///
/// # Errors
/// See [`RegressorBandsError`].
pub fn compare_regressors(
    regressors: &[&SpectralRegressor],
    identities: &[String],
    n_bands: usize,
) -> Result<Vec<PairDifference>, RegressorBandsError> {
    if regressors.len() < 2 {
        return Err(RegressorBandsError::Few(regressors.len()));
    }
    if identities.len() != regressors.len() {
        let (identities, regressors) = (identities.len(), regressors.len());
        return Err(RegressorBandsError::Identities { identities, regressors });
    }
    let shape = |it: &SpectralRegressor| (it.matrix.nrows(), it.matrix.ncols());
    let (first_rows, first_columns) = shape(regressors[0]);
    if let Some(index) = regressors.iter().position(|it| shape(it) != shape(regressors[0])) {
        let (rows, columns) = shape(regressors[index]);
        return Err(RegressorBandsError::Shape { index, rows, columns, first_rows, first_columns });
    }
    if n_bands == 0 || n_bands > first_columns {
        return Err(RegressorBandsError::Bands { bands: n_bands, k: first_columns });
    }
    let bands = bands(first_columns, n_bands);
    let mut pairs = Vec::new();
    for second in 1..regressors.len() {
        for first in 0..second {
            let (a, b) = (&regressors[first].matrix, &regressors[second].matrix);
            let norm = |band: &std::ops::Range<usize>| band_norm(a, b, band.clone());
            pairs.push(PairDifference {
                first,
                second,
                same: identities[first] == identities[second],
                bands: bands.iter().map(norm).collect(),
            });
        }
    }
    Ok(pairs)
}

fn band_norm(a: &Mat<f64>, b: &Mat<f64>, columns: std::ops::Range<usize>) -> f64 {
    let gap = |row: usize, column: usize| a[(row, column)].powi(2) - b[(row, column)].powi(2);
    columns
        .flat_map(|column| (0..a.nrows()).map(move |row| gap(row, column).powi(2)))
        .sum::<f64>()
        .sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regressor(value: impl Fn(usize, usize) -> f64) -> SpectralRegressor {
        SpectralRegressor {
            names: vec!["a".to_owned(), "b".to_owned()],
            parents: vec![None, Some(0)],
            matrix: Mat::from_fn(2, 5, value),
            space: None,
        }
    }

    #[test]
    fn differences_by_hand() {
        let a = regressor(|row, column| (row + column) as f64);
        let flipped = regressor(|row, column| -((row + column) as f64));
        let other = regressor(|row, column| if column == 4 { 0.0 } else { (row + column) as f64 });
        let identities = ["x", "x", "y"].map(str::to_owned);
        let pairs = compare_regressors(&[&a, &flipped, &other], &identities, 2).unwrap();
        // Signs do not count.
        assert_eq!((pairs[0].same, &pairs[0].bands[..]), (true, &[0.0, 0.0][..]));
        // The last column held 4 and 5: their squares make sqrt(16^2 + 25^2).
        let expected = f64::from(16 * 16 + 25 * 25).sqrt();
        assert_eq!((pairs[1].same, &pairs[1].bands[..]), (false, &[0.0, expected][..]));
        assert_eq!((pairs[2].first, pairs[2].second), (1, 2));
        assert_eq!(bands(5, 2), [0..3, 3..5]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let a = regressor(|_, _| 1.0);
        let names = ["x", "y"].map(str::to_owned);
        let error = |list: &[&SpectralRegressor], n_bands| {
            compare_regressors(list, &names[..list.len().min(2)], n_bands).unwrap_err().to_string()
        };
        assert_eq!(error(&[&a], 1), "there are 1 regressors: a comparison needs two");
        assert_eq!(error(&[&a, &a], 9), "9 bands of 5 coefficients");
        let map = FunctionalMap::without_spaces(Mat::zeros(9, 4));
        let error = carried_regressor(&a, &map).unwrap_err().to_string();
        assert_eq!(error, "the map is 9 x 4, but the regressor has 5 coefficients");
    }
}
