//! Adam: the optimizer of the paper's demo, beside our exact solvers.

/// Options of [`minimize`]; the defaults are those of the demo.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamOptions {
    pub n_steps: usize,
    /// The step of a parameter whose gradient keeps its sign.
    pub learning_rate: f64,
    /// How much of the mean gradient is kept at every step.
    pub beta1: f64,
    /// How much of the mean squared gradient is kept at every step.
    pub beta2: f64,
    /// Added to the root of the mean squared gradient.
    pub epsilon: f64,
}

impl Default for AdamOptions {
    fn default() -> Self {
        Self { n_steps: 1000, learning_rate: 0.1, beta1: 0.9, beta2: 0.999, epsilon: 1e-7 }
    }
}

/// What [`minimize`] did.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamReport {
    /// The energy before every step, and after the last one.
    pub energies: Vec<f64>,
}

impl AdamReport {
    /// The energy at the point that is left in `x`.
    pub fn last(&self) -> f64 {
        *self.energies.last().expect("there is an energy after the last step")
    }
}

/// Takes `n_steps` steps of Adam from `x`, which becomes the last point.
///
/// Kingma & Ba 2015, algorithm 1, in double precision: steps along the mean gradient over the root of
/// the mean squared gradient, both freed of their bias to zero. `energy` writes the gradient at its
/// first argument into its second (which holds zeros before) and returns the energy. An entry whose
/// gradient stays zero does not move: a gradient with zeros holds parameters fixed.
///
/// The last point is not the best one: Adam overshoots, as the demo's does.
pub fn minimize(
    x: &mut [f64],
    options: &AdamOptions,
    mut energy: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> AdamReport {
    let mut adam = Adam::new(x.len(), options);
    let mut gradient = vec![0.0; x.len()];
    let mut energies = Vec::with_capacity(options.n_steps + 1);
    for _ in 0..options.n_steps {
        gradient.fill(0.0);
        energies.push(energy(x, &mut gradient));
        adam.step(&gradient, options.learning_rate, |entry, amount| x[entry] -= amount);
    }
    gradient.fill(0.0);
    energies.push(energy(x, &mut gradient));
    AdamReport { energies }
}

/// What Adam remembers of the gradients.
#[derive(Debug, Clone)]
pub struct Adam {
    beta1: f64,
    beta2: f64,
    epsilon: f64,
    means: Vec<f64>,
    squares: Vec<f64>,
    /// The powers of the betas: what is missing of the means that began at zero.
    missing: [f64; 2],
}

impl Adam {
    /// Remembers nothing yet of `n` entries; of the options the betas and epsilon count.
    pub fn new(n: usize, options: &AdamOptions) -> Self {
        let AdamOptions { beta1, beta2, epsilon, .. } = *options;
        let (means, squares) = (vec![0.0; n], vec![0.0; n]);
        Self { beta1, beta2, epsilon, means, squares, missing: [1.0, 1.0] }
    }

    /// Takes in a gradient and tells for every entry by how much it goes down.
    pub fn step(
        &mut self,
        gradient: &[f64],
        learning_rate: f64,
        mut subtract: impl FnMut(usize, f64),
    ) {
        let Self { beta1, beta2, epsilon, .. } = *self;
        self.missing[0] *= beta1;
        self.missing[1] *= beta2;
        let [missing1, missing2] = self.missing;
        let moments = self.means.iter_mut().zip(&mut self.squares);
        for (entry, (slope, (mean, square))) in gradient.iter().zip(moments).enumerate() {
            *mean += (1.0 - beta1) * (slope - *mean);
            *square += (1.0 - beta2) * (slope * slope - *square);
            let deviation = (*square / (1.0 - missing2)).sqrt();
            subtract(entry, learning_rate * (*mean / (1.0 - missing1)) / (deviation + epsilon));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `sum_i w_i (x_i - c_i)^2 / 2` with weights of many magnitudes.
    fn bowl(x: &[f64], gradient: &mut [f64]) -> f64 {
        let mut energy = 0.0;
        for (i, (x, slope)) in x.iter().zip(gradient).enumerate() {
            let (weight, center) = (10f64.powi(i as i32 - 2), i as f64 - 1.5);
            *slope = weight * (x - center);
            energy += 0.5 * weight * (x - center).powi(2);
        }
        energy
    }

    #[test]
    fn a_bowl_is_descended_whatever_the_scale_of_its_axes() {
        let mut x = vec![0.0; 5];
        let report = minimize(&mut x, &AdamOptions::default(), bowl);
        for (i, x) in x.iter().enumerate() {
            assert!((x - (i as f64 - 1.5)).abs() < 1e-2, "{i}: {x}");
        }
        assert_eq!(report.energies.len(), 1001);
        assert_eq!(report.last(), bowl(&x, &mut [0.0; 5]));
        assert!(report.last() < 1e-3 * report.energies[0], "{}", report.last());
    }

    /// The first step goes by the learning rate against the sign of the gradient, since both means
    /// are freed of their bias: `-lr g / (|g| + eps)`; the second by hand.
    #[test]
    fn the_first_two_steps_are_those_of_the_algorithm() {
        let at = |n_steps| {
            let mut x = vec![3.0];
            let options = AdamOptions { n_steps, ..Default::default() };
            minimize(&mut x, &options, |x, gradient| {
                gradient[0] = 2.0 * x[0];
                x[0] * x[0]
            });
            x[0]
        };
        let first = 3.0 - 0.1 * 6.0 / (6.0 + 1e-7);
        assert!((at(1) - first).abs() < 1e-15);
        let slope = 2.0 * first;
        let mean = (0.9 * 0.1 * 6.0 + 0.1 * slope) / (1.0 - 0.81);
        let square = (0.999 * 0.001 * 36.0 + 0.001 * slope * slope) / (1.0 - 0.999 * 0.999);
        let second = first - 0.1 * mean / (f64::sqrt(square) + 1e-7);
        assert!((at(2) - second).abs() < 1e-14);
    }

    #[test]
    fn entries_without_gradient_stay() {
        let mut x = vec![7.0, 1.0];
        minimize(&mut x, &AdamOptions::default(), |x, gradient| {
            gradient[1] = x[1];
            0.5 * x[1] * x[1]
        });
        assert_eq!(x[0], 7.0);
    }
}
