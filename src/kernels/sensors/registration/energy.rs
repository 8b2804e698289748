//! The registration energy and its normal equations.

use nalgebra::{Matrix3, SMatrix};
use rayon::prelude::*;

use super::correspond::Pair;
use super::graph::DeformationGraph;
use super::normal_matrix::{Block, Pattern, Six};
use super::warp::Motion;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::numerics::block_pattern::BlockPattern;

/// Factors of the terms.
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// Of the mean over samples.
    pub data: f64,
    pub smooth: f64,
    /// The share of point-to-plane distances; the rest is point-to-point.
    pub plane: f64,
    /// Where squares become linear (Huber 1964), in metres.
    pub huber: f64,
}

/// A surface at rest, or as it is before this step, with a graph that moves it.
pub struct Posed<'a> {
    pub graph: &'a DeformationGraph,
    /// Where the nodes are before the motion.
    pub nodes: &'a [Vec3],
    /// Where all vertices are before the motion.
    pub rest: &'a [Vec3],
    /// The vertices that carry data.
    pub samples: &'a [u32],
}

impl Posed<'_> {
    /// The samples' vertices and where they are after a motion.
    pub fn places(&self, motion: &Motion) -> Vec<(u32, Vec3)> {
        let place = |it: &u32| {
            let vertex = *it as usize;
            (*it, motion.point(self.nodes, &self.graph.skin[vertex], &self.rest[vertex]))
        };
        self.samples.par_iter().with_min_len(512).map(place).collect()
    }

    /// `sum data rho(...) / n + smooth / 2 sum w_ij |r_ij|^2`.
    pub fn energy(&self, motion: &Motion, pairs: &[Pair], terms: &Terms) -> f64 {
        let places = self.places(motion);
        let rho = |r: f64| match r.abs() <= terms.huber {
            true => 0.5 * r * r,
            false => terms.huber * (r.abs() - 0.5 * terms.huber),
        };
        let of_pair = |pair: &Pair| {
            let off = pair.point - places[pair.sample as usize].1;
            let (plane, point) = (rho(off.dot(&pair.normal)), rho(off.norm()));
            pair.weight * (terms.plane * plane + (1.0 - terms.plane) * point)
        };
        let data: f64 = pairs.iter().map(of_pair).sum();
        let smooth: f64 = (self.graph.edges.iter())
            .map(|&(i, j, weight)| weight * self.stretch(motion, i, j).1.norm_squared())
            .sum();
        terms.data / self.samples.len() as f64 * data + 0.5 * terms.smooth * smooth
    }

    /// `R_i (g_j - g_i)` and the residual `R_i (g_j - g_i) + g_i + t_i - g_j - t_j` of an edge.
    pub fn stretch(&self, motion: &Motion, i: u32, j: u32) -> (Vec3, Vec3) {
        let (i, j) = (i as usize, j as usize);
        let arm = motion.rotations[i] * (self.nodes[j] - self.nodes[i]);
        let from = self.nodes[i] + motion.translations[i];
        (arm, arm + from - self.nodes[j] - motion.translations[j])
    }

    /// The Gauss-Newton matrix and the negative gradient, with `R <- exp(w) R`:
    /// `d v / d w_j = -w_j [R_j (v - g_j)]_x`, `d v / d t_j = w_j I`.
    pub fn normal_equations(
        &self,
        pattern: &Pattern,
        motion: &Motion,
        pairs: &[Pair],
        terms: &Terms,
    ) -> (Vec<Block>, Vec<Six>) {
        let samples = self.sample_terms(motion, pairs, terms);
        let rows: Vec<(Vec<Block>, Six)> = (0..pattern.blocks.n_rows())
            .into_par_iter()
            .map(|row| self.data_row(pattern, motion, &samples, row))
            .collect();
        let mut blocks = Vec::with_capacity(pattern.blocks.columns().len());
        let mut b = Vec::with_capacity(rows.len());
        for (row, gradient) in rows {
            blocks.extend(row);
            b.push(gradient);
        }
        for row in 0..pattern.blocks.n_rows() {
            for place in pattern.blocks.row(row) {
                let column = pattern.blocks.columns()[place];
                if (column as usize) < row {
                    blocks[place] = blocks[pattern.blocks.place(column, row as u32)].transpose();
                }
            }
        }
        self.add_smoothness(&pattern.blocks, motion, terms.smooth, &mut blocks, &mut b);
        (blocks, b)
    }

    /// For each sample the 3 x 3 weight of its displacement and the pull on it.
    fn sample_terms(
        &self,
        motion: &Motion,
        pairs: &[Pair],
        terms: &Terms,
    ) -> Vec<(Matrix3<f64>, Vec3)> {
        let places = self.places(motion);
        let mut res = vec![(Matrix3::zeros(), Vec3::zeros()); self.samples.len()];
        let factor = terms.data / self.samples.len() as f64;
        let slope = |r: f64| if r.abs() <= terms.huber { 1.0 } else { terms.huber / r.abs() };
        for pair in pairs {
            let off = pair.point - places[pair.sample as usize].1;
            let plane = terms.plane * slope(off.dot(&pair.normal));
            let point = (1.0 - terms.plane) * slope(off.norm());
            let normal = pair.normal;
            let weight = (normal * normal.transpose() * plane + Matrix3::identity() * point)
                * (factor * pair.weight);
            let (sum, pull) = &mut res[pair.sample as usize];
            *sum += weight;
            *pull += weight * off;
        }
        res
    }

    /// The blocks of a row from its diagonal on, those before it left zero, and its pull.
    fn data_row(
        &self,
        pattern: &Pattern,
        motion: &Motion,
        samples: &[(Matrix3<f64>, Vec3)],
        row: usize,
    ) -> (Vec<Block>, Six) {
        let columns = &pattern.blocks.columns()[pattern.blocks.row(row)];
        let mut blocks = vec![Block::zeros(); columns.len()];
        let mut b = Six::zeros();
        for &(sample, place) in &pattern.samples[row] {
            let (weight, pull) = &samples[sample as usize];
            if *weight == Matrix3::zeros() {
                continue;
            }
            let vertex = self.samples[sample as usize] as usize;
            let skin = &self.graph.skin[vertex];
            let arm = |node: u32| {
                let node = node as usize;
                motion.rotations[node] * (self.rest[vertex] - self.nodes[node])
            };
            let own = arm(row as u32);
            let own_weight = skin[place as usize].1;
            // B^T h for B = [-[a]_x, I] is (a x h, h).
            let turn = own.cross(pull);
            b += Six::new(turn.x, turn.y, turn.z, pull.x, pull.y, pull.z) * own_weight;
            let from_row_on = skin.iter().filter(|it| it.1 > 0.0 && it.0 as usize >= row);
            for &(node, other_weight) in from_row_on {
                let at = columns.binary_search(&node).expect("nodes of a sample are joined");
                add_product(&mut blocks[at], &own, weight, &arm(node), own_weight * other_weight);
            }
        }
        (blocks, b)
    }

    fn add_smoothness(
        &self,
        pattern: &BlockPattern,
        motion: &Motion,
        smooth: f64,
        blocks: &mut [Block],
        b: &mut [Six],
    ) {
        for &(i, j, weight) in &self.graph.edges {
            let (arm, residual) = self.stretch(motion, i, j);
            let scaled = smooth * weight;
            let identity = Matrix3::identity() * scaled;
            add_product(&mut blocks[pattern.place(i, i)], &arm, &identity, &arm, 1.0);
            // The other end only shifts: B_j = [0, -I].
            let cross = arm.cross_matrix() * scaled;
            let (ij, ji) = (pattern.place(i, j), pattern.place(j, i));
            let mut corner = blocks[ij].fixed_view_mut::<3, 3>(0, 3);
            corner -= cross;
            let mut corner = blocks[ij].fixed_view_mut::<3, 3>(3, 3);
            corner -= identity;
            let mut corner = blocks[ji].fixed_view_mut::<3, 3>(3, 0);
            corner -= cross.transpose();
            let mut corner = blocks[ji].fixed_view_mut::<3, 3>(3, 3);
            corner -= identity;
            let mut corner = blocks[pattern.place(j, j)].fixed_view_mut::<3, 3>(3, 3);
            corner += identity;
            let turn = -arm.cross(&residual) * scaled;
            let shift = -residual * scaled;
            b[i as usize] += Six::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            b[j as usize] -= Six::new(0.0, 0.0, 0.0, shift.x, shift.y, shift.z);
        }
    }
}

/// `block += factor B_a^T W B_c` for `B_a = [-[a]_x, I]` and a symmetric `W`.
fn add_product(block: &mut Block, a: &Vec3, weight: &Matrix3<f64>, c: &Vec3, factor: f64) {
    let scaled = weight * factor;
    // -W [c]_x; and B_a^T puts [a]_x, the transpose of -[a]_x, before.
    let turned = -scaled * c.cross_matrix();
    let mut right: SMatrix<f64, 3, 6> = SMatrix::zeros();
    right.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
    right.fixed_view_mut::<3, 3>(0, 3).copy_from(&scaled);
    let top = a.cross_matrix() * right;
    let mut upper = block.fixed_view_mut::<3, 6>(0, 0);
    upper += top;
    let mut lower = block.fixed_view_mut::<3, 6>(3, 0);
    lower += right;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;
    use crate::kernels::numerics::random::Random;

    #[test]
    fn the_pull_is_the_negative_gradient_of_the_energy() {
        let grid = shapes::rectangle(12, 12, 1.0, 1.0);
        let may_hold = vec![true; grid.n_vertices()];
        let graph = DeformationGraph::new(grid.vertices(), grid.faces(), &may_hold, 0.3).unwrap();
        let samples: Vec<u32> = (0..grid.n_vertices() as u32).collect();
        let mut random = Random::new(7);
        let n_unknowns = 6 * graph.n_nodes();
        let mut numbers = |n: usize, size: f64| -> Vec<f64> {
            (0..n).map(|_| random.between(-size, size)).collect()
        };
        let motion = Motion::identity(graph.n_nodes()).stepped(&numbers(n_unknowns, 0.2));
        let pairs: Vec<Pair> = (samples.iter().step_by(2))
            .map(|&sample| {
                let off = numbers(6, 0.03);
                let point = grid.vertices()[sample as usize] + Vec3::new(off[0], off[1], off[2]);
                let normal = Vec3::new(off[3], off[4], off[5]).normalize();
                Pair { sample, point, normal, weight: 0.7 }
            })
            .collect();
        let terms = Terms { data: 1000.0, smooth: 10.0, plane: 0.9, huber: 0.02 };
        let posed =
            Posed { graph: &graph, nodes: &graph.nodes, rest: grid.vertices(), samples: &samples };
        let pattern = Pattern::new(&graph, &samples);
        let (blocks, b) = posed.normal_equations(&pattern, &motion, &pairs, &terms);
        let step = 1e-6;
        for unknown in 0..n_unknowns {
            let at = |amount: f64| {
                let mut change = vec![0.0; n_unknowns];
                change[unknown] = amount;
                posed.energy(&motion.stepped(&change), &pairs, &terms)
            };
            let slope = (at(step) - at(-step)) / (2.0 * step);
            let pull = b[unknown / 6][unknown % 6];
            assert!((slope + pull).abs() < 1e-5 * (1.0 + pull.abs()), "{unknown}: {slope} {pull}");
        }
        for row in 0..graph.n_nodes() as u32 {
            for place in pattern.blocks.row(row as usize) {
                let column = pattern.blocks.columns()[place];
                let mirrored = blocks[pattern.blocks.place(column, row)].transpose();
                assert!((blocks[place] - mirrored).norm() < 1e-9, "the matrix is symmetric");
            }
        }
    }
}
