//! The energy of Transfer4D's paper: chamfer distance, smoothness, and steadiness over time.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::energy::Posed;
use super::warp::Motion;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;

/// Factors of the terms.
#[derive(Debug, Clone, Copy)]
pub struct ChamferTerms {
    /// Of the mean squared distances.
    pub data: f64,
    pub smooth: f64,
    /// Of the nodes' mean squared change of translation since the frame before.
    pub steady_translation: f64,
    /// Of the nodes' mean squared change of rotation matrix since the frame before, in squared metres.
    pub steady_rotation: f64,
    /// Squared distances from here on do not count.
    pub truncation: f64,
}

/// The points of a frame that the samples of a surface are drawn to, and where its nodes were.
pub struct ChamferTarget<'a> {
    pub points: &'a [Vec3],
    pub tree: &'a PointTree,
    pub before: &'a Motion,
}

/// The energy at a motion and its gradient, six numbers a node, for `R <- exp(w) R` and `t <- t + dt`.
///
/// `data (mean_s min_q |s - q|^2 + mean_q min_s |s - q|^2) + smooth sum w_ij |r_ij|^2 + ...`, where
/// squares above the truncation are zero, and the nearest points are held fixed for the gradient (it is
/// exact wherever they do not change).
pub fn chamfer_energy(
    posed: &Posed<'_>,
    target: &ChamferTarget<'_>,
    motion: &Motion,
    terms: &ChamferTerms,
    gradient: &mut [f64],
) -> f64 {
    let places: Vec<Vec3> = posed.places(motion).iter().map(|it| it.1).collect();
    let (data, pulls) = chamfer(&places, target, terms.truncation);
    for (vertex, pull) in posed.samples.iter().zip(&pulls) {
        let pull = pull * terms.data;
        let vertex = *vertex as usize;
        for &(node, weight) in posed.graph.skin[vertex].iter().filter(|it| it.1 > 0.0) {
            let node = node as usize;
            let arm = motion.rotations[node] * (posed.rest[vertex] - posed.nodes[node]);
            add(gradient, node, arm.cross(&pull) * weight, pull * weight);
        }
    }
    let smooth = smoothness(posed, motion, terms.smooth, gradient);
    let steady = steadiness(target.before, motion, terms, gradient);
    terms.data * data + smooth + steady
}

fn add(gradient: &mut [f64], node: usize, turn: Vec3, shift: Vec3) {
    let own = &mut gradient[6 * node..6 * node + 6];
    own.iter_mut().zip(turn.iter().chain(shift.iter())).for_each(|(sum, it)| *sum += it);
}

/// The truncated symmetric chamfer distance, and its gradient by every place.
fn chamfer(places: &[Vec3], target: &ChamferTarget<'_>, truncation: f64) -> (f64, Vec<Vec3>) {
    let tree = PointTree::new(places);
    let nearest = |tree: &PointTree, point: &Vec3| {
        let mut found = Vec::new();
        tree.nearest(*point, 1, &mut found);
        found.first().copied().filter(|it| it.0 < truncation)
    };
    let ahead: Vec<Option<(f64, u32)>> =
        places.par_iter().with_min_len(256).map(|it| nearest(target.tree, it)).collect();
    let back: Vec<Option<(f64, u32)>> =
        target.points.par_iter().with_min_len(256).map(|it| nearest(&tree, it)).collect();
    let (n_ahead, n_back) = (places.len().max(1) as f64, target.points.len().max(1) as f64);
    let mut pulls = vec![Vec3::zeros(); places.len()];
    let (mut sum_ahead, mut sum_back) = (0.0, 0.0);
    for (place, found) in ahead.iter().enumerate() {
        if let Some((square, point)) = found {
            sum_ahead += square;
            pulls[place] += (places[place] - target.points[*point as usize]) * (2.0 / n_ahead);
        }
    }
    for (point, found) in back.iter().enumerate() {
        if let Some((square, place)) = found {
            sum_back += square;
            let place = *place as usize;
            pulls[place] += (places[place] - target.points[point]) * (2.0 / n_back);
        }
    }
    (sum_ahead / n_ahead + sum_back / n_back, pulls)
}

fn smoothness(posed: &Posed<'_>, motion: &Motion, factor: f64, gradient: &mut [f64]) -> f64 {
    let mut sum = 0.0;
    for &(i, j, weight) in &posed.graph.edges {
        let (arm, residual) = posed.stretch(motion, i, j);
        sum += weight * residual.norm_squared();
        let shift = residual * (2.0 * factor * weight);
        add(gradient, i as usize, arm.cross(&shift), shift);
        add(gradient, j as usize, Vec3::zeros(), -shift);
    }
    factor * sum
}

fn steadiness(before: &Motion, motion: &Motion, terms: &ChamferTerms, gradient: &mut [f64]) -> f64 {
    let n = motion.translations.len().max(1) as f64;
    let (of_shift, of_turn) = (terms.steady_translation / n, terms.steady_rotation / n);
    if of_shift == 0.0 && of_turn == 0.0 {
        return 0.0;
    }
    let mut sum = 0.0;
    for node in 0..motion.translations.len() {
        let shift = motion.translations[node] - before.translations[node];
        let (now, then) = (motion.rotations[node].matrix(), before.rotations[node].matrix());
        sum += of_shift * shift.norm_squared() + of_turn * (now - then).norm_squared();
        // |exp(w) R - Q|^2 = 6 - 2 tr(exp(w) R Q^T), and tr([w]_x M) only sees what is odd in M.
        let odd = axial(&(now * then.transpose()));
        add(gradient, node, odd * (2.0 * of_turn), shift * (2.0 * of_shift));
    }
    sum
}

/// `a` with `tr([w]_x M) = -w . a`.
fn axial(m: &Matrix3<f64>) -> Vec3 {
    Vec3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;
    use crate::kernels::numerics::random::Random;
    use crate::kernels::sensors::registration::graph::DeformationGraph;

    /// The gradient of all terms against central differences.
    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let grid = shapes::rectangle(10, 10, 1.0, 1.0);
        let may_hold = vec![true; grid.n_vertices()];
        let graph = DeformationGraph::new(grid.vertices(), grid.faces(), &may_hold, 0.3).unwrap();
        let samples: Vec<u32> = (0..grid.n_vertices() as u32).step_by(2).collect();
        let mut random = Random::new(11);
        let n = 6 * graph.n_nodes();
        let mut numbers =
            |size: f64| -> Vec<f64> { (0..n).map(|_| random.between(-size, size)).collect() };
        let before = Motion::identity(graph.n_nodes()).stepped(&numbers(0.1));
        let motion = before.stepped(&numbers(0.1));
        let points: Vec<Vec3> = (grid.vertices().iter())
            .map(|it| it + Vec3::new(0.04, -0.03, 0.02 + 0.1 * it.x * it.y))
            .chain([Vec3::repeat(9.0)])
            .collect();
        let tree = PointTree::new(&points);
        let target = ChamferTarget { points: &points, tree: &tree, before: &before };
        let posed =
            Posed { graph: &graph, nodes: &graph.nodes, rest: grid.vertices(), samples: &samples };
        let all = ChamferTerms {
            data: 1000.0,
            smooth: 10.0,
            steady_translation: 2.0,
            steady_rotation: 1.5,
            truncation: 0.3,
        };
        let none = ChamferTerms {
            data: 0.0,
            smooth: 0.0,
            steady_translation: 0.0,
            steady_rotation: 0.0,
            ..all
        };
        let each = [
            ChamferTerms { data: 1000.0, ..none },
            ChamferTerms { smooth: 10.0, ..none },
            ChamferTerms { steady_translation: 2.0, ..none },
            ChamferTerms { steady_rotation: 1.5, ..none },
            all,
        ];
        for terms in each {
            let mut gradient = vec![0.0; n];
            let energy = chamfer_energy(&posed, &target, &motion, &terms, &mut gradient);
            assert!(energy > 0.0 && gradient.iter().any(|it| it.abs() > 1e-3));
            for unknown in 0..n {
                let at = |amount: f64| {
                    let mut change = vec![0.0; n];
                    change[unknown] = amount;
                    let moved = motion.stepped(&change);
                    chamfer_energy(&posed, &target, &moved, &terms, &mut vec![0.0; n])
                };
                let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
                let own = gradient[unknown];
                assert!((slope - own).abs() < 1e-5 * (1.0 + own.abs()), "{unknown}: {slope} {own}");
            }
        }
    }

    #[test]
    fn what_is_too_far_does_not_count() {
        let points = [Vec3::zeros(), Vec3::x() * 5.0];
        let tree = PointTree::new(&points);
        let before = Motion::identity(1);
        let target = ChamferTarget { points: &points, tree: &tree, before: &before };
        let places = [Vec3::y() * 0.5, Vec3::x() * 2.0];
        let (distance, pulls) = chamfer(&places, &target, 0.3);
        // Half of 0.25 either way.
        assert_eq!((distance, pulls[1]), (0.25, Vec3::zeros()));
        assert_eq!(pulls[0], Vec3::y());
        let (distance, _) = chamfer(&places, &target, 100.0);
        assert_eq!(distance, (0.25 + 4.0) / 2.0 + (0.25 + 9.0) / 2.0);
    }
}
