//! Transfer4D's own optimisation of a frame: Adam on the chamfer energy.

use super::chamfer::{ChamferTarget, ChamferTerms, chamfer_energy};
use super::energy::Posed;
use super::warp::Motion;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::point_tree::PointTree;
use crate::kernels::numerics::adam::{Adam, AdamOptions};
use crate::kernels::numerics::random::Random;

/// The paper's settings. Lengths are for a surface whose box has a diagonal of 2 m.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperOptions {
    /// Adam's steps in every frame.
    pub n_steps: usize,
    /// The first step, in radians and metres; every further one is `decay` times the one before.
    pub learning_rate: f64,
    pub decay: f64,
    /// The weight of smoothness against 1000 times the chamfer distance.
    pub smoothness: f64,
    /// The weight of the mean squared change of translations since the frame before.
    pub steady_translation: f64,
    /// The weight of the mean squared change of rotation matrices since the frame before.
    pub steady_rotation: f64,
    /// How many points of the surface are drawn, and how many of the frame.
    pub n_samples: usize,
    /// The squared distance from which pairs do not count.
    pub truncation: f64,
}

impl Default for PaperOptions {
    fn default() -> Self {
        Self {
            n_steps: 100,
            learning_rate: 0.06,
            decay: 0.999,
            smoothness: 10.0,
            steady_translation: 0.0,
            steady_rotation: 0.0,
            n_samples: 5000,
            truncation: 0.3,
        }
    }
}

/// Fits a motion to the points of a frame, from where it was in the frame before.
///
/// Works in units of `scale`, half the diagonal of the surface's box, in which the paper's step and
/// truncation are meant. `posed.samples` are all vertices that may be drawn; the same ones and the same
/// points are used in all steps of a frame.
pub fn fit_frame(
    posed: &Posed<'_>,
    measured: &[Vec3],
    before: &Motion,
    scale: f64,
    options: &PaperOptions,
    seed: u64,
) -> Motion {
    let mut random = Random::stream(seed, "paper");
    let samples = drawn(posed.samples, options.n_samples, &mut random);
    let points = drawn(measured, options.n_samples, &mut random);
    let tree = PointTree::new(&points);
    let target = ChamferTarget { points: &points, tree: &tree, before };
    let posed = Posed { samples: &samples, ..*posed };
    let terms = ChamferTerms {
        data: 1000.0,
        smooth: options.smoothness,
        steady_translation: options.steady_translation,
        steady_rotation: options.steady_rotation * scale * scale,
        truncation: options.truncation * scale * scale,
    };
    let n = 6 * before.translations.len();
    // PyTorch's epsilon.
    let mut adam = Adam::new(n, &AdamOptions { epsilon: 1e-8, ..AdamOptions::default() });
    let mut motion = before.clone();
    let mut gradient = vec![0.0; n];
    let mut step = vec![0.0; n];
    for index in 0..options.n_steps {
        gradient.fill(0.0);
        chamfer_energy(&posed, &target, &motion, &terms, &mut gradient);
        // By lengths in units of `scale`, and the energy in units of its square.
        let units = |entry: usize| if entry % 6 < 3 { 1.0 } else { scale };
        let energy = 1.0 / (scale * scale);
        gradient.iter_mut().enumerate().for_each(|(entry, it)| *it *= units(entry) * energy);
        let rate = options.learning_rate * options.decay.powi(index as i32);
        adam.step(&gradient, rate, |entry, amount| step[entry] = -amount * units(entry));
        motion = motion.stepped(&step);
    }
    motion
}

/// Some of the items, in their order; all if there are not more.
fn drawn<T: Copy>(items: &[T], most: usize, random: &mut Random) -> Vec<T> {
    if items.len() <= most {
        return items.to_vec();
    }
    let mut order: Vec<usize> = (0..items.len()).collect();
    random.shuffle(&mut order);
    order.truncate(most);
    order.sort_unstable();
    order.into_iter().map(|it| items[it]).collect()
}
