//! Straight lines through points.

/// `y = intercept + slope x`, with the least sum of squared distances along y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    pub slope: f64,
    pub intercept: f64,
    /// The share of the variance of y that the line explains.
    pub r_squared: f64,
}

/// Fits a line; `None` for points of fewer than two different x.
pub fn fit_line(points: &[[f64; 2]]) -> Option<Fit> {
    let n = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|it| it[axis]).sum::<f64>() / n;
    let (x_mean, y_mean) = (mean(0), mean(1));
    // About the means: large offsets do not eat digits.
    let product = |a: usize, b: usize| {
        let off = |it: &[f64; 2], axis: usize| it[axis] - if axis == 0 { x_mean } else { y_mean };
        points.iter().map(|it| off(it, a) * off(it, b)).sum::<f64>()
    };
    let (xx, xy, yy) = (product(0, 0), product(0, 1), product(1, 1));
    if points.len() < 2 || xx <= f64::EPSILON * x_mean * x_mean * n {
        return None;
    }
    let slope = xy / xx;
    // A constant is explained in full by a level line.
    let r_squared = if yy == 0.0 { 1.0 } else { xy * xy / (xx * yy) };
    Some(Fit { slope, intercept: y_mean - slope * x_mean, r_squared })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Anscombe (1973): four sets that share one line, `y = 3 + x / 2` with `R² = 0.67`.
    #[test]
    fn anscombes_first_set_has_its_known_line() {
        let x = [10.0, 8.0, 13.0, 9.0, 11.0, 14.0, 6.0, 4.0, 12.0, 7.0, 5.0];
        let y = [8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68];
        let points: Vec<[f64; 2]> = x.iter().zip(y).map(|(&x, y)| [x, y]).collect();
        let fit = fit_line(&points).unwrap();
        assert!((fit.slope - 0.500_090_909_090_909_1).abs() < 1e-12, "{fit:?}");
        assert!((fit.intercept - 3.000_090_909_090_909).abs() < 1e-12, "{fit:?}");
        assert!((fit.r_squared - 0.666_542_459_508_774_8).abs() < 1e-12, "{fit:?}");
    }

    #[test]
    fn a_line_far_away_is_found_exactly() {
        let at = |it: i32| [1e6 + f64::from(it), 7.0 - 3.0 * f64::from(it)];
        let points: Vec<[f64; 2]> = (0..10).map(at).collect();
        let fit = fit_line(&points).unwrap();
        assert!((fit.slope + 3.0).abs() < 1e-9 && (fit.r_squared - 1.0).abs() < 1e-12, "{fit:?}");
        assert_eq!(fit_line(&[[1.0, 2.0], [1.0, 3.0]]), None);
        assert_eq!(fit_line(&[[1.0, 2.0]]), None);
        let level = fit_line(&[[1.0, 2.0], [2.0, 2.0]]).unwrap();
        assert_eq!((level.slope, level.intercept, level.r_squared), (0.0, 2.0, 1.0));
    }
}
