//! Moving a surface by a deformation graph.

use nalgebra::{Matrix3, Rotation3};
use rayon::prelude::*;

use super::graph::{DeformationGraph, N_INFLUENCES};
use crate::kernels::geometry::{kabsch::best_rotation, mesh::Vec3};

/// A rotation and a translation for every node.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    pub rotations: Vec<Rotation3<f64>>,
    pub translations: Vec<Vec3>,
}

impl Motion {
    pub fn identity(n_nodes: usize) -> Self {
        Self {
            rotations: vec![Rotation3::identity(); n_nodes],
            translations: vec![Vec3::zeros(); n_nodes],
        }
    }

    /// Applies increments `(w, t)` of every node: `R <- exp(w) R`, `t <- t + dt`.
    pub fn stepped(&self, step: &[f64]) -> Self {
        let (six, _) = step.as_chunks::<6>();
        let turn = |(it, by): (&Rotation3<f64>, &[f64; 6])| {
            Rotation3::new(Vec3::new(by[0], by[1], by[2])) * it
        };
        let shift = |(it, by): (&Vec3, &[f64; 6])| it + Vec3::new(by[3], by[4], by[5]);
        Self {
            rotations: self.rotations.iter().zip(six).map(turn).collect(),
            translations: self.translations.iter().zip(six).map(shift).collect(),
        }
    }

    /// Where nodes get if they go on as they came from the motion before, each by a share of that way.
    pub fn ahead(&self, before: &Self, shares: &[f64]) -> Self {
        let turn = |node: usize| {
            let (now, before) = (self.rotations[node], before.rotations[node]);
            Rotation3::new((now * before.inverse()).scaled_axis() * shares[node]) * now
        };
        let shift = |node: usize| {
            let (now, before) = (self.translations[node], before.translations[node]);
            now + (now - before) * shares[node]
        };
        Self {
            rotations: (0..shares.len()).map(turn).collect(),
            translations: (0..shares.len()).map(shift).collect(),
        }
    }

    /// Where a point goes that nodes move:
    /// `sum_j w_j (R_j (v - g_j) + g_j + t_j)`.
    pub fn point(&self, nodes: &[Vec3], skin: &[(u32, f64); N_INFLUENCES], point: &Vec3) -> Vec3 {
        let mut res = Vec3::zeros();
        for &(node, weight) in skin.iter().filter(|it| it.1 > 0.0) {
            let node = node as usize;
            let place = nodes[node];
            let moved = self.rotations[node] * (point - place) + place + self.translations[node];
            res += moved * weight;
        }
        res
    }

    /// The rotation that is nearest to the weighted mean of the nodes' (Kabsch).
    pub fn rotation(&self, skin: &[(u32, f64); N_INFLUENCES]) -> Rotation3<f64> {
        let mut mean = Matrix3::zeros();
        for &(node, weight) in skin.iter().filter(|it| it.1 > 0.0) {
            mean += self.rotations[node as usize].matrix() * weight;
        }
        best_rotation(&mean).to_rotation_matrix()
    }
}

/// All vertices after a motion of the graph.
pub fn warp(graph: &DeformationGraph, rest: &[Vec3], motion: &Motion) -> Vec<Vec3> {
    (rest.par_iter().zip(&graph.skin).with_min_len(1024))
        .map(|(point, skin)| motion.point(&graph.nodes, skin, point))
        .collect()
}

/// The rigid motion `(R, t)` that brings points nearest to others: `R a + t ~ b` (Kabsch 1976).
///
/// Fewer than three points, or points on a line, get one of the equally good rotations.
pub fn fit_rigid(pairs: &[(Vec3, Vec3)]) -> (Rotation3<f64>, Vec3) {
    if pairs.is_empty() {
        return (Rotation3::identity(), Vec3::zeros());
    }
    let n = pairs.len() as f64;
    let from = pairs.iter().map(|it| it.0).sum::<Vec3>() / n;
    let to = pairs.iter().map(|it| it.1).sum::<Vec3>() / n;
    let covariance: Matrix3<f64> =
        pairs.iter().map(|(a, b)| (b - to) * (a - from).transpose()).sum();
    let rotation = best_rotation(&covariance).to_rotation_matrix();
    (rotation, to - rotation * from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::shapes;

    #[test]
    fn steady_motions_are_told_ahead() {
        let at = |time: f64| Motion {
            rotations: vec![Rotation3::new(Vec3::new(0.1, -0.2, 0.3) * time)],
            translations: vec![Vec3::new(1.0, 2.0, -0.5) * time],
        };
        let (found, expected) = (at(2.0).ahead(&at(1.0), &[1.0]), at(3.0));
        assert!((found.rotations[0].matrix() - expected.rotations[0].matrix()).norm() < 1e-12);
        assert!((found.translations[0] - expected.translations[0]).norm() < 1e-12);
        assert_eq!(at(2.0).ahead(&at(1.0), &[0.0]).translations, at(2.0).translations);
    }

    #[test]
    fn a_rigid_motion_of_all_nodes_is_rigid() {
        let grid = shapes::rectangle(20, 20, 1.0, 1.0);
        let may_hold = vec![true; grid.n_vertices()];
        let graph = DeformationGraph::new(grid.vertices(), grid.faces(), &may_hold, 0.15).unwrap();
        let rotation = Rotation3::new(Vec3::new(0.3, -0.5, 0.2));
        let shift = Vec3::new(0.1, 0.2, -0.4);
        let motion = Motion {
            rotations: vec![rotation; graph.n_nodes()],
            translations: graph.nodes.iter().map(|it| rotation * it + shift - it).collect(),
        };
        let warped = warp(&graph, grid.vertices(), &motion);
        let mut pairs = Vec::new();
        for (before, after) in grid.vertices().iter().zip(warped) {
            assert!((rotation * before + shift - after).norm() < 1e-12);
            pairs.push((*before, after));
        }
        let (found, by) = fit_rigid(&pairs);
        let off = (found.matrix() - rotation.matrix()).norm();
        assert!(off < 1e-7 && (by - shift).norm() < 1e-7, "{off}");
    }
}
