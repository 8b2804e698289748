//! Which points of a cloud lie on the same sheet of its surface.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::mesh::Vec3;
use super::point_tree::PointTree;

/// The planes that touch a cloud at its points, for telling apart sheets that come near each other:
/// two fingers, an arm and the side of the body.
#[derive(Debug, Clone, PartialEq)]
pub struct CloudSheets {
    normals: Vec<Vec3>,
    /// How far points are from each other around every point.
    spacings: Vec<f64>,
}

/// The neighbours whose distance is the spacing.
const NEAR: usize = 6;

/// How far off each other's planes points of a sheet may lie, in spacings, beyond what the turn of the
/// normals explains: more than noise, less than the gap between sheets.
const THICK: f64 = 0.6;

impl CloudSheets {
    /// Fits a plane to every point and its nearest neighbours, which count less the farther they are
    /// (Hoppe et al. 1992, with the weights of Levin 2004 made compact).
    ///
    /// Normals have no side: their sign means nothing.
    pub fn new(points: &[Vec3], n_neighbors: usize) -> Self {
        let tree = PointTree::new(points);
        let fit = |index: usize| {
            let mut found = Vec::new();
            tree.nearest(points[index], n_neighbors + 1, &mut found);
            let radius = found.last().map_or(0.0, |it| it.0).sqrt() * 1.01;
            let near = found.get(NEAR).or(found.last()).map_or(0.0, |it| it.0).sqrt();
            (normal_of(points, &found, radius), near)
        };
        let (normals, spacings) = (0..points.len()).into_par_iter().map(fit).unzip();
        Self { normals, spacings }
    }

    /// Unit normals, of either sign.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Whether two points can lie on one sheet: neither is farther from the other's plane than the
    /// turn of the normals on the way, and some noise, explain.
    pub fn are_one(&self, points: &[Vec3], a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|it| it as usize);
        let chord = points[b] - points[a];
        let [n, m] = [a, b].map(|it| self.normals[it]);
        let off = n.dot(&chord).abs().max(m.dot(&chord).abs());
        // The chord of an arc is off the planes at its ends by the sine of half the turn.
        let half_turn = ((1.0 - n.dot(&m).abs().min(1.0)) * 0.5).sqrt();
        off <= chord.norm() * half_turn + THICK * self.spacings[a].min(self.spacings[b])
    }
}

fn normal_of(points: &[Vec3], found: &[(f64, u32)], radius: f64) -> Vec3 {
    let weight = |square: f64| (1.0 - square / (radius * radius)).max(0.0).powi(2);
    let (mut total, mut mean) = (0.0, Vec3::zeros());
    for &(square, index) in found {
        total += weight(square);
        mean += points[index as usize] * weight(square);
    }
    mean /= total.max(f64::MIN_POSITIVE);
    let spread = found.iter().fold(Matrix3::zeros(), |sum, &(square, index)| {
        let arm = (points[index as usize] - mean) / radius.max(f64::MIN_POSITIVE);
        sum + arm * arm.transpose() * weight(square)
    });
    let eigen = spread.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::numerics::random::Random;

    /// Two parallel sheets of points, a spacing apart along both axes.
    fn sheets(gap: f64, noise: f64) -> Vec<Vec3> {
        let mut random = Random::new(3);
        let side = |height: f64| (0..400).map(move |it| (it % 20, it / 20, height));
        let all = side(0.0).chain(side(gap));
        let shaken = all.map(|(x, y, z)| {
            let shift = Vec3::from_fn(|_, _| random.normal() * noise);
            Vec3::new(f64::from(x), f64::from(y), z) + shift
        });
        shaken.collect()
    }

    #[test]
    fn sheets_at_one_and_a_half_spacings_are_told_apart() {
        for (gap, noise) in [(1.5, 0.0), (1.5, 0.08), (2.0, 0.15)] {
            let points = sheets(gap, noise);
            let found = CloudSheets::new(&points, 12);
            let pairs = (0..400_u32).flat_map(|a| [a + 1, a + 20].map(|b| [a, b]));
            let own = pairs.clone().filter(|it| it[1] < 400 && it[1] % 20 != 0);
            let n_own = own.clone().count();
            let n_kept = own.filter(|it| found.are_one(&points, it[0], it[1])).count();
            assert!(n_kept as f64 > 0.97 * n_own as f64, "{n_kept} of {n_own}");
            // At the rim the nearest points of the other sheet are as many as those of the own.
            let is_inner = |it: &u32| (1..19).contains(&(it % 20)) && (1..19).contains(&(it / 20));
            let across = (0..400).filter(is_inner);
            let n_joined = across.filter(|&it| found.are_one(&points, it, it + 400)).count();
            assert!(n_joined < 7, "{n_joined} of 324 at {gap} and {noise}");
        }
    }
}
