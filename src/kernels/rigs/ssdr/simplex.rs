//! Weights of one vertex that are not negative and sum to one.

use faer::Mat;
use nalgebra::{DMatrix, DVector};

use super::weights::Row;

/// The least squares of one vertex.
pub struct Problem<'a> {
    pub u: &'a [f64; 4],
    pub gram: &'a Mat<f64>,
    pub linear: Vec<f64>,
    /// Added to the diagonal of `H`.
    pub ridge: f64,
}

/// A weight or a gradient below this counts as zero, relative to the size of `H`.
const ZERO: f64 = 1e-10;

impl Problem<'_> {
    pub fn n_bones(&self) -> usize {
        self.linear.len()
    }

    fn entry(&self, a: usize, b: usize) -> f64 {
        let mut sum = 0.0;
        for column in 0..4 {
            let gram = &self.gram.col_as_slice(4 * b + column)[4 * a..4 * a + 4];
            sum += self.u[column] * dot(self.u, gram.try_into().expect("four of four"));
        }
        if a == b { sum + self.ridge } else { sum }
    }

    pub fn diagonal(&self, bone: usize) -> f64 {
        self.entry(bone, bone)
    }

    /// `w^T H w - 2 g^T w`.
    pub fn value(&self, row: &Row) -> f64 {
        let mut sum = 0.0;
        for &(a, weight_a) in row {
            sum -= 2.0 * weight_a * self.linear[a as usize];
            for &(b, weight_b) in row {
                sum += weight_a * weight_b * self.entry(a as usize, b as usize);
            }
        }
        sum
    }

    /// About the least value without this bone: of the other bones of the row, and the one that helps
    /// them most.
    pub fn value_without(&self, row: &Row, bone: u32) -> f64 {
        let cost = |bone: usize| self.diagonal(bone) - 2.0 * self.linear[bone];
        let others = || (0..self.n_bones()).filter(|it| *it as u32 != bone);
        let mut left: Row = row.iter().copied().filter(|it| it.0 != bone).collect();
        let sum: f64 = left.iter().map(|it| it.1).sum();
        left.iter_mut().for_each(|it| it.1 /= sum);
        if left.is_empty() {
            let best = others().min_by(|&a, &b| cost(a).total_cmp(&cost(b)));
            let Some(best) = best else { return f64::INFINITY };
            left.push((best as u32, 1.0));
        }
        let gradient = self.gradient(&left);
        let next = others()
            .filter(|it| left.iter().all(|own| own.0 as usize != *it))
            .min_by(|&a, &b| gradient[a].total_cmp(&gradient[b]));
        if let Some(next) = next {
            left.push((next as u32, 0.0));
            left.sort_unstable_by_key(|it| it.0);
        }
        self.value(&self.on_simplex(left))
    }

    /// Starts with the best single bone and adds the one along which the error falls fastest, as long
    /// as there is room (matching pursuit; Tropp & Gilbert 2007).
    pub fn choose(&self, max_influences: usize) -> Row {
        let cost = |bone: usize| self.diagonal(bone) - 2.0 * self.linear[bone];
        let costs: Vec<f64> = (0..self.n_bones()).map(cost).collect();
        let best = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let mut row: Row = vec![(best.expect("there is a bone") as u32, 1.0)];
        // Bones may leave again, but the error falls every time, so this ends.
        for _ in 0..2 * max_influences {
            if row.len() == max_influences {
                break;
            }
            let gradient = self.gradient(&row);
            let scale = self.diagonal(row[0].0 as usize).abs().max(f64::MIN_POSITIVE);
            let level: f64 = row.iter().map(|it| it.1 * gradient[it.0 as usize]).sum();
            let is_new = |it: &usize| row.iter().all(|own| own.0 as usize != *it);
            let steepest = (0..self.n_bones())
                .filter(is_new)
                .min_by(|&a, &b| gradient[a].total_cmp(&gradient[b]));
            let Some(next) = steepest.filter(|&it| gradient[it] < level - ZERO * scale) else {
                break;
            };
            let mut wider = row.clone();
            wider.push((next as u32, 0.0));
            wider.sort_unstable_by_key(|it| it.0);
            let wider = self.on_simplex(wider);
            if !(self.value(&wider) < self.value(&row)) {
                break;
            }
            row = wider;
        }
        row
    }

    /// `H w - g`, for all bones.
    fn gradient(&self, row: &Row) -> Vec<f64> {
        let mut image = vec![0.0; 4 * self.n_bones()];
        for &(bone, weight) in row {
            for column in 0..4 {
                let factor = weight * self.u[column];
                let gram = self.gram.col_as_slice(4 * bone as usize + column);
                for (sum, value) in image.iter_mut().zip(gram) {
                    *sum += factor * value;
                }
            }
        }
        let blocks = image.as_chunks::<4>().0.iter().zip(&self.linear);
        let mut gradient: Vec<f64> = blocks.map(|(block, g)| dot(self.u, block) - g).collect();
        for &(bone, weight) in row {
            gradient[bone as usize] += self.ridge * weight;
        }
        gradient
    }

    /// The best weights of these bones that are not negative and sum to one, from feasible ones: an
    /// active set method. Bones without weight are dropped.
    pub fn on_simplex(&self, start: Row) -> Row {
        let bones: Vec<usize> = start.iter().map(|it| it.0 as usize).collect();
        let n = bones.len();
        if n == 1 {
            return vec![(start[0].0, 1.0)];
        }
        let mut h = DMatrix::zeros(n, n);
        for a in 0..n {
            for b in 0..=a {
                h[(a, b)] = self.entry(bones[a], bones[b]);
                h[(b, a)] = h[(a, b)];
            }
        }
        let g = DVector::from_fn(n, |it, _| self.linear[bones[it]]);
        let scale = (0..n).map(|it| h[(it, it)]).fold(f64::MIN_POSITIVE, f64::max);
        let mut w = DVector::from_fn(n, |it, _| start[it].1);
        let mut is_free = vec![true; n];
        for _ in 0..4 * n {
            let free: Vec<usize> = (0..n).filter(|&it| is_free[it]).collect();
            let Some(wanted) = equal_sum(&h, &g, &free, scale) else { break };
            // As far towards the wanted weights as none gets negative.
            let mut step = 1.0f64;
            let mut blocking = None;
            for (&it, &goal) in free.iter().zip(wanted.iter()) {
                if goal < 0.0 {
                    let reach = w[it] / (w[it] - goal);
                    if reach < step || blocking.is_none() {
                        (step, blocking) = (reach.min(step), Some(it));
                    }
                }
            }
            for (&it, &goal) in free.iter().zip(wanted.iter()) {
                w[it] += step * (goal - w[it]);
            }
            if let Some(it) = blocking {
                w[it] = 0.0;
                is_free[it] = false;
                continue;
            }
            let gradient = &h * &w - &g;
            let level: f64 = free.iter().map(|&it| w[it] * gradient[it]).sum();
            let fixed = (0..n).filter(|&it| !is_free[it]);
            let steepest = fixed.min_by(|&a, &b| gradient[a].total_cmp(&gradient[b]));
            match steepest.filter(|&it| gradient[it] < level - ZERO * scale) {
                Some(it) => is_free[it] = true,
                None => break,
            }
        }
        let mut row: Row = start.iter().zip(w.iter()).map(|(it, &weight)| (it.0, weight)).collect();
        row.retain(|it| it.1 > ZERO);
        let sum: f64 = row.iter().map(|it| it.1).sum();
        row.iter_mut().for_each(|it| it.1 /= sum);
        row
    }
}

/// Minimizes `w^T H w - 2 g^T w` for some weights that sum to one, of any sign.
fn equal_sum(
    h: &DMatrix<f64>,
    g: &DVector<f64>,
    free: &[usize],
    scale: f64,
) -> Option<DVector<f64>> {
    let n = free.len();
    let mut part = DMatrix::from_fn(n, n, |a, b| h[(free[a], free[b])]);
    for it in 0..n {
        // Bones that move alike here would make it singular.
        part[(it, it)] += 1e-11 * scale;
    }
    let factor = part.cholesky()?;
    let by_g = factor.solve(&DVector::from_fn(n, |it, _| g[free[it]]));
    let by_one = factor.solve(&DVector::from_element(n, 1.0));
    let multiplier = (1.0 - by_g.sum()) / by_one.sum();
    let wanted = by_g + by_one * multiplier;
    wanted.iter().all(|it| it.is_finite()).then_some(wanted)
}

pub fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}
