//! The motions of all bones in all frames.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use nalgebra::{Matrix3, Matrix4, SMatrix};
use rayon::prelude::*;

use super::{Moving, SsdrOptions, additions::Addition, weights::Row};
use crate::kernels::geometry::kabsch::best_rotation;
use crate::kernels::geometry::mesh::Vec3;

pub type Matrix3x4 = SMatrix<f64, 3, 4>;

/// `3T x 4B`: a rotation and a translation for every frame and bone.
#[derive(Debug, Clone)]
pub struct Motions {
    pub matrix: Mat<f64>,
}

/// Frames whose sums one task adds up.
const FRAMES: usize = 32;

impl Motions {
    pub fn identity(moving: &Moving, n_bones: usize) -> Self {
        let matrix = Mat::from_fn(3 * moving.n_frames(), 4 * n_bones, |row, column| {
            if row % 3 == column % 4 { 1.0 } else { 0.0 }
        });
        Self { matrix }
    }

    pub fn n_bones(&self) -> usize {
        self.matrix.ncols() / 4
    }

    pub fn get(&self, frame: usize, bone: usize) -> (Matrix3<f64>, Vec3) {
        let block = block(&self.matrix, frame, bone);
        (block.fixed_columns::<3>(0).into_owned(), block.column(3).into_owned())
    }

    /// Some of the bones, then others.
    pub fn with(&self, kept: &[usize], added: &[Addition]) -> Self {
        let n_bones = kept.len() + added.len();
        let matrix = Mat::from_fn(self.matrix.nrows(), 4 * n_bones, |row, column| {
            let (bone, axis) = (column / 4, column % 4);
            match kept.get(bone) {
                Some(old) => self.matrix[(row, 4 * old + axis)],
                None => added[bone - kept.len()].motion[row / 3][(row % 3, axis)],
            }
        });
        Self { matrix }
    }

    /// `3T x V`: where vertices are, less where they are skinned to.
    pub fn residuals(&self, moving: &Moving, rows: &[Row]) -> Mat<f64> {
        let mut res = moving.frames.clone();
        for (vertex, row) in rows.iter().enumerate() {
            let column = res.col_as_slice_mut(vertex);
            for &(bone, weight) in row {
                for (axis, coordinate) in moving.rest[vertex].iter().enumerate() {
                    let share = weight * coordinate;
                    let motion = self.matrix.col_as_slice(4 * bone as usize + axis);
                    for (sum, it) in column.iter_mut().zip(motion) {
                        *sum -= share * it;
                    }
                }
            }
        }
        res
    }

    /// `G = M^T M`, `4B x 4B`.
    pub fn gram(&self) -> Mat<f64> {
        let mut gram = Mat::zeros(self.matrix.ncols(), self.matrix.ncols());
        let m = self.matrix.as_ref();
        matmul(gram.as_mut(), Accum::Replace, m.transpose(), m, 1.0, Par::Seq);
        gram
    }

    /// Fits every bone to the vertices of its label.
    pub fn fit_rigid(&mut self, moving: &Moving, labels: &[u32]) {
        let rows: Vec<Row> = labels.iter().map(|&it| vec![(it, 1.0)]).collect();
        let options = SsdrOptions { motion_sweeps: 1, affinity: 0.0, ..SsdrOptions::default() };
        self.improve(moving, &rows, &options);
    }

    /// Further on the way from the motions before to these, by a share of it.
    pub fn beyond(&self, before: &Self, share: f64) -> Self {
        let mut res = self.clone();
        for frame in 0..self.matrix.nrows() / 3 {
            for bone in 0..self.n_bones() {
                let now = block(&self.matrix, frame, bone);
                let mut further = now + (now - block(&before.matrix, frame, bone)) * share;
                let rotation = best_rotation(&further.fixed_columns::<3>(0).into_owned());
                further.fixed_columns_mut::<3>(0).copy_from(rotation.to_rotation_matrix().matrix());
                res.set(frame, bone, &further);
            }
        }
        res
    }

    /// Fits the bones one after the other to what the others leave, a few rounds in every frame.
    ///
    /// For bone `j`, `sum_i |w_ij (R u_i + T) - r_i|^2` with `r_i = v_i - sum_{l != j} w_il M_l u_i` is
    /// least for the rotation of `sum w_ij r_i u_i^T - W q p^T`, where `p` and `q` are the means of
    /// `u_i` and `r_i / w_ij` by `W = sum w_ij^2`. Affinity adds that the bone alone should fit its
    /// vertices, by the fourth powers of their weights.
    pub fn improve(&mut self, moving: &Moving, rows: &[Row], options: &SsdrOptions) {
        let n_bones = self.n_bones();
        let sums = Sums::new(moving, rows, n_bones, options.affinity);
        let work = |frame: usize| -> Vec<Matrix3x4> {
            let mut own: Vec<Matrix3x4> =
                (0..n_bones).map(|it| block(&self.matrix, frame, it)).collect();
            for _ in 0..options.motion_sweeps {
                for bone in 0..n_bones {
                    let mut target = block(&sums.targets, frame, bone);
                    for (other, products) in &sums.pairs[bone] {
                        target -= own[*other] * products;
                    }
                    if let Some(fitted) = fit(&target, &sums.moments[bone]) {
                        own[bone] = fitted;
                    }
                }
            }
            own
        };
        let fitted: Vec<Vec<Matrix3x4>> =
            (0..moving.n_frames()).into_par_iter().map(work).collect();
        for (frame, bones) in fitted.iter().enumerate() {
            for (bone, motion) in bones.iter().enumerate() {
                self.set(frame, bone, motion);
            }
        }
    }

    fn set(&mut self, frame: usize, bone: usize, motion: &Matrix3x4) {
        for column in 0..4 {
            for row in 0..3 {
                self.matrix[(3 * frame + row, 4 * bone + column)] = motion[(row, column)];
            }
        }
    }
}

fn block(matrix: &Mat<f64>, frame: usize, bone: usize) -> Matrix3x4 {
    Matrix3x4::from_fn(|row, column| matrix[(3 * frame + row, 4 * bone + column)])
}

/// The rigid motion for `target = sum w v u^T` (`3 x 4`) and `moments = sum w^2 u u^T` (`4 x 4`);
/// `None` if the bone moves nothing.
pub fn fit(target: &Matrix3x4, moments: &Matrix4<f64>) -> Option<Matrix3x4> {
    let total = moments[(3, 3)];
    if !(total > 1e-12) {
        return None;
    }
    let p = moments.fixed_view::<3, 1>(0, 3) / total;
    let q = target.column(3) / total;
    let covariance = target.fixed_columns::<3>(0) - q * p.transpose() * total;
    let rotation = best_rotation(&covariance).to_rotation_matrix();
    let translation = q - rotation * p;
    let mut motion = Matrix3x4::zeros();
    motion.fixed_columns_mut::<3>(0).copy_from(rotation.matrix());
    motion.set_column(3, &translation);
    Some(motion)
}

/// What vertices say about bones, for fixed weights.
struct Sums {
    /// `3T x 4B`: `sum_i w_ij v_i u_i^T`, with the affinity's share.
    targets: Mat<f64>,
    /// `sum_i w_ij^2 u_i u_i^T`, with the affinity's share.
    moments: Vec<Matrix4<f64>>,
    /// For every bone, the others that share vertices with it: `sum_i w_ij w_il u_i u_i^T`.
    pairs: Vec<Vec<(usize, Matrix4<f64>)>>,
}

impl Sums {
    fn new(moving: &Moving, rows: &[Row], n_bones: usize, affinity: f64) -> Self {
        let mut products = vec![Matrix4::zeros(); n_bones * n_bones];
        let mut is_shared = vec![false; n_bones * n_bones];
        let mut fourth = vec![0.0; n_bones];
        let mut total = vec![0.0; n_bones];
        for (row, u) in rows.iter().zip(&moving.rest) {
            let u = nalgebra::Vector4::from(*u);
            let square = u * u.transpose();
            for &(a, weight_a) in row {
                total[a as usize] += weight_a;
                fourth[a as usize] += weight_a.powi(4);
                for &(b, weight_b) in row {
                    let at = a as usize * n_bones + b as usize;
                    products[at] += square * (weight_a * weight_b);
                    is_shared[at] = true;
                }
            }
        }
        let pulls: Vec<f64> = (0..n_bones)
            .map(|it| if fourth[it] > 0.0 { affinity * total[it] / fourth[it] } else { 0.0 })
            .collect();
        let mut moments: Vec<Matrix4<f64>> =
            (0..n_bones).map(|it| products[it * n_bones + it]).collect();
        for (row, u) in rows.iter().zip(&moving.rest) {
            let u = nalgebra::Vector4::from(*u);
            for &(bone, weight) in row {
                let pull = pulls[bone as usize] * weight.powi(4);
                moments[bone as usize] += u * u.transpose() * pull;
            }
        }
        let pairs = (0..n_bones)
            .map(|a| {
                let others = (0..n_bones).filter(|&b| b != a && is_shared[a * n_bones + b]);
                others.map(|b| (b, products[a * n_bones + b])).collect()
            })
            .collect();
        let factor = |bone: usize, weight: f64| weight + pulls[bone] * weight.powi(4);
        Self { targets: targets(moving, rows, n_bones, &factor), moments, pairs }
    }
}

/// `sum_i f(w_ij) v_i u_i^T` for all frames and bones, some frames a task.
fn targets(
    moving: &Moving,
    rows: &[Row],
    n_bones: usize,
    factor: &(dyn Fn(usize, f64) -> f64 + Sync),
) -> Mat<f64> {
    let mut res = Mat::zeros(3 * moving.n_frames(), 4 * n_bones);
    let mut chunks = Vec::new();
    let mut rest = res.as_mut();
    let mut first = 0;
    while rest.nrows() > 0 {
        let height = (3 * FRAMES).min(rest.nrows());
        let (chunk, below) = rest.split_at_row_mut(height);
        chunks.push((first, chunk));
        first += height;
        rest = below;
    }
    chunks.into_par_iter().for_each(|(first, mut chunk)| {
        let height = chunk.nrows();
        let frames = moving.frames.as_ref().subrows(first, height);
        for (vertex, (row, u)) in rows.iter().zip(&moving.rest).enumerate() {
            let positions = frames.col(vertex).try_as_col_major().expect("columns are contiguous");
            for &(bone, weight) in row {
                let weight = factor(bone as usize, weight);
                for (axis, coordinate) in u.iter().enumerate() {
                    let column = chunk.as_mut().col_mut(4 * bone as usize + axis);
                    let sums = column.try_as_col_major_mut().expect("columns are contiguous");
                    let share = weight * coordinate;
                    for (sum, position) in sums.as_slice_mut().iter_mut().zip(positions.as_slice())
                    {
                        *sum += share * position;
                    }
                }
            }
        }
    });
    res
}
