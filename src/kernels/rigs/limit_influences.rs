//! Skin weights with few joints a vertex.

use super::weights::SkinWeights;

/// What was lost by dropping weights, as shares of a vertex's whole weight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InfluenceLoss {
    /// Vertices that lost something.
    pub n_vertices: usize,
    pub largest: f64,
    /// Over all vertices.
    pub mean: f64,
}

/// Keeps the `count` largest weights of every vertex and scales them to sum to one.
///
/// Of equal weights, the smaller joints stay.
///
/// # Panics
/// If `count` is zero.
pub fn limit_influences(weights: &SkinWeights, count: usize) -> (SkinWeights, InfluenceLoss) {
    assert!(count > 0, "a vertex needs an influence");
    let mut loss = InfluenceLoss::default();
    let mut rows = weights.to_rows();
    for row in &mut rows {
        // Stable: joints ascend within a row.
        row.sort_by(|a, b| b.1.total_cmp(&a.1));
        let lost: f64 = row.iter().skip(count).map(|it| it.1).sum();
        loss.n_vertices += usize::from(row.len() > count);
        loss.largest = loss.largest.max(lost);
        loss.mean += lost / weights.n_vertices() as f64;
        row.truncate(count);
    }
    let limited = SkinWeights::from_rows(weights.n_joints(), &rows);
    (limited.expect("the largest weight of a row is positive"), loss)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_weights_stay_and_the_loss_is_told() {
        let rows = vec![vec![(0, 0.1), (1, 0.5), (2, 0.4)], vec![(2, 1.0)]];
        let weights = SkinWeights::from_rows(3, &rows).unwrap();
        let (limited, loss) = limit_influences(&weights, 2);
        assert_eq!(limited.max_influences(), 2);
        assert!((limited.get(0, 1) - 5.0 / 9.0).abs() < 1e-12);
        assert_eq!(loss.n_vertices, 1);
        assert!((loss.largest - 0.1).abs() < 1e-12 && (loss.mean - 0.05).abs() < 1e-12);
        assert_eq!(limit_influences(&weights, 3).0, weights);
    }
}
