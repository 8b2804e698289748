//! Gauss-Newton steps on one level of a deformation graph.

use rayon::prelude::*;

use super::correspond::{Limits, Seen, source_to_target, target_to_source, visible};
use super::energy::{Posed, Terms};
use super::normal_matrix::{Pattern, solve};
use super::target::Target;
use super::warp::Motion;
use crate::kernels::geometry::mesh::Vec3;

/// What the steps of a level share.
pub struct Level<'a> {
    pub posed: Posed<'a>,
    pub pattern: &'a Pattern,
    pub faces: &'a [[u32; 3]],
    pub target: &'a Target,
    pub terms: Terms,
    /// The factor on pairs from the target to the source; none are sought if it is 0.
    pub reverse: f64,
    /// Relative decrease of the energy at which a level is done.
    pub tolerance: f64,
}

/// The first damping, relative to the diagonal (Levenberg 1944, Marquardt 1963).
const DAMPING: f64 = 1e-4;

/// How often a step that raises the energy is shortened.
const RETRIES: usize = 4;

/// The most target pixels that ask for a vertex.
const N_REVERSE: usize = 2000;

impl Level<'_> {
    /// Improves a motion; one outer iteration for each entry of `limits`. Returns how many were made.
    pub fn refine(&self, mut motion: Motion, limits: &[Limits]) -> (Motion, usize) {
        let vertices = self.vertices(&motion);
        let seen = Seen::new(self.target, &vertices, self.faces);
        let mut damping = DAMPING;
        for (iteration, limits) in limits.iter().enumerate() {
            let places = self.posed.places(&motion);
            let visible = visible(self.target, &seen, &places, limits);
            let mut pairs = source_to_target(self.target, &seen, &visible, limits);
            if self.reverse > 0.0 {
                let weight = self.reverse;
                let more =
                    target_to_source(self.target, &seen, &visible, limits, weight, N_REVERSE);
                pairs.extend(more.0);
            }
            let before = self.posed.energy(&motion, &pairs, &self.terms);
            let (blocks, b) =
                self.posed.normal_equations(self.pattern, &motion, &pairs, &self.terms);
            let mut decrease = 0.0;
            for _ in 0..RETRIES {
                let step = solve(&self.pattern.blocks, &blocks, &b, damping, 50, 1e-4);
                let flat: Vec<f64> = step.iter().flat_map(|it| it.iter().copied()).collect();
                let stepped = motion.stepped(&flat);
                let after = self.posed.energy(&stepped, &pairs, &self.terms);
                if after <= before && flat.iter().all(|it| it.is_finite()) {
                    decrease = before - after;
                    motion = stepped;
                    damping = (damping * 0.3).max(DAMPING);
                    break;
                }
                damping *= 10.0;
            }
            if !(decrease > self.tolerance * before) {
                return (motion, iteration + 1);
            }
        }
        (motion, limits.len())
    }

    fn vertices(&self, motion: &Motion) -> Vec<Vec3> {
        let posed = &self.posed;
        (posed.rest.par_iter().zip(&posed.graph.skin).with_min_len(1024))
            .map(|(point, skin)| motion.point(posed.nodes, skin, point))
            .collect()
    }
}
