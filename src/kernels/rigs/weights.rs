//! Skin weights: how much every joint moves every vertex.

/// `V x Q` skin weights, sparse by rows. Every row holds ascending joints and sums to one.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeights {
    n_joints: usize,
    /// `V + 1` offsets into `joints` and `values`.
    offsets: Vec<usize>,
    joints: Vec<u32>,
    values: Vec<f64>,
}

/// Why something is no set of skin weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WeightsError {
    #[error("vertex {vertex} is moved by no joint ({count} of {n_vertices} vertices are not)")]
    Unweighted { vertex: usize, count: usize, n_vertices: usize },
    #[error("vertex {vertex} is moved by joint {joint}, but there are {n_joints} joints")]
    OutOfRange { vertex: usize, joint: u32, n_joints: usize },
    #[error("vertex {vertex} has the weight {value} for joint {joint}")]
    NotAWeight { vertex: usize, joint: u32, value: f64 },
}

impl SkinWeights {
    /// Builds normalized weights from `V` lists of (joint, weight), in any order.
    ///
    /// Repeated joints are added up, zeros dropped, and every row divided by its sum.
    ///
    /// # Errors
    /// See [`WeightsError`].
    pub fn from_rows(n_joints: usize, rows: &[Vec<(u32, f64)>]) -> Result<Self, WeightsError> {
        let mut res = Self { n_joints, offsets: vec![0], joints: Vec::new(), values: Vec::new() };
        let mut unweighted = None;
        let mut count = 0;
        for (vertex, row) in rows.iter().enumerate() {
            let mut row = row.clone();
            row.sort_by_key(|it| it.0);
            for &(joint, value) in &row {
                if joint as usize >= n_joints {
                    return Err(WeightsError::OutOfRange { vertex, joint, n_joints });
                }
                if !(0.0..f64::INFINITY).contains(&value) {
                    return Err(WeightsError::NotAWeight { vertex, joint, value });
                }
            }
            let sum: f64 = row.iter().map(|it| it.1).sum();
            if !(sum > 0.0) {
                unweighted.get_or_insert(vertex);
                count += 1;
                continue;
            }
            let first = res.joints.len();
            for (joint, value) in row.into_iter().filter(|it| it.1 > 0.0) {
                if res.joints.len() > first && res.joints.last() == Some(&joint) {
                    *res.values.last_mut().expect("as long as `joints`") += value / sum;
                } else {
                    res.joints.push(joint);
                    res.values.push(value / sum);
                }
            }
            res.offsets.push(res.joints.len());
        }
        match unweighted {
            Some(vertex) => Err(WeightsError::Unweighted { vertex, count, n_vertices: rows.len() }),
            None => Ok(res),
        }
    }

    /// Takes arrays as [`SkinWeights::as_parts`] gives them.
    ///
    /// # Errors
    /// With the first thing that is not as promised.
    pub fn from_parts(
        n_joints: usize,
        offsets: Vec<usize>,
        joints: Vec<u32>,
        values: Vec<f64>,
    ) -> Result<Self, String> {
        if joints.len() != values.len() {
            return Err(format!("{} joints but {} values", joints.len(), values.len()));
        }
        if offsets.first() != Some(&0) || offsets.last() != Some(&joints.len()) {
            return Err(format!("the offsets do not span the {} values", joints.len()));
        }
        for (vertex, range) in offsets.windows(2).enumerate() {
            let (Some(joints), Some(values)) =
                (joints.get(range[0]..range[1]), values.get(range[0]..range[1]))
            else {
                return Err(format!("vertex {vertex} has the range {}..{}", range[0], range[1]));
            };
            let ascending = joints.windows(2).all(|it| it[0] < it[1]);
            if !ascending || joints.last().is_none_or(|&it| it as usize >= n_joints) {
                return Err(format!("vertex {vertex} has the joints {joints:?} of {n_joints}"));
            }
            let sum: f64 = values.iter().sum();
            if !values.iter().all(|&it| it > 0.0) || !((sum - 1.0).abs() < 1e-6) {
                return Err(format!("the weights of vertex {vertex} sum to {sum}"));
            }
        }
        Ok(Self { n_joints, offsets, joints, values })
    }

    pub fn n_vertices(&self) -> usize {
        self.offsets.len() - 1
    }

    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// The joints that move a vertex, ascending, with their weights.
    pub fn row(&self, vertex: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.offsets[vertex]..self.offsets[vertex + 1];
        self.joints[range.clone()].iter().copied().zip(self.values[range].iter().copied())
    }

    /// The weight of one joint at one vertex; zero where it is not stored.
    pub fn get(&self, vertex: usize, joint: usize) -> f64 {
        self.row(vertex).find(|it| it.0 as usize == joint).map_or(0.0, |it| it.1)
    }

    /// All rows as lists, the form that [`SkinWeights::from_rows`] takes.
    pub fn to_rows(&self) -> Vec<Vec<(u32, f64)>> {
        (0..self.n_vertices()).map(|vertex| self.row(vertex).collect()).collect()
    }

    /// The stored arrays: `V + 1` offsets, joints, values.
    pub fn as_parts(&self) -> (&[usize], &[u32], &[f64]) {
        (&self.offsets, &self.joints, &self.values)
    }

    /// The largest number of joints that move one vertex.
    pub fn max_influences(&self) -> usize {
        self.offsets.windows(2).map(|it| it[1] - it[0]).max().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_sorted_merged_and_normalized() {
        let rows = vec![vec![(2, 1.0), (0, 2.0), (2, 1.0), (1, 0.0)]];
        let weights = SkinWeights::from_rows(3, &rows).unwrap();
        assert_eq!(weights.row(0).collect::<Vec<_>>(), [(0, 0.5), (2, 0.5)]);
    }

    #[test]
    fn unweighted_vertices_are_counted() {
        let rows = vec![vec![(0, 1.0)], vec![], vec![(0, 0.0)]];
        let error = SkinWeights::from_rows(1, &rows).unwrap_err();
        assert_eq!(error, WeightsError::Unweighted { vertex: 1, count: 2, n_vertices: 3 });
    }
}
