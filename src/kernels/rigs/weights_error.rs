//! How far skin weights are from the true ones.

use super::weights::SkinWeights;

/// What two sets of weights of one mesh differ by.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightErrors {
    /// By vertex: the share of the weight that is at other joints, half the sum of all differences.
    pub misplaced: Vec<f64>,
    /// Vertices that the same joint moves most, or one of as large a weight.
    pub n_same_heaviest: usize,
}

/// Why weights cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WeightsErrorError {
    #[error("the weights are of {estimate} vertices, the true ones of {truth}")]
    Vertices { estimate: usize, truth: usize },
    #[error("the weights are of {estimate} joints, the true ones of {truth}")]
    Joints { estimate: usize, truth: usize },
}

/// Compares the weights of all vertices. Joints are compared by their indices.
///
/// # Errors
/// See [`WeightsErrorError`].
pub fn weight_errors(
    estimate: &SkinWeights,
    truth: &SkinWeights,
) -> Result<WeightErrors, WeightsErrorError> {
    let (n_estimate, n_truth) = (estimate.n_vertices(), truth.n_vertices());
    if n_estimate != n_truth {
        return Err(WeightsErrorError::Vertices { estimate: n_estimate, truth: n_truth });
    }
    let (n_estimate, n_truth) = (estimate.n_joints(), truth.n_joints());
    if n_estimate != n_truth {
        return Err(WeightsErrorError::Joints { estimate: n_estimate, truth: n_truth });
    }
    let mut misplaced = Vec::with_capacity(truth.n_vertices());
    let mut n_same_heaviest = 0;
    for vertex in 0..truth.n_vertices() {
        let kept: f64 =
            truth.row(vertex).map(|(joint, it)| it.min(estimate.get(vertex, joint as usize))).sum();
        misplaced.push((1.0 - kept).max(0.0));
        let most = truth.row(vertex).fold(0.0, |most: f64, it| most.max(it.1));
        let heaviest = estimate.row(vertex).fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a }).0;
        n_same_heaviest += usize::from(truth.get(vertex, heaviest as usize) >= most - 1e-9);
    }
    Ok(WeightErrors { misplaced, n_same_heaviest })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_at_other_joints_is_misplaced() {
        let truth = vec![vec![(0, 1.0)], vec![(0, 0.5), (1, 0.5)], vec![(2, 1.0)]];
        let estimate = vec![vec![(0, 0.75), (2, 0.25)], vec![(1, 1.0)], vec![(1, 1.0)]];
        let [truth, estimate] = [truth, estimate].map(|it| SkinWeights::from_rows(3, &it).unwrap());
        let found = weight_errors(&estimate, &truth).unwrap();
        assert_eq!(found.misplaced, [0.25, 0.5, 1.0]);
        assert_eq!(found.n_same_heaviest, 2);
        let back = weight_errors(&truth, &estimate).unwrap();
        assert_eq!(back.misplaced, found.misplaced);
        let other = SkinWeights::from_rows(4, &estimate.to_rows()).unwrap();
        assert_eq!(
            weight_errors(&other, &truth).unwrap_err().to_string(),
            "the weights are of 4 joints, the true ones of 3"
        );
    }
}
